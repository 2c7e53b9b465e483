"""Measure the steps of the sensor's kernels on some blocks of pixels, on one thread.

    python benchmarks/sensor_steps.py [--cutoff 200] [--shift 0.97] [--size 1280]

The texture of bench_sensor.py moves by `--shift` px per frame, with frames 1 ms apart and C = 0.2.
A sensor sees eight frame intervals; each step of the ninth then runs 300 times on five blocks of
pixels. The least CPU time of 5 runs is printed in ns per pixel and frame, and per event; the system
time is their mean. Events include 0.3 ns per pixel to restore the comparators' memory; the branch
predictor learns what repeats, so they cost a little more in a real run.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from typing import Any

import numba
import numpy as np
from bench_sensor import moving_texture
from numpy.typing import NDArray
from process_times import times_now

from sensor import SensorModel
from sensor.engine.group import _BLOCK_PX, SensorGroup
from sensor.engine.sorting import room_for_events
from sensor.engine.workers import Workers
from sensor.kernels import comparator, packing, photoreceptor, radiance, silence
from sensor.kernels.advance import Block, room_for_block

INTERVAL_S, BEFORE, TIMES, RUNS, C = 1e-3, 8, 300, 5, 0.2
CLOCK = packing.Interval(INTERVAL_S, 0.0, 0.0, round(INTERVAL_S * 1e6))


@numba.njit
def fire_lines(flagged, lights, dark, before, block, alike):
    """Take the logarithms of the flagged ideal pixels and fire their events."""
    block.comparators.memory[:] = before
    u0, u1 = block.lines[0, : flagged.size], block.lines[1, : flagged.size]
    light = radiance.Light(lights, np.empty((0, 0)), dark)
    radiance.log_of_flagged(flagged, light, 0, slice(0, lights.shape[1]), block.light, u0)
    radiance.log_of_flagged(flagged, light, 1, slice(0, lights.shape[1]), block.light, u1)
    lines = comparator.Lines(u0, u1, 0.0, 0.0)
    return comparator.events_of_lines(
        flagged, lines, block.comparators, block.light_band, alike, block.work, 0
    )


@numba.njit
def fire_curves(flagged, response, x, before, block):
    """Fire the events of the flagged filtered pixels."""
    block.comparators.memory[:] = before
    for k in range(flagged.size):
        block.work.curve[comparator.WHOLE, k] = x
    return comparator.events_of_curves(flagged, response, CLOCK, block.comparators, block.work, 0)


class Steps:
    """Steps with their CPU time, added up over the blocks."""

    def __init__(self) -> None:
        self.loops: dict[str, Any] = {}
        self.ns: Counter[str] = Counter()
        self.system_ns: Counter[str] = Counter()

    def run(self, name: str, kernel: Any, *args: Any) -> Any:
        """Measure a step and return its result."""
        if name not in self.loops:

            @numba.njit
            def loop(args):
                result = kernel(*args)
                for _ in range(TIMES - 1):
                    result = kernel(*args)
                return result

            self.loops[name] = loop
        result, least_s = self.loops[name](args), math.inf
        for _ in range(RUNS):
            start = times_now()
            self.loops[name](args)
            spent = times_now() - start
            least_s = min(least_s, spent.cpu_s)
            self.system_ns[name] += spent.system_s / (RUNS * TIMES) * 1e9
        self.ns[name] += least_s / TIMES * 1e9
        return result


def ideal_steps(
    steps: Steps, block: Block, lights: NDArray[np.float32], model: SensorModel
) -> tuple[int, int]:
    """Measure the steps of ideal pixels; return the number of events and of flagged pixels."""
    n, dark, before = lights.shape[1], model.dark_level, block.comparators.memory.copy()
    band, flag = block.light_band, block.flag
    steps.run("light band, once a chunk", silence.set_light_band, n, block.comparators, band)
    one = np.float32(1.0)
    steps.run("flag", silence.flag_outside, lights[1], np.float32(dark), one, band, flag)
    count = steps.run("list the flagged", silence.list_flagged, flag, n, block.flagged)
    clock = ([[value]] for value in CLOCK)
    dt_s, _, start_us, length_us = (np.array(value)[0] for value in clock)
    alike = comparator.Alike(
        0, np.zeros(1, int), dt_s, start_us, length_us, np.zeros((1, 2), np.int64)
    )
    args = block.flagged[:count], lights, dark, before, block, alike
    return steps.run("logarithms and events of the flagged", fire_lines, *args), count


def filtered_steps(
    steps: Steps,
    block: Block,
    lights: NDArray[np.float32],
    model: SensorModel,
    state: tuple[NDArray[np.float64], ...],
) -> tuple[int, int]:
    """Measure the steps of filtered pixels; `state` is u, v1 and v2 at the start."""
    n, before = lights.shape[1], block.comparators.memory.copy()
    u1, v1_end, v2_end = np.empty((3, n))
    steps.run("logarithm", radiance.log_intensity, lights[1], model.dark_level, u1)
    u0, v1, v2 = (array.copy() for array in state)
    response = photoreceptor.Response(u0, u1, v1, v2, v1_end, v2_end, float(model.poles))
    step = photoreceptor.photoreceptor_step(INTERVAL_S, model.cutoff_hz, model.poles)
    row = np.array([step], photoreceptor.STEP)[0]
    if step.x < silence.CHORD_STEP:
        kernel = silence.flag_by_chord
    else:
        kernel = silence.flag_by_cubic if step.x < silence.CUBIC_STEP else silence.flag_by_all
    args = n, response, row, 0.0, block.comparators, block.flag
    steps.run(f"poles, flag ({kernel.__name__})", kernel, *args)
    count = steps.run("list the flagged", silence.list_flagged, block.flag, n, block.flagged)
    args = block.flagged[:count], response, step.x, before, block
    return steps.run("events of the flagged", fire_curves, *args), count


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--cutoff", type=float, default=200.0, help="cutoff, Hz; inf for no filter")
    parser.add_argument("--shift", type=float, default=0.97, help="motion, px per frame")
    parser.add_argument("--size", type=int, default=1280, help="sensor and frame side in pixels")
    asked = parser.parse_args()
    size = asked.size
    frames = moving_texture(size, BEFORE + 2, asked.shift)
    dark = 1e-3 * float(np.percentile(frames[0], 99.9))
    model = SensorModel(
        width=size, height=size, contrast_threshold=C, cutoff_hz=asked.cutoff, dark_level=dark
    )
    group = SensorGroup.start([0], [model], [1.0], frames[0], 0, 0)
    rooms = [lambda events, _: room_for_events(events)]
    steps, fired, flagged, measured = Steps(), 0, 0, 0
    with Workers(1) as workers:
        chunk, t_s = frames[1:-1], np.arange(BEFORE + 1) * INTERVAL_S
        for _ in group.advance(chunk, 1, t_s, rooms, workers):
            pass
        block = room_for_block(1, _BLOCK_PX, True, workers.pools[0])
        for start in np.linspace(0.1, 0.8, 5) * (size * size - _BLOCK_PX):
            pixels = slice(int(start), int(start) + _BLOCK_PX)
            block.comparators.C_on[:] = block.comparators.C_off[:] = C
            block.comparators.memory[:] = group.state.memory[0, pixels]
            packing.place(pixels.start, size, block.work.position)
            block.flag[:] = False
            lights = frames[-2:].reshape(2, -1)[:, pixels].copy()
            if math.isinf(asked.cutoff):
                events, count = ideal_steps(steps, block, lights, model)
            else:
                state = group.state.u, group.state.v1[0], group.state.v2[0]
                start_of_block = tuple(array[pixels] for array in state)
                events, count = filtered_steps(steps, block, lights, model, start_of_block)
            fired, flagged, measured = fired + events, flagged + count, measured + _BLOCK_PX
    print(f"{fired / measured:.3f} events and {flagged / measured:.3f} flagged a pixel and frame")
    print("| step | ns a pixel and frame | system | ns an event |\n|---|---|---|---|")
    for name, ns in steps.ns.items():
        system = steps.system_ns[name] / measured
        print(f"| {name} | {ns / measured:.2f} | {system:.2f} | {ns / max(fired, 1):.1f} |")


if __name__ == "__main__":
    main()
