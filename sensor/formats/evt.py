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
from sensor.formats import batching, evt_words
from sensor.formats.evt_systems import system_of
from sensor.formats.evt_words import Layout, decode_triggers
from sensor.formats.header import Header, facts_from_json, facts_to_json
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
    """The word format of one version, with its names in the header, such as EVT3 and 3.0."""

    name: str
    version: str
    word: type[np.unsignedinteger]
    layout: Layout
    encode: Callable
    decode: Callable


def _new_state() -> np.ndarray:
    state = np.full(evt_words.STATE_SIZE, -1, np.int64)
    state[[evt_words.SKIPPED, evt_words.HELD, evt_words.STEP_BACK_US]] = 0
    return state


def write(path: Path, header: Header, parts: Iterable[Events], codec: Codec) -> int:
    """Write a RAW file."""
    width, height = header.size
    if max(width, height) > MAX_SIDE_PX:
        raise EventFormatError(
            f"{codec.name}: the sensor has {width}x{height} px, but coordinates of 11 bits hold at "
            f"most {MAX_SIDE_PX}x{MAX_SIDE_PX} px"
        )
    lines = [
        f"evt {codec.version}",
        f"format {codec.name};height={height};width={width}",
        f"geometry {width}x{height}",
    ]
    facts = facts_to_json(header)
    for name in ("sensor_model", "origin"):
        if facts.get(name, "{}") != "{}":
            lines.append(f"{name} {facts[name]}")
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
                raise EventFormatError(
                    f"{codec.name}: found times from {t[0]} to {t[-1]} us, expected 0 to "
                    f"{MAX_TIME_US - 1} us; subtract an offset first (--from-start, --shift-us)"
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
            taken, count = self._codec.encode(rest, self._width, self._state, self._words)
            words = self._words[:count]
            if trigger is not None and taken:
                words[-1] = words[-1] & self._codec.layout.time_bits | trigger
            self._file.write(words.astype(words.dtype.newbyteorder("<"), copy=False).data)
            done += taken

    def put_trigger(self, triggers: Triggers, k: int) -> None:
        """Write a trigger, with the words of the clock that an event at its time would have."""
        row = max(0, self._state[evt_words.Y])
        x, y = np.array([[0], [row]], np.uint16)
        event = Columns(triggers.t_us[k : k + 1], x, y, triggers.p[k : k + 1])
        kind = evt_words.TRIGGER << self._codec.layout.kind_shift
        channel = int(triggers.channel[k]) << evt_words.CHANNEL_SHIFT
        self.put(event, kind | channel | int(triggers.p[k] > 0))


def _check_triggers(triggers: Triggers, codec: Codec) -> None:
    if len(triggers) == 0:
        return
    first_us, last_us = triggers.t_us[[0, -1]]
    highest, channels = triggers.channel.max(), codec.layout.channels
    if first_us < 0 or last_us >= MAX_TIME_US or highest >= channels:
        raise EventFormatError(
            f"{codec.name}: found triggers from {first_us} to {last_us} us on channels up to "
            f"{highest}, expected 0 to {MAX_TIME_US - 1} us on channels 0 to {channels - 1}; "
            "shift the times with --shift-us"
        )


def end_us(start_us: int, t_offset_us: int) -> int:
    """Return the exclusive upper bound on event times, us."""
    return _start_us(start_us, t_offset_us) + MAX_TIME_US


def _start_us(first_us: int, t_offset_us: int) -> int:
    """Return `t0`: the start of the clock if the times are too large without it."""
    if abs(t_offset_us) > _MOST:
        raise EventFormatError(
            f"the clock starts at {t_offset_us} us, expected within 2^62 us of 0"
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
            f"{path}: the header does not say which version of EVT the file has (a line '% evt "
            "3.0' or '% format EVT3;...'); give the format by name, evt2 or evt3"
        )
    return version


def read_header(path: Path, codec: Codec) -> Header:
    """Read the header of a RAW file."""
    with path.open("rb") as file:
        return _of_version(_read_raw(file), codec).header


def _of_version(raw: _Raw, codec: Codec) -> _Raw:
    if raw.version not in (None, codec.name.lower()):
        raise EventFormatError(
            f"header: declares version {raw.version}, but the file is read as {codec.name}"
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
            raise EventFormatError(f"byte {length}: the header ends within a line, or is too long")
        with reading(f"byte {length - len(line)}: found {line[:40]!r}, expected a line of text"):
            key, _, value = line[1:].decode("utf-8").strip().partition(" ")
        ended = key == "end"
        fields[key] = value.strip()
    if not fields:
        raise EventFormatError("byte 0: found no header, expected lines that start with '%'")
    count = _number(fields, "event_count")
    if count is not None and not ended:
        raise EventFormatError(f"byte {length}: the header ends without '% end'")
    if fields.get("endianness", "little") != "little":
        raise EventFormatError("header, endianness: found big, expected little")
    width, height = _size(fields)
    start_us = _number(fields, "t0") or 0
    clock_us = _number(fields, "t_offset", least=-_MOST)
    others = tuple(name for name in fields if name and name not in _FIELDS)
    offset_us = start_us if clock_us is None else clock_us
    header = Header(width, height, *facts_from_json(fields), offset_us, others)
    triggers = _number(fields, "trigger_count")
    return _Raw(_version(fields), header, count, triggers, start_us, length)


def _number(fields: dict[str, str], name: str, least: int = 0) -> int | None:
    value = fields.get(name)
    if value is None:
        return None
    whole = re.fullmatch(r"-?\d{1,19}", value, re.ASCII) is not None
    if not whole or not least <= int(value) <= _MOST:
        expected = f"an integer, {least} to {_MOST}"
        raise EventFormatError(f"header, {name}: found {value[:40]!r}, expected {expected}")
    return int(value)


def _version(fields: dict[str, str]) -> str | None:
    versions = set()
    if "evt" in fields:
        versions.add({"2.0": "evt2", "3.0": "evt3"}.get(fields["evt"], fields["evt"]))
    if "format" in fields:
        versions.add(fields["format"].split(";")[0].lower())
    if len(versions) > 1 or not versions <= {"evt2", "evt3"}:
        raise EventFormatError(
            f"header: declares {' and '.join(sorted(versions))}, expected one version, EVT2 or EVT3"
        )
    if not versions and (system := system_of(fields)):
        return system.version
    return versions.pop() if versions else None


def _size(fields: dict[str, str]) -> tuple[int | None, int | None]:
    """Return width and height from `geometry` and `format`, which must be equal.

    Old files have neither; their number of the system gives the size.
    """
    sizes = set()
    if "geometry" in fields:
        match = re.fullmatch(r"(\d{1,9})x(\d{1,9})", fields["geometry"], re.ASCII)
        if match is None:
            raise EventFormatError(
                f"header, geometry: found {fields['geometry'][:40]!r}, expected WIDTHxHEIGHT"
            )
        sizes.add((int(match[1]), int(match[2])))
    options = dict(re.findall(r";\s*(\w+)=(\d{1,9})(?=;|$)", fields.get("format", ""), re.ASCII))
    if {"width", "height"} <= options.keys():
        sizes.add((int(options["width"]), int(options["height"])))
    if len(sizes) > 1:
        raise EventFormatError(f"header: declares conflicting sizes: {sorted(sizes)}")
    if not sizes and (system := system_of(fields)):
        return system.width, system.height
    return sizes.pop() if sizes else (None, None)


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
                taken, decoded, stop = codec.decode(words, width, height, state, columns)
                columns.t_us[:decoded] += raw.start_us
                offset += size * taken
                if decoded:
                    count += decoded
                    yield Events.trusted(*columns.part(slice(decoded)), like=none)
                if stop not in (evt_words.DONE, evt_words.FULL):
                    word = f"{words[taken]:#0{2 + 2 * size}x}"
                    raise EventFormatError(f"byte {offset}, word {word}: {_reason(stop, state)}")
                words = words[taken:]
    _check_count(raw.trigger_count, triggers, "triggers", offset)
    if held := int(state[evt_words.HELD]):
        _log.warning(
            "%s: the clock steps back by up to %d us in %d words of events; these events get the "
            "time of the previous event",
            path,
            state[evt_words.STEP_BACK_US],
            held,
        )
    _check_count(raw.count, count, "events", offset)
    if skipped := int(state[evt_words.SKIPPED]):
        _log.warning("%s: skipped %d events that come before the first time and row", path, skipped)


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
    return int(np.count_nonzero(words >> codec.layout.kind_shift == evt_words.TRIGGER))


def _check_count(expected: int | None, count: int, what: str, offset: int) -> None:
    """Refuse a file whose header has another number of events or triggers."""
    if expected not in (None, count):
        raise EventFormatError(
            f"byte {offset}: the file ends after {count} {what}, but its header says {expected}; "
            "it is truncated or damaged"
        )


def read_triggers(path: Path, codec: Codec) -> Triggers:
    """Read the external triggers of a RAW file, from all of its words."""
    state = _new_state()
    parts = []
    count = 0
    with path.open("rb") as file:
        raw = _of_version(_read_raw(file), codec)
        offset = raw.length
        for words in _blocks(file, offset, codec):
            room = _triggers_in(words, codec)
            columns = np.empty(room, np.int64), np.empty(room, np.uint8), np.empty(room, np.int8)
            decoded = decode_triggers(words, codec.layout, state, *columns)
            parts.append([column[:decoded] for column in columns])
            count += room
            offset += words.nbytes
    _check_count(raw.trigger_count, count, "triggers", offset)
    if not parts:
        return NO_TRIGGERS
    t_us, channel, p = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Triggers(t_us + raw.start_us, channel, p)


def _reason(stop: int, state: np.ndarray) -> str:
    value, last_us = state[[evt_words.FOUND, evt_words.LAST_US]]
    return {
        evt_words.BAD_X: f"found x = {value}, outside the sensor",
        evt_words.BAD_Y: f"found y = {value}, outside the sensor",
        evt_words.BACKWARDS: f"its time, {value} us, is before the previous time, {last_us} us",
        evt_words.BAD_WORD: "the format has no word of this type",
        evt_words.NO_BASE: "a vector of events comes before the word that gives its start",
    }[stop]
