"""`Triggers`: edges on the trigger inputs of a camera, on the clock of its events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensor.errors import EventError, EventFormatError
from sensor.events import shifted

_DTYPES = {"t_us": np.int64, "channel": np.uint8, "p": np.int8}


@dataclass(frozen=True, slots=True, eq=False)
class Triggers:
    """External triggers of a recording, sorted by time.

    Parameters
    ----------
    t_us
        (N,) int64, microseconds, on the clock of the events.
    channel
        (N,) uint8, number of the input.
    p
        (N,) int8, +1 for a rising edge, -1 for a falling one.

    Raises
    ------
    EventFormatError
        A field has the wrong dtype, shape, values or order; the text names it.

    Examples
    --------
    An input that goes up at 12 us and down at 20 us; `later` moves it with its events:

    >>> import numpy as np
    >>> from sensor.formats import Triggers
    >>> edges = Triggers(np.array([12, 20]), np.zeros(2, np.uint8), np.array([1, -1], np.int8))
    >>> edges.t_us[edges.p > 0]
    array([12])
    >>> edges.later(1_000_000).t_us
    array([1000012, 1000020])
    """

    t_us: NDArray[np.int64]
    channel: NDArray[np.uint8]
    p: NDArray[np.int8]

    def __post_init__(self) -> None:
        for name, dtype in _DTYPES.items():
            column = getattr(self, name)
            if not isinstance(column, np.ndarray):
                raise EventFormatError(f"triggers, {name}: found {column!r}, expected an array")
            if column.dtype != dtype or column.shape != (len(self.t_us),):
                raise EventFormatError(
                    f"triggers, {name}: found {column.dtype} of shape {column.shape}, expected "
                    f"{np.dtype(dtype)} of shape ({len(self.t_us)},)"
                )
        if np.any(self.t_us[1:] < self.t_us[:-1]):
            raise EventFormatError("triggers, t_us: found times that run backwards")
        if not np.all(np.abs(self.p) == 1):
            raise EventFormatError("triggers, p: found values other than +1 and -1")

    def __len__(self) -> int:
        return len(self.t_us)

    def rising_us(self, channel: int | None = None) -> NDArray[np.int64]:
        """Return the times of rising edges on one input.

        Parameters
        ----------
        channel
            Number of the input; by default the only one that has edges.

        Returns
        -------
        (K,) int64, microseconds.

        Raises
        ------
        EventError
            Several inputs have edges and none is named, or the named one has none.
        """
        channels = np.unique(self.channel).tolist()
        found = f"triggers: found edges on channel {', '.join(map(str, channels)) or 'none'}"
        if channel is None and len(channels) > 1:
            raise EventError(f"{found}, expected one channel to be named")
        if channel is not None and channel not in channels:
            raise EventError(f"{found}, expected {channel} among them")
        mine = True if channel is None else self.channel == channel
        return self.t_us[(self.p > 0) & mine]

    def later(self, shift_us: int) -> Triggers:
        """Return the triggers with a shift added to their times, microseconds.

        Raises
        ------
        EventError
            As `Events.later`.
        """
        return Triggers(shifted(self.t_us, shift_us, "Triggers.later"), self.channel, self.p)


def _no_triggers() -> Triggers:
    return Triggers(*(np.empty(0, dtype) for dtype in _DTYPES.values()))


NO_TRIGGERS = _no_triggers()
