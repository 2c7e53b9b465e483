"""Options for reading files of events that do not store all that is needed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import sensor

SHIFT_LIMIT_US = 1 << 62
"""Shifts of times are smaller, so that int64 holds the sum of two."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """What a file of events does not store.

    Parameters
    ----------
    size
        Width and height of the sensor, px, if the file does not store them.
    time_unit
        Unit of the times of a text file: s, ms, us or ns. Required if the times are whole numbers
        and no header line names the unit.
    sort
        Sort the events of text, AEDAT, DAT, ES or a bag by time. This needs all events in memory.
    topic
        Topic of a ROS bag, if several topics have events.
    """

    size: tuple[int, int] | None = None
    time_unit: str | None = None
    sort: bool = False
    topic: str | None = None

    def parts(self, path: str | Path, format: str | None) -> Iterator[sensor.Events]:
        """Read a file.

        Parameters
        ----------
        path, format
            As in `sensor.formats.read_events`.

        Returns
        -------
        Its events in parts.
        """
        from sensor.formats import read_events

        return read_events(path, format=format, **asdict(self))


AS_STORED = ReadOptions()
