"""Describe a plot as data; `report.js` draws it on the page, `figures` draws it into files."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import cycle

from tasks.metric import number_text
from tasks.study.results.asked import SensorId

COLORS = {
    "ink": ("#1d2126", "#e6e6e1"),
    "soft": ("#5b646e", "#a0a8b0"),
    "series-0": ("#0072b2", "#5ab4f0"),
    "series-1": ("#007a59", "#2ecc9b"),
    "series-2": ("#8a6500", "#f5cf4d"),
    "series-3": ("#b03a00", "#f2894a"),
    "series-4": ("#8a2c82", "#d9a0ea"),
    "series-5": ("#4d5560", "#b4bcc6"),
    "series-6": ("#3b7d00", "#a5d96a"),
    "series-7": ("#c2185b", "#ff8ab0"),
}
"""Colors by name, for a light and for a dark page. Series differ in lightness and in hue."""

Place = tuple[float, float]
Outline = Sequence[Place]  # corners, px, y down

_TURNS = [k * math.pi / 12 for k in range(24)]
CIRCLE = [(round(4.5 * math.cos(a), 2), round(4.5 * math.sin(a), 2)) for a in _TURNS]
MARKS: Sequence[Outline] = (
    CIRCLE,
    [(-4, -4), (4, -4), (4, 4), (-4, 4)],
    [(0, -5.2), (5, 3.8), (-5, 3.8)],
    [(0, -5.6), (5.2, 0), (0, 5.6), (-5.2, 0)],
    [(0, 5.2), (5, -3.8), (-5, -3.8)],
)

_VISIBLE = 1 / 60  # of the height of a panel, about 4 px
_MUCH = 1.5  # factor by which an axis of its own enlarges a panel

Tick = tuple[float, str]


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis; of its `ticks`, from fine to coarse, the first with few enough labels is drawn."""

    label: str
    log: bool
    include: Sequence[float]
    ticks: Sequence[Sequence[Tick]]
    most: int

    def ticks_within(self, low: float, high: float) -> Sequence[Tick]:
        """Choose the ticks of a visible range."""
        inside = [[tick for tick in ticks if low <= tick[0] <= high] for ticks in self.ticks]
        fitting = (ticks for ticks in inside if sum(bool(t[1]) for t in ticks) <= self.most)
        return next(fitting, inside[-1])


@dataclass(frozen=True, slots=True)
class Key:
    """Look of a series. `color` is a name in `COLORS`; `label` is drawn at the first point."""

    name: str
    color: str
    mark: Outline
    label: str = ""


@dataclass(frozen=True, slots=True)
class Point:
    """A mark with the lines of its tooltip."""

    x: float
    y: float
    lines: Sequence[str]


@dataclass(frozen=True, slots=True)
class Line:
    """A series in one panel. Without a path, the line joins the points."""

    points: Sequence[Point]
    path: Sequence[Place] | None = None


@dataclass(frozen=True, slots=True)
class Panel:
    """One panel: a line for each key of the plot, and dashed reference lines."""

    label: str
    detail: str
    lines: Sequence[Line]
    references: Sequence[float] = ()
    reference_label: str = ""


@dataclass(frozen=True, slots=True)
class Limit:
    """A limit on x; the drawer shades what is above it."""

    x: float
    label: str


@dataclass(frozen=True, slots=True)
class Plot:
    """Panels that share the x axis and the series."""

    title: str
    x: Axis
    y: Axis
    keys: Sequence[Key]
    panels: Sequence[Panel]
    labels_below: bool
    limit: Limit | None
    own_axes: bool


def plot(
    title: str,
    x_label: str,
    y_label: str,
    keys: Sequence[Key],
    panels: Sequence[Panel],
    *,
    log_y: bool = False,
    include_y: Sequence[float] = (),
    labels_below: bool = False,
    limit: Limit | None = None,
    deciding: float = 0.0,
) -> Plot:
    """Make a plot with a logarithmic x axis and compute the ticks of both axes.

    Each panel has its own y axis if a shared axis hides a `deciding` difference of y in one of
    them.
    """
    shown = [place for panel in panels for place in _places(panel)]
    include_x = () if limit is None else (limit.x,)
    widths = [*(x for x, _ in shown), *include_x] or [1.0]
    of_panels = [[*(y for _, y in _places(panel)), *panel.references] for panel in panels]
    reached = [*(y for heights in of_panels for y in heights), *include_y] or [1.0]
    log_y = log_y and min(reached) > 0
    y_ticks = (_log_ticks if log_y else _even_ticks)(min(reached), max(reached))
    x_axis = Axis(x_label, True, include_x, _log_ticks(min(widths), max(widths)), most=6)
    y_axis = Axis(y_label, log_y, include_y, y_ticks, most=9)
    own_axes = _hides(of_panels, deciding, log_y)
    return Plot(title, x_axis, y_axis, keys, panels, labels_below, limit, own_axes)


def _places(panel: Panel) -> list[Place]:
    places = [(point.x, point.y) for line in panel.lines for point in line.points]
    return places + [place for line in panel.lines for place in line.path or ()]


def _hides(of_panels: Sequence[Sequence[float]], deciding: float, log: bool) -> bool:
    """Return whether a difference takes less than `_VISIBLE` of an axis that the panels share.

    A panel counts only if an axis of its own shows the difference over `_MUCH` times as large.
    """
    scaled = [[math.log10(y) if log else y for y in heights] for heights in of_panels if heights]
    if not scaled or not deciding:
        return False
    shared = max(map(max, scaled)) - min(map(min, scaled))
    for heights in scaled:
        least = min(heights)
        step = math.log10(1 + deciding / 10**least) if log else deciding
        if step < _VISIBLE * shared and max(heights) - least < shared / _MUCH:
            return True
    return False


def sensor_keys(sensors: Iterable[SensorId], *, labeled: bool = False) -> list[Key]:
    """Give each sensor a color and a mark; `labeled` shows its name or width at the first point."""
    colors = [name for name in COLORS if name.startswith("series")]
    return [
        Key(sensor.label, color, mark, str(sensor) if labeled else "")
        for sensor, color, mark in zip(sensors, cycle(colors), cycle(MARKS))
    ]


def _log_ticks(low: float, high: float) -> list[list[Tick]]:
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    finest = tuple(round(0.1 * k, 1) for k in range(10, 100))  # for a range of less than an octave
    fine, usual = (1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9), (1, 2, 5)
    return [
        [(m * 10.0**d, f"{m * 10.0**d:g}" if m in named else "") for d in decades for m in marks]
        for marks, named in ((finest, finest), (fine, fine), (usual, usual), (usual, (1,)))
    ]


def _even_ticks(low: float, high: float) -> list[list[Tick]]:
    """Return ticks at steps of 1, 2 and 5, from 1/100 of the range; they extend past its ends."""
    span = high - low or 1.0
    finest = math.floor(math.log10(span / 100))
    ladder = []
    for power in range(finest, finest + 4):
        for step in (m * 10.0**power for m in (1, 2, 5)):
            if span / 100 <= step <= span:
                first, last = (math.ceil((low - span / 5) / step), int((high + span / 5) // step))
                values = [k * step for k in range(first, last + 1)]
                ladder.append([(v, number_text(v, max(0, -power))) for v in values])
    return ladder
