"""Read TOML and JSON files into frozen dataclasses; errors name the wrong field."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import tomllib
import types
import typing
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Annotated, Any, TypeVar

from eres_render.errors import reading, suggestion

T = TypeVar("T")
Vector3 = tuple[float, float, float]
FloatOrInf = Annotated[float, "inf"]
"""A number or inf, also as text ("inf"), because JSON has no such number."""

_OLD_NAMES = "old names"
_MAX_NESTED = 100
_NAMES: dict[Any, str] = {
    float: "a number",
    FloatOrInf: "a number or inf",
    int: "an integer",
    bool: "true or false",
    str: "a string",
    tuple[float, float]: "two numbers",
    Vector3: "three numbers",
}


def formerly(*names: str) -> dict[str, tuple[str, ...]]:
    """Return metadata for a dataclass field that can also be read under its old names."""
    return {_OLD_NAMES: names}


def differences(actual: Any, expected: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield fields that differ, such as "render.spp", and their values; None if missing."""
    if isinstance(actual, dict) and isinstance(expected, dict):
        for key in {**expected, **actual}:
            inner = f"{name}.{key}" if name else key
            yield from differences(actual.get(key), expected.get(key), inner)
    elif actual != expected:
        yield name, actual, expected


def read_toml(kind: type[T], file: Path, error: type[ValueError]) -> T:
    """Read a TOML file; raise `error` if anything is wrong with it."""
    return _read(kind, file, tomllib.loads, "TOML", error)


def read_json(kind: type[T], file: Path, error: type[ValueError]) -> T:
    """Read a JSON file; raise `error` if anything is wrong with it."""
    return _read(kind, file, json.loads, "JSON", error)


def _read(
    kind: type[T], file: Path, parse: Callable[[str], Any], name: str, error: type[ValueError]
) -> T:
    with reading(file, name, error):
        parsed = parse(file.read_text(encoding="utf-8"))
        check_nesting(parsed)
        return read_typed(kind, parsed, file, error)


def check_nesting(parsed: Any) -> None:
    """Refuse a parsed value that is nested so deep that it could not be printed or compared."""
    level, depth = [parsed], 0
    while level := [
        inner
        for inside in level
        if isinstance(inside, dict | list)
        for inner in (inside.values() if isinstance(inside, dict) else inside)
    ]:
        depth += 1
        if depth > _MAX_NESTED:
            raise RecursionError


def read_typed(
    kind: type[T], parsed: Any, file: Path, error: type[ValueError], field: str = ""
) -> T:
    """Convert a parsed value to a type, or raise `error`; a value that has the type stays as it is.

    `kind` is a dataclass (a table with exactly its fields; fields with a default may be absent), a
    union of dataclasses that differ in their field `kind`, dict[str, ...], a tuple of one type (a
    list), a Literal of words, float (finite), `FloatOrInf`, int, bool, str or Any. A union with
    None is for an optional field, which is null in JSON or absent.
    """
    if kind is Any or (
        type(parsed) is kind and (kind is not float or math.isfinite(number(parsed)))
    ):
        return typing.cast(T, parsed)

    def inner(inner_kind: Any, value: Any, inner_field: str) -> Any:
        return read_typed(inner_kind, value, file, error, inner_field)

    def refuse(what: str) -> ValueError:
        return error(f"{file}: {field + ': ' if field else ''}{what}")

    if typing.get_origin(kind) is Annotated and kind != FloatOrInf:  # for the command line
        return typing.cast(T, inner(typing.get_args(kind)[0], parsed, field))
    result: Any
    prefix = f"{field}." if field else ""
    if isinstance(kind, types.UnionType) or typing.get_origin(kind) is typing.Union:
        if parsed is None and types.NoneType in typing.get_args(kind):
            return typing.cast(T, None)
        return typing.cast(T, inner(_member(kind, parsed, refuse), parsed, field))
    if dataclasses.is_dataclass(kind) and isinstance(parsed, dict):
        values = _fields(kind, parsed, file, error, prefix)
        try:
            return kind(**values)
        except Exception as reason:  # numbers of a file may raise anything in a constructor
            raise refuse(str(reason)) from reason
    arguments = typing.get_args(kind)
    if typing.get_origin(kind) is dict and isinstance(parsed, dict):
        result = {k: inner(arguments[1], v, prefix + k) for k, v in parsed.items()}
    elif typing.get_origin(kind) is tuple and isinstance(parsed, list):
        if arguments[-1] is not Ellipsis and len(parsed) != len(arguments):
            raise refuse(f"found {parsed!r}, expected {_name(kind)}")
        result = tuple(inner(arguments[0], v, f"{field}[{i}]") for i, v in enumerate(parsed))
    elif typing.get_origin(kind) is typing.Literal and parsed in arguments:
        result = parsed
    elif kind is float and type(parsed) is int and math.isfinite(number(parsed)):
        result = float(parsed)
    elif kind == FloatOrInf and not math.isnan(value := number(parsed)):
        result = value
    else:
        raise refuse(f"found {parsed!r}, expected {_name(kind)}")
    return typing.cast(T, result)


def check_known(
    words: Collection[str],
    known: Collection[str],
    file: Path,
    error: type[ValueError],
    prefix: str = "",
) -> None:
    """Raise `error` for the first unknown field, with `prefix` (its table and a dot) before it."""
    for word in words:
        if word not in known:
            raise error(f"{file}: {prefix}{word}: unknown; {suggestion(word, known)}")


def _fields(
    kind: type, table: dict[str, Any], file: Path, error: type[ValueError], prefix: str
) -> dict[str, Any]:
    """Return the values of a dataclass's fields from a table."""
    fields, kinds = dataclasses.fields(kind), _kinds(kind)
    named = {word: f for f in fields for word in (f.name, *f.metadata.get(_OLD_NAMES, ()))}
    values: dict[str, Any] = {}
    check_known([word for word in table if word not in named], list(kinds), file, error, prefix)
    for word, value in table.items():
        name = named[word].name
        if name in values:
            raise error(f"{file}: {prefix}{name}: found twice, once under an old name")
        values[name] = read_typed(kinds[name], value, file, error, prefix + word)
    for f in fields:
        may_be_absent = (f.default, f.default_factory) != (dataclasses.MISSING, dataclasses.MISSING)
        if f.name not in values and not may_be_absent:
            raise error(f"{file}: {prefix}{f.name}: missing, expected {_name(kinds[f.name])}")
    return values


@functools.cache  # a file may hold thousands of one class
def _kinds(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind, include_extras=True)


def _member(union: Any, parsed: Any, refuse: Callable[[str], ValueError]) -> Any:
    """Return the member of a union that a value belongs to."""
    members = [member for member in typing.get_args(union) if member is not types.NoneType]
    if len(members) == 1 or not isinstance(parsed, dict):
        return members[0]
    by_word = {typing.get_args(typing.get_type_hints(m)["kind"])[0]: m for m in members}
    kind = parsed.get("kind")
    if not isinstance(kind, str) or kind not in by_word:
        raise refuse(f"kind: found {kind!r}, expected one of {', '.join(by_word)}")
    return by_word[kind]


def number(parsed: Any) -> float:
    """Return the number, which may be inf, or NaN if the value is not a number, or too large."""
    try:
        return float(parsed) if type(parsed) in (int, float, str) else math.nan
    except (ValueError, OverflowError):
        return math.nan


def _name(kind: Any) -> str:
    if typing.get_origin(kind) is tuple:
        return _NAMES.get(kind, "a list")
    if typing.get_origin(kind) is typing.Literal:
        return " or ".join(map(repr, typing.get_args(kind)))
    return _NAMES.get(kind, "a table")
