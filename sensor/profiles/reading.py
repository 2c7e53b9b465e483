"""Profiles: the electronics of cameras of the catalogue, by name, and TOML files of users."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

from sensor.cameras import camera_names, find_camera
from sensor.cameras.fields import ALIASES
from sensor.cameras.fields import FIELDS as FIELDS_OF_CAMERA
from sensor.errors import SensorError, nearest, reading
from sensor.model import PHOTORECEPTORS, SensorModel
from sensor.numbers import real, refusal
from sensor.profiles.profile import Bound, Profile, Sourced
from sensor.profiles.quantities import FIELDS, QUANTITIES

_FACTS = {"value", "unit", "source", "interval"}


def profile_names() -> list[str]:
    """Return the names of the cameras of the catalogue whose contrast threshold is known."""
    return [name for name in camera_names() if find_camera(name).states("threshold")]


def find_profile(name: str | Path) -> Profile:
    """Return the electronics of a camera of the catalogue, or those of a file.

    Parameters
    ----------
    name
        A name, or the path of a TOML file; see `read_profile`.

    Returns
    -------
    Profile

    Raises
    ------
    SensorError
        There is no such profile, or its file is invalid.

    Examples
    --------
    >>> from sensor.profiles import find_profile
    >>> find_profile("davis240").title
    'iniVation DAVIS240'
    >>> find_profile("davis241")
    Traceback (most recent call last):
    sensor.errors.SensorError: profile: found 'davis241'; did you mean 'davis240'?
    """
    text, names = str(name), profile_names()
    if text in names:
        return _of_catalogue(text)
    if text.endswith(".toml") or Path(text).is_file():
        return read_profile(Path(text))
    advice = nearest(text, names, "a file such as mine.toml, or ")
    raise SensorError(f"profile: found {text!r}; {advice}")


def _of_catalogue(name: str) -> Profile:
    camera, known = find_camera(name), {}
    for field in FIELDS:
        key = ALIASES.get(field, field)
        if camera.states(key):
            source = camera.sources[key]
            value = getattr(camera, FIELDS_OF_CAMERA[key])
            known[field] = Sourced(value, source.text, source.interval)
    return Profile(name, camera.title, known)


def read_profile(file: str | Path) -> Profile:
    """Read the profile in a TOML file.

    Parameters
    ----------
    file
        A file with a `title` and a table for each known field: `value`, `unit`, `source`, and, if
        it was measured, its 95 % `interval`. A table with an interval and no value is a bound.
        Fields and units are those of `sensor.profiles.quantities`.

    Returns
    -------
    Profile

    Raises
    ------
    SensorError
        There is no such file, it is not TOML, a field is unknown, a unit is wrong, a number is
        outside its range, or a source is missing; the text names file and field.
    OSError
        The file cannot be read.

    Examples
    --------
    >>> from pathlib import Path
    >>> from sensor.profiles import read_profile
    >>> text = 'title = "mine"\\n[threshold_on]\\nvalue = 10\\nunit = "%"\\nsource = "measured"'
    >>> _ = Path("mine.toml").write_text(text)
    >>> round(read_profile("mine.toml").known["threshold_on"].value, 4)
    0.0953
    """
    file = Path(file)
    if not file.is_file():
        raise SensorError(f"{file}: no such profile")
    with reading(file, "TOML", SensorError):
        table = tomllib.loads(file.read_text(encoding="utf-8"))
        title = table.pop("title", None)
        if not isinstance(title, str):
            raise SensorError(f"title: found {title!r}, expected the name of the sensor")
        for name in table:
            if name not in FIELDS:
                raise SensorError(f"{name}: unknown; {nearest(name, FIELDS)}")
        found = {name: _read(name, facts) for name, facts in table.items()}
        known = {name: one for name, one in found.items() if isinstance(one, Sourced)}
        bounds = {name: one for name, one in found.items() if isinstance(one, Bound)}
        profile = Profile(str(file), title, known, bounds)
        profile.applied_to(SensorModel(width=1, height=1, dark_level=1.0))
    return profile


def _read(name: str, facts: Any) -> Sourced | Bound:
    if not isinstance(facts, dict):
        raise refusal(name, facts, "a table with value, unit and source")
    for one in facts:
        if one not in _FACTS:
            raise SensorError(f"{name}.{one}: unknown, expected value, unit, source or interval")
    source = facts.get("source")
    if not isinstance(source, str) or not source:
        raise refusal(f"{name}.source", source, "a text that says where the value comes from")
    value = facts.get("value")
    if name == "photoreceptor":
        if value not in PHOTORECEPTORS:
            raise refusal(f"{name}.value", value, " or ".join(map(repr, PHOTORECEPTORS)))
        return Sourced(value, source)
    units = QUANTITIES[name].units
    unit = facts.get("unit")
    if not isinstance(unit, str) or unit not in units:
        raise refusal(f"{name}.unit", unit, " or ".join(map(repr, units)))
    interval = facts.get("interval")
    if interval is not None and not (isinstance(interval, list) and len(interval) == 2):
        raise refusal(f"{name}.interval", interval, "two numbers, or none")
    convert = units[unit]
    ends = None
    if interval is not None:
        low, high = (convert(_number(f"{name}.interval", one)) for one in interval)
        if low > high:
            raise refusal(f"{name}.interval", interval, "its lower end first")
        if value is None:
            return Bound((low, high), source)
        ends = low, high
    number = convert(_number(f"{name}.value", value))
    if not math.isfinite(number) and name != "cutoff":
        raise refusal(f"{name}.value", value, f"a finite number of {unit}")
    if number == 0 and name == "illuminance":
        raise refusal(f"{name}.value", value, f"a positive number of {unit}")
    return Sourced(number, source, ends)


def _number(name: str, value: object) -> float:
    expected = "a number of at least 0"
    number = real(name, value, expected)
    if number < 0:
        raise refusal(name, value, expected)
    return number
