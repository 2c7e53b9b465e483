"""Check the faces of a PLY mesh, which Mitsuba takes as they are."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from eres_render.errors import RenderError

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}


class _Element(NamedTuple):
    name: str
    size: int  # number of its records
    properties: list[list[str]]  # words after "property"


def check_faces(path: Path) -> None:
    """Refuse a mesh with a face of a vertex that it does not have: Mitsuba would read other memory.

    Files that are no PLY, or end early, are left to Mitsuba, which refuses them.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    RenderError
        A face has such a vertex.
    """
    with path.open("rb") as file:
        try:
            kind, elements = _header(file)
            largest, vertices = _largest_index(file, kind, elements)
        except (ValueError, KeyError, IndexError):
            return
    if largest >= vertices:
        raise RenderError(
            f"{path}: found a face of vertex {largest}, expected 0 to {vertices - 1}, as there are "
            f"{vertices} vertices"
        )


def _header(file: BinaryIO) -> tuple[str, list[_Element]]:
    kind, elements = "", list[_Element]()
    while (words := file.readline().decode("ascii").split()) != ["end_header"]:
        match words:
            case ["format", found, _]:
                kind = found
            case ["element", name, count]:
                elements.append(_Element(name, int(count), []))
            case ["property", *rest]:
                elements[-1].properties.append(rest)
            case ["ply"] | ["comment" | "obj_info", *_]:
                pass
            case _:  # also the end of the file
                raise ValueError
    return kind, elements


def _largest_index(file: BinaryIO, kind: str, elements: list[_Element]) -> tuple[int, int]:
    """Return the largest index of a vertex, as an unsigned number, and the number of vertices."""
    vertex, face = elements
    if (vertex.name, face.name, len(face.properties)) != ("vertex", "face", 1):
        raise ValueError
    _, count_type, index_type, _ = face.properties[0]
    if kind == "ascii":
        lines = islice(file, vertex.size, vertex.size + face.size)
        indices = [int(word) for line in lines for word in line.split()[1:]]
        return max((one & 0xFFFFFFFF for one in indices), default=-1), vertex.size
    order = _ORDERS[kind]
    record = sum(np.dtype(_TYPES[one]).itemsize for one, _ in vertex.properties)
    data = np.frombuffer(file.read()[record * vertex.size :], np.uint8)
    largest, start, left, run = -1, 0, face.size, 1 << 16
    head, each = np.dtype(_TYPES[count_type]).itemsize, np.dtype(_TYPES[index_type]).itemsize
    unsigned = np.dtype(f"{order}u{each}")  # -1 is too large, too
    while left:  # a run of faces with the same number of corners
        corners = data[start] if order == "<" else data[start + head - 1]
        step = head + each * int(corners)
        fits = min(left, 2 * run, (data.size - start) // step)  # not all, as runs may be short
        rows = data[start : start + fits * step].reshape(fits, step)
        same = np.all(rows[:, :head] == rows[0, :head], axis=1)
        run = int(fits if same.all() else same.argmin())
        found = np.ascontiguousarray(rows[:run, head:]).view(unsigned)
        largest = max(largest, int(found.max(initial=0)))
        start, left = start + run * step, left - run
    return largest, vertex.size
