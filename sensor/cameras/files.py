"""Cameras in TOML files: those of the catalogue, by name, and those of users."""

from __future__ import annotations

import functools
import json
import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from sensor.cameras.camera import KEYS, KINDS, EventCamera, Source
from sensor.cameras.fields import Key
from sensor.errors import SensorError, reading, suggestion
from sensor.numbers import real, refusal

_CATALOGUE = Path(__file__).parent / "catalogue"
_FACTS = "value", "unit", "source", "kind", "interval"
OTHERS = {  # keys that name another camera
    "base": "name or file of a camera that this one changes",
    "electronics": "name or file of a camera whose pixels and bus this one has on its own grid",
}
UNLIMITED = "unlimited"
_ALIASES = {"threshold_on": "threshold"}  # in files of earlier versions

# Keys that act through a cutoff and a warm-up alone.
_LIGHT = "pitch", "cutoff", "illuminance", "like", "area_exponent", "warm_up"


@functools.cache
def camera_names() -> tuple[str, ...]:
    """Return the names of the cameras in the catalogue.

    Examples
    --------
    >>> from sensor import camera_names
    >>> "davis346" in camera_names()
    True
    """
    return tuple(sorted(file.stem for file in _CATALOGUE.glob("*.toml")))


def plain_camera(width: int, height: int | None = None) -> EventCamera:
    """Return a camera without noise or bus: ideal pixels with the paper's threshold of 0.2.

    Parameters
    ----------
    width, height
        Size, px; a square by default.

    Returns
    -------
    EventCamera
        Without a name.

    Examples
    --------
    >>> from sensor import plain_camera
    >>> plain_camera(346, 260).model(cutoff_hz=200.0).cutoff_hz
    200.0
    """
    return EventCamera(width=width, height=width if height is None else height)


def find_camera(name: str | Path) -> EventCamera:
    """Return a camera of the catalogue, or that of a file.

    Parameters
    ----------
    name
        A name, as in `camera_names`, or the path of a TOML file; see `read_camera`.

    Returns
    -------
    EventCamera

    Raises
    ------
    SensorError
        There is no such camera, or its file is invalid.

    Examples
    --------
    >>> from sensor import find_camera
    >>> find_camera("gen4-cd").width
    1280
    >>> find_camera("davis364")
    Traceback (most recent call last):
    sensor.errors.SensorError: camera: found 'davis364'; did you mean 'davis346'?
    """
    text = str(name)
    if text in camera_names():
        return _packaged(text)
    if text.endswith(".toml") or Path(text).is_file():
        return read_camera(text)
    advice = suggestion(text, camera_names(), "a file such as mine.toml, or ")
    raise SensorError(f"camera: found {text!r}; {advice}")


@functools.cache
def _packaged(name: str) -> EventCamera:
    return read_camera(_CATALOGUE / f"{name}.toml")


def read_camera(file: str | Path) -> EventCamera:
    """Read a camera from a TOML file.

    Its keys are those of `sensor.cameras.camera.KEYS`; `base`, the name or file of a camera that
    this one changes; and `electronics`, one whose pixels and bus it has. The later wins: defaults,
    `base`, `electronics`, the values of the file. A value is a number in the first unit of its key,
    or a table of `value`, `unit`, `source` and, if they are known, `kind` and the 95 % `interval`.
    A table with an interval and no value is a bound, which is not simulated. A threshold in log
    units holds for ON and OFF; in %, a rise of the light for ON and a fall for OFF, both are
    needed. A width without a height is a square. `bus` may name a camera with a known bus.

    Parameters
    ----------
    file
        The file.

    Returns
    -------
    EventCamera
        Its name is that of the file.

    Raises
    ------
    SensorError
        The file cannot be read, a key or a unit is unknown, or a value is wrong; the text names
        file and key.

    Examples
    --------
    >>> from pathlib import Path
    >>> from sensor import read_camera
    >>> _ = Path("mine.toml").write_text('base = "davis346"\\nthreshold = 0.15\\nleak = 0.2')
    >>> camera = read_camera("mine.toml")
    >>> camera.name, camera.width, camera.contrast_threshold, camera.leak_hz
    ('mine', 346, 0.15, 0.2)
    """
    file = Path(file)
    if not file.is_file():
        raise SensorError(f"{file}: no such file")
    with reading(file, "TOML", SensorError):
        return camera_of(tomllib.loads(file.read_text(encoding="utf-8")), file.stem, file.parent)


def camera_of(
    table: Mapping[str, Any], name: str = "", folder: str | Path | None = None
) -> EventCamera:
    """Return the camera that a table describes, as `read_camera` reads it from a file."""
    values = {_ALIASES.get(key, key): value for key, value in table.items()}
    camera = EventCamera()
    for word in OTHERS:
        other = values.pop(word, None)
        if other is None:
            continue
        if not isinstance(other, str):
            raise refusal(word, other, "the name or the file of a camera")
        named = find_camera(Path(folder or "") / other if other.endswith(".toml") else other)
        camera = named if word == "base" else camera.with_electronics(named)
    if "width" in values and "height" not in values:
        values["height"] = values["width"]
    changed: dict[str, Any] = {"name": name or camera.name}
    sources = dict(camera.sources)
    if "threshold" in values and "threshold_off" not in values:
        on = values["threshold"]
        if isinstance(on, dict) and on.get("unit") == "%":
            raise SensorError("threshold: give threshold_off, too: rise and fall in % differ")
        changed["contrast_threshold_off"] = None
        sources.pop("threshold_off", None)
    for key_name, facts in values.items():
        if key_name not in KEYS:
            raise SensorError(f"{key_name}: unknown; {suggestion(key_name, [*KEYS, *OTHERS])}")
        key = KEYS[key_name]
        value, source = _read(key_name, key, facts)
        if value is not None:
            changed[key.field] = value
        if source is not None:
            sources[key_name] = source
    return replace(camera, **changed, sources=sources)


def _read(name: str, key: Key, facts: Any) -> tuple[Any, Source | None]:
    """Return the value of a key, None for a bound, and its source, None for words of a title."""
    if key.part == "name":
        return key.checked(name, facts), None
    if not isinstance(facts, dict):
        return _value(name, key, facts, None), Source("", "given")
    for fact in facts:
        if fact not in _FACTS:
            raise SensorError(f"{name}.{fact}: unknown; choose from: {', '.join(_FACTS)}")
    source = facts.get("source")
    if not isinstance(source, str) or not source:
        raise refusal(f"{name}.source", source, "a string that says where the value comes from")
    kind, unit, interval = facts.get("kind", "published"), facts.get("unit"), facts.get("interval")
    if kind not in KINDS:
        raise refusal(f"{name}.kind", kind, " or ".join(map(repr, KINDS)))
    if unit not in (None, *key.units):
        raise refusal(f"{name}.unit", unit, " or ".join(map(repr, key.units)))
    ends = None
    if interval is not None:
        if key.kind is not float or not (isinstance(interval, list) and len(interval) == 2):
            raise refusal(f"{name}.interval", interval, "two numbers, for a numeric key")
        low, high = (_number(f"{name}.interval", key, end, unit) for end in interval)
        if low > high:
            raise refusal(f"{name}.interval", interval, "the lower end first")
        ends = low, high
        if "value" not in facts:
            return None, Source(source, "bound", ends)
    if "value" not in facts:
        raise SensorError(f"{name}: needs a value or an interval, and has neither")
    return _value(name, key, facts["value"], unit), Source(source, kind, ends)


def _value(name: str, key: Key, value: Any, unit: Any) -> Any:
    if key.kind is float:
        if name == "bus" and isinstance(value, str):
            return _bus_hz(value)
        value = _number(name, key, value, unit)
        if math.isinf(value) and name not in ("cutoff", "bus"):
            raise refusal(name, value, "a finite number")
    return key.checked(name, value)


def _bus_hz(name: str) -> float:
    """Return the capacity of the bus of a camera, events/s; inf for `UNLIMITED`."""
    if name == UNLIMITED:
        return math.inf
    if name not in camera_names():
        advice = suggestion(name, camera_names(), f"a number of Mev/s, {UNLIMITED!r}, or ")
        raise SensorError(f"bus: found {name!r}; {advice}")
    bus_hz = find_camera(name).bus_hz
    if math.isinf(bus_hz):
        raise SensorError(f"bus: the capacity of the bus of {name!r} is unknown; give it in Mev/s")
    return bus_hz


def _number(name: str, key: Key, value: Any, unit: Any) -> float:
    """Return a number in the unit of the camera's field."""
    unit = unit or next(iter(key.units))
    words = {"1": "a number", "log": "a number in log units"}.get(unit, f"a number of {unit}")
    return key.units[unit](real(name, value, f"{words}, 0 or more", 0.0))


def write_camera(file: str | Path, camera: EventCamera, *, overwrite: bool = True) -> None:
    """Write a camera to a TOML file, which `read_camera` reads.

    Parameters
    ----------
    file
        The file.
    camera
        The camera; all values that it states or that are not defaults are written.
    overwrite
        Whether to replace a file.

    Raises
    ------
    OSError
        The file cannot be written, or exists and is not to be replaced.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from sensor import find_camera, read_camera, write_camera
    >>> camera = replace(find_camera("davis346"), name="mine", leak_hz=0.2)
    >>> write_camera("mine.toml", camera)
    >>> read_camera("mine.toml") == camera
    True
    """
    from sensor.formats.new_file import new_file  # here, as formats load libraries

    lines = []
    for name, facts in facts_of(camera):
        if not facts["kind"] and not camera.states(name):
            continue
        text = _text(facts["value"])
        if facts["source"]:
            if facts["kind"] == "bound":
                facts |= {"value": "", "kind": ""}
            told = [
                f"{fact} = {_text(facts[fact])}" for fact in facts if facts[fact] not in ("", [])
            ]
            text = f"{{ {', '.join(told)} }}"
        lines.append(f"{name} = {text}")
    with new_file(Path(file), overwrite=overwrite) as new:
        new.write_text("\n".join(lines) + "\n", encoding="utf-8")


def values_of(camera: EventCamera) -> dict[str, Any]:
    """Return what decides the events of a camera at a given cutoff, where it is not the default."""
    values = {}
    for name, key in KEYS.items():
        value = getattr(camera, key.field)
        if value != key.default and key.part != "name" and name not in _LIGHT:
            values[name] = "inf" if value == math.inf else value
    return values


def facts_of(camera: EventCamera) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each key and what a file has of it: value, unit, source, kind, interval; "" or [] if
    unknown. The unit is the first from which the value comes back to the bit."""
    for name, key in KEYS.items():
        value, source = getattr(camera, key.field), camera.sources.get(name)
        text, kind, interval = source or ("", "", None)
        unit = "" if key.kind in (str, bool) else next(iter(key.units))
        if key.kind is float and value is not None:
            unit = next(name for name, up in key.units.items() if up(value / up(1.0)) == value)
            value /= key.units[unit](1.0)
        ends = [end / key.units[unit](1.0) for end in interval or ()]
        facts = {"value": value, "unit": unit, "source": text, "kind": kind, "interval": ends}
        yield name, facts


def _text(value: Any) -> str:
    """Return a value in TOML."""
    if isinstance(value, list):
        return f"[{', '.join(map(_text, value))}]"
    if isinstance(value, str):  # JSON's escapes are among those of TOML, which has one more
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return str(value).lower() if isinstance(value, bool) else repr(value)
