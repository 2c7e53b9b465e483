"""`DsecReader`: any part of a DSEC file, without reading what precedes it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sensor.errors import EventFormatError, reading
from sensor.events import Events, no_events, whole_us
from sensor.formats import dsec
from sensor.formats.hdf5_file import check_stored, load_h5py


class DsecReader:
    """A DSEC file that stays open, for windows in any order.

    Only the chunks of 65536 events that overlap a window are read. After a fork, open the file
    again. `close`, or a `with` statement, closes it.

    Parameters
    ----------
    path
        The file.
    size
        (width, height) of the sensor, for files that do not store it.

    Raises
    ------
    EventFormatError
        The file is damaged or has no index of milliseconds, or no size is stored or given.
    OSError
        The file cannot be read.

    Examples
    --------
    >>> import numpy as np
    >>> from sensor import Events
    >>> from sensor.formats import write_events
    >>> from sensor.formats.dsec_reader import DsecReader
    >>> t_us, pixel = np.arange(0, 100_000, 10), np.zeros(10_000, np.uint16)
    >>> p = np.ones(10_000, np.int8)
    >>> write_events("long.h5", Events(t_us, pixel, pixel, p, width=346, height=260))
    10000
    >>> reader = DsecReader("long.h5")
    >>> reader
    DsecReader(10000 events of 346x260 px, 'long.h5')
    >>> reader.between(70_000, 70_100)
    Events(10 of 346x260 px, 70000..70090 us)
    >>> reader.part(0, 3)
    Events(3 of 346x260 px, 0..20 us)
    """

    def __init__(self, path: str | Path, size: tuple[int, int] | None = None) -> None:
        path = Path(path)
        path.open("rb").close()  # raises OSError if the file is missing or not readable
        self.path = path
        with reading(self.path, dsec.TITLE):
            self.header = dsec.read_header(path).with_size(size)
            self.file = load_h5py().File(path, "r")
            try:
                names = [f"events/{name}" for name in ("t", "x", "y", "p")]
                self._columns = {name[-1]: dsec.integers(self.file, name) for name in names}
                check_stored(*self._columns.values())
                self._ms_to_idx = dsec.integers(self.file, "ms_to_idx")
            except BaseException:
                self.close()
                raise

    def __enter__(self) -> DsecReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self.file.close()

    def __repr__(self) -> str:
        size = f"{self.header.width}x{self.header.height} px"
        return f"DsecReader({len(self)} events of {size}, {str(self.path)!r})"

    def __len__(self) -> int:
        return len(self._columns["t"])

    def index_at(self, t_us: int) -> int:
        """Return the number of events before a time, whole microseconds.

        Raises
        ------
        EventError
            The time is not a whole number.
        EventFormatError
            The file is damaged.
        """
        t_us = whole_us("DsecReader", "t_us", t_us) - self.header.t_offset_us
        if t_us <= 0:
            return 0
        ms = t_us // 1000
        with reading(self.path, dsec.TITLE):
            known = len(self._ms_to_idx)  # later times are within the last millisecond, or later
            first = int(self._ms_to_idx[min(ms, known - 1)]) if known else 0
            stop = int(self._ms_to_idx[ms + 1]) if ms + 1 < known else len(self)
            t = self._columns["t"]
            is_damaged = not first <= stop <= len(self)
            index = 0 if is_damaged else first + int(np.searchsorted(t[first:stop], t_us))
            after_others = index > first or index == 0 or t[index - 1] < t_us
            before_others = index < stop or index == len(self) or t[index] >= t_us
            if is_damaged or not (after_others and before_others):
                raise EventFormatError(f"ms_to_idx: disagrees with events/t near {ms} ms")
            return index

    def part(self, first: int, stop: int) -> Events:
        """Return events by their index in the file.

        Parameters
        ----------
        first, stop
            Range of indices, as in a slice.

        Returns
        -------
        Events

        Raises
        ------
        EventFormatError
            The events are damaged.
        """
        first, stop, _ = slice(first, stop).indices(len(self))
        if first >= stop:
            return no_events(*self.header.size, self.header.model)
        with reading(self.path, dsec.TITLE):
            values = {name: column[first:stop] for name, column in self._columns.items()}
            return dsec.checked(values, first, self.header.t_offset_us, self.header)

    def between(self, t_start_us: int, t_end_us: int) -> Events:
        """Return the events in a half-open window of time.

        Parameters
        ----------
        t_start_us, t_end_us
            The window [t_start_us, t_end_us), microseconds.

        Returns
        -------
        Events

        Raises
        ------
        EventError
            A time is not an integer, so it may be in seconds.
        EventFormatError
            The events are damaged.
        """
        return self.part(self.index_at(t_start_us), self.index_at(t_end_us))
