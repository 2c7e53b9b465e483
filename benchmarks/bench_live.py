"""Measure `LiveCamera`: CPU time of a pushed frame, and of a frame of `stream`.

    python benchmarks/bench_live.py [--frames 60] [--runs 5] [--cutoff 200]

The texture of bench_sensor.py moves by 0.97 px per frame, with frames 1 ms apart, C = 0.2, one
thread. Each frame is pushed alone, and its events are dropped before the next. The bus is that of a
DAVIS346, 12 Mev/s with a FIFO of 4096 events, at all sizes. The time is user and system time, the
mean of all frames but the first; the kinds take turns, and the least of all runs counts.
"""

from __future__ import annotations

import argparse

import numpy as np
from bench_sensor import moving_texture
from process_times import times_now

from sensor import LiveCamera, Readout, SensorModel, stream

SIZES = (346, 260), (640, 480), (1280, 720)
BUS = Readout(max_rate_hz=12e6, fifo_depth=4096)


def pushed(
    frames: np.ndarray, t_s: np.ndarray, model: SensorModel, bus: Readout | None
) -> tuple[float, int]:
    """Return the CPU seconds of all pushes but the first, and their events."""
    with LiveCamera(model, readout=bus, threads=1) as live:
        live.push(frames[0], t_s[0])
        start = times_now()
        count = sum(len(live.push(*one)) for one in zip(frames[1:], t_s[1:], strict=True))
        return (times_now() - start).cpu_s, count


def streamed(frames: np.ndarray, t_s: np.ndarray, model: SensorModel) -> tuple[float, int]:
    """Return the CPU seconds of a stream, its start included, and its events."""
    start = times_now()
    count = sum(map(len, stream(frames, t_s, model, threads=1)))
    return (times_now() - start).cpu_s, count


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=60, help="frames in the sequence")
    parser.add_argument("--runs", type=int, default=5, help="runs of each kind; the least counts")
    parser.add_argument("--cutoff", type=float, default=200.0, help="cutoff, Hz; inf for no filter")
    args = parser.parse_args()
    print("| sensor | events per frame | push, ms | push with a bus, ms | `stream`, ms |")
    print("|---|---|---|---|---|")
    for width, height in SIZES:
        frames = moving_texture(width, args.frames, 0.97)[:, :height].copy()
        t_s = np.arange(len(frames)) * 1e-3
        model = SensorModel(width=width, height=height, cutoff_hz=args.cutoff)
        runs = [
            (
                pushed(frames, t_s, model, None),
                pushed(frames, t_s, model, BUS),
                streamed(frames, t_s, model),
            )
            for _ in range(args.runs + 1)
        ][1:]  # the first may compile
        events = runs[0][2][1] // (len(t_s) - 1)
        cells = [f"{1e3 * min(kind)[0] / (len(t_s) - 1):.2f}" for kind in zip(*runs, strict=True)]
        print(f"| {width}x{height} | {events} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
