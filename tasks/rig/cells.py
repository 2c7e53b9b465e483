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

_Light = tuple[float, float]  # cutoff and contrast threshold
_Cell = tuple[int, float]  # width, px, and speed, m/s
_Place = dict[int, list[Row]]  # the rows of a task at a place, by item
_Shared = dict[int, list[int]]  # items that all widths have, by the number of their place


def in_cells(recordings: Sequence[Sequence[Row]], per_visit: Mapping[str, int]) -> list[Row]:
    """Group the rows of recordings by distance and speed, with the same items in each group.

    Parameters
    ----------
    recordings
        The rows of each recording, with `speed` as measured, m/s, and with the number of the place
        on the print as `sample`.
    per_visit
        Number n of items in a visit to a place, by task, 1 if it is not given: item k of visit v is
        n v + k, and odd visits are those on the carriage's way back.
    """
    every = [row for rows in recordings for row in rows]
    speeds = _groups(row.speed for row in every)
    widths = _groups(float(row.width) for row in every)
    groups: dict[tuple[str, _Light, str], dict[_Cell, dict[int, _Place]]] = {}
    # The nth visit in a direction has the same items in every recording, whatever other speeds it
    # has: the visits of each place, speed and direction are counted anew.
    visits: defaultdict[Hashable, dict[tuple[int, int], int]] = defaultdict(dict)
    for recording, rows in enumerate(recordings):
        for row in sorted(rows, key=lambda row: row.item):
            cell = round(widths[row.width]), float(f"{speeds[row.speed]:.3g}")
            group = row.scene, (row.cutoff_hz, row.contrast_threshold), row.task
            visit, k = divmod(row.item, per_visit.get(row.task, 1))
            back = visit % 2
            counted = visits[group, cell, row.sample, back]
            n = counted.setdefault((recording, visit), len(counted))
            item = (2 * n + back) * per_visit.get(row.task, 1) + k
            place = groups.setdefault(group, {}).setdefault(cell, {}).setdefault(row.sample, {})
            moved = replace(row, width=cell[0], speed=cell[1], speed_m_s=cell[1])
            place.setdefault(item, []).append(moved)
    of_light: dict[tuple[str, _Light], set[int]] = {}
    for (scene, light, _), cells in groups.items():
        of_light.setdefault((scene, light), set()).update(width for width, _ in cells)
    for (scene, light), has in of_light.items():
        lacks = {px for (other, _), of in of_light.items() if other == scene for px in of - has}
        if lacks:
            _log.warning(
                "%s: cutoff %g Hz, threshold %g: has crops %s wide, but none %s wide",
                *(scene, *light, _named(has), _named(lacks)),
            )
    grouped: list[Row] = []
    for (scene, light, task), cells in groups.items():
        rows = _equal(cells, of_light[scene, light])
        if not rows:
            named = _named(of_light[scene, light])
            lacking = f"{task} of {scene}: crops {named} wide share no place at any speed"
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


def _equal(cells: dict[_Cell, dict[int, _Place]], widths: Collection[int]) -> list[Row]:
    """Return the rows of a task on a picture, reduced to what every width has."""
    shared = {
        speed: _shared([cells.get((width, speed), {}) for width in widths])
        for speed in sorted({speed for _, speed in cells})
    }
    sizes = sorted({len(items) for places in shared.values() for items in places.values()})
    chosen = max((_full(shared, n) for n in sizes), key=_worth, default={})
    count = min(map(len, chosen.values()), default=0)
    rows = []
    for (_, speed), places in cells.items():
        if speed not in chosen:
            continue
        numbers = [*chosen[speed]]
        spread = np.linspace(0, len(numbers) - 1, count).round().astype(int).tolist()
        for sample, number in enumerate(numbers[index] for index in spread):
            for item, old in enumerate(chosen[speed][number]):
                rows += [replace(row, sample=sample, item=item) for row in places[number][old]]
    return rows


def _shared(widths: Sequence[dict[int, _Place]]) -> _Shared:
    """Return the items that all widths have, by their place; without places that have none."""
    shared = {
        number: sorted(set.intersection(*(set(places[number]) for places in widths)))
        for number in sorted(set.intersection(*map(set, widths)))
    }
    return {number: items for number, items in shared.items() if items}


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
