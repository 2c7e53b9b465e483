"""`Footage`: frames of linear radiance from a video or a folder of images."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, repeat
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tasks.errors import TaskError
from tasks.footage import images, video
from tasks.footage.luminance import Luminance, coding_of

_log = logging.getLogger(__name__)

_MIN_FPS, _MAX_FPS = 1e-3, 1e8  # times are whole nanoseconds

Float32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False, slots=True)
class Footage:
    """Frames of linear radiance with their times.

    Iterating reads the frames in order, (H, W) float32 each; only one is in memory.

    Parameters
    ----------
    path
        The video, or the folder.
    t_s
        (T,) times of the frames, seconds, increasing.
    t_offset_us
        Time 0 of `t_s` on the clock of the footage, microseconds; the first frame is less than 1 us
        later.
    height, width
        Size of the frames, px.
    encoding
        Transfer function of the stored numbers, see `sensor.to_linear`.
    white_level
        Radiance of white: 1 for encoded numbers, else the 99.9th percentile of the first frame.
    frames
        Function that starts reading: it returns an iterator of (H, W) float32.
    mender
        Mends and counts float pixels that are no light; None for integers.
    fps
        Frames per second that replace the video's own times.
    """

    path: Path
    t_s: NDArray[np.float64]
    t_offset_us: int
    height: int
    width: int
    encoding: str
    white_level: float
    frames: Callable[[], Iterator[Float32]]
    mender: Luminance | None = None
    fps: float | None = None

    def __len__(self) -> int:
        return len(self.t_s)

    def __iter__(self) -> Iterator[Float32]:
        return self.frames()

    def between(self, start_s: float, end_s: float | None) -> Footage:
        """Return the frames of a part, which keep their times on the clock of the footage.

        Parameters
        ----------
        start_s, end_s
            Seconds from the first frame; None for the end of the footage.

        Returns
        -------
        Footage

        Raises
        ------
        TaskError
            Fewer than two frames are between.
        """
        since_s = self.t_s - self.t_s[0]
        ends_s = start_s, math.inf if end_s is None else end_s
        first, stop = np.searchsorted(since_s, ends_s).tolist()
        if stop - first < 2:
            raise TaskError(
                f"{self.path}: --start {start_s:g} --end {end_s}: found {max(0, stop - first)} "
                f"frames between, expected at least 2 of the {since_s[-1]:g} s"
            )
        passed_us = math.floor(1e6 * self.t_s[first])
        return replace(
            self,
            t_s=self.t_s[first:stop] - 1e-6 * passed_us,
            t_offset_us=self.t_offset_us + passed_us,
            frames=lambda: islice(self.frames(), first, stop),
        )


def open_footage(
    path: str | Path,
    *,
    fps: float | None = None,
    time_unit: str | None = None,
    encoding: str | None = None,
    layer: str | None = None,
    repair: bool = False,
) -> Footage:
    """Open a video, or a folder of images.

    Parameters
    ----------
    path
        A video that FFmpeg reads, or a folder of PNG, JPEG, TIFF or OpenEXR images, in the order of
        the numbers in their names.
    fps
        Frames per second. Needed for a folder without timestamps.txt. For a video, it replaces the
        video's own times, as slow-motion footage needs.
    time_unit
        Unit of timestamps.txt, "s", "ms", "us" or "ns", unless its first line states the unit, such
        as "# unit: us".
    encoding
        Transfer function of the stored numbers, see `sensor.to_linear`. By default a video's tag,
        or "rec709" without a tag; "linear" for floats; "srgb" for other images.
    layer
        Layer of OpenEXR files, see `eres_render.storage.exr.read_luminance`.
    repair
        Whether float pixels that are NaN, infinite or negative get the median of their neighbors;
        see `Luminance`.

    Returns
    -------
    Footage
        Colors are made linear, then converted to luminance (ITU-R BT.709, or as an OpenEXR file
        says).

    Raises
    ------
    TaskError
        The footage cannot be read, its frames differ in size, its times are unknown or do not match
        its frames, floats have another encoding than "linear", or pixels hold no light. Frames are
        checked when they are read.
    RenderError
        An OpenEXR file cannot be read, or its layer is not clear.
    SensorError
        The encoding is unknown.
    """
    path = Path(path)
    if fps is not None and not _MIN_FPS <= fps <= _MAX_FPS:
        raise TaskError(f"fps: found {fps}, expected {_MIN_FPS:g} to {_MAX_FPS:g}")
    coded: Callable[[], Iterator[NDArray[np.generic]]]
    files: list[Path] = []
    if path.is_dir():
        files = images.list_images(path)
        t_ns = images.times_ns(path, files, fps, time_unit)
        if images.has_transparency(files[0], layer):
            _log.warning("%s: transparency is ignored; transparent pixels become visible", path)
        coded = partial(images.read_images, files, layer)
        usual = "srgb"
    else:
        usual = video.tagged_encoding(path, encoding)
        t_ns = video.times_ns(path, fps)
        coded = partial(video.read_frames, path, len(t_ns))
    if time_unit is not None and not files:
        raise TaskError(f"{path}: --time-unit is only for a folder with timestamps.txt")
    if layer is not None and not (files and images.is_exr(files[0])):
        raise TaskError(f"{path}: --layer is only for OpenEXR images")
    first = next(coded())
    encoding, white = coding_of(first, encoding, usual, path)
    advice = "; --repair replaces them with their neighbors' median"
    luminance = Luminance(encoding, white, repair, advice)
    offset_us = t_ns[0] // 1000
    return Footage(
        path=path,
        t_s=1e-9 * np.array([t - 1000 * offset_us for t in t_ns]),
        t_offset_us=offset_us,
        height=first.shape[0],
        width=first.shape[1],
        encoding=encoding,
        white_level=white,
        frames=lambda: map(luminance, files or repeat(path), coded()),
        mender=luminance if first.dtype.kind == "f" else None,
        fps=fps,
    )
