"""Rows of recordings in cells like those of a study: one speed, one width, the same samples.

A slider keeps its speed to within a few percent, and crops from one distance differ by a few
pixels. A study compares medians over the same number of samples and items at each width and speed,
and takes differences between widths of the same ones.
"""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from tasks.errors import RigError
from tasks.metric import MIN_SAMPLES_FOR_INTERVAL
from tasks.row import Row

_log = logging.getLogger(__name__)

_APART = 1.1  # ratio from which two neighboring speeds, or widths, count as different

_Light = tuple[str, float, float]  # picture, cutoff and contrast threshold
_Cell = tuple[int, float]  # width, px, and speed, m/s
_Rows = dict[tuple[int, int], list[Row]]  # of a task, by the numbers of place and item
_Shared = dict[int, list[int]]  # items that all widths have, by the number of their place


def in_cells(recordings: Sequence[Sequence[Row]], per_visit: Mapping[str, int]) -> list[Row]:
    """Group the rows of recordings by distance and speed, with the same items in each group.

    Rows have the measured speed, m/s, and as `sample` the number of the place. With n items per
    visit (`per_visit` of the task, else 1), item k of visit v is n v + k; odd visits are on the way
    back.
    """
    every = [row for rows in recordings for row in rows]
    speeds = _groups(row.speed for row in every)
    widths = _groups(float(row.width) for row in every)
    groups: dict[tuple[_Light, str], dict[_Cell, _Rows]] = {}
    of_light: defaultdict[_Light, set[int]] = defaultdict(set)
    # The nth visit in a direction has the same items in every recording, whatever other speeds it
    # has: the visits of each place, speed and direction are counted anew.
    visits: defaultdict[Hashable, dict[tuple[int, int], int]] = defaultdict(dict)
    for recording, rows in enumerate(recordings):
        for row in sorted(rows, key=lambda row: row.item):
            cell = round(widths[row.width]), float(f"{speeds[row.speed]:.3g}")
            light = row.scene, row.cutoff_hz, row.contrast_threshold
            of_light[light].add(cell[0])
            group = light, row.task
            visit, k = divmod(row.item, per_visit.get(row.task, 1))
            back = visit % 2
            counted = visits[group, cell, row.sample, back]
            n = counted.setdefault((recording, visit), len(counted))
            item = (2 * n + back) * per_visit.get(row.task, 1) + k
            in_cell = groups.setdefault(group, {}).setdefault(cell, {})
            moved = replace(row, width=cell[0], speed=cell[1], speed_m_s=cell[1])
            in_cell.setdefault((row.sample, item), []).append(moved)
    for light, has in of_light.items():
        lacks = {px for other, of in of_light.items() if other[0] == light[0] for px in of - has}
        if lacks:
            _log.warning(
                "%s: cutoff %g Hz, threshold %g: has crops %s wide, but none %s wide",
                *light,
                _named(has),
                _named(lacks),
            )
    grouped: list[Row] = []
    for (light, task), cells in groups.items():
        rows = _equal(cells, of_light[light])
        if not rows:
            named = _named(of_light[light])
            lacking = f"{task} of {light[0]}: crops {named} wide share no place at any speed"
            _log.warning("%s; this task is left out", lacking)
        grouped += rows
    if every and not grouped:
        raise RigError(
            f"evaluate: {lacking}; record the same speeds from each distance, or increase --places"
        )
    return grouped


def _named(widths: Collection[int]) -> str:
    return " and ".join(f"{width} px" for width in sorted(widths))


def _groups(values: Iterable[float]) -> dict[float, float]:
    """Return the median of the group of each value; a gap of 10 % separates groups."""
    ordered = np.unique(list(values))
    gaps = np.flatnonzero(ordered[1:] >= _APART * ordered[:-1]) + 1
    groups = np.split(ordered, gaps)
    return {value: float(np.median(group)) for group in groups for value in group.tolist()}


def _equal(cells: dict[_Cell, _Rows], widths: Collection[int]) -> list[Row]:
    """Return the rows of a task on a picture, reduced to what every width has."""
    shared = {
        speed: _shared(cells.get((width, speed), {}) for width in widths)
        for speed in sorted({speed for _, speed in cells})
    }
    sizes = sorted({len(items) for places in shared.values() for items in places.values()})
    chosen = max((_full(shared, n) for n in sizes), key=_worth, default={})
    count = min(map(len, chosen.values()), default=0)
    rows = []
    for (_, speed), in_cell in cells.items():
        if speed not in chosen:
            continue
        places = [*chosen[speed].items()]
        spread = np.linspace(0, len(places) - 1, count).round().astype(int).tolist()
        for sample, (place, items) in enumerate(places[index] for index in spread):
            for item, old in enumerate(items):
                rows += [replace(row, sample=sample, item=item) for row in in_cell[place, old]]
    return rows


def _shared(widths: Iterable[_Rows]) -> _Shared:
    """Return the items that all widths have, by their place."""
    shared: defaultdict[int, list[int]] = defaultdict(list)
    for place, item in sorted(set.intersection(*map(set, widths))):
        shared[place].append(item)
    return shared


def _full(shared: dict[float, _Shared], n: int) -> dict[float, _Shared]:
    """Return the first n items at the places that have so many, at the speeds with such places."""
    full = {
        speed: {number: items[:n] for number, items in places.items() if len(items) >= n}
        for speed, places in shared.items()
    }
    return {speed: places for speed, places in full.items() if places}


def _worth(speeds: dict[float, _Shared]) -> tuple[int, bool, int]:
    """Return the number of speeds, whether they have intervals, and their smallest item count."""
    places = min(map(len, speeds.values()), default=0)
    items = min((sum(map(len, at.values())) for at in speeds.values()), default=0)
    return len(speeds), places >= MIN_SAMPLES_FOR_INTERVAL, items
