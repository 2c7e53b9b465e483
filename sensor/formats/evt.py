"""Prophesee RAW files: the text header and the stream of words.

`evt2` and `evt3` encode and decode the words. The header:

    % event_count 1234                 ours: number of events, to detect truncated files
    % trigger_count 56                 ours: number of triggers, if there are any
    % evt 3.0
    % format EVT3;height=720;width=1280
    % geometry 1280x720
    % sensor_model {"width": 1280, ...}     ours: if the events have a model
    % origin {"seed": 3}                    ours
    % t0 1600000000000000                   faery's: offset of all times, microseconds
    % t_offset 1000000                      ours: start of the clock, if it is not t0
    % end

Lines are `% key value`; readers ignore unknown keys. Words follow, little-endian.
"""

from __future__ import annotations

import itertools
import logging
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from sensor.errors import EventFormatError, reading
from sensor.events import Columns, Events, no_events
from sensor.formats import batching
from sensor.formats.evt_systems import system_of
from sensor.formats.evt_words import (
    BACKWARDS,
    BAD_WORD,
    BAD_X,
    BAD_Y,
    CHANNEL_SHIFT,
    DONE,
    FOUND,
    FULL,
    HELD,
    LAST_US,
    NO_BASE,
    SKIPPED,
    STATE_SIZE,
    STEP_BACK_US,
    TRIGGER,
    Layout,
    Y,
    decode_triggers,
)
from sensor.formats.header import (
    Header,
    model_from_json,
    model_to_json,
    origin_from_json,
    origin_to_json,
)
from sensor.formats.triggers import NO_TRIGGERS, Triggers

_log = logging.getLogger(__name__)

MAX_SIDE_PX = 1 << 11  # coordinates have 11 bits
MAX_TIME_US = 1 << 40  # 12.7 days; up to there, EVT3's words of the clock take 1 MiB
_MAX_START_US = MAX_TIME_US // 2  # largest first time without an offset
_MOST = 1 << 62  # in the header
_READ_WORDS = 1 << 18
_WRITE_WORDS = 1 << 16
_COUNT_DIGITS = 20
_MAX_HEADER_BYTES = 1 << 20

_FIELDS = {
    *("evt", "format", "geometry", "endianness", "end"),
    *("event_count", "trigger_count", "sensor_model", "origin", "t0", "t_offset"),
}


@dataclass(frozen=True, slots=True)
class Codec:
    """The word format of one version.

    Parameters
    ----------
    name, version
        Names in the header, such as EVT3 and 3.0.
    word, layout
        Type of the words, and the fields in them.
    encode, decode
        As in `evt2`.
    """

    name: str
    version: str
    word: type[np.unsignedinteger]
    layout: Layout
    encode: Callable
    decode: Callable


def _new_state() -> np.ndarray:
    state = np.full(STATE_SIZE, -1, np.int64)
    state[[SKIPPED, HELD, STEP_BACK_US]] = 0
    return state


def write(path: Path, header: Header, parts: Iterable[Events], codec: Codec) -> int:
    """Write a RAW file."""
    width, height = header.size
    if max(width, height) > MAX_SIDE_PX:
        raise EventFormatError(
            f"{codec.name} has 11 bits for a coordinate: found a sensor of {width}x{height} px, "
            f"expected at most {MAX_SIDE_PX}x{MAX_SIDE_PX}"
        )
    lines = [
        f"evt {codec.version}",
        f"format {codec.name};height={height};width={width}",
        f"geometry {width}x{height}",
    ]
    if header.model is not None:
        lines.append(f"sensor_model {model_to_json(header.model)}")
    if header.origin:
        lines.append(f"origin {origin_to_json(header.origin)}")
    parts = iter(parts)
    first = next(parts)
    start_us = _start_us(int(first.t_us[0]) if len(first) else 0, header.t_offset_us)
    if start_us:
        lines.append(f"t0 {start_us}")
    if start_us != header.t_offset_us:
        lines.append(f"t_offset {header.t_offset_us}")
    triggers = header.triggers.later(-start_us)
    if len(triggers):
        lines.append(f"trigger_count {len(triggers)}")
    lines.append("end")
    _check_triggers(triggers, codec)
    written = 0
    count = 0
    with path.open("wb") as file:
        file.write(_count_line(0))
        file.write("".join(f"% {line}\n" for line in lines).encode())
        words = _Words(file, width, codec)
        for part in itertools.chain([first], parts):
            columns = part.columns._replace(t_us=part.t_us - start_us)
            t = columns.t_us
            if len(part) and not 0 <= t[0] <= t[-1] < MAX_TIME_US:
                wrong = t[0] if t[0] < 0 else t[-1]
                raise EventFormatError(
                    f"{codec.name}: found time {wrong} us, expected 0 to {MAX_TIME_US - 1} us; "
                    "subtract an offset first (--from-start, --shift-us)"
                )
            done = 0
            while len(part) and written < len(triggers) and triggers.t_us[written] <= t[-1]:
                stop = int(np.searchsorted(t, triggers.t_us[written]))
                words.put(columns.part(slice(done, stop)))
                words.put_trigger(triggers, written)
                done, written = stop, written + 1
            words.put(columns.part(slice(done, None)))
            count += len(part)
        for k in range(written, len(triggers)):
            words.put_trigger(triggers, k)
        file.seek(0)
        file.write(_count_line(count))
    return count


class _Words:
    """The words of a file that is being written."""

    def __init__(self, file: BinaryIO, width: int, codec: Codec) -> None:
        self._file = file
        self._width = width
        self._codec = codec
        self._state = _new_state()
        self._words = np.empty(_WRITE_WORDS, codec.word)

    def put(self, events: Columns, trigger: int | None = None) -> None:
        """Write events; with a trigger, write its word in place of that of the single event."""
        done = 0
        while done < len(events.t_us):
            rest = events.part(slice(done, None))
            taken, made = self._codec.encode(rest, self._width, self._state, self._words)
            words = self._words[:made]
            if trigger is not None and taken:
                words[-1] = words[-1] & self._codec.layout.time_bits | trigger
            self._file.write(words.astype(words.dtype.newbyteorder("<"), copy=False).data)
            done += taken

    def put_trigger(self, triggers: Triggers, k: int) -> None:
        """Write a trigger, with the words of the clock that an event at its time would have."""
        row = max(0, self._state[Y])
        event = Columns(
            triggers.t_us[k : k + 1],
            np.zeros(1, np.uint16),
            np.full(1, row, np.uint16),
            triggers.p[k : k + 1],
        )
        kind = TRIGGER << self._codec.layout.kind_shift
        self.put(event, kind | int(triggers.channel[k]) << CHANNEL_SHIFT | int(triggers.p[k] > 0))


def _check_triggers(triggers: Triggers, codec: Codec) -> None:
    if len(triggers) == 0:
        return
    first_us, last_us = triggers.t_us[[0, -1]]
    if first_us < 0 or last_us >= MAX_TIME_US:
        raise EventFormatError(
            f"{codec.name}: found triggers from {first_us} to {last_us} us, expected 0 to "
            f"{MAX_TIME_US - 1} us; shift the clock first (--shift-us)"
        )
    if triggers.channel.max() >= codec.layout.channels:
        raise EventFormatError(
            f"{codec.name}: found a trigger on channel {triggers.channel.max()}, expected 0 to "
            f"{codec.layout.channels - 1}"
        )


def end_us(start_us: int, t_offset_us: int) -> int:
    """Return the time before which events must end.

    Returns
    -------
    The time, us.
    """
    return _start_us(start_us, t_offset_us) + MAX_TIME_US


def _start_us(first_us: int, t_offset_us: int) -> int:
    """Return `t0`: the start of the clock if the times are too large without it."""
    if abs(t_offset_us) > _MOST:
        raise EventFormatError(
            f"found a clock that starts at {t_offset_us} us, expected at most 2^62 us from 0"
        )
    return t_offset_us if first_us >= _MAX_START_US and 0 < t_offset_us <= first_us else 0


def _count_line(count: int) -> bytes:
    return f"% event_count {count:<{_COUNT_DIGITS}}\n".encode()


@dataclass(frozen=True, slots=True)
class _Raw:
    """Content of the text header."""

    version: str | None  # of the words, "evt2" or "evt3"
    header: Header
    count: int | None
    trigger_count: int | None
    start_us: int  # that all times lack
    length: int  # bytes before the first word


def read_version(path: Path) -> str:
    """Return the version of a RAW file, `evt2` or `evt3`."""
    with reading(path, "Prophesee RAW"), path.open("rb") as file:
        version = _read_raw(file).version
    if version is None:
        raise EventFormatError(
            f"{path}: the header does not say which version of EVT it is; expected '% evt 3.0' or "
            "'% format EVT3;...', or the format by name (evt2, evt3)"
        )
    return version


def read_header(path: Path, codec: Codec) -> Header:
    """Read the header of a RAW file."""
    with path.open("rb") as file:
        return _of_version(_read_raw(file), codec).header


def _of_version(raw: _Raw, codec: Codec) -> _Raw:
    if raw.version not in (None, codec.name.lower()):
        raise EventFormatError(
            f"header: found words of version {raw.version}, expected {codec.name}"
        )
    return raw


def _read_raw(file: BinaryIO) -> _Raw:
    fields: dict[str, str] = {}
    length = 0
    ended = False
    while not ended:
        line = file.readline(_MAX_HEADER_BYTES)
        if not line.startswith((b"% ", b"%\n")):  # a word of an old file may begin with b"%"
            break
        length += len(line)
        if not line.endswith(b"\n") or length > _MAX_HEADER_BYTES:
            raise EventFormatError(f"byte {length}: the header breaks off within a line")
        with reading(f"byte {length - len(line)}: found {line[:40]!r}, expected a line of text"):
            key, _, value = line[1:].decode("utf-8").strip().partition(" ")
        ended = key == "end"
        fields[key] = value.strip()
    if not fields:
        raise EventFormatError("byte 0: found no header, expected lines that start with '%'")
    count = _number(fields, "event_count")
    if count is not None and not ended:
        raise EventFormatError(f"byte {length}: the header breaks off before '% end'")
    if fields.get("endianness", "little") != "little":
        raise EventFormatError("header, endianness: found big, expected little")
    width, height = _size(fields)
    start_us = _number(fields, "t0") or 0
    clock_us = _number(fields, "t_offset", least=-_MOST)
    header = Header(
        width,
        height,
        model_from_json(fields["sensor_model"]) if "sensor_model" in fields else None,
        origin_from_json(fields["origin"]) if "origin" in fields else {},
        start_us if clock_us is None else clock_us,
        tuple(name for name in fields if name and name not in _FIELDS),
    )
    triggers = _number(fields, "trigger_count")
    return _Raw(_version(fields), header, count, triggers, start_us, length)


def _number(fields: dict[str, str], name: str, least: int = 0) -> int | None:
    value = fields.get(name)
    if value is None:
        return None
    whole = re.fullmatch(r"-?\d{1,19}", value, re.ASCII) is not None
    if not whole or not least <= int(value) <= _MOST:
        raise EventFormatError(f"header, {name}: found {value[:40]!r}, expected a number")
    return int(value)


def _version(fields: dict[str, str]) -> str | None:
    said = set()
    if "evt" in fields:
        said.add({"2.0": "evt2", "3.0": "evt3"}.get(fields["evt"], fields["evt"]))
    if "format" in fields:
        said.add(fields["format"].split(";")[0].lower())
    if len(said) > 1 or not said <= {"evt2", "evt3"}:
        raise EventFormatError(
            f"header: found version {' and '.join(sorted(said))!r}, expected EVT2 or EVT3"
        )
    if not said and (system := system_of(fields)):
        return system.version
    return said.pop() if said else None


def _size(fields: dict[str, str]) -> tuple[int | None, int | None]:
    """Return width and height from `geometry` and `format`, which must be equal.

    Old files have neither; their number of the system gives the size.
    """
    said = set()
    if "geometry" in fields:
        match = re.fullmatch(r"(\d{1,9})x(\d{1,9})", fields["geometry"], re.ASCII)
        if match is None:
            raise EventFormatError(
                f"header, geometry: found {fields['geometry'][:40]!r}, expected WIDTHxHEIGHT"
            )
        said.add((int(match[1]), int(match[2])))
    options = dict(re.findall(r";\s*(\w+)=(\d{1,9})(?=;|$)", fields.get("format", ""), re.ASCII))
    if {"width", "height"} <= options.keys():
        said.add((int(options["width"]), int(options["height"])))
    if len(said) > 1:
        raise EventFormatError(f"header: found two sizes, {sorted(said)}, expected one")
    if not said and (system := system_of(fields)):
        return system.width, system.height
    return said.pop() if said else (None, None)


def read(path: Path, header: Header, codec: Codec) -> Iterator[Events]:
    """Read the events of a RAW file.

    Events before the first word with a time or a row are skipped, as in Prophesee's decoders; the
    log reports their number. Where the low part of the clock steps back, as in files of some
    cameras, events get the time of the event before them; the log reports this too.
    """
    width, height = header.size
    size = np.dtype(codec.word).itemsize
    none = no_events(width, height, header.model)
    state = _new_state()
    count = triggers = 0
    with path.open("rb") as file:
        raw = _of_version(_read_raw(file), codec)
        offset = raw.length
        yield none
        for words in _blocks(file, offset, codec):
            if raw.trigger_count is not None:
                triggers += _triggers_in(words, codec)
            while len(words):
                room = min(batching.PART_EVENTS, 12 * len(words))  # no word makes more than 12
                columns = Columns.room(room)
                taken, made, found = codec.decode(words, width, height, state, columns)
                columns.t_us[:made] += raw.start_us
                offset += size * taken
                if made:
                    count += made
                    yield Events.trusted(*columns.part(slice(made)), like=none)
                if found not in (DONE, FULL):
                    word = f"{words[taken]:#0{2 + 2 * size}x}"
                    raise EventFormatError(f"byte {offset}, word {word}: {_reason(found, state)}")
                words = words[taken:]
    _check_count(raw.trigger_count, triggers, "triggers", offset)
    held = int(state[HELD])
    if held:
        _log.warning(
            "%s: the clock steps back by up to %d us at %d words of events, which get the time of "
            "the event before them",
            *(path, state[STEP_BACK_US], held),
        )
    skipped = int(state[SKIPPED])
    _check_count(raw.count, count, "events", offset)
    if skipped:
        _log.warning(
            "%s: skipped %d events before the first time and row of the stream", path, skipped
        )


def _blocks(file: BinaryIO, offset: int, codec: Codec) -> Iterator[np.ndarray]:
    """Yield the words from a byte on; refuse a part of a word at the end."""
    size = np.dtype(codec.word).itemsize
    file.seek(offset)
    while data := file.read(size * _READ_WORDS):
        words = np.frombuffer(data, f"<u{size}", len(data) // size)
        yield words.astype(codec.word, copy=False)  # on a big-endian machine
        offset += words.nbytes
        if len(data) % size:
            raise EventFormatError(f"byte {offset}: the file ends within a word of {size} bytes")


def _triggers_in(words: np.ndarray, codec: Codec) -> int:
    return int(np.count_nonzero(words >> codec.layout.kind_shift == TRIGGER))


def _check_count(expected: int | None, found: int, what: str, offset: int) -> None:
    """Refuse a file whose header has another number of events or triggers."""
    if expected is not None and expected != found:
        raise EventFormatError(
            f"byte {offset}: the file ends after {found} {what}, expected {expected} as its "
            "header says; the file is truncated or damaged"
        )


def read_triggers(path: Path, codec: Codec) -> Triggers:
    """Read the external triggers of a RAW file, from all of its words."""
    state = _new_state()
    found = []
    count = 0
    with path.open("rb") as file:
        raw = _of_version(_read_raw(file), codec)
        offset = raw.length
        for words in _blocks(file, offset, codec):
            room = _triggers_in(words, codec)
            columns = np.empty(room, np.int64), np.empty(room, np.uint8), np.empty(room, np.int8)
            made = decode_triggers(words, codec.layout, state, *columns)
            found.append([column[:made] for column in columns])
            count += room
            offset += words.nbytes
    _check_count(raw.trigger_count, count, "triggers", offset)
    if not found:
        return NO_TRIGGERS
    t_us, channel, p = (np.concatenate(column) for column in zip(*found, strict=True))
    return Triggers(t_us + raw.start_us, channel, p)


def _reason(found: int, state: np.ndarray) -> str:
    return {
        BAD_X: f"found x = {state[FOUND]}, outside the sensor",
        BAD_Y: f"found y = {state[FOUND]}, outside the sensor",
        BACKWARDS: f"found time {state[FOUND]} us after {state[LAST_US]} us",
        BAD_WORD: "found a word of a type that the format does not have",
        NO_BASE: "found a vector of events before any word that says where it starts",
    }[found]
