"""Folders of images: their order, times and pixel values."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import suppress
from decimal import Decimal
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from eres_render.errors import reading
from eres_render.storage.exr import find_layer, read_luminance
from sensor.time_units import TIME_UNITS
from tasks.errors import TaskError

_TIMES = "timestamps.txt"
_KINDS = {
    ".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg", ".tif": "tiff", ".tiff": "tiff", ".exr": "exr"
}  # fmt: skip
_BITS_PER_SAMPLE, _PHOTOMETRIC, _EXTRA_SAMPLES = 258, 262, 338  # of TIFF
_PNG_BITS = 24  # where a file states its bits per sample
# Pillow's modes that are read by Pillow: what alpha is removed from, and what stays as it is.
_8_BITS = {"1": "L", "L": "L", "LA": "L", "P": "RGB", "RGB": "RGB", "RGBA": "RGB"}
_DEEP = "I;16", "I;16B", "F"
_SUBFILE, _REDUCED_OR_MASK = 254, 0b101
_BIG_TIFF = b"+"
_WHOLE = r"\d+"
_NUMBERS = _WHOLE, r"\d+(?:\.\d+)?"


def list_images(folder: Path) -> list[Path]:
    """Return a folder's images except hidden files, in the order of the numbers in their names."""
    named = (file for file in folder.iterdir() if not file.name.startswith("."))
    files = [file for file in named if file.suffix.lower() in _KINDS]
    kinds = sorted({_KINDS[file.suffix.lower()] for file in files})
    if len(kinds) > 1:
        raise TaskError(f"{folder}: found {' and '.join(kinds)}, expected images of one kind")
    if len(files) < 2:
        raise TaskError(
            f"{folder}: found {len(files)} images, expected at least two PNG, JPEG, TIFF or EXR"
        )
    by_whole, by_decimal = (sorted(files, key=partial(_natural, number=n)) for n in _NUMBERS)
    for first, second in zip(by_whole, by_decimal, strict=True):
        if first != second:
            raise TaskError(
                f"{folder}: {first.name} and {second.name} have no clear order; use whole numbers"
            )
    return by_whole


def _natural(file: Path, number: str) -> tuple[list[tuple[Decimal, str]], str]:
    """Return a key that sorts 10 after 9, and 1 after 01."""
    parts = _parts(file, number)
    return [(Decimal(p), "") if p[0].isdecimal() else (Decimal(-1), p) for p in parts], file.name


def _parts(file: Path, number: str = _WHOLE) -> list[str]:
    return [part for part in re.split(f"({number})", file.stem) if part]


def is_exr(file: Path) -> bool:
    """Return whether an image is an OpenEXR file, by its name."""
    return _KINDS.get(file.suffix.lower()) == "exr"


def has_transparency(file: Path, layer: str | None = None) -> bool:
    """Return whether an image has transparency, which `read_images` leaves out."""
    kind = _KINDS[file.suffix.lower()]
    with reading(file, "an image", TaskError):
        if kind == "tiff":
            return bool(_tiff_tags(file).get(_EXTRA_SAMPLES))
        if kind == "exr":
            return find_layer(file, layer).has_alpha
        data = file.read_bytes()
        return kind == "png" and (data[25:26] in (b"\x04", b"\x06") or b"tRNS" in _png_chunks(data))


def _png_chunks(data: bytes) -> Iterator[bytes]:
    """Yield the types of a PNG file's chunks, up to the last complete one."""
    at = 8  # after the signature
    while len(data) >= (end := at + 12 + int.from_bytes(data[at : at + 4])):
        yield data[at + 4 : at + 8]
        at = end


def _tiff_tags(file: Path, page: int = 0) -> ImageFileDirectory_v2:
    """Return the tags of an image of a TIFF file; none if it has no such image, or is no TIFF."""
    tags = ImageFileDirectory_v2()
    with file.open("rb") as data, suppress(Exception):  # its decoder decides whether it is one
        head = data.read(8)
        tags = ImageFileDirectory_v2(head + data.read(8) if head[2:3] == _BIG_TIFF else head)
        for _ in range(page + 1):
            if not tags.next:
                return ImageFileDirectory_v2()
            data.seek(tags.next)
            tags.load(data)
    return tags


def times_ns(
    folder: Path,
    files: list[Path],
    fps: float | None,
    time_unit: str | None,
    *,
    option: str = "--time-unit",
) -> list[int]:
    """Return the times of the images of a folder, nanoseconds, increasing."""
    file = folder / _TIMES
    if fps is None and not file.exists():
        raise TaskError(f"{folder}: has no times; give --fps, such as --fps 240, or add {_TIMES}")
    if fps is not None:
        if file.exists() or time_unit is not None:
            other = _TIMES if file.exists() else "--time-unit"
            raise TaskError(f"{folder}: give --fps or {other}, not both")
        _check_complete(files)
        return [round(k * 1e9 / fps) for k in range(len(files))]
    times = _read_times(file, time_unit, option)
    if len(times) != len(files):
        raise TaskError(f"{file}: {len(times)} times for {len(files)} images; expected one each")
    return times


def _check_complete(files: list[Path]) -> None:
    """Refuse gaps in the numbering, after which evenly spaced times would be wrong."""
    numbers = [[int(part) for part in _parts(file) if part.isdecimal()] for file in files]
    if not all(numbers):
        return
    steps = np.diff([each[-1] for each in numbers])
    gaps = [*np.flatnonzero(steps <= 0), *np.flatnonzero(steps > np.min(steps))]
    if gaps:
        before, after = files[gaps[0] : gaps[0] + 2]
        raise TaskError(f"{after}: uneven number after {before.name}; renumber, or add {_TIMES}")


def _read_times(file: Path, time_unit: str | None, option: str) -> list[int]:
    with reading(file, "text", TaskError):
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    stated = re.fullmatch(r"#\s*unit\s*:\s*(\w+)\s*", lines[0]) if lines else None
    if stated and time_unit and stated[1] != time_unit:
        raise TaskError(f"{file}: states the unit {stated[1]}, but {option} is {time_unit}")
    unit = time_unit or (stated and stated[1])
    if unit is None or unit not in TIME_UNITS:
        raise TaskError(
            f"{file}: unit: found {unit or 'none'}, expected {option} s, ms, us or ns, or a first "
            "line such as '# unit: us'"
        )
    times: list[int] = []
    for k, line in enumerate(lines, start=1):
        text = line.partition("#")[0].strip()
        if not text:
            continue
        with suppress(ArithmeticError, ValueError):
            # Exact: a float of seconds since 1970 has steps of a quarter of a microsecond.
            time = round(Decimal(text).scaleb(TIME_UNITS[unit] + 3))
            if not times or time > times[-1]:
                times.append(int(np.int64(time)))  # an error beyond 292 years
                continue
        raise TaskError(f"{file}:{k}: found {text!r}, expected a time after the previous one")
    return times


def read_images(files: list[Path], layer: str | None = None) -> Iterator[NDArray[np.generic]]:
    """Read images one after another, (H, W), or (H, W, 3) red, green, blue.

    They are uint8, uint16 or float32; an OpenEXR image is its luminance.
    """
    expected: list[str] = []
    for file in files:
        with reading(file, "an image", TaskError):
            image = _read(file, layer)
        height, width = image.shape[:2]
        traits = [f"{width}x{height} px", "floats" if image.dtype.kind == "f" else "integers"]
        if is_exr(file):
            traits.append("a display window from x={} y={}".format(*find_layer(file, layer).corner))
        for ours, first in zip(traits, expected or traits, strict=False):
            if ours != first:
                raise TaskError(f"{file}: found {ours}, expected {first}, as in {files[0].name}")
        expected = expected or traits
        yield image


def _read(file: Path, layer: str | None) -> NDArray[np.generic]:
    kind = _KINDS.get(file.suffix.lower())
    if kind is None:
        raise TaskError(f"{file}: expected an extension of {', '.join(_KINDS)}")
    if kind == "exr":
        return read_luminance(file, layer=layer)
    second = _tiff_tags(file, 1) if kind == "tiff" else {}
    if second and not second.get(_SUBFILE, 0) & _REDUCED_OR_MASK:  # others would be left out
        raise TaskError(f"{file}: contains several images; store each in its own file")
    data = file.read_bytes()
    image = _decoded(file, data, kind) if _is_complete(data, kind) else None
    if image is None:
        raise TaskError(f"{file}: is not a complete {kind.upper()} image ({len(data)} bytes)")
    if image.dtype not in (np.uint8, np.uint16, np.float32):
        raise TaskError(f"{file}: found {image.dtype}, expected 8 or 16 bits, or 32-bit floats")
    if image.dtype == np.uint16 and kind == "tiff" and _tiff_tags(file).get(_PHOTOMETRIC) == 0:
        image = np.invert(image)  # white is 0, which decoders turn round for 8 bits only
    return image


def _decoded(file: Path, data: bytes, kind: str) -> NDArray[np.generic] | None:
    """Return an image without alpha, rotated by its EXIF orientation; None if it is damaged.

    Pillow would round colors of 16 bits to 8 and lacks a few kinds: OpenCV reads these.
    """
    bits = {"png": data[_PNG_BITS:][:1], "tiff": _tiff_tags(file).get(_BITS_PER_SAMPLE, b"")}
    with suppress(UnidentifiedImageError), Image.open(io.BytesIO(data)) as opened:
        if opened.mode in _DEEP or (opened.mode in _8_BITS and max(bits.get(kind) or (8,)) <= 8):
            ImageOps.exif_transpose(opened, in_place=True)
            image = np.asarray(opened.convert(_8_BITS.get(opened.mode, opened.mode)))
            return image.astype(image.dtype.newbyteorder("="), copy=False)
    import cv2  # here, as the base install is without it

    codes = np.frombuffer(data, np.uint8)
    colors = cv2.imdecode(codes, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
    return colors if colors is None or colors.ndim == 2 else colors[..., ::-1]


def _is_complete(data: bytes, kind: str) -> bool:
    """Return whether a file has its end: decoders return part of the image of a truncated one."""
    if kind == "png":
        return b"IEND" in _png_chunks(data)
    if kind != "jpeg":
        return True
    at = 2  # after the start of the image; a preview inside a segment has an end too
    while data[at : at + 1] == b"\xff" and data[at + 1 : at + 2] != b"\xda":
        is_fill = data[at + 1 : at + 2] == b"\xff"  # T.81, B.1.1.2
        at += 1 if is_fill else 2 + int.from_bytes(data[at + 2 : at + 4])
    return b"\xff\xd9" in data[at:]  # phones append films
