"""Compare baked light that is looked up with a ray for every sample: time, radiance and events.

Run: python benchmarks/bench_look_up.py [--width PX] [--spp N] [--k1 K] [--threads N] [SCENE ...]

Renders the same poses along the path in turn with the integrators `baked-full` and `baked`, and
prints a Markdown table: the least CPU and wall time of a frame over the rounds, averaged over the
poses; how much of that CPU time is system time; the share of pixels that were looked up; and the
difference of log radiance: rms, largest, and the number of pixels per million where it exceeds
1e-3. Then come the events of an ideal sensor (C = 0.2) on 21 frames of each, with 0.5 px of motion
from frame to frame. With `--k1` all frames are seen through a lens with that first radial term and
the same corners of the view.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from process_times import Times, times_now

from eres_render import Camera, Distortion, Renderer, Scene, list_scenes, load_scene
from sensor import Events, SensorModel, simulate

_POSES, _ROUNDS, _FRAMES, _STEP_PX = 5, 5, 21, 0.5
_HEADS = (
    *("scene", "baked-full CPU, ms", "of it system", "baked CPU, ms", "of it system"),
    *("ratio", "wall ratio", "looked up"),
    *("log rms", "max", "> 1e-3, ppm", "events", "difference"),
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenes", nargs="*", default=list_scenes())
    parser.add_argument("--width", type=int, default=1280, help="side of the image, px")
    parser.add_argument("--spp", type=int, default=16, help="samples per pixel")
    parser.add_argument("--k1", type=float, default=0.0, help="first radial term of a lens")
    parser.add_argument("--threads", type=int, default=2, help="threads of Dr.Jit, 2 or more")
    chosen = parser.parse_args()
    import drjit as dr

    dr.set_thread_count(chosen.threads)
    print("| " + " | ".join(_HEADS) + " |\n" + "|---" * len(_HEADS) + "|")
    for name in chosen.scenes:
        cells = row(load_scene(name), chosen.width, chosen.spp, chosen.k1)
        print("| " + " | ".join(cells) + " |", flush=True)


def row(scene: Scene, width: int, spp: int, k1: float) -> list[str]:
    """Return the cells of one scene."""
    camera = through_lens(scene.camera(width), k1)
    full = Renderer(scene, spp=spp, integrator="baked-full", camera=camera)
    looked_up = Renderer(scene, spp=spp, integrator="baked", camera=camera)
    cost = np.zeros((_POSES, 2, 3))
    errors, shares = [], []
    times_s = np.linspace(0.05, 0.95, _POSES) * scene.duration_s
    for k, pose in enumerate(full.trajectory.pose(times_s)):
        looked_up.frame(pose)  # compile
        full.frame(pose)
        rounds = [(timed(full, pose), timed(looked_up, pose)) for _ in range(_ROUNDS)]
        for which, times in enumerate(zip(*rounds, strict=True)):
            least = min(times, key=lambda one: one.cpu_s)
            cost[k, which] = least.cpu_s, least.system_s, min(times).wall_s
        a, b = (one.frame(pose).astype(np.float64) for one in (looked_up, full))
        lit = (a > 0) & (b > 0)
        errors.append(np.where(lit, np.log(np.where(lit, a, 1) / np.where(lit, b, 1)), a != b))
        assert looked_up._look_up is not None
        shares.append(1 - looked_up._look_up.traced / width**2)
    error = np.stack(errors)
    counts = [len(events(one)) for one in (full, looked_up)]
    (full_cpu, full_system, full_wall), (cpu, system, wall) = 1e3 * cost.mean(0)
    return [
        *(scene.name, f"{full_cpu:.0f}", f"{full_system:.0f}", f"{cpu:.0f}", f"{system:.0f}"),
        *(f"{full_cpu / cpu:.2f}", f"{full_wall / wall:.2f}", f"{100 * np.mean(shares):.1f} %"),
        *(f"{np.sqrt(np.mean(error**2)):.1e}", f"{np.abs(error).max():.1e}"),
        f"{1e6 * np.mean(np.abs(error) > 1e-3):.2f}",
        *(f"{counts[0]:,}", f"{counts[1] / counts[0] - 1:+.1e}"),
    ]


def through_lens(camera: Camera, k1: float) -> Camera:
    """Return a camera whose lens has a radial term, and the same corners of the view."""
    lens = Distortion(k1=k1)
    corner = camera.rays(np.zeros(2))[:2]
    drawn_in = float(lens.distort(corner)[0] / corner[0])
    return Camera(camera.width, camera.height, fx=camera.fx / drawn_in, distortion=lens)


def timed(renderer: Renderer, pose: NDArray[np.float64]) -> Times:
    """Return the times of a frame."""
    start = times_now()
    renderer.frame(pose)
    return times_now() - start


def events(renderer: Renderer) -> Events:
    """Return the events of an ideal sensor on a few frames."""
    motion: Callable[[float, float], float] = renderer.image_motion
    start_s = 0.4 * renderer.scene.duration_s
    step_s = 1e-3 * _STEP_PX / motion(start_s, start_s + 1e-3)
    t_s = start_s + step_s * np.arange(_FRAMES)
    frames = np.stack([renderer.frame(pose) for pose in renderer.trajectory.pose(t_s)])
    side = frames.shape[1]
    return simulate(frames, t_s, SensorModel(width=side, height=side))


if __name__ == "__main__":
    main()
