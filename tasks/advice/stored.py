"""Scored windows of stored runs: the cases of the lag law, and a table of them in the package."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from itertools import pairwise
from statistics import median
from typing import NamedTuple

from tasks.advice.law import lag_px

TABLE = "stored.json"
"""The table in this package; `python benchmarks/lag_law.py --write` writes it."""


@dataclass(frozen=True, slots=True)
class Case:
    """Two neighboring widths in one window."""

    run: str
    scene: str
    samples: int  # 1, or how many it is the median of
    cutoff_hz: float
    speed: float  # factor on the base speed
    width: int  # px, of the finer one
    coarser: int  # px
    lag_px: float  # of the finer one
    margin_db: float  # PSNR of the finer minus that of the coarser

    @property
    def finer_won(self) -> bool:
        """Whether the finer one has the better image."""
        return self.margin_db > 0


class Window(NamedTuple):
    """One window in one light at one speed, seen by sensors of all widths with equal pixels."""

    run: str
    scene: str
    sample: int
    cutoff_hz: float  # inf for ideal pixels
    speed: float  # factor on the base speed
    speed_px_s: float  # of the image, px/s of the widest sensor
    widths: tuple[int, ...]  # px, ascending
    psnr_db: tuple[float, ...]  # of event integration, by width
    events_per_px: tuple[float, ...]  # of a pixel while the image moves by a pixel, by width

    def lag_px(self, width: int) -> float:
        """Return the lag of a sensor, px of it."""
        return lag_px(self.speed_px_s * width / self.widths[-1], self.cutoff_hz)

    def cases(self) -> Iterator[Case]:
        """Yield the pairs of neighboring widths; none with ideal pixels, whose lag is 0."""
        scores = zip(self.widths, self.psnr_db, strict=True)
        for (coarser, low), (finer, high) in pairwise(scores if self.cutoff_hz < math.inf else ()):
            where = self.run, self.scene, 1, self.cutoff_hz, self.speed
            yield Case(*where, finer, coarser, self.lag_px(finer), high - low)


def cases_of(windows: Iterable[Window]) -> list[Case]:
    """Return the cases of windows."""
    return [case for window in windows for case in window.cases()]


@cache
def stored_windows() -> tuple[Window, ...]:
    """Return the windows of the table in this package."""
    return tuple(
        Window(
            part["run"],
            scene,
            sample,
            float(cutoff),
            speed,
            px_s,
            *map(tuple, (part["widths"], psnr_db, events)),
        )
        for part in json.loads(files("tasks.advice").joinpath(TABLE).read_text())
        for scene, sample, cutoff, speed, px_s, psnr_db, events in part["windows"]
    )


@cache
def stored_cases() -> tuple[Case, ...]:
    """Return the cases of the table in this package."""
    return tuple(cases_of(stored_windows()))


@cache
def stored_cells() -> tuple[Case, ...]:
    """Return the medians of these cases over the samples of a scene."""
    cells: defaultdict[tuple[object, ...], list[Case]] = defaultdict(list)
    for case in stored_cases():
        cells[case.run, case.scene, case.cutoff_hz, case.speed, case.width].append(case)
    return tuple(
        replace(
            inside[0],
            samples=len(inside),
            lag_px=median(case.lag_px for case in inside),
            margin_db=median(case.margin_db for case in inside),
        )
        for inside in cells.values()
    )
