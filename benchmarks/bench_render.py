"""Measure the rendering of clips to disk, against a bare loop of Mitsuba's own `mi.render`.

    python benchmarks/bench_render.py [SCENE ...]

Each round renders the same poses of a baked scene twice, at 1280 px and 16 samples per pixel: with
`render_clip`, which also finds the frame times and writes EXR frames, poses and checksums, and with
`mi.render` and the path tracer at depth 1, which writes nothing. It prints a Markdown table of
medians over the rounds: M samples/s, and the ratio within a round, which should be at least 0.85;
then user and system time of both, in ns per sample.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from process_times import times_now

from eres_render import Clip, Renderer, list_scenes, load_scene, render_clip

_WIDTH, _SPP = 1280, 16
_ROUNDS = 5
_WINDOW_S = 0.008  # at 0.5 px per frame: about 10 frames per round


def main() -> None:
    print(
        "| scene | `render_clip` with EXR, M samples/s | `mi.render`, M samples/s | ratio "
        "| user + system, ns | `mi.render`'s |\n|---|---|---|---|---|---|"
    )
    for name in sys.argv[1:] or list_scenes():
        ours, bare = ns_per_sample(Renderer(load_scene(name), _WIDTH, _SPP))
        ratio = np.median(bare[:, 0] / ours[:, 0])
        medians = [np.median(times, axis=0) for times in (ours, bare)]
        cells = [f"{1e3 / wall:.1f}" for wall, _, _ in medians]
        cells += [f"{ratio:.2f}", *(f"{user:.1f} + {system:.1f}" for _, user, system in medians)]
        print(f"| {name} | " + " | ".join(cells) + " |")


def ns_per_sample(renderer: Renderer) -> tuple[np.ndarray, np.ndarray]:
    """Return the times of `render_clip` and of `mi.render`: wall, user and system by round."""
    import mitsuba as mi

    mi_scene, camera, integrator = renderer._mi_scene, renderer._sensor, renderer._tracer
    parameters = mi.traverse(camera)
    # Mitsuba's camera looks along z with x to the left and y up.
    from_mitsuba = np.diag([-1.0, -1.0, 1.0, 1.0])

    def mitsuba_frame(pose: np.ndarray) -> None:
        parameters["to_world"] = mi.ScalarTransform4f((pose @ from_mitsuba).tolist())
        parameters.update()
        np.asarray(mi.render(mi_scene, sensor=camera, integrator=integrator, spp=_SPP, seed=0))

    pose = renderer.trajectory.pose(0.0)
    mitsuba_frame(pose)  # compile
    renderer.frame(pose)
    _ = renderer.white_level  # once per scene, not once per clip
    ours, bare = [], []
    with tempfile.TemporaryDirectory() as folder:
        for k in range(_ROUNDS):
            t_s = 0.7 + 1.7 * k
            clip = Clip(k, t_s, t_s, t_s + _WINDOW_S)
            start = times_now()
            sequence = render_clip(renderer, clip, Path(folder) / str(k), 0.5)
            samples = len(sequence) * _WIDTH**2 * _SPP
            ours.append(1e9 / samples * np.array(times_now() - start))
            start = times_now()
            for pose in sequence.T_world_cam:
                mitsuba_frame(pose)
            bare.append(1e9 / samples * np.array(times_now() - start))
    return np.array(ours), np.array(bare)


if __name__ == "__main__":
    main()
