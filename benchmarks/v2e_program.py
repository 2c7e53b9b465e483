"""Compare `sensor.emulators.v2e` with the program v2e, event for event.

    python benchmarks/v2e_program.py [--trials 60] [--seed 0]

Needs v2e (https://github.com/SensorsINI/v2e, tried at cac6384): `pip install -e` of a clone, or its
folder on PYTHONPATH, and PyTorch. Random frames, thresholds, cutoffs and refractory periods; the
noise of the program is off. Prints how many events differ in pixel, polarity or by more than a
microsecond, and how many by one.
"""

from __future__ import annotations

import argparse
import logging
import math

import numpy as np
from numpy.typing import NDArray
from v2ecore.emulator import EventEmulator

from sensor.emulators import v2e


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--trials", type=int, default=60, help="(default: 60)")
    parser.add_argument("--seed", type=int, default=0, help="(default: 0)")
    options = parser.parse_args()
    logging.disable(logging.WARNING)  # of clamped steps and of frames without events
    rng = np.random.default_rng(options.seed)
    events = differing = late = 0
    for _ in range(options.trials):
        frames, t_s = random_frames(rng)
        C, C_off = rng.uniform(0.05, 0.4, 2)
        cutoff_hz = float(rng.choice([math.inf, 13, 50, 200, 1000]))
        refractory_s = float(rng.choice([0, 0, 5e-4, 3e-3]))
        program = EventEmulator(
            pos_thres=C,
            neg_thres=C_off,
            sigma_thres=0.0,
            cutoff_hz=cutoff_hz if cutoff_hz < math.inf else 0.0,
            leak_rate_hz=0.0,
            refractory_period_s=refractory_s,
            shot_noise_rate_hz=0.0,
            device="cpu",
        )
        found = [program.generate_events(*one) for one in zip(frames, t_s.tolist(), strict=True)]
        theirs = np.concatenate([np.empty((0, 4)), *(one for one in found if one is not None)])
        theirs[:, 0] = np.rint(1e6 * theirs[:, 0])
        ours = v2e(
            frames, t_s, contrast_threshold=C, contrast_threshold_off=C_off, cutoff_hz=cutoff_hz,
            refractory_s=refractory_s,
        )  # fmt: skip
        mine = np.column_stack([ours.t_us, ours.x, ours.y, ours.p])
        events += len(theirs)
        mine, theirs = in_order(mine), in_order(theirs)
        if mine.shape != theirs.shape or np.any(mine[:, 1:] != theirs[:, 1:]):
            differing += max(len(mine), len(theirs))
            continue
        apart_us = np.abs(mine[:, 0] - theirs[:, 0])
        differing += int(np.sum(apart_us > 1))
        late += int(np.sum(apart_us == 1))
    print(f"{events} events in {options.trials} runs: {differing} differ, {late} by a microsecond")


def random_frames(
    rng: np.random.Generator,
) -> tuple[list[NDArray[np.generic]], NDArray[np.float64]]:
    """Return frames that wander, of 8 bits, float32 or float64, and their times."""
    shape, count = rng.integers(1, 30, 2), int(rng.integers(2, 40))
    t_s = np.cumsum(rng.uniform(2e-4, 1e-2, count))
    if rng.random() < 0.7:
        t_s -= t_s[0]
    change = np.cumsum(rng.normal(0, 0.15, (count, *shape)), axis=0)
    light = rng.uniform(0, 255, shape) * np.exp(change)
    kind = rng.integers(3)
    if kind == 0:
        return list(np.clip(np.round(light), 0, 255).astype(np.uint8)), t_s
    return list(light.astype(np.float32 if kind == 1 else np.float64)), t_s


def in_order(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sort rows of time, column, row, polarity: the program shuffles events of one time."""
    return rows[np.lexsort((rows[:, 1], rows[:, 2], rows[:, 0]))]


if __name__ == "__main__":
    main()
