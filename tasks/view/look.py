"""Options of `eres view`: which events are shown, and how."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from tasks.errors import TaskError

_WINDOW_MS = 10.0
_MAX_S = 9e12  # int64 can hold it in microseconds
_RANGES = {
    "window": (1e-3, 1e3 * _MAX_S),
    "count": (1, math.inf),
    "slow": (1e-6, 1e9),
    "fps": (0.01, 1000),
    "height": (1, 1 << 14),
    **dict.fromkeys(("start", "end", "at"), (-_MAX_S, _MAX_S)),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """Which events are shown, and how.

    Parameters
    ----------
    window
        Each picture shows the events of this many milliseconds up to its time; 10 by default.
    count
        Each picture shows this many events up to its time, instead of a window.
    slow
        How many times slower than real time. By default the file lasts a few seconds.
    fps
        Pictures per second of a .mp4, .gif, .webp or .rrd; 25 by default.
    start
        Leave out earlier events; seconds on their clock, as `eres info` prints it.
    end
        Leave out later events, seconds.
    at
        Time of the picture in a .png, seconds; by default the middle.
    palette
        Colors: blue-red or dark.
    height
        Height of the pictures, px; by default chosen for the sensor and the kind of file.
    sensor
        Camera of files that do not name theirs, a name or a TOML file. It gives the caption, and
        the size of files without a size.
    """

    window: float | None = None
    count: int | None = None
    slow: float | None = None
    fps: float | None = None
    start: float | None = None
    end: float | None = None
    at: float | None = None
    palette: Literal["blue-red", "dark"] = "blue-red"
    height: int | None = None
    sensor: str | None = None

    def check(self) -> None:
        """Refuse values that no file can show.

        Raises
        ------
        TaskError
            A value is out of range; the text names the option.
        """
        if self.window is not None and self.count is not None:
            raise TaskError("give --window or --count, not both")
        for name, (low, high) in _RANGES.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                span = f"{low:g} or more" if math.isinf(high) else f"{low:g} to {high:g}"
                raise TaskError(f"{name}: found {value}, expected {span}")
        if not self.span_us[0] < self.span_us[1]:
            raise TaskError(f"--start {self.start:g} is not before --end {self.end:g}")

    @property
    def window_ms(self) -> float:
        """Length of a window, ms, if its number of events is not given."""
        return _WINDOW_MS if self.window is None else self.window

    @property
    def length_us(self) -> int | None:
        """Length of a window, us; None if its number of events is given."""
        return None if self.count is not None else round(1e3 * self.window_ms)

    @property
    def span_us(self) -> tuple[int, int]:
        """From `start` to `end`, us; the limits of int64 if they are not given."""
        start_us = -(1 << 63) if self.start is None else round(1e6 * self.start)
        return start_us, 1 << 63 if self.end is None else round(1e6 * self.end)


ALL_OF_IT = Look()
