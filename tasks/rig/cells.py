"""Rows of recordings in cells like those of a study: one speed, one width, the same samples.

A slider keeps its speed to within a few percent, and crops from one distance differ by a few
pixels. A study compares medians over the same number of samples and items at each width and speed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from statistics import median

import numpy as np

from tasks.errors import RigError
from tasks.row import Row

_APART = 1.1  # ratio from which two neighboring speeds, or widths, count as different

_Light = tuple[float, float]  # cutoff and contrast threshold
_Place = list[Row]  # the rows of a task at one place of one recording


def in_cells(recordings: Sequence[Sequence[Row]]) -> list[Row]:
    """Group the rows of recordings by distance and speed, with equal samples in each group.

    Parameters
    ----------
    recordings
        The rows of each recording, with `speed` as measured, m/s, and with the number of the place
        on the page as `sample`: the carriage comes to a place more than once.

    Returns
    -------
    rows
        `width` and `speed` are the medians of their groups, which are separated by gaps of 10 %;
        `speed_m_s` equals `speed`. For each picture, task and light, only speeds that every width
        has are kept, all with the same number of places, evenly spread, and of items at each, the
        first ones: so many that most scores are kept. Samples, one for each place, are numbered
        from 0 in each light at each speed and width.

    Raises
    ------
    RigError
        If the recordings of a picture have no speed in common.
    """
    every = [row for rows in recordings for row in rows]
    speeds = _groups(row.speed for row in every)
    widths = _groups(float(row.width) for row in every)
    tasks: dict[tuple[str, str, _Light], dict[tuple[int, float], list[_Place]]] = {}
    for rows in recordings:
        places: dict[tuple[str, str, _Light, int, float, int], _Place] = {}
        for row in rows:
            width, speed = round(widths[row.width]), float(f"{speeds[row.speed]:.3g}")
            moved = replace(row, width=width, speed=speed, speed_m_s=speed)
            light = row.cutoff_hz, row.contrast_threshold
            at = row.scene, row.task, light, width, speed, row.sample
            places.setdefault(at, []).append(moved)
        for (scene, task, light, width, speed, _), place in places.items():
            cells = tasks.setdefault((scene, task, light), {})
            cells.setdefault((width, speed), []).append(_numbered(place))
    return [row for (scene, *_), cells in tasks.items() for row in _equal(scene, cells)]


def _numbered(place: _Place) -> _Place:
    """Return the rows with items from 0 on, over all visits of the place."""
    items = {item: k for k, item in enumerate(sorted({row.item for row in place}))}
    return [replace(row, item=items[row.item]) for row in place]


def _groups(values: Iterable[float]) -> dict[float, float]:
    """Return the median of the group of each value; a gap of 10 % separates groups."""
    groups: list[list[float]] = []
    for value in sorted(set(values)):
        if groups and value < _APART * groups[-1][-1]:
            groups[-1].append(value)
        else:
            groups.append([value])
    return {value: median(group) for group in groups for value in group}


def _equal(scene: str, cells: dict[tuple[int, float], list[_Place]]) -> list[Row]:
    """Return the rows of a task on a picture, reduced to what every width has."""
    sizes = sorted({_items(place) for places in cells.values() for place in places})
    items, kept = max(((n, _full(cells, n)) for n in sizes), key=lambda one: _worth(*one))
    if not kept:
        named = " and ".join(f"{width} px" for width in sorted({width for width, _ in cells}))
        raise RigError(
            f"evaluate: {scene}: found no speed that the crops of {named} have in common, expected "
            "one; record the same speeds from each distance, or give more windows"
        )
    count = min(map(len, kept.values()))
    rows = []
    for places in kept.values():
        spread = np.linspace(0, len(places) - 1, count).round().astype(int).tolist()
        for sample, index in enumerate(spread):
            rows += [replace(row, sample=sample) for row in places[index] if row.item < items]
    return rows


def _full(
    cells: dict[tuple[int, float], list[_Place]], items: int
) -> dict[tuple[int, float], list[_Place]]:
    """Return the places with so many items, at the speeds that every width then has."""
    full = {at: [one for one in cells[at] if _items(one) >= items] for at in cells}
    widths = {width for width, _ in cells}
    speeds = {speed for _, speed in cells if all(full.get((w, speed)) for w in widths)}
    return {at: places for at, places in full.items() if at[1] in speeds}


def _worth(items: int, kept: dict[tuple[int, float], list[_Place]]) -> tuple[int, int]:
    """Return the number of cells, then that of the scores in each."""
    return len(kept), items * min(map(len, kept.values()), default=0)


def _items(place: _Place) -> int:
    return 1 + max(row.item for row in place)
