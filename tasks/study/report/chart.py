"""A small static chart as inline SVG, in the report's own colours and type."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

_WIDTH, _HEIGHT = 360, 310
_LEFT, _RIGHT, _TOP, _BOTTOM = 46, 12, 12, 42


class Chart:
    """Lines and marks over a logarithmic x axis.

    Parameters
    ----------
    x, y
        (lowest, highest) of each axis, in the units of the data.
    x_label, y_label
        Names of the axes.
    log_y
        Whether the y axis is logarithmic too; if not it has a few even ticks.
    """

    def __init__(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        x_label: str,
        y_label: str,
        *,
        log_y: bool,
    ) -> None:
        self._x = math.log10(x[0]), math.log10(x[1])
        self._y = (math.log10(y[0]), math.log10(y[1])) if log_y else y
        self._log_y = log_y
        self._parts: list[str] = []
        right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM
        self._parts.append(
            f'<rect class="frame" x="{_LEFT}" y="{_TOP}" width="{right - _LEFT}" '
            f'height="{bottom - _TOP}"/>'
        )
        for value, label in _log_ticks(*x):
            at = self._at(value, y[0])[0]
            self._grid(at, at, _TOP, bottom, label)
            self.text(at, bottom + 15, label, anchor="middle")
        for value, label in _log_ticks(*y) if log_y else _even_ticks(*y):
            at = self._at(x[0], value)[1]
            self._grid(_LEFT, right, at, at, label)
            self.text(_LEFT - 6, at + 4, label, anchor="end")
        self.text((_LEFT + right) / 2, _HEIGHT - 8, x_label, anchor="middle")
        middle = (_TOP + bottom) / 2
        self._parts.append(
            f'<text transform="translate(11 {middle}) rotate(-90)" text-anchor="middle">'
            f"{escape(y_label)}</text>"
        )

    def line(self, x: Iterable[float], y: Iterable[float], colour: str) -> None:
        """Draw a line through points in data units."""
        points = (self._at(*point) for point in zip(x, y, strict=True))
        path = "L".join(f"{at_x:.1f} {at_y:.1f}" for at_x, at_y in points)
        self._parts.append(f'<path d="M{path}" fill="none" stroke="{colour}" stroke-width="1.75"/>')

    def dots(self, x: Iterable[float], y: Iterable[float], colour: str) -> None:
        """Draw a dot at each point in data units."""
        for point in zip(x, y, strict=True):
            at_x, at_y = self._at(*point)
            self._parts.append(f'<circle cx="{at_x:.1f}" cy="{at_y:.1f}" r="3.5" fill="{colour}"/>')

    def text(
        self, at_x: float, at_y: float, text: str, *, anchor: str, colour: str | None = None
    ) -> None:
        """Write at a place of the picture."""
        style = f' style="fill:{colour}"' if colour else ""
        self._parts.append(
            f'<text x="{at_x:.1f}" y="{at_y:.1f}" text-anchor="{anchor}"{style}>'
            f"{escape(text)}</text>"
        )

    def svg(self, label: str) -> str:
        """The chart; `label` tells a screen reader what it shows."""
        return (
            f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{escape(label)}">'
            f"{''.join(self._parts)}</svg>"
        )

    def _at(self, x: float, y: float) -> tuple[float, float]:
        across = (math.log10(x) - self._x[0]) / (self._x[1] - self._x[0])
        value = math.log10(y) if self._log_y else y
        up = (value - self._y[0]) / (self._y[1] - self._y[0])
        return (
            _LEFT + across * (_WIDTH - _RIGHT - _LEFT),
            _HEIGHT - _BOTTOM - up * (_HEIGHT - _BOTTOM - _TOP),
        )

    def _grid(self, x1: float, x2: float, y1: float, y2: float, label: str) -> None:
        faint = "" if label else ' stroke-opacity="0.45"'
        self._parts.append(
            f'<line class="grid" x1="{x1:.1f}" x2="{x2:.1f}" y1="{y1:.1f}" y2="{y2:.1f}"{faint}/>'
        )


def _log_ticks(low: float, high: float) -> list[tuple[float, str]]:
    """1, 2 and 5 of every decade; where fewer than two decades start, all three have labels."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    values = [m * 10.0**d for d in range(first, last + 1) for m in (1, 2, 5)]
    inside = [value for value in values if low <= value <= high]
    decades = [value for value in inside if math.log10(value).is_integer()]
    labelled: Sequence[float] = decades if len(decades) > 1 else inside
    return [(value, f"{value:g}" if value in labelled else "") for value in inside]


def _even_ticks(low: float, high: float) -> list[tuple[float, str]]:
    rough = (high - low) / 6
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough)
    count = math.floor(high / step + 1e-9) - math.ceil(low / step - 1e-9) + 1
    first = math.ceil(low / step - 1e-9)
    return [((first + k) * step, f"{(first + k) * step:g}") for k in range(count)]
