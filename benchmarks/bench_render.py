"""The speed of rendering clips to disk, against rendering the same frames and writing nothing.

Run: python benchmarks/bench_render.py [SIDE_PX [SPP]]

Three ways to render the same poses of the baked carpet, turn by turn: `render_clip`, our renderer
without the writing, and a bare loop of Mitsuba's own `mi.render` with its path tracer at depth 1.
The figures are medians of the ratios of frame rates.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from eres_render import Clip, Renderer, load_scene, render_clip

_ROUNDS = 5
_WINDOW_S = 0.008  # at 0.5 px a frame: about 10 frames a round


def main() -> None:
    width, spp = (int(word) for word in (sys.argv[1:] + ["1280", "16"][len(sys.argv) - 1 :]))
    renderer = Renderer(load_scene("carpet"), width, spp)
    print(f"{width} px, {spp} spp, {renderer.variant}, white level {renderer.white_level:.3f}")

    import mitsuba as mi

    world, camera, integrator = renderer._world, renderer._sensor, renderer._tracer
    parameters = mi.traverse(camera)

    def mitsuba_frame(pose: np.ndarray) -> None:
        parameters["to_world"] = mi.ScalarTransform4f(pose.tolist())
        parameters.update()
        np.asarray(mi.render(world, sensor=camera, integrator=integrator, spp=spp, seed=0))

    rates: dict[str, list[float]] = {"render_clip": [], "without writing": [], "mi.render": []}
    mitsuba_frame(np.eye(4))  # compile
    with tempfile.TemporaryDirectory() as folder:
        for k in range(_ROUNDS):
            t_s = 0.7 + 0.5 * k
            clip = Clip(k, t_s, t_s, t_s + _WINDOW_S)
            start = time.perf_counter()
            sequence = render_clip(renderer, clip, Path(folder) / str(k), 0.5)
            rates["render_clip"].append(len(sequence) / (time.perf_counter() - start))

            start = time.perf_counter()
            for pose in sequence.T_world_cam:
                renderer.frame(pose)
            rates["without writing"].append(len(sequence) / (time.perf_counter() - start))

            # Mitsuba's camera looks along z with x to the left and y up.
            poses = sequence.T_world_cam @ np.diag([-1.0, -1.0, 1.0, 1.0])
            start = time.perf_counter()
            for pose in poses:
                mitsuba_frame(pose)
            rates["mi.render"].append(len(sequence) / (time.perf_counter() - start))

    samples = width**2 * spp / 1e6
    for name, rate in rates.items():
        best = max(rate)
        print(f"{name:16s} {best:6.2f} frames/s, {samples * best:6.1f} M samples/s (best)")
    for name in ("without writing", "mi.render"):
        ratios = [a / b for a, b in zip(rates["render_clip"], rates[name], strict=True)]
        print(f"render_clip / {name:16s} {statistics.median(ratios):.3f}")
    print("at least 0.85 of mi.render is wanted")


if __name__ == "__main__":
    main()
