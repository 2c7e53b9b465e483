"""Read a TOML or JSON table into a frozen dataclass, or say which field is wrong and how."""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")
Vector3 = tuple[float, float, float]
_NAMES: dict[Any, str] = {
    float: "a number",
    int: "an integer",
    bool: "true or false",
    str: "a string",
    Vector3: "three numbers",
}


def read_typed(
    kind: type[T], found: Any, file: Path, error: type[ValueError], field: str = ""
) -> T:
    """Return a parsed value as the wanted type.

    Parameters
    ----------
    kind
        A dataclass (a table with exactly its fields, those with a default may be absent), a union
        of dataclasses told apart by their field `kind`, dict[str, ...], tuple of one type (a list),
        Literal of words, float (finite), int, bool or str. None stands for an absent field.
    found
        The parsed value.
    file, field
        Where it stands, for the message.
    error
        What to raise when a field is missing, unknown, mistyped or refused by its dataclass.
    """

    def inner(inner_kind: Any, value: Any, inner_field: str) -> Any:
        return read_typed(inner_kind, value, file, error, inner_field)

    def refuse(what: str) -> ValueError:
        return error(f"{file}: {field or 'top level'}: {what}")

    result: Any
    if isinstance(kind, types.UnionType):
        kind = _member(kind, found, refuse)
    if dataclasses.is_dataclass(kind) and isinstance(found, dict):
        kinds = typing.get_type_hints(kind)
        prefix = f"{field}." if field else ""
        may_be_absent = {
            f.name
            for f in dataclasses.fields(kind)
            if (f.default, f.default_factory) != (dataclasses.MISSING, dataclasses.MISSING)
        }
        for name in (name for name in kinds if name not in found and name not in may_be_absent):
            raise error(f"{file}: {prefix}{name}: missing, expected {_name(kinds[name])}")
        for name in (name for name in found if name not in kinds):
            raise error(f"{file}: {prefix}{name}: unknown, expected one of {', '.join(kinds)}")
        values = {name: inner(kinds[name], value, prefix + name) for name, value in found.items()}
        try:
            return kind(**values)
        except ValueError as reason:
            raise refuse(str(reason)) from reason
    arguments = typing.get_args(kind)
    if typing.get_origin(kind) is dict and isinstance(found, dict):
        result = {k: inner(arguments[1], v, f"{field}.{k}") for k, v in found.items()}
    elif typing.get_origin(kind) is tuple and isinstance(found, list):
        if arguments[-1] is not Ellipsis and len(found) != len(arguments):
            raise refuse(f"found {found!r}, expected {_name(kind)}")
        result = tuple(inner(arguments[0], v, f"{field}[{i}]") for i, v in enumerate(found))
    elif typing.get_origin(kind) is typing.Literal and found in arguments:
        result = found
    elif kind is float and type(found) in (int, float) and math.isfinite(found):
        result = float(found)
    elif kind in (str, int, bool) and type(found) is kind:
        result = found
    else:
        raise refuse(f"found {found!r}, expected {_name(kind)}")
    return typing.cast(T, result)


def _member(union: types.UnionType, found: Any, refuse: Callable[[str], ValueError]) -> Any:
    """Return which member of a union a value is meant to be."""
    members = [member for member in typing.get_args(union) if member is not types.NoneType]
    if len(members) == 1 or not isinstance(found, dict):
        return members[0]
    by_word = {typing.get_args(typing.get_type_hints(m)["kind"])[0]: m for m in members}
    if found.get("kind") not in by_word:
        raise refuse(f"kind: found {found.get('kind')!r}, expected one of {', '.join(by_word)}")
    return by_word[found["kind"]]


def _name(kind: Any) -> str:
    if typing.get_origin(kind) is tuple:
        return _NAMES.get(kind, "a list")
    if typing.get_origin(kind) is typing.Literal:
        return " or ".join(map(repr, typing.get_args(kind)))
    return _NAMES.get(kind, "a table")
