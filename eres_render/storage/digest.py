"""One digest for settings and data that depends on their values only."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from enum import Enum

import numpy as np

VERSION = 1
"""Version of the canonical form; raise it with every change of the form."""


def digest(value: object) -> str:
    """Return the SHA-256 of the canonical form of a value, 64 hexadecimal digits.

    A dataclass counts as a mapping of its fields, whatever its name; mappings have no order. A
    field that is None is left out, so that an optional field that is added later changes no digest.
    Enums and numbers count by value (1 equals 1.0), arrays by type, shape and bytes. For a file,
    pass the digest of its bytes.
    """
    return hashlib.sha256(_encoded([VERSION, value])).hexdigest()


def _encoded(value: object) -> bytes:
    """Return bytes that are equal only for equal values."""
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
        return _tagged("text", value.encode(errors="surrogatepass"))
    if isinstance(value, float) and not value.is_integer():
        return _tagged("number", value.hex().encode())
    if isinstance(value, int | float):
        return _tagged("number", str(int(value)).encode())
    raise TypeError(f"digest: found {value!r}, expected settings or data")


def _tagged(kind: str, content: bytes) -> bytes:
    return f"{kind} {len(content)}:".encode() + content
