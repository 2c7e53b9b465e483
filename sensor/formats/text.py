"""Text as in the RPG datasets: a line `width height`, then a line `t x y p` for each event.

t is in seconds with six decimals, p is 0 or 1. Files without the first line need the size of the
sensor. Further decimals are rounded to microseconds.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numba
import numpy as np

from sensor.errors import EventFormatError
from sensor.events import Columns, Events, no_events
from sensor.formats import batching
from sensor.formats.header import Header

_LINE_BYTES = 40  # the longest line written: sign, 13 + 1 + 6 digits of time, 5, 5, 1, 4 separators
_READ_BYTES = 1 << 22
_MAX_LINE_BYTES = 256  # longest line read
_SHORTEST_LINE_BYTES = 8  # "0 0 0 0\n"

_DONE, _FULL, _BAD_LINE, _BAD_X, _BAD_Y, _BAD_P, _BACKWARDS = range(7)
_REASONS = {
    _BAD_LINE: "expected a time in seconds as a plain decimal, then x, y and p",
    _BAD_X: "x is outside the sensor",
    _BAD_Y: "y is outside the sensor",
    _BAD_P: "expected p to be 0 or 1",
    _BACKWARDS: "the time is earlier than the one before it",
}
_MAX_SECONDS = 9 * 10**12  # what int64 microseconds hold, nearly

_TAB, _NEWLINE, _RETURN, _SPACE, _MINUS, _POINT, _ZERO, _NINE = (ord(c) for c in "\t\n\r -.09")


@numba.njit(cache=True, nogil=True)
def _put_digits(out, at, value, digits):
    """Write `value` in decimal with at least `digits` digits; return the end position."""
    power = np.int64(1)
    count = 1
    while count < digits or (count < 19 and value // power >= 10):
        power *= 10
        count += 1
    while power > 0:
        out[at] = _ZERO + (value // power) % 10
        at += 1
        power //= 10
    return at


@numba.njit(cache=True, nogil=True)
def _format_lines(events, out):
    """Write columns of events as lines into (n,) uint8; return the bytes used."""
    t, x, y, p = events
    at = 0
    for i in range(t.size):
        time = t[i]
        if time < 0:
            out[at] = _MINUS
            at += 1
            time = -time
        at = _put_digits(out, at, time // 1_000_000, 1)
        out[at] = _POINT
        at = _put_digits(out, at + 1, time % 1_000_000, 6)
        out[at] = _SPACE
        at = _put_digits(out, at + 1, np.int64(x[i]), 1)
        out[at] = _SPACE
        at = _put_digits(out, at + 1, np.int64(y[i]), 1)
        out[at] = _SPACE
        out[at + 1] = _ZERO + (p[i] > 0)
        out[at + 2] = _NEWLINE
        at += 3
    return at


@numba.njit(cache=True, nogil=True)
def _skip_blanks(data, at):
    while data[at] == _SPACE or data[at] == _TAB or data[at] == _RETURN:
        at += 1
    return at


@numba.njit(cache=True, nogil=True)
def _integer(data, at, most):
    """Parse digits; return their value (-1 if missing or above `most`) and the end position."""
    value = np.int64(0)
    start = at
    while _ZERO <= data[at] <= _NINE:
        value = value * 10 + (np.int64(data[at]) - _ZERO)
        if value > most:
            return np.int64(-1), at
        at += 1
    return (value if at > start else np.int64(-1)), at


@numba.njit(cache=True, nogil=True)
def _parse_lines(data, width, height, last, events):
    """Parse (n,) uint8 that ends with a newline into columns of events.

    Return (bytes taken, events made, why it stopped, the last time).
    """
    t, x, y, p = events
    made = 0
    at = 0
    while at < data.size:
        line = at
        at = _skip_blanks(data, at)
        if data[at] == _NEWLINE:
            at += 1
            continue
        if made == t.size:
            return line, made, _FULL, last
        negative = data[at] == _MINUS
        if negative:
            at += 1
        seconds, at = _integer(data, at, _MAX_SECONDS)
        if seconds < 0:
            return line, made, _BAD_LINE, last
        micro = np.int64(0)
        if data[at] == _POINT:
            at += 1
            scale = 100_000
            first_dropped = True
            while _ZERO <= data[at] <= _NINE:
                digit = np.int64(data[at]) - _ZERO
                if scale > 0:
                    micro += digit * scale
                    scale //= 10
                elif first_dropped:
                    micro += digit >= 5
                    first_dropped = False
                at += 1
        time = seconds * 1_000_000 + micro
        if negative:
            time = -time
        if data[at] != _SPACE and data[at] != _TAB:
            return line, made, _BAD_LINE, last
        column, at = _integer(data, _skip_blanks(data, at), 1 << 32)
        if column < 0 or (data[at] != _SPACE and data[at] != _TAB):
            return line, made, _BAD_LINE, last
        row, at = _integer(data, _skip_blanks(data, at), 1 << 32)
        if row < 0 or (data[at] != _SPACE and data[at] != _TAB):
            return line, made, _BAD_LINE, last
        polarity, at = _integer(data, _skip_blanks(data, at), 1 << 32)
        at = _skip_blanks(data, at)
        if polarity < 0 or polarity > 1:
            return line, made, _BAD_P, last
        if data[at] != _NEWLINE:
            return line, made, _BAD_LINE, last
        if column >= width:
            return line, made, _BAD_X, last
        if row >= height:
            return line, made, _BAD_Y, last
        if time < last:
            return line, made, _BACKWARDS, last
        last = time
        t[made] = time
        x[made] = column
        y[made] = row
        p[made] = 2 * polarity - 1
        made += 1
        at += 1
    return at, made, _DONE, last


def write(path: Path, header: Header, parts: Iterable[Events]) -> int:
    """Write a text file, without model and origin.

    Parameters
    ----------
    path
        The new file.
    header
        Size, model, origin and start of the clock.
    parts
        Consecutive parts of one stream.

    Returns
    -------
    int
        Number of events.

    Raises
    ------
    EventFormatError
        A time is beyond 9e12 seconds.
    """
    count = 0
    with path.open("wb") as file:
        file.write(f"{header.width} {header.height}\n".encode())
        for part in parts:
            if len(part) and max(-int(part.t_us[0]), int(part.t_us[-1])) >= _MAX_SECONDS * 10**6:
                raise EventFormatError(
                    f"text: found times from {part.t_us[0]} to {part.t_us[-1]} us, expected less "
                    f"than {_MAX_SECONDS} s"
                )
            out = np.empty(_LINE_BYTES * len(part), np.uint8)
            used = _format_lines(part.columns, out)
            file.write(out[:used].data)
            count += len(part)
    return count


def read_header(path: Path) -> Header:
    """Read the size of the sensor from the first line, if the file has it.

    Raises
    ------
    EventFormatError
        The first line is neither a size nor an event.
    """
    return _read_first_line(path)[0]


def _read_first_line(path: Path) -> tuple[Header, int]:
    """Return the header and the byte at which the events start."""
    with path.open("rb") as file:
        line = file.readline(_MAX_LINE_BYTES)
    words = line.split()
    if len(words) == 2 and line.endswith(b"\n") and all(w.isdigit() for w in words):
        return Header(int(words[0]), int(words[1])), len(line)
    if len(words) == 4:
        return Header(None, None), 0
    raise EventFormatError(
        f"byte 0: found {line[:60]!r}, expected a line 'width height' or an event 't x y p'"
    )


def read(path: Path, header: Header) -> Iterator[Events]:
    """Read the events of a text file.

    A file that is truncated between two lines looks complete.

    Parameters
    ----------
    path
        The file.
    header
        Its header, with a size.

    Yields
    ------
    Events
        At least one part.

    Raises
    ------
    EventFormatError
        A line is not an event of this sensor, or earlier than the one before it.
    """
    width, height = header.width or 0, header.height or 0
    none = no_events(width, height, header.model)
    last = np.iinfo(np.int64).min
    rest = b""
    with path.open("rb") as file:
        offset = _read_first_line(path)[1]
        file.seek(offset)
        yield none
        ended = False
        while not ended:
            data = file.read(_READ_BYTES)
            ended = not data
            data = rest + data
            if ended and data and not data.endswith(b"\n"):
                data += b"\n"  # the last line may lack it
            whole = data.rfind(b"\n") + 1
            rest = data[whole:]
            if len(rest) > _MAX_LINE_BYTES:
                raise EventFormatError(f"byte {offset + whole}: found a line without end")
            lines = np.frombuffer(data, np.uint8, whole)
            while len(lines):
                room = min(batching.PART_EVENTS, len(lines) // _SHORTEST_LINE_BYTES + 1)
                columns = Columns.room(room)
                taken, made, found, last = _parse_lines(lines, width, height, last, columns)
                offset += taken
                if made:
                    yield Events.trusted(*columns.part(slice(made)), like=none)
                lines = lines[taken:]
                if found not in (_DONE, _FULL):
                    line = lines[:60].tobytes().split(b"\n")[0]
                    raise EventFormatError(f"byte {offset}: found {line!r}: {_REASONS[found]}")
