"""Compare `simulate` with `stream`, and show what new memory costs.

    python benchmarks/bench_simulate.py [--scene "very dense"] [--frames 25] [--runs 4]

`simulate` returns all events at once, so it fills memory that `stream` uses again and again. The
first two rows are calls back to back. The others take turns, with a pause before each, in which the
host of a virtual machine takes freed memory back; filling new memory then costs several times as
much. User and system time in ns per pixel and frame, one thread, each the least of the runs by
their sum.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

from bench_sensor import SCENES, moving_texture
from process_times import Times, times_now

from sensor import SensorModel, simulate, stream

SIZE = 1280


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", choices=SCENES, default="very dense")
    parser.add_argument("--frames", type=int, default=25)
    parser.add_argument("--runs", type=int, default=4)
    parser.add_argument("--pause", type=float, default=6.0, help="seconds before some runs")
    args = parser.parse_args()
    shift_px, step_s = SCENES[args.scene]
    frames = moving_texture(SIZE, args.frames, shift_px)
    t_s = [k * step_s for k in range(len(frames))]
    model = SensorModel(width=SIZE, height=SIZE)

    def collected() -> int:
        return len(simulate(frames, t_s, model, threads=1))

    def in_parts() -> int:
        return sum(len(part) for part in stream(frames, t_s, model, threads=1))

    def spent(function: Callable[[], int], pause_s: float) -> Times:
        time.sleep(pause_s)
        start = times_now()
        function()
        return times_now() - start

    collected()  # compiles
    print(f"{in_parts() / frames[1:].size:.3f} events per pixel and frame")
    each = args.pause
    found = {
        "stream": [spent(in_parts, 0) for _ in range(args.runs)],
        "simulate": [spent(collected, 0) for _ in range(args.runs)],
        f"stream, {each:g} s later": [],
        f"simulate, {each:g} s later": [],
    }
    for _ in range(args.runs):
        found[f"stream, {each:g} s later"].append(spent(in_parts, each))
        found[f"simulate, {each:g} s later"].append(spent(collected, each))
    per_px = 1e9 / frames[1:].size
    print(f"{'':24}{'user':>8}{'system':>8}{'sum':>8}")
    for name, runs in found.items():
        least = min(runs, key=lambda one: one.cpu_s)
        user_s = least.cpu_s - least.system_s
        numbers = (per_px * one for one in (user_s, least.system_s, least.cpu_s))
        print(f"{name:24}" + "".join(f"{number:8.1f}" for number in numbers))


if __name__ == "__main__":
    main()
