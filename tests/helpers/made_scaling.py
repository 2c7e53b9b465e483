"""Scaling statistics with known modes and exponents."""

from __future__ import annotations

import numpy as np

from sensor.statistics import PowerLaw, log_bin_edges_us
from tasks.study.results.paper import CUTOFFS_HZ, WIDTHS
from tasks.study.results.scaling import Intervals, Scaling, Slopes

EDGES_US = log_bin_edges_us()


def slopes(exponent: float) -> Slopes:
    law = PowerLaw(exponent, exponent - 0.1, exponent + 0.1, 100.0)
    return Slopes(tuple(100.0 * p**-exponent for p in (1, 3, 9)), law)


def peak(mode_us: float) -> tuple[int, ...]:
    """Return counts with their mode in the bin of `mode_us`."""
    at = int(np.searchsorted(EDGES_US, mode_us, side="right")) - 1
    return tuple(max(1, 1000 - 50 * abs(k - at)) for k in range(len(EDGES_US) - 1))


def made(scene: str = "carpet", exponent: float = 0.9) -> Scaling:
    """Modes at 10 ms for 128 px, falling as 1 / width, at two speeds in three lights."""
    return Scaling(
        scene=scene,
        clip=0,
        sizes_px=(1, 3, 9),
        everywhere=slopes(exponent),
        edges=slopes(exponent + 0.4),
        edges_us=tuple(EDGES_US.tolist()),
        intervals=tuple(
            Intervals(width, cutoff, speed, peak(1.28e6 / width / speed), 0, 7)
            for cutoff in CUTOFFS_HZ
            for speed in (1.0, 2.0)
            for width in WIDTHS
        ),
    )
