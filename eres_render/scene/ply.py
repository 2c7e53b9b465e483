"""Check the faces of a PLY mesh, which Mitsuba takes as they are."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eres_render.errors import RenderError

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"half": "f2", "float": "f4", "double": "f8", "float16": "f2", "float32": "f4"},
    **{"float64": "f8", "long": "i8", "ulong": "u8"},
}
_INDICES = ("vertex_index", "vertex_indices")
_UNSIGNED = 0xFFFFFFFF  # 32 bits, as Mitsuba keeps indices: -1 is too large, too
_AT_ONCE = 1 << 20  # records
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}


class _Property(NamedTuple):
    name: str
    type: str  # of its numbers, as `numpy.dtype` has it
    count_type: str  # of the length before a list; "" for a single number


class _Element(NamedTuple):
    name: str
    size: int  # number of its records
    properties: list[_Property]

    @property
    def has_lists(self) -> bool:
        return any(prop.count_type for prop in self.properties)


def check_faces(path: Path) -> None:
    """Refuse a mesh with a face of a missing vertex: Mitsuba would read other memory."""
    with path.open("rb") as file:
        try:
            kind, elements = _header(file)
            vertices = {element.name: element.size for element in elements}["vertex"]
            largest = _largest_index(file, kind, elements)
        except Exception:  # of any kind, from its numbers; Mitsuba says what is wrong
            return
    if largest >= vertices:
        raise RenderError(
            f"{path}: a face refers to vertex {largest}, but there are only {vertices} vertices "
            "(counted from 0)"
        )


def _header(file: BinaryIO) -> tuple[str, list[_Element]]:
    kind, elements = "", list[_Element]()
    for line in file:
        match line.decode("latin-1").split():
            case ["format", kind, _]:
                pass
            case ["element", name, count]:
                elements.append(_Element(name, int(count), []))
            case ["property", "list", count_type, type_, name]:
                prop = _Property(name, _TYPES[type_], _TYPES[count_type])
                elements[-1].properties.append(prop)
            case ["property", type_, name]:
                elements[-1].properties.append(_Property(name, _TYPES[type_], ""))
            case [] | ["ply"] | ["comment" | "obj_info", *_]:
                pass
            case ["end_header"]:
                return kind, elements
            case _:
                raise ValueError
    raise ValueError


def _largest_index(file: BinaryIO, kind: str, elements: list[_Element]) -> int:
    """Return the largest index of a vertex in a face, as an unsigned number; -1 without faces."""
    last = max(k for k, element in enumerate(elements) if element.name == "face")
    to_faces = elements[: last + 1]
    if kind == "ascii":
        words = (word for line in file for word in line.split())
        return max(_largest_in_words(words, element) for element in to_faces)
    order, largest, start = _ORDERS[kind], -1, 0
    data = np.frombuffer(file.read(), np.uint8)
    for element in to_faces:
        index, start = _largest_in_bytes(data, start, element, order)
        largest = max(largest, index)
    return largest


def _largest_in_words(words: Iterator[bytes], element: _Element) -> int:
    """Step over the records of an element, and return the largest index of a face in them."""
    if not element.has_lists:
        _skip(words, element.size * len(element.properties))
        return -1
    largest = -1
    for _ in range(element.size):
        for prop in element.properties:
            count = int(next(words, b"")) if prop.count_type else 1
            if _has_indices(element, prop):
                indices = (int(float(word)) & _UNSIGNED for word in islice(words, count))
                largest = max(largest, max(indices, default=-1))
            else:
                _skip(words, count)
    return largest


def _largest_in_bytes(
    data: NDArray[np.uint8], start: int, element: _Element, order: str
) -> tuple[int, int]:
    """Return the largest index of a face in the records of an element, and where these end."""
    if not element.has_lists:
        record = sum(np.dtype(prop.type).itemsize for prop in element.properties)
        return -1, start + record * element.size
    largest, left, run = -1, element.size, 1 << 16
    while left:  # a run of records whose lists are as long as those of the first
        counts, faces, step = _layout(data[start:], element, order)
        fits = min(left, 2 * run, _AT_ONCE, (data.size - start) // step)  # as runs may be short
        rows = data[start : start + fits * step].reshape(fits, step)
        same = np.all(rows[:, counts] == rows[0, counts], axis=1)
        run = int(fits if same.all() else same.argmin())
        for columns, kind in faces:
            indices = np.ascontiguousarray(rows[:run, columns]).view(kind).astype(np.int64)
            largest = max(largest, int((indices & _UNSIGNED).max(initial=0)))
        start, left = start + run * step, left - run
    return largest, start


def _layout(
    data: NDArray[np.uint8], element: _Element, order: str
) -> tuple[list[int], list[tuple[slice, str]], int]:
    """Return where a record has lengths of lists, and indices of vertices; and its own length."""
    counts, faces, at = list[int](), list[tuple[slice, str]](), 0
    for prop in element.properties:
        count, each = 1, np.dtype(prop.type).itemsize
        if prop.count_type:
            head = np.dtype(f"{order}{prop.count_type}")
            count = int(data[at : at + head.itemsize].view(head)[0])
            counts += range(at, at + head.itemsize)
            at += head.itemsize
        if count < 0:
            raise ValueError
        end = at + count * each
        if _has_indices(element, prop):
            faces.append((slice(at, end), f"{order}{prop.type}"))
        at = end
    return counts, faces, at


def _has_indices(element: _Element, prop: _Property) -> bool:
    return element.name == "face" and prop.name in _INDICES and prop.count_type != ""


def _skip(words: Iterator[bytes], count: int) -> None:
    next(islice(words, count, count), None)
