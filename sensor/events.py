"""`Events`: a sorted event stream with the size of its sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor.errors import EventError
from sensor.model import SensorModel

_DTYPES = {"t_us": np.int64, "x": np.uint16, "y": np.uint16, "p": np.int8}
_FIRST_US, _LAST_US = np.iinfo(np.int64).min, np.iinfo(np.int64).max
_STRUCTURED = np.dtype([("x", np.int16), ("y", np.int16), ("t", np.int64), ("p", np.bool_)])


class Columns(NamedTuple):
    """The four arrays of `Events`, (N,) each, for compiled functions."""

    t_us: NDArray[np.int64]
    x: NDArray[np.uint16]
    y: NDArray[np.uint16]
    p: NDArray[np.int8]

    @classmethod
    def room(cls, size: int) -> Columns:
        """Allocate columns for `size` events."""
        x, y = np.empty((2, size), np.uint16)
        return cls(np.empty(size, np.int64), x, y, np.empty(size, np.int8))

    def part(self, which: slice | NDArray[np.bool_ | np.integer]) -> Columns:
        """Return the columns of some events: views for a slice, copies for a mask or indices."""
        return Columns(self.t_us[which], self.x[which], self.y[which], self.p[which])


@dataclass(frozen=True, slots=True, eq=False)
class Events:
    """Events of one sensor, sorted by time.

    Simulated events are also sorted by (y, x) within a microsecond.

    Parameters
    ----------
    t_us
        (N,) int64, microseconds, on the clock of the frames.
    x, y
        (N,) uint16, pixel column and row; (0, 0) is the top-left pixel.
    p
        (N,) int8, +1 for brighter, -1 for darker.
    width, height
        The sensor's size in pixels.
    model
        The simulated sensor, with the dark level that was used; None for recordings.

    Raises
    ------
    EventError
        A field has the wrong dtype, shape, range or order; the message names it.

    Examples
    --------
    >>> import numpy as np
    >>> from sensor import Events
    >>> t_us = np.array([10, 25, 25, 40])
    >>> x, y = np.array([[3, 1, 2, 3], [0, 1, 1, 0]], np.uint16)
    >>> p = np.array([1, -1, 1, 1], np.int8)
    >>> events = Events(t_us, x, y, p, width=4, height=2)
    >>> events
    Events(4 of 4x2 px, 10..40 us)
    >>> events.between(20, 40)  # a window of time without its end
    Events(2 of 4x2 px, 25..25 us)
    >>> events[-2:].x  # the last two
    array([2, 3], dtype=uint16)
    >>> events.where(events.p > 0).x  # any mask
    array([3, 2, 3], dtype=uint16)
    >>> events.polarity_sum()  # change of log intensity, in contrast thresholds
    array([[ 0,  0,  0,  2],
           [ 0, -1,  1,  0]])
    """

    t_us: NDArray[np.int64]
    x: NDArray[np.uint16]
    y: NDArray[np.uint16]
    p: NDArray[np.int8]
    width: int
    height: int
    model: SensorModel | None = None

    def __post_init__(self) -> None:
        for name, dtype in _DTYPES.items():
            array = getattr(self, name)
            is_row = isinstance(array, np.ndarray) and array.ndim == 1
            if not is_row or array.dtype != dtype or len(array) != len(self.t_us):
                kind = getattr(array, "dtype", type(array).__name__)
                raise EventError(
                    f"Events.{name}: found {kind} of shape {np.shape(array)}, expected a 1-D array "
                    f"of {np.dtype(dtype)}, of the length of t_us"
                )
        for name in ("width", "height"):
            side = getattr(self, name)
            if not isinstance(side, int | np.integer) or side < 0:
                raise EventError(f"Events.{name}: found {side!r}, expected 0 or more whole px")
        if len(self.t_us) == 0:
            return
        backwards = np.flatnonzero(self.t_us[1:] < self.t_us[:-1])
        if backwards.size:
            raise EventError(
                f"Events.t_us: event {backwards[0] + 1} is earlier than the event before it; sort "
                "the events by time"
            )
        for name, size in (("x", self.width), ("y", self.height)):
            largest = int(getattr(self, name).max())
            if largest >= size:
                raise EventError(f"Events.{name}: found {largest}, expected less than {size}")
        if not np.all(np.abs(self.p) == 1):
            raise EventError("Events.p: found values other than +1 and -1")

    def __len__(self) -> int:
        return len(self.t_us)

    def __repr__(self) -> str:
        span = f", {self.t_us[0]}..{self.t_us[-1]} us" if len(self) else ""
        return f"Events({len(self)} of {self.width}x{self.height} px{span})"

    def _repr_html_(self) -> str:
        from sensor.notebook import html_of  # here, as few sessions are notebooks

        return html_of(self)

    @classmethod
    def trusted(
        cls,
        t_us: NDArray[np.int64],
        x: NDArray[np.uint16],
        y: NDArray[np.uint16],
        p: NDArray[np.int8],
        *,
        like: Events,
    ) -> Events:
        """Make events from columns that are known to be valid, without checks.

        Parameters
        ----------
        t_us, x, y, p
            (N,) columns as in `Events`.
        like
            Events of the same sensor.

        Returns
        -------
        Events
        """
        events = object.__new__(cls)
        values = t_us, x, y, p, like.width, like.height, like.model
        for name, value in zip(cls.__slots__, values, strict=True):
            object.__setattr__(events, name, value)
        return events

    @property
    def columns(self) -> Columns:
        """The four arrays."""
        return Columns(self.t_us, self.x, self.y, self.p)

    def __getitem__(self, part: slice) -> Events:
        """Return a contiguous part of the stream, as views of the same memory."""
        if not isinstance(part, slice) or part.step not in (None, 1):
            raise TypeError(
                f"Events: found the index {part!r:.60}, expected a slice with step 1; "
                "`events.where(mask)` selects any events, and the columns are `events.t_us`, "
                "`events.x`, `events.y` and `events.p`"
            )
        return Events.trusted(*self.columns.part(part), like=self)

    def between(self, t_start_us: int, t_end_us: int) -> Events:
        """Return the events in a half-open time window, as views of the same memory.

        Parameters
        ----------
        t_start_us, t_end_us
            The window [t_start_us, t_end_us), whole microseconds.

        Returns
        -------
        Events

        Raises
        ------
        EventError
            A time is not an integer, so it may be in seconds.
        """
        first, last = (
            self._before(whole_us("Events.between", name, t_us))
            for name, t_us in (("t_start_us", t_start_us), ("t_end_us", t_end_us))
        )
        return self[first:last]

    def _before(self, t_us: int) -> int:
        """Return the number of events before a time."""
        # Beyond int64 NumPy would compare in float64, which merges times.
        if t_us > _LAST_US:
            return len(self)
        return int(np.searchsorted(self.t_us, np.int64(max(t_us, _FIRST_US))))

    def where(self, keep: NDArray[np.bool_]) -> Events:
        """Return a copy of the events that an (N,) mask selects.

        Raises
        ------
        EventError
            The mask has another type than bool, such as indices, or another length.
        """
        mask = np.asarray(keep)
        if mask.dtype != np.bool_ or mask.shape != (len(self),):
            raise EventError(
                f"Events.where: found {mask.dtype} of shape {mask.shape}, expected a mask of bools "
                f"of shape ({len(self)},)"
            )
        # An unpredictable mask costs numpy a branch per event and column, indices cost none.
        chosen = np.flatnonzero(mask)
        return Events.trusted(*self.columns.part(chosen), like=self)

    def copy(self) -> Events:
        """Return a copy of the events."""
        t_us, x, y, p = self.columns
        return Events.trusted(t_us.copy(), x.copy(), y.copy(), p.copy(), like=self)

    def later(self, shift_us: int) -> Events:
        """Return the events with a shift added to their times, whole microseconds.

        Raises
        ------
        EventError
            The shift is not an integer, or a time would not fit into int64.
        """
        t_us, x, y, p = self.columns
        return Events.trusted(shifted(t_us, shift_us, "Events.later"), x, y, p, like=self)

    @classmethod
    def from_structured(
        cls, array: NDArray[np.void], width: int, height: int, model: SensorModel | None = None
    ) -> Events:
        """Make events from a structured array, such as those of tonic.

        Parameters
        ----------
        array
            (N,) with the fields x, y, t (whole microseconds) and p (positive for brighter), sorted
            by t.
        width, height
            Size of the sensor, px.
        model
            The simulated sensor, if there is one.

        Returns
        -------
        Events

        Raises
        ------
        EventError
            A field is missing, or its values are out of range or order.
        """
        if not {"x", "y", "t", "p"} <= set(array.dtype.names or ()):
            raise EventError(
                f"Events.from_structured: found fields {array.dtype.names}, expected x, y, t and p"
            )
        bounds = {"t": (_FIRST_US, _LAST_US), "x": (0, 2**16 - 1), "y": (0, 2**16 - 1)}
        for name, (low, high) in bounds.items():
            column = array[name]
            values = (column.min(), column.max()) if len(column) else ()
            if column.dtype.kind not in "iu" or any(not low <= int(v) <= high for v in values):
                raise EventError(
                    f"Events.from_structured: found {name} of {column.dtype} with values "
                    f"{' to '.join(map(str, values))}, expected integers from {low} to {high}"
                )
        x, y = (array[name].astype(np.uint16) for name in ("x", "y"))
        p = np.where(array["p"] > 0, 1, -1).astype(np.int8)
        return cls(array["t"].astype(np.int64), x, y, p, width, height, model)

    def to_structured(self) -> NDArray[np.void]:
        """Return an (N,) structured array with tonic's fields: x and y int16, t int64 us, p bool.

        Raises
        ------
        EventError
            The sensor is too large for int16.
        """
        if max(self.width, self.height) > 2**15:
            raise EventError(
                f"Events.to_structured: found {self.width}x{self.height} px, expected at most "
                f"{2**15} px per side, the range of int16"
            )
        array = np.empty(len(self), _STRUCTURED)
        array["x"], array["y"], array["t"], array["p"] = self.x, self.y, self.t_us, self.p > 0
        return array

    def polarity_sum(self) -> NDArray[np.int64]:
        """Return the sum of polarities per pixel, (height, width) int64: Delta L / C of Eq. (8)."""
        pixel = self.y.astype(np.int64) * self.width + self.x
        total = np.bincount(pixel, weights=self.p, minlength=self.width * self.height)
        return total.astype(np.int64).reshape(self.height, self.width)


def whole_us(function: str, name: str, t_us: object) -> int:
    """Return a time in microseconds as a Python integer."""
    if not isinstance(t_us, int | np.integer):
        raise EventError(
            f"{function}: found {name} = {t_us!r}, expected whole microseconds as an integer: "
            "round(1e6 * seconds)"
        )
    return int(t_us)


def shifted(t_us: NDArray[np.int64], shift_us: int, function: str) -> NDArray[np.int64]:
    """Return ascending times with a shift added, (N,) int64 us."""
    shift = whole_us(function, "shift_us", shift_us)
    if not len(t_us):
        return t_us.copy()
    if not _FIRST_US <= shift + int(t_us[0]) <= shift + int(t_us[-1]) <= _LAST_US:
        raise EventError(
            f"{function}: adding shift_us = {shift} to times from {t_us[0]} to {t_us[-1]} us "
            "overflows int64"
        )
    return t_us + shift


def no_events(width: int, height: int, model: SensorModel | None) -> Events:
    """Return an empty stream of a sensor of this size, px."""
    return Events(*Columns.room(0), width, height, model)


def concatenate(parts: Sequence[Events]) -> Events:
    """Join consecutive parts of one stream, at least one."""
    columns = [np.concatenate([getattr(part, name) for part in parts]) for name in _DTYPES]
    return Events.trusted(*columns, like=parts[0])
