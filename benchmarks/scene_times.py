"""Measure the times of scenes: textures, loading, baking, and frames on their way to a sensor.

    python benchmarks/scene_times.py [--bake] [SCENE ...]

Each scene has a process and an empty cache of its own, with compiled kernels. It prints a Markdown
table: CPU and wall time to make the textures; wall time to load the scene with its textures and
lightmaps, and the peak memory until then; CPU time of a frame of 1280 px and 16 samples per pixel
that `clip_in_progress` renders and gives to a sensor, and that it reads from the cache, the least
of three clips; with `--bake`, CPU and wall time to make the lightmaps.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from process_times import Times, times_now

_WIDTH, _SPP, _STEP_PX = 1280, 16, 0.5
_CLIPS = 3
_WINDOW_S = 0.015  # about 17 frames
_HEADS = (
    *("scene", "textures CPU, s", "wall, s", "loading, s", "peak, GB"),
    *("rendered frame CPU, ms", "cached, ms", "baking CPU, s", "wall, s"),
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenes", nargs="*", default=["carpet", "rocks", "room"])
    parser.add_argument("--bake", action="store_true", help="make the lightmaps, too; minutes")
    parser.add_argument("--alone", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.alone:
        print("| " + " | ".join(row(chosen.scenes[0], bake=chosen.bake)) + " |", flush=True)
        return
    print("| " + " | ".join(_HEADS) + " |\n" + "|---" * len(_HEADS) + "|", flush=True)
    for name in chosen.scenes:
        for compiled in (False, True):
            with tempfile.TemporaryDirectory() as cache:
                command = [sys.executable, __file__, "--alone", name]
                command += ["--bake"] if chosen.bake and compiled else []
                output = None if compiled else subprocess.DEVNULL
                environment = os.environ | {"ERES_CACHE": cache}
                subprocess.run(command, check=True, stdout=output, env=environment)


def row(name: str, *, bake: bool) -> list[str]:
    """Return the cells of one scene, measured in this process."""
    from eres_render import Clip, Renderer, clip_in_progress, load_scene
    from eres_render.rendering.backend import select_variant
    from eres_render.rendering.irradiance import irradiance_maps

    select_variant()
    start = times_now()
    scene = load_scene(name)
    scene.texture_files()
    textures = times_now() - start
    start = times_now()
    renderer = Renderer(scene, _WIDTH, _SPP)
    loading = times_now() - start
    peak_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    renderer.frame(renderer.trajectory.pose(0.5))  # compile
    _ = renderer.white_level  # once a scene

    def frame_s(clip: Clip, folder: Path) -> float:
        start = times_now()
        with clip_in_progress(renderer, clip, folder, _STEP_PX) as frames:
            for _ in frames:
                pass
        return (times_now() - start).cpu_s / len(frames)

    with tempfile.TemporaryDirectory() as folder:
        clips = [Clip(k, 2.0 + k, 2.0 + k, 2.0 + k + _WINDOW_S) for k in range(_CLIPS)]
        rendered, cached = (
            min(frame_s(clip, Path(folder) / str(clip.index)) for clip in clips) for _ in range(2)
        )
    baking = None
    if bake:
        start = times_now()
        irradiance_maps(scene, scene.settings.bake.cell_m, scene.settings.bake.spp)
        baking = times_now() - start
    return [
        *(name, f"{textures.cpu_s:.1f}", f"{textures.wall_s:.1f}"),
        *(f"{loading.wall_s:.1f}", f"{peak_gb:.1f}"),
        *(f"{1e3 * rendered:.0f}", f"{1e3 * cached:.1f}", *_baked(baking)),
    ]


def _baked(times: Times | None) -> tuple[str, str]:
    return ("–", "–") if times is None else (f"{times.cpu_s:.0f}", f"{times.wall_s:.0f}")


if __name__ == "__main__":
    main()
