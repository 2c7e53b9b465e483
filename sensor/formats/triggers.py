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
        A field has the wrong dtype, shape, values or order; the message names it.

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
            kind, shape = getattr(column, "dtype", type(column).__name__), np.shape(column)
            if kind != dtype or shape != (len(self.t_us),):
                raise EventFormatError(
                    f"triggers, {name}: found {kind} of shape {shape}, expected an array of "
                    f"{np.dtype(dtype)} of shape ({len(self.t_us)},)"
                )
        if np.any(self.t_us[1:] < self.t_us[:-1]):
            raise EventFormatError("triggers, t_us: the times are not in ascending order")
        if not np.all(np.abs(self.p) == 1):
            raise EventFormatError("triggers, p: found values other than +1 and -1")

    def __len__(self) -> int:
        return len(self.t_us)

    def rising_us(self, channel: int | None = None) -> NDArray[np.int64]:
        """Return the times of rising edges on one input.

        Parameters
        ----------
        channel
            Number of the input. It may be left out if only one input has edges.

        Returns
        -------
        (K,) int64, microseconds.

        Raises
        ------
        EventError
            No channel is given and several have edges, or the given channel has none.
        """
        channels = np.unique(self.channel).tolist()
        if channel not in channels and (channel is not None or len(channels) > 1):
            listed = ", ".join(map(str, channels)) or "none"
            other = "" if channel is None else f", not on {channel}"
            raise EventError(f"triggers: found edges on channels {listed}{other}; choose one")
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


NO_TRIGGERS = Triggers(np.empty(0, np.int64), np.empty(0, np.uint8), np.empty(0, np.int8))
