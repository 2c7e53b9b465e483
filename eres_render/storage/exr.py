"""Read and write single-channel OpenEXR images."""

from __future__ import annotations

import ctypes
import functools
import io
import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Literal

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from eres_render.errors import RenderError
from eres_render.storage.atomic import write_bytes

Compression = Literal["zip", "none"]

_COMPRESSIONS = {"zip": OpenEXR.ZIP_COMPRESSION, "none": OpenEXR.NO_COMPRESSION}
_LEAST_TOO_LARGE = 65520  # rounds to infinity in half precision
_silencing = threading.Lock()


def to_half(image: NDArray[np.floating], path: Path) -> NDArray[np.float16]:
    """Round an image to half precision.

    Parameters
    ----------
    image
        (H, W).
    path
        The file to write, for error messages.

    Returns
    -------
    (H, W) float16.

    Raises
    ------
    RenderError
        If a value is not finite, or becomes infinite.
    """
    if not (image.min() > -_LEAST_TOO_LARGE and image.max() < _LEAST_TOO_LARGE):
        bad = np.argwhere(~(np.abs(image) < _LEAST_TOO_LARGE))[0]
        raise RenderError(
            f"{path}: pixel x={bad[1]} y={bad[0]}: found {image[tuple(bad)]:g}, expected a finite "
            f"value below {_LEAST_TOO_LARGE:g}, the limit of half-floats"
        )
    return np.ascontiguousarray(image, dtype=np.float16)


def write_luminance(
    path: Path,
    image: NDArray[np.floating],
    attributes: Mapping[str, str] | None = None,
) -> None:
    """Write an image as the half-float channel Y.

    Parameters
    ----------
    path
        The file, which appears under its name only when it is complete.
    image
        (H, W).
    attributes
        Texts for the header, by name.

    Raises
    ------
    RenderError
        If the file cannot be written, or a value does not fit half precision.
    """
    write_channels(path, {"Y": to_half(image, path)}, attributes)


def write_channels(
    path: Path,
    channels: Mapping[str, NDArray[np.generic]],
    attributes: Mapping[str, str] | None = None,
    compression: Compression = "zip",
) -> None:
    """Write the channels of an image.

    Parameters
    ----------
    path
        The file, which appears under its name only when it is complete.
    channels
        (H, W) each, by name.
    attributes
        Texts for the header, by name.
    compression
        Whether to compress the file. Both are lossless, and every reader supports them. A frame of
        1280 x 1280 takes 2.2 MB and 35 to 42 ms of CPU time, or 3.3 MB and 3 to 5 ms.

    Raises
    ------
    RenderError
        If the file cannot be written.
    """
    header = {"compression": _COMPRESSIONS[compression], "type": OpenEXR.scanlineimage}
    file = OpenEXR.File({**header, **(attributes or {})}, dict(channels))

    # Via memory: the library reports no error if the last bytes of a file do not fit on the disk.
    data = io.BytesIO()
    file.write(data)
    write_bytes(path, data.getbuffer())


def read_luminance(path: Path, *, intact: bool = False) -> NDArray[np.float32]:
    """Read the image of channel Y.

    Parameters
    ----------
    path
        The file.
    intact
        Whether the file is known to be undamaged. If not, stdout and stderr of the process are
        silent during the reading, because the library prints its errors there.

    Returns
    -------
    image
        (H, W) float32.

    Raises
    ------
    RenderError
        If the file is missing, truncated or not an image with a channel Y.
    """
    with _open(path, silent=not intact) as file:
        return np.asarray(file.channels()["Y"].pixels, dtype=np.float32)


def read_half(path: Path) -> NDArray[np.float16]:
    """Read the image of channel Y in half precision, as `write_luminance` stores it.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    (H, W) float16.

    Raises
    ------
    RenderError
        If the file is missing, truncated or not such an image.
    """
    with _open(path) as file:
        return np.asarray(file.channels()["Y"].pixels, dtype=np.float16)


def read_channels(path: Path) -> dict[str, NDArray[np.float32]]:
    """Read all channels of an image.

    Returns
    -------
    (H, W) float32 each, by name.

    Raises
    ------
    RenderError
        If the file is missing, truncated or not an image.
    """
    with _open(path, expected="a whole image", separate=True) as file:
        return {name: np.asarray(one.pixels, np.float32) for name, one in file.channels().items()}


def read_attributes(path: Path) -> dict[str, str]:
    """Read the text attributes of an image's header.

    Raises
    ------
    RenderError
        If the file is missing or not an image.
    """
    with _open(path, header_only=True) as file:
        return {k: v for k, v in file.header().items() if isinstance(v, str)}


def check_readable(path: Path) -> None:
    """Refuse a damaged image; Mitsuba would abort the process on it.

    Raises
    ------
    RenderError
        If OpenEXR cannot read it.
    """
    status = path.stat()
    _check_readable(path, status.st_mtime_ns, status.st_size)


@functools.cache  # once per process: a scene with many images takes about a second
def _check_readable(path: Path, changed_ns: int, size: int) -> None:
    with _open(path, expected="a whole image") as file:
        file.channels()


@contextmanager
def _silence() -> Iterator[None]:
    """Discard the output of C and C++ libraries, which does not go through Python's streams."""
    flush_all = ctypes.CDLL(None).fflush
    with _silencing, open(os.devnull, "wb") as nowhere:
        flush_all(None)
        kept = {}
        for stream in (1, 2):
            with suppress(OSError):  # the process may not have this stream
                kept[stream] = os.dup(stream)
        try:
            for stream in kept:
                os.dup2(nowhere.fileno(), stream)
            yield
        finally:
            flush_all(None)
            for stream, copy in kept.items():
                os.dup2(copy, stream)
                os.close(copy)


@contextmanager
def _open(
    path: Path,
    header_only: bool = False,
    expected: str = "an image with a channel Y",
    separate: bool = False,
    silent: bool = True,
) -> Iterator[OpenEXR.File]:
    """Open an image; errors of the library become a RenderError that names the file.

    While it is open, the process is silent, as the library prints its errors. What other threads
    print meanwhile is lost, so a missing file, which is common, is not opened.
    """
    if not path.is_file():
        raise RenderError(f"{path}: missing")
    try:
        with (
            _silence() if silent else nullcontext(),
            OpenEXR.File(str(path), separate_channels=separate, header_only=header_only) as file,
        ):
            yield file
    except (RuntimeError, ValueError, KeyError, TypeError) as error:
        found = f"{path.stat().st_size} bytes that OpenEXR cannot read"
        raise RenderError(f"{path}: found {found}, expected {expected}") from error
