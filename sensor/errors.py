"""Errors of the sensor package, and advice in them."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from errno import EINVAL

_MAX_CHARACTERS = 500  # of a library's message, which may quote the file


class SensorError(ValueError):
    """Frames, times or a sensor model cannot be simulated.

    Examples
    --------
    >>> from sensor import SensorModel
    >>> SensorModel(width=0, height=260)
    Traceback (most recent call last):
    sensor.errors.SensorError: SensorModel.width: found 0, expected an integer in 1..65536
    """


class EventError(ValueError):
    """Arrays are not a valid event stream; the message names the field.

    Examples
    --------
    Files often have 0 for darker; `Events` have -1:

    >>> import numpy as np
    >>> from sensor import Events
    >>> t_us, pixel = np.array([10, 20]), np.array([3, 4], np.uint16)
    >>> Events(t_us, pixel, pixel, np.array([0, 1], np.int8), width=346, height=260)
    Traceback (most recent call last):
    sensor.errors.EventError: Events.p: found values other than +1 and -1
    """


class EventFormatError(EventError):
    """An event file is damaged or cannot store the events; the message names the file and place.

    Examples
    --------
    >>> from pathlib import Path
    >>> from sensor.formats import load_events
    >>> _ = Path("bare.txt").write_text("0.000334 17 201 1")
    >>> load_events("bare.txt")
    Traceback (most recent call last):
    sensor.errors.EventFormatError: bare.txt: the file does not store the sensor's size; ...
    >>> load_events("bare.txt", size=(346, 260))
    Events(1 of 346x260 px, 334..334 us)
    """


@contextmanager
def reading(
    place: object, format: str = "", error: type[ValueError] = EventFormatError
) -> Iterator[None]:
    """Turn any failure to read a file into an error that starts with the file's name.

    Libraries raise errors of any class on damaged files, so all are caught. System errors, such as
    a missing file, keep their class and get the file's name. `format` is what the file is read as,
    for errors of libraries; "" for a place in it.
    """
    try:
        yield
    except (EventError, SensorError) as reason:  # which say what is wrong
        raise error(f"{place}: {reason}") from reason
    except Exception as reason:
        # A damaged offset is EINVAL; libraries that describe the content give no number.
        if isinstance(reason, OSError) and reason.errno not in (None, EINVAL):
            if not format or reason.filename is not None:
                raise
            raise OSError(reason.errno, reason.strerror, str(place)) from reason
        what = f"could not be read as {format}: " if format else ""
        raise error(f"{place}: {what}{_in_one_line(reason)}") from reason


def _in_one_line(error: Exception) -> str:
    """Return the text of an error, or its name if it has none."""
    if isinstance(error, RecursionError):
        return "nested too deeply"
    return " ".join(str(error).split())[:_MAX_CHARACTERS] or type(error).__name__


def suggestion(name: str, names: Collection[str], others: str = "") -> str:
    """Return the advice for an unknown name: a similar one, or all names."""
    close = difflib.get_close_matches(name.lower(), names, n=1)
    return f"did you mean {close[0]!r}?" if close else f"expected {others}one of {', '.join(names)}"
