"""Read frames and times: check them, a few at a time, without a copy if possible."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sensor.errors import SensorError
from sensor.kernels.packing import MAX_INTERVAL_US
from sensor.memory import MEMORY
from sensor.model import MAX_TIME_S
from sensor.numbers import refusal

FrameInput = NDArray[np.floating] | Iterable[NDArray[np.floating]]

_log = logging.getLogger(__name__)

_LONG_INTERVAL_S = 1.0
# Fewer different whole numbers may be a mask, a checkerboard or a step wedge.
_LEVELS_OF_AN_IMAGE = 16


def checked_times(t_s: ArrayLike, index: int = 0) -> NDArray[np.float64]:
    """Return frame times as (T,) float64 seconds; `index` is the number of the first frame."""
    try:
        times = np.asarray(t_s)
    except (TypeError, ValueError) as error:
        raise refusal("t_s", t_s, "a 1-D array of times in seconds") from error
    if times.dtype.kind not in "iuf" or times.ndim != 1 or times.size == 0:
        what = f"{times.dtype} of shape {times.shape}"
        raise SensorError(f"t_s: found {what}, expected a 1-D array of one or more times in s")
    times = times.astype(np.float64)
    good = np.isfinite(times)
    good[1:] &= times[1:] > times[:-1]
    if not good.all():
        k = int(good.argmin())
        after = f" after {times[k - 1]}" if k else ""
        raise SensorError(
            f"t_s[{index + k}]: found {times[k]}{after}, expected finite, strictly increasing "
            "times in seconds"
        )
    return times


def check_spans(t_s: NDArray[np.float64], speed: float, index: int = 0) -> None:
    """Check that (T,) frame times, divided by the speed, fit into 64-bit microseconds."""
    at_speed = "" if speed == 1 else f" at speed {speed:g}"
    far = np.flatnonzero(~(np.abs(t_s) <= MAX_TIME_S))
    if far.size:
        raise SensorError(
            f"t_s[{index + far[0]}]: found {t_s[far[0]]:g} s{at_speed}, expected at most "
            f"{MAX_TIME_S:g} s from 0, so that int64 can store it in microseconds"
        )
    interval_s = np.diff(t_s)
    wrong = interval_s[~((interval_s > 0) & (interval_s * 1e6 <= MAX_INTERVAL_US))]
    if wrong.size:
        raise SensorError(
            f"t_s: two frames are {wrong[0]:g} s apart{at_speed}, expected more than 0 and at most "
            f"{MAX_INTERVAL_US * 1e-6:.0f} s"
        )


def whole_microseconds(t_s: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Round times to whole microseconds, half up; return them and the remainders, us.

    Whole seconds are converted separately, so that large times, as since 1970, keep all digits.
    """
    seconds = np.floor(t_s)
    us = (t_s - seconds) * 1e6
    whole_us = np.floor(us + 0.5)
    return seconds.astype(np.int64) * 1_000_000 + whole_us.astype(np.int64), us - whole_us


class FrameReader:
    """Reads frames in order: `first`, then `chunk` by chunk, of one size and a float type.

    They are a (T, H, W) array, or an iterable of (H, W) arrays.
    """

    def __init__(self, frames: FrameInput, count: int) -> None:
        self._count = count
        self._array: NDArray[np.floating] | None = None
        self._rest: Iterator[NDArray[np.floating]] = iter(())
        if isinstance(frames, np.ndarray):
            check_shape(frames.shape, count)
            self._array = frames
            first = frames[0]
        elif isinstance(frames, Iterable):
            self._rest = iter(frames)
            start = [np.asarray(frame) for frame in itertools.islice(self._rest, 1)]
            check_all_read(len(start), 1, count)
            first = start[0]
        else:
            raise refusal("frames", frames, "an array (F, H, W), or an iterable of images (H, W)")
        self.shape: tuple[int, ...] = first.shape
        self.first = checked_frames(first[None], 0)[0]
        self._room: NDArray[np.floating] = np.empty((0, *self.shape), self.first.dtype)
        refuse_bad_radiance(self.first[None], 0)

    def chunk(self, done: int, most: int) -> NDArray[np.floating]:
        """Return the next frames, (F, H, W); the kernels check that radiance is valid."""
        wanted = min(most, self._count - done)
        if self._array is not None:
            return checked_frames(self._array[done : done + wanted], done)
        return checked_frames(self._read(done, wanted), done)

    def check_end(self) -> None:
        """Raise `SensorError` if there are more frames than times."""
        check_end(self._rest, self._count)

    def _read(self, index: int, wanted: int) -> NDArray[np.floating]:
        """Read the next frames into memory that the next call reuses."""
        if len(self._room) < wanted:
            self._room = MEMORY.array((wanted, *self.shape), self.first.dtype)
        done = 0
        for frame in map(np.asarray, itertools.islice(self._rest, wanted)):
            checked_frames(frame[None], index + done)
            if frame.shape != self.shape:
                raise SensorError(
                    f"frame {index + done}: found shape {frame.shape}, expected {self.shape}, the "
                    "shape of the first frame"
                )
            if self._room.dtype == np.float32 and _float_type(frame) is np.float64:
                room = MEMORY.array(self._room.shape, np.float64)
                room[:done] = self._room[:done]  # the rest may be anything
                self._room = room
            self._room[done] = frame
            done += 1
        check_all_read(index + done, index + wanted, self._count)
        return self._room[:wanted]


def check_shape(shape: tuple[int, ...], count: int) -> None:
    """Refuse an array of frames that does not have one frame for each time."""
    if len(shape) != 3 or shape[0] != count:
        raise SensorError(
            f"frames: found shape {shape}, expected ({count}, H, W): one frame for each entry of "
            "t_s"
        )


def check_all_read(read: int, wanted: int, count: int) -> None:
    """Refuse an iterable that ended before a number of frames were read."""
    if read < wanted:
        raise SensorError(
            f"frames: ended after {read} frames, expected {count}, one for each entry of t_s"
        )


def check_end(rest: Iterator[object], count: int) -> None:
    """Refuse an iterable with more frames than times."""
    if next(rest, None) is not None:
        raise SensorError(f"frames: found more than {count} frames for the {count} times of t_s")


def checked_frames(chunk: NDArray[np.floating], index: int) -> NDArray[np.floating]:
    """Return (F, H, W) frames as contiguous float32 or float64, without a copy if possible."""
    if chunk.ndim != 3 or chunk.size == 0:
        raise SensorError(f"frame {index}: found shape {chunk.shape[1:]}, expected (H, W)")
    if chunk.dtype.kind != "f":
        advice = (
            "; integer images are usually encoded for a screen, and "
            "sensor.to_linear(frames, 'srgb') converts them to radiance"
        )
        raise SensorError(
            f"frame {index}: found {chunk.dtype}, expected linear radiance as float32 or "
            f"float64{advice if chunk.dtype.kind in 'ui' else ''}"
        )
    return np.ascontiguousarray(chunk, dtype=_float_type(chunk))


def _float_type(frames: NDArray[np.floating]) -> type[np.floating]:
    """Return the type of this machine's floats that holds frames of any float type."""
    return np.float64 if frames.dtype.itemsize > 4 else np.float32


def refuse_bad_radiance(chunk: NDArray[np.floating], index: int) -> None:
    """Raise if radiance, (F, H, W), is negative or not finite."""
    if not (chunk.min() >= 0 and chunk.max() < np.inf):  # NaN fails both comparisons
        bad = np.argwhere(~((chunk >= 0) & (chunk < np.inf)))
        f, y, x = bad[0]
        raise SensorError(
            f"frame {index + f}, pixel x={x} y={y}: found radiance {chunk[f, y, x]}, "
            "expected a finite number of at least 0"
        )


def warn_of_long_intervals(t_s: NDArray[np.float64]) -> None:
    """Warn if the median interval is above 1 s: the times may not be in seconds."""
    if len(t_s) > 1 and (median_s := float(np.median(np.diff(t_s)))) > _LONG_INTERVAL_S:
        _log.warning(
            "t_s: the median interval between frames is %.6g s; give times in s, not in ms or us",
            median_s,
        )


def warn_of_whole_numbers(frame: NDArray[np.floating]) -> None:
    """Warn if a frame (H, W) looks like an 8-bit image: many values, all whole, from 0 to 255.

    Photon counts look the same, so this is not an error.
    """
    highest = frame.max()
    if highest > 255 or not (_whole(frame[0]) and _whole(frame)):
        return
    levels = np.count_nonzero(np.bincount(frame.astype(np.uint8).ravel()))
    if levels >= _LEVELS_OF_AN_IMAGE:
        _log.warning(
            "frames: the first frame looks like an 8-bit image: whole numbers from %d to %d, %d "
            "different values. They are taken as linear radiance; if they are encoded for a "
            "screen, convert them: sensor.to_linear(frames.astype(np.uint8), 'srgb')",
            frame.min(),
            highest,
            levels,
        )


def _whole(values: NDArray[np.floating]) -> bool:
    return bool(np.all(np.trunc(values) == values))
