"""Measure frames of 1280 px and 16 samples per pixel with one of Mitsuba's variants.

    ERES_VARIANT=cuda_ad_mono python benchmarks/bench_variants.py [SCENE ...]

It prints a Markdown table: wall-clock time of a frame in memory, the median of six after the first,
and million samples per second, for baked light as it is rendered by default, for baked light traced
through every sample, and for path tracing.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from eres_render import Renderer, list_scenes, load_scene
from eres_render.rendering.backend import select_variant

_WIDTH, _SPP, _FRAMES = 1280, 16, 7
_STEP_S = 0.002


def main() -> None:
    variant = select_variant()
    print(f"| scene | integrator | `{variant}`, ms per frame | M samples/s |\n|---|---|---|---|")
    for name in sys.argv[1:] or list_scenes():
        scene = load_scene(name)
        for integrator in ("baked", "baked-full", "path"):
            renderer = Renderer(scene, _WIDTH, _SPP, integrator=integrator)
            spent_s = []
            for k in range(_FRAMES):
                pose = renderer.trajectory.pose(0.7 + _STEP_S * k)
                start = time.perf_counter()
                renderer.frame(pose)
                spent_s.append(time.perf_counter() - start)
            seconds = float(np.median(spent_s[1:]))
            rate = _WIDTH**2 * _SPP / seconds / 1e6
            print(f"| {name} | {integrator} | {1e3 * seconds:.1f} | {rate:.0f} |", flush=True)


if __name__ == "__main__":
    main()
