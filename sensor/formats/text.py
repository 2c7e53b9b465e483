"""Text as in the RPG datasets: a line `width height`, then a line `t x y p` for each event.

t is in seconds with six decimals, p is 0 or 1. Files without the first line need the size of the
sensor. Further decimals are rounded to microseconds.

The reader also accepts the text of other programs: commas or tabs between the numbers, exponents,
p of -1 and 1, comments (`#`, `%`) and a line of names such as `t_us,x,y,p` at the start, which
gives the order of the columns and perhaps the unit of time.
"""

from __future__ import annotations

import codecs
import logging
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sensor.errors import EventFormatError
from sensor.events import Columns, Events, no_events
from sensor.formats import batching
from sensor.formats.compiling import jit
from sensor.formats.header import Header
from sensor.time_units import TIME_UNITS

_log = logging.getLogger(__name__)

_LINE_BYTES = 40  # the longest line written: sign, 13 + 1 + 6 digits of time, 5, 5, 1, 4 separators
_READ_BYTES = 1 << 22
_MAX_LINE_BYTES = 256  # longest line of an event
_MAX_COMMENT_BYTES = 1 << 16
_MIN_LINE_BYTES = 8  # "0 0 0 0\n"
_SAMPLE_BYTES = 1 << 16  # of events, whose times show whether their unit is clear
_DECIMALS = 6  # of seconds as we and others write them; pandas writes whole floats as 1500.0

_DONE, _FULL, _BAD_LINE, _BAD_X, _BAD_Y, _BAD_P, _MIXED_P, _BACKWARDS = range(8)
_REASONS = {
    _BAD_LINE: "expected four numbers, of which only the time may have a fraction: {order}",
    _BAD_X: "x is outside the sensor",
    _BAD_Y: "y is outside the sensor",
    _BAD_P: "expected p to be 0 or 1, or -1 or 1",
    _MIXED_P: "OFF events have p = 0 in some lines and p = -1 in others; use the same p in all",
    _BACKWARDS: "the time is earlier than the previous time (--sort or sort=True sorts the events)",
}
_MAX_SECONDS = 9 * 10**12  # what int64 microseconds hold, nearly

_NAMES = {"x": "x", "y": "y"}
_NAMES |= dict.fromkeys(("t", "ts", "time", "timestamp", "timestamps"), "t")
_NAMES |= dict.fromkeys(("p", "pol", "polarity", "polarities", "on"), "p")
_COLUMNS = "txyp"

_TAB, _NEWLINE, _RETURN, _SPACE, _MINUS, _POINT, _ZERO, _NINE = (ord(c) for c in "\t\n\r -.09")
_PLUS, _COMMA, _SMALL_E, _LARGE_E = (ord(c) for c in "+,eE")
_POWERS = 10 ** np.arange(19, dtype=np.int64)
_MOST = np.iinfo(np.int64).max
_MAX_DIGITS = (_MOST - 9) // 10  # another digit still fits into int64

LAST_US, DARKER = range(2)  # entries of the reader's state: last time, p of darker events
_UNKNOWN = np.iinfo(np.int64).min  # p of no file


@jit
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


@jit
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


@jit
def _skip_blanks(data, at):
    while data[at] == _SPACE or data[at] == _TAB or data[at] == _RETURN:
        at += 1
    return at


@jit
def _skip_separator(data, at):
    at = _skip_blanks(data, at)
    return _skip_blanks(data, at + 1) if data[at] == _COMMA else at


@jit
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


@jit
def _plain_line(data, at):
    """Parse a line as we write it; return t, x, y, p and the end position, -1 for other lines."""
    none = np.int64(0)
    second, at = _integer(data, at, _MAX_SECONDS)
    if second < 0 or data[at] != _POINT:
        return none, none, none, none, -1
    micro, end = _integer(data, at + 1, 999_999)
    if end != at + 7 or data[end] != _SPACE:
        return none, none, none, none, -1
    x, at = _integer(data, end + 1, 1 << 16)
    if x < 0 or data[at] != _SPACE:
        return none, none, none, none, -1
    y, at = _integer(data, at + 1, 1 << 16)
    if y < 0 or data[at] != _SPACE:
        return none, none, none, none, -1
    p, at = _integer(data, at + 1, 1)
    if p < 0 or data[at] != _NEWLINE:
        return none, none, none, none, -1
    return second * 1_000_000 + micro, x, y, p, at


@jit
def _number(data, at, power, rounded):
    """Parse a decimal, perhaps with an exponent, and multiply it by 10^power.

    Return the value and the end position, -1 if it is not a number, or not whole and not rounded.
    """
    negative = data[at] == _MINUS
    if negative or data[at] == _PLUS:
        at += 1
    value = np.int64(0)
    start = at
    dropped = np.int64(-1)  # the first digit that int64 cannot hold
    after_point = False
    while _ZERO <= data[at] <= _NINE or (data[at] == _POINT and not after_point):
        if data[at] == _POINT:
            after_point = True
        elif dropped < 0 and value <= _MAX_DIGITS:
            value = value * 10 + (np.int64(data[at]) - _ZERO)
            power -= after_point
        else:
            dropped = np.int64(data[at]) - _ZERO if dropped < 0 else dropped
            power += not after_point
        at += 1
    if at == start + after_point:
        return value, -1
    if data[at] == _SMALL_E or data[at] == _LARGE_E:
        below = data[at + 1] == _MINUS
        exponent, at = _integer(data, at + 1 + (below or data[at + 1] == _PLUS), 9999)
        if exponent < 0:
            return value, -1
        power += -exponent if below else exponent
    value = _scaled(value, power, dropped, rounded)
    return (-value if negative else value), (at if value >= 0 else -1)


@jit
def _scaled(value, power, dropped, rounded):
    """Multiply by 10^power; return -1 if that is too large, or not whole and not rounded.

    `dropped` is the digit after the last one of `value`, or negative.
    """
    if value == 0:
        return value
    if power > 0:
        too_large = power > 18 or value > _MOST // _POWERS[min(power, 18)]
        return np.int64(-1) if too_large else value * _POWERS[power]
    if power == 0:
        return value + (rounded and dropped >= 5)
    if power < -18:  # less than 1, and only at -19 perhaps at least 1/2
        half = power == -19 and value >= _POWERS[18] * 5
        return np.int64(half if rounded else -1)
    unit = _POWERS[-power]
    rest = value % unit
    if rest and not rounded:
        return np.int64(-1)
    return value // unit + (rest >= unit - rest)


@jit
def _any_line(data, at, order, power):
    """Parse four numbers in any order; return t, x, y, p and the end position, -1 if wrong."""
    value = np.zeros(4, np.int64)
    for k in range(4):
        before = at
        if k > 0:
            at = _skip_separator(data, at)
        is_time = order[k] == 0
        value[order[k]], end = _number(data, at, power if is_time else 0, is_time)
        if end < 0 or (k > 0 and at == before):
            return value[0], value[1], value[2], value[3], -1
        at = end
    at = _skip_blanks(data, at)
    good = data[at] == _NEWLINE and abs(value[0]) <= _MAX_SECONDS * 1_000_000
    return value[0], value[1], value[2], value[3], at if good else -1


@jit
def _parse_lines(data, width, height, order, power, sort, state, events):
    """Parse (n,) uint8 lines into events; return (bytes taken, events done, why it stopped).

    The data end with a newline. `order` has the column of each number of a line, 0 to 3 for t, x,
    y, p; 10^`power` makes microseconds of the times. With `sort` they may run backwards.
    """
    t, x, y, p = events
    usual = power == 6 and order[0] == 0 and order[1] == 1 and order[2] == 2
    last = state[LAST_US]
    darker = state[DARKER]
    done = 0
    at = 0
    stop = _DONE
    while at < data.size:
        line = at
        end = -1
        if usual:
            time, column, row, polarity, end = _plain_line(data, at)
        if end < 0:
            at = _skip_blanks(data, at)
            if data[at] == _NEWLINE:
                at += 1
                continue
            time, column, row, polarity, end = _any_line(data, at, order, power)
        if end < 0:
            stop = _BAD_LINE
        elif not 0 <= column < width:
            stop = _BAD_X
        elif not 0 <= row < height:
            stop = _BAD_Y
        elif time < last and not sort:
            stop = _BACKWARDS
        elif polarity != 1 and polarity != darker:
            if darker == _UNKNOWN and (polarity == 0 or polarity == -1):
                darker = polarity
            else:
                stop = _MIXED_P if polarity == 0 or polarity == -1 else _BAD_P
        if done == t.size:
            stop = _FULL
        if stop != _DONE:
            at = line
            break
        last = time
        t[done] = time
        x[done] = column
        y[done] = row
        p[done] = 1 if polarity > 0 else -1
        done += 1
        at = end + 1
    state[LAST_US] = last
    state[DARKER] = darker
    return at, done, stop


def write(path: Path, header: Header, parts: Iterable[Events]) -> int:
    """Write a text file, without model and origin."""
    count = 0
    with path.open("wb") as file:
        file.write(f"{header.width} {header.height}\n".encode())
        for part in parts:
            if len(part) and max(-int(part.t_us[0]), int(part.t_us[-1])) >= _MAX_SECONDS * 10**6:
                raise EventFormatError(
                    f"text: found times from {part.t_us[0]} to {part.t_us[-1]} us, expected less "
                    f"than {_MAX_SECONDS} s from 0"
                )
            out = np.empty(_LINE_BYTES * len(part), np.uint8)
            used = _format_lines(part.columns, out)
            file.write(out[:used].data)
            count += len(part)
    return count


@dataclass(frozen=True, slots=True)
class _Start:
    """Content of the lines before the events."""

    header: Header
    order: tuple[int, ...]  # the column of each number of a line, as in `_COLUMNS`
    time_unit: str | None
    length: int  # bytes before the events


def read_header(path: Path) -> Header:
    """Read the size of the sensor from the first line, if the file has it."""
    return _read_start(path).header


def _read_start(path: Path) -> _Start:
    size: tuple[int, int] | tuple[None, None] = (None, None)
    order: tuple[int, ...] = (0, 1, 2, 3)
    unit = None
    with path.open("rb") as file:
        if file.read(len(codecs.BOM_UTF8)) != codecs.BOM_UTF8:
            file.seek(0)
        first = length = file.tell()
        while True:
            line = file.readline(_MAX_COMMENT_BYTES)
            words = line.replace(b",", b" ").split()
            whole = line.endswith(b"\n")
            short = whole and len(line) <= _MAX_LINE_BYTES
            names = _named_columns(line) if short else None
            if names is not None:
                order, unit = names
            elif short and len(words) == 2 and all(word.isdigit() for word in words):
                sides = int(words[0]), int(words[1])
                if size not in ((None, None), sides):
                    raise EventFormatError(f"byte {length}: found another size, {line!r}")
                size = sides
            elif line[:1] not in (b"#", b"%") or not whole:
                if length > first or len(words) == 4:  # the parser reports a bad event
                    return _Start(Header(*size), order, unit, length)
                raise EventFormatError(
                    f"byte {length}: found {line[:60]!r}, expected a line 'width height', a line "
                    "of names such as 't x y p', or an event 't x y p'"
                )
            length += len(line)


def _named_columns(line: bytes) -> tuple[tuple[int, ...], str | None] | None:
    """Return the order of the columns and the unit of time that a line of names gives."""
    text = line.decode("utf-8", "replace").lower().lstrip("#% ")
    words = re.sub(r"\s*[\[(]\s*(\w+)\s*[\])]", r"_\1", text).replace(",", " ").split()
    names, unit = [], None
    for word in words:
        name, _, suffix = word.strip("\"'").partition("_")
        if suffix and name != word and _NAMES.get(name) == "t":
            if suffix not in TIME_UNITS:
                return None
            unit = suffix
        elif suffix:
            return None
        names.append(_NAMES.get(name, ""))
    if sorted(names) != sorted(_COLUMNS):
        return None
    return tuple(_COLUMNS.index(name) for name in names), unit


def _power(path: Path, start: _Start, time_unit: str | None) -> int:
    """Return the power of ten from the file's unit of time to microseconds."""
    if time_unit is not None and time_unit not in TIME_UNITS:
        raise EventFormatError(
            f"time_unit: found {time_unit!r}, expected one of {', '.join(TIME_UNITS)}"
        )
    if None not in (time_unit, start.time_unit) and time_unit != start.time_unit:
        raise EventFormatError(
            f"time_unit: the line of names says {start.time_unit}, not the given {time_unit}"
        )
    unit = time_unit or start.time_unit
    if unit is None and (whole := _whole_times(path, start)):
        raise EventFormatError(
            f"byte {start.length}: the times, {', '.join(whole[:3])}, are whole numbers, and may "
            "be seconds or microseconds; give their unit (time_unit='us', --time-unit us)"
        )
    return TIME_UNITS[unit or "s"]


def _whole_times(path: Path, start: _Start) -> list[str]:
    """Return the first times of the file if all are whole numbers, so that the unit is unclear."""
    with path.open("rb") as file:
        file.seek(start.length)
        lines = file.read(_SAMPLE_BYTES).replace(b",", b" ").splitlines()
    place = start.order.index(0)
    times = [words[place].decode("latin-1") for line in lines if len(words := line.split()) == 4]
    try:
        has_fraction = any(
            float(time) % 1
            or (len(time.partition(".")[2]) >= _DECIMALS and "e" not in time.lower())
            for time in times
        )
    except ValueError:  # the parser reports the line
        has_fraction = True
    return [] if has_fraction else times


def read(
    path: Path, header: Header, *, time_unit: str | None = None, sort: bool = False
) -> Iterator[Events]:
    """Read the events of a text file; the default unit is in the line of names, or seconds.

    A file that is truncated between two lines looks complete. If the last line does not end, so
    that its last number may lack digits, the log has a warning.
    """
    start = _read_start(path)
    power = _power(path, start, time_unit)
    none = no_events(*header.size, header.model)
    parts = _parts(path, start, power, sort, none)
    yield none
    yield from batching.by_time(parts) if sort else parts


def _parts(path: Path, start: _Start, power: int, sort: bool, none: Events) -> Iterator[Events]:
    state = np.array([np.iinfo(np.int64).min, _UNKNOWN])
    order = np.array(start.order)
    rest = b""
    with path.open("rb") as file:
        offset = start.length
        file.seek(offset)
        ended = False
        while not ended:
            data = file.read(_READ_BYTES)
            ended = not data
            data = rest + data
            if ended and data and not data.endswith(b"\n"):
                data += b"\n"  # the last line may lack it
                if start.order[-1] != _COLUMNS.index("p"):  # p has one digit
                    _log.warning(
                        "%s: the last line has no line end; if the file is truncated, the last "
                        "event has a wrong %s",
                        path,
                        {"t": "time"}.get(_COLUMNS[start.order[-1]], "pixel"),
                    )
            whole = data.rfind(b"\n") + 1
            rest = data[whole:]
            if len(rest) > _MAX_LINE_BYTES:
                raise EventFormatError(
                    f"byte {offset + whole}: found no end of line within {_MAX_LINE_BYTES} bytes"
                )
            lines = np.frombuffer(data, np.uint8, whole)
            while len(lines):
                room = min(batching.PART_EVENTS, len(lines) // _MIN_LINE_BYTES + 1)
                columns = Columns.room(room)
                taken, done, stop = _parse_lines(
                    lines, none.width, none.height, order, power, sort, state, columns
                )
                offset += taken
                if done:
                    yield Events.trusted(*columns.part(slice(done)), like=none)
                lines = lines[taken:]
                if stop not in (_DONE, _FULL):
                    line = lines[:60].tobytes().split(b"\n")[0]
                    expected = " ".join(_COLUMNS[k] for k in start.order)
                    reason = _REASONS[stop].format(order=expected)
                    raise EventFormatError(f"byte {offset}: found {line!r}: {reason}")
