"""The JSON schema of a camera's file, with which editors complete and check it."""

from __future__ import annotations

import math
from typing import Any

from sensor.cameras.camera import KEYS, KINDS
from sensor.cameras.fields import Key
from sensor.cameras.files import OTHERS, UNLIMITED, camera_names, find_camera
from sensor.numbers import FINITE, POSITIVE

_SOURCE = {"type": "string", "minLength": 1}
_INTERVAL = {
    "type": "array",
    "items": {"type": "number", "minimum": 0},
    "minItems": 2,
    "maxItems": 2,
}
_TYPES = {float: "number", int: "integer", bool: "boolean", str: "string"}


def camera_schema() -> dict[str, Any]:
    """Return the JSON schema of a camera's file, from `sensor.cameras.camera.KEYS`."""
    others = {name: {"type": "string", "description": meaning} for name, meaning in OTHERS.items()}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Event camera",
        "type": "object",
        "additionalProperties": False,
        "properties": others | {name: _property(name, key) for name, key in KEYS.items()},
        "$defs": {"kind": {"enum": [*KINDS]}, "source": _SOURCE, "interval": _INTERVAL},
    }


def _property(name: str, key: Key) -> dict[str, Any]:
    unit, scale = next(iter(key.units.items()))
    described = f"{key.meaning}, {unit}" if unit != "1" else key.meaning
    bare, in_table = _value(key, scale(1.0)), _value(key, None)
    if key.part == "name":
        return {"description": described, **bare}
    if name == "bus":
        cameras = [each for each in camera_names() if find_camera(each).bus_hz < math.inf]
        buses = {"enum": [UNLIMITED, *cameras]}
        bare, in_table = {"anyOf": [bare, buses]}, {"anyOf": [in_table, buses]}
    facts = {"value": in_table}
    facts |= {fact: {"$ref": f"#/$defs/{fact}"} for fact in ("source", "kind")}
    if key.kind in (float, int):
        facts["unit"] = {"enum": [*key.units]}
    table: dict[str, Any] = {"type": "object", "additionalProperties": False, "properties": facts}
    table["required"] = ["value", "source"]
    if key.kind is float:
        facts["interval"] = {"$ref": "#/$defs/interval"}
        table["required"] = ["source"]
        table["anyOf"] = [{"required": ["value"]}, {"required": ["interval"]}]
    return {"description": described, "anyOf": [bare, table]}


def _value(key: Key, scale: float | None) -> dict[str, Any]:
    """Return the schema of a value; its range, in units of `scale` if that is known."""
    if key.words:
        return {"enum": [*key.words]}
    schema: dict[str, Any] = {"type": _TYPES[key.kind]}
    if key.kind in (str, bool):
        return schema
    if scale is None:
        return schema | {"minimum": 0}
    if key.least == POSITIVE:
        schema["exclusiveMinimum"] = 0
    else:
        schema["minimum"] = key.kind(key.least / scale)
    if key.most < FINITE:
        schema["maximum"] = key.kind(key.most / scale)
    return schema
