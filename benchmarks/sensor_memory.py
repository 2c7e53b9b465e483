"""Measure how much a simulation adds to peak memory (VmHWM), MiB, including its chunk of frames.

    for run in "inf 96 1" "200 48 2" "bank 16 2" "simulate 96 1"; do
        python benchmarks/sensor_memory.py $run
    done

The arguments are a cutoff in Hz for `stream`, "bank" for the nine settings of bench_sensor.py, or
"simulate" for an ideal pixel; frames; threads. Frames of 1280x1280 px, dense, come from a
generator that runs back and forth over twelve frames.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from bench_sensor import moving_texture
from numpy.typing import NDArray

from sensor import SensorModel, simulate, stream, stream_bank

_SIZE = 1280


def peak_mib() -> float:
    """Return the most memory that this process has had since the last reset, MiB."""
    status = Path("/proc/self/status").read_text()
    return int(re.findall(r"VmHWM:\s+(\d+)", status)[0]) / 1024


def model(cutoff_hz: float, size: int = _SIZE) -> SensorModel:
    """Return a square sensor with a cutoff."""
    return SensorModel(width=size, height=size, cutoff_hz=cutoff_hz)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("kind", help="cutoff in Hz, inf, bank or simulate")
    parser.add_argument("frames", type=int)
    parser.add_argument("threads", type=int)
    args = parser.parse_args()
    views = moving_texture(_SIZE, 12, 0.97)
    t_s = np.arange(args.frames) * 1e-3

    def frames() -> Iterator[NDArray[np.float32]]:
        for k in range(args.frames):
            yield views[11 - abs(11 - k % 22)].copy()

    for cutoff_hz in (math.inf, 200.0):  # load the kernels first
        simulate(views[:2, :32, :32], t_s[:2], model(cutoff_hz, 32))
    Path("/proc/self/clear_refs").write_text("5")  # resets VmHWM
    before = peak_mib()
    if args.kind == "simulate":
        fired = len(simulate(frames(), t_s, model(math.inf), threads=args.threads))
    elif args.kind == "bank":
        models = [model(cutoff_hz) for cutoff_hz in (math.inf, 200.0, 50.0) for _ in range(3)]
        parts = stream_bank(
            frames(), t_s, models, speeds=[1.0, 4 / 3, 2.0] * 3, threads=args.threads
        )
        fired = sum(len(events) for _, events in parts)
    else:
        parts_of_one = stream(frames(), t_s, model(float(args.kind)), threads=args.threads)
        fired = sum(map(len, parts_of_one))
    print(
        f"{args.kind}, {args.frames} frames, {args.threads} threads: "
        f"{peak_mib() - before:.0f} MiB, {fired / 1e6:.1f} M events"
    )


if __name__ == "__main__":
    main()
