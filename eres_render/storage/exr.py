"""Single-channel OpenEXR images, written whole or not at all."""

from __future__ import annotations

import ctypes
import functools
import io
import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from eres_render.errors import RenderError
from eres_render.storage.atomic import write_bytes

_silencing = threading.Lock()


def write_luminance(
    path: Path, image: NDArray[np.floating], attributes: Mapping[str, str] | None = None
) -> None:
    """Write an (H, W) image as half-float channel Y, with text attributes in the header.

    The file appears under its name only once it is complete.

    Raises
    ------
    RenderError
        If the folder or the disk does not take it, or a value does not fit half precision.
    """
    with np.errstate(over="ignore"):
        half = np.ascontiguousarray(image, dtype=np.float16)
    if not np.isfinite(half).all():
        raise RenderError(f"{path}: a value of the image is not finite in half precision")
    write_channels(path, {"Y": half}, attributes)


def write_channels(
    path: Path,
    channels: Mapping[str, NDArray[np.generic]],
    attributes: Mapping[str, str] | None = None,
) -> None:
    """Write (H, W) channels of an image, whole or not at all.

    Raises
    ------
    RenderError
        If the folder or the disk does not take it.
    """
    # ZIP: measured on 1280 x 1280 carpet frames, it is as small as PIZ (2.2 MB), costs 0.03 s of
    # one core, less than a tenth of the frame's rendering, and every reader knows it.
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    file = OpenEXR.File({**header, **(attributes or {})}, dict(channels))

    # By way of memory: the library does not say if the disk refuses a file's last bytes.
    data = io.BytesIO()
    file.write(data)
    write_bytes(path, data.getbuffer())


def read_luminance(path: Path, *, intact: bool = False) -> NDArray[np.float32]:
    """Read the (H, W) image of channel Y as float32.

    Parameters
    ----------
    path
        The file.
    intact
        That it is as it was written is known. Else nothing that other threads print meanwhile is
        seen, lest the library say on stdout and stderr what it finds wrong.

    Raises
    ------
    RenderError
        If the file is missing, truncated or not an image with a channel Y.
    """
    with nullcontext() if intact else _silence(), _open(path) as file:
        return np.asarray(file.channels()["Y"].pixels, dtype=np.float32)


def read_attributes(path: Path) -> dict[str, str]:
    """Read the text attributes of an image's header.

    Raises
    ------
    RenderError
        If the file is missing or not an image.
    """
    with _silence(), _open(path, header_only=True) as file:
        return {k: v for k, v in file.header().items() if isinstance(v, str)}


def check_readable(path: Path) -> None:
    """Refuse an image of any channels that is damaged; Mitsuba would end the process over it.

    Raises
    ------
    RenderError
        If OpenEXR cannot read it.
    """
    status = path.stat()
    _check_readable(path, status.st_mtime_ns, status.st_size)


@functools.cache  # once a process, for a second or so of a scene with many images
def _check_readable(path: Path, changed_ns: int, size: int) -> None:
    with _silence(), _open(path, expected="a whole image") as file:
        file.channels()


@contextmanager
def _silence() -> Iterator[None]:
    """Send to nowhere what C and C++ libraries print, past Python's own streams."""
    flush_all = ctypes.CDLL(None).fflush
    with _silencing, open(os.devnull, "wb") as nowhere:
        flush_all(None)
        kept = {}
        for stream in (1, 2):
            with suppress(OSError):  # a process may have none
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
    path: Path, header_only: bool = False, expected: str = "an image with a channel Y"
) -> Iterator[OpenEXR.File]:
    """Open an image; what goes wrong with it is told as a RenderError that names it."""
    if not path.is_file():
        raise RenderError(f"{path}: missing")
    try:
        with OpenEXR.File(str(path), header_only=header_only) as file:
            yield file
    except (RuntimeError, ValueError, KeyError, TypeError) as error:
        found = f"{path.stat().st_size} bytes that OpenEXR cannot read"
        raise RenderError(f"{path}: found {found}, expected {expected}") from error
