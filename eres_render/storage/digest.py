"""One digest of settings and data, of their values alone."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from enum import Enum

import numpy as np

VERSION = 1
"""Of the form in which values are hashed; counts every change of it."""


def digest(value: object) -> str:
    """Return the SHA-256 of a value in a canonical form, 64 hexadecimal digits.

    A dataclass counts as a mapping from the names of its fields to their values; its own name does
    not count. Mappings have no order. A field that is None is left out, so that an optional field
    that is added later changes no digest. Enums count by value, numbers too (1 and 1.0 are equal),
    arrays by type, shape and bytes. A file is given as the digest of its bytes.

    Raises
    ------
    TypeError
        If there is anything but these, lists, tuples, strings and None.
    """
    return hashlib.sha256(_encoded([VERSION, value])).hexdigest()


def _encoded(value: object) -> bytes:
    """Return bytes that are equal for equal values alone."""
    if isinstance(value, Enum):
        return _encoded(value.value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping) and all(isinstance(name, str) for name in value):
        named = ((name, value[name]) for name in sorted(value) if value[name] is not None)
        return _tagged("mapping", b"".join(_encoded(part) for pair in named for part in pair))
    if isinstance(value, list | tuple):
        return _tagged("list", b"".join(map(_encoded, value)))
    if isinstance(value, np.ndarray) and value.dtype.kind in "biufc":
        return _tagged(f"array {value.dtype.str} {value.shape}", value.tobytes())
    if value is None or isinstance(value, bool):
        return _tagged(str(value), b"")
    if isinstance(value, str):
        return _tagged("text", value.encode())
    if isinstance(value, float) and not value.is_integer():
        return _tagged("number", value.hex().encode())
    if isinstance(value, int | float):
        return _tagged("number", str(int(value)).encode())
    raise TypeError(f"digest: found {value!r}, expected settings or data")


def _tagged(kind: str, content: bytes) -> bytes:
    return f"{kind} {len(content)}:".encode() + content
