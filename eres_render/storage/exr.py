"""Read and write OpenEXR images; those that we write have one channel."""

from __future__ import annotations

import ctypes
import functools
import io
import math
import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from eres_render.errors import RenderError
from eres_render.storage.atomic import write_bytes

Compression = Literal["zip", "none"]

MIN_WHITE = 0.06
"""Least radiance of white for half-floats: a thousandth of it, the dark level, is about the least
normal one; below, shadows are rounded visibly."""

_COMPRESSIONS = {"zip": OpenEXR.ZIP_COMPRESSION, "none": OpenEXR.NO_COMPRESSION}
_LEAST_TOO_LARGE = 65520  # rounds to infinity in half precision
# CIE x and y of red, green, blue and white of Rec. 709, the primaries of a file that names none.
_REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
_FREE_PIXELS = 1 << 26  # of a display window
_MAX_GROWTH = 500  # further ones for each pixel of the data window
_DEEP = (OpenEXR.deepscanline, OpenEXR.deeptile)
_silencing = threading.Lock()


def to_half(image: NDArray[np.floating], path: Path) -> NDArray[np.float16]:
    """Round an (H, W) image to half precision; refuse values that are too large or not finite."""
    if not (image.min() > -_LEAST_TOO_LARGE and image.max() < _LEAST_TOO_LARGE):
        bad = np.argwhere(~(np.abs(image) < _LEAST_TOO_LARGE))[0]
        raise RenderError(
            f"{path}: pixel x={bad[1]} y={bad[0]}: found {image[tuple(bad)]:g}, expected a finite "
            f"value below {_LEAST_TOO_LARGE:g}, the limit of half-floats"
        )
    return np.ascontiguousarray(image, dtype=np.float16)


def write_luminance(
    path: Path, image: NDArray[np.floating], attributes: Mapping[str, str] | None = None
) -> None:
    """Write an (H, W) image as the half-float channel Y."""
    write_channels(path, {"Y": to_half(image, path)}, attributes)


def write_channels(
    path: Path,
    channels: Mapping[str, NDArray[np.generic]],
    attributes: Mapping[str, str] | None = None,
    compression: Compression = "zip",
) -> None:
    """Write the channels of an image, (H, W) each, by name; both compressions are lossless.

    A frame of 1280 x 1280 takes 2.2 MB and 35 to 42 ms of CPU time, or 3.3 MB and 3 to 5 ms.
    """
    header = {"compression": _COMPRESSIONS[compression], "type": OpenEXR.scanlineimage}
    file = OpenEXR.File({**header, **(attributes or {})}, dict(channels))

    # Via memory: the library reports no error if the last bytes of a file do not fit on the disk.
    data = io.BytesIO()
    file.write(data)
    write_bytes(path, data.getbuffer())


def read_luminance(
    path: Path, *, layer: str | None = None, intact: bool = False
) -> NDArray[np.float32]:
    """Read the luminance of an image on its display window, (H, W); 0 outside the data window.

    It is channel Y, or comes from R, G and B with the file's `chromaticities` (Rec. 709 by
    default). `layer` is as in "ViewLayer.Combined", or the part, or part and layer; by default
    channels without a layer, else the only layer with light, else Blender's Combined. Unless
    `intact`, the process prints nothing meanwhile, because the library prints its errors.
    """
    chosen = find_layer(path, layer, intact=intact)
    prefix = chosen.prefix
    with _open(path, expected="a whole image", silent=not intact) as file:
        part = next(part for part in file.parts if part.part_index == chosen.part)
        header, channels = part.header, part.channels
        if prefix + "Y" in channels:
            image = np.asarray(channels[prefix + "Y"].pixels, dtype=np.float32)
        else:
            weights = _luminance_weights(header.get("chromaticities", _REC709))
            red, green, blue = (np.asarray(channels[prefix + c].pixels, np.float32) for c in "RGB")
            with np.errstate(invalid="ignore"):  # of infinite colors
                image = weights[0] * red + weights[1] * green + weights[2] * blue
        return _on_display(image, header)


class Layer(NamedTuple):
    """Channels of a file that hold light."""

    name: str
    """Of the part and the layer."""
    part: int
    prefix: str
    """Of the channels' names."""
    has_alpha: bool
    corner: tuple[int, int]
    """First column and row of the display window."""


def find_layer(path: Path, wanted: str | None = None, *, intact: bool = False) -> Layer:
    """Find the layer that `read_luminance` reads."""
    layers, names = [], []
    with _open(path, header_only=True, expected="an image", silent=not intact) as file:
        for part in file.parts:
            own = [channel.name for channel in part.header["channels"]]
            names += own
            if part.type() not in _DEEP:
                column, row = part.header["displayWindow"][0].tolist()
                for prefix in _prefixes(own):
                    name, alpha = _layer_name(part.name(), prefix), prefix + "A" in own
                    layers.append(Layer(name, part.part_index, prefix, alpha, (column, row)))
    if not layers:
        raise RenderError(
            f"{path}: found channels {', '.join(names)}, expected Y, or R, G and B, with one value "
            "per pixel"
        )
    if wanted is not None:
        choices = [[layer for layer in layers if layer.name == wanted]]
    else:
        combined = [layer for layer in layers if layer.name.rpartition(".")[2] == "Combined"]
        choices = [[layer for layer in layers if not layer.prefix], layers, combined]
    for choice in choices:
        if len(choice) == 1:
            return choice[0]
    listed = ", ".join(layer.name or "(none)" for layer in layers)
    what = "choose one with --layer" if wanted is None else f"none is {wanted!r} (--layer)"
    raise RenderError(f"{path}: found layers {listed}; {what}")


def _prefixes(names: list[str]) -> list[str]:
    """Return what stands before R, G and B, or before a Y without a layer: "" or "layer."."""
    prefixes = dict.fromkeys(name[: name.rfind(".") + 1] for name in names)
    colors = {prefix: {prefix + c for c in "RGB"} for prefix in prefixes}
    return [p for p in prefixes if colors[p] <= {*names} or (p == "" and "Y" in names)]


def _layer_name(part: str, prefix: str) -> str:
    """Return the name of a layer; Blender repeats the part in it."""
    layer = prefix.removesuffix(".")
    return layer if layer.startswith(part) else f"{part}.{layer}".removesuffix(".")


def _luminance_weights(chromaticities: Sequence[float]) -> NDArray[np.float32]:
    """Return Y's row in the matrix from RGB to XYZ, by CIE x and y of R, G, B and white."""
    x, y = np.reshape(chromaticities, (4, 2)).T.astype(np.float64)
    xyz = np.stack([x, y, 1 - x - y])  # a column for each
    scales = np.linalg.solve(xyz[:, :3], xyz[:, 3] / y[3])
    return np.asarray(scales * y[:3], np.float32)


def _on_display(image: NDArray[np.float32], header: Mapping[str, Any]) -> NDArray[np.float32]:
    """Return an image of the data window on the display window, 0 elsewhere."""
    first, last = (np.asarray(corner, np.int64) for corner in header["displayWindow"])
    start = header["dataWindow"][0] - first  # of the data, in the display window
    size = last - first + 1
    if not start.any() and image.shape == (size[1], size[0]):
        return image
    if math.prod(size.tolist()) > _FREE_PIXELS + _MAX_GROWTH * image.size:
        raise ValueError("the display window is far larger than the data window")
    shown = np.zeros((size[1], size[0]), np.float32)
    low = np.clip(start, 0, size)
    high = np.clip(start + image.shape[::-1], low, size)
    (left, top), (right, bottom) = low - start, high - start
    shown[low[1] : high[1], low[0] : high[0]] = image[top:bottom, left:right]
    return shown


def read_half(path: Path) -> NDArray[np.float16]:
    """Read channel Y in half precision, (H, W), as `write_luminance` stores it."""
    with _open(path) as file:
        return np.asarray(file.channels()["Y"].pixels, dtype=np.float16)


def read_attributes(path: Path) -> dict[str, str]:
    """Read the text attributes of an image's header."""
    with _open(path, header_only=True) as file:
        return {k: v for k, v in file.header().items() if isinstance(v, str)}


def check_readable(path: Path) -> None:
    """Refuse a damaged image; Mitsuba would abort the process on it."""
    status = path.stat()
    _check_readable(path, status.st_mtime_ns, status.st_size)


@functools.cache  # once per process: a scene with many images takes about a second
def _check_readable(path: Path, changed_ns: int, size: int) -> None:
    with _open(path, expected="a whole image") as file:
        file.channels()


@contextmanager
def _silence() -> Iterator[None]:
    """Discard the output of C and C++ libraries, which does not go through Python's streams."""
    flush_all = ctypes.CDLL("ucrtbase" if os.name == "nt" else None).fflush
    with _silencing, open(os.devnull, "wb") as nowhere:
        flush_all(None)
        copies = {}
        for stream in (1, 2):
            with suppress(OSError):  # the process may not have this stream
                copies[stream] = os.dup(stream)
        try:
            for stream in copies:
                os.dup2(nowhere.fileno(), stream)
            yield
        finally:
            flush_all(None)
            for stream, copy in copies.items():
                os.dup2(copy, stream)
                os.close(copy)


@contextmanager
def _open(
    path: Path,
    header_only: bool = False,
    expected: str = "an image with a channel Y",
    silent: bool = True,
) -> Iterator[OpenEXR.File]:
    """Open an image; errors of the library become a RenderError that names the file.

    If `silent`, the process prints nothing meanwhile, as the library prints its errors.
    """
    if not path.is_file():
        raise RenderError(f"{path}: missing")
    try:
        with (
            _silence() if silent else nullcontext(),
            OpenEXR.File(str(path), separate_channels=True, header_only=header_only) as file,
        ):
            yield file
    except OSError:  # of the system
        raise
    except Exception as error:  # what a damaged file makes of the library cannot be listed
        content = f"{path.stat().st_size} bytes that OpenEXR cannot read"
        raise RenderError(f"{path}: found {content}, expected {expected}") from error
