"""Measure the sensor on an NVIDIA GPU, against one core of the CPU, in one run.

    python benchmarks/bench_gpu.py [--size 1280] [--frames 161] [--runs 3]

The frames are those of bench_sensor.py. Times are wall-clock, the least of the runs, which take
turns; events are sorted and in host memory. "uploaded" has the frames in host memory, "there" on
the GPU, where a renderer or a network may have left them. One core has the first 65 frames,
in host memory; the last column is the speed over its own.
"""

from __future__ import annotations

import argparse
import math
import time

from bench_sensor import SCENES, moving_texture
from numba import cuda

from sensor import SensorModel, stream

_CORE_FRAMES = 65


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--size", type=int, default=1280, help="sensor and frame side in pixels")
    parser.add_argument("--frames", type=int, default=161, help="frames in the sequence")
    parser.add_argument("--runs", type=int, default=3, help="runs of each kind; the least counts")
    args = parser.parse_args()
    print(cuda.get_current_device().name)
    print("| scene | cutoff | events per pixel and frame | frames | M pixel-frames/s | of a core |")
    print("|---|---|---|---|---|---|")
    for scene, (shift_px, interval_s) in SCENES.items():
        frames = moving_texture(args.size, args.frames, shift_px)
        t_s = [k * interval_s for k in range(len(frames))]
        there = cuda.to_device(frames)
        for cutoff_hz in (math.inf, 200.0, 50.0):
            model = SensorModel(width=args.size, height=args.size, cutoff_hz=cutoff_hz)
            few = slice(0, _CORE_FRAMES)
            kinds = {
                "one core": (frames[few], t_s[few], {"threads": 1}),
                "uploaded": (frames, t_s, {"device": "cuda"}),
                "there": (there, t_s, {"device": "cuda"}),
            }
            rates = dict.fromkeys(kinds, 0.0)
            fired = dict.fromkeys(kinds, 0)
            for _ in range(args.runs + 1):  # the first one compiles
                for kind, (light, times, how) in kinds.items():
                    start = time.perf_counter()
                    fired[kind] = sum(map(len, stream(light, times, model, **how)))
                    seconds = time.perf_counter() - start
                    work = args.size**2 * (len(times) - 1)
                    rates[kind] = max(rates[kind], work / seconds)
            density = fired["there"] / (args.size**2 * (len(frames) - 1))
            for kind, rate in rates.items():
                print(
                    f"| {scene} | {cutoff_hz:g} Hz | {density:.3f} | {kind} "
                    f"| {rate / 1e6:.0f} | {rate / rates['one core']:.1f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
