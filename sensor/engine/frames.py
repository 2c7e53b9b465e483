"""Reading frames and their times: checked, a few at a time, without a copy where possible."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sensor.errors import SensorError

Frames = NDArray[np.floating] | Iterable[NDArray[np.floating]]
MAX_TIME_S = 9.2e12  # 2^63 us, nearly

_log = logging.getLogger(__name__)

_LONG_INTERVAL_S = 1.0
# So many different whole numbers are an image; fewer may be a mask, a checkerboard or a wedge.
_LEVELS_OF_AN_IMAGE = 16


def checked_times(t_s: ArrayLike) -> NDArray[np.float64]:
    """Frame times as (T,) float64 seconds.

    Raises
    ------
    SensorError
        They are not one finite, strictly increasing sequence; the text names the first offender.
    """
    times = np.asarray(t_s, dtype=np.float64)
    if times.ndim != 1 or times.size == 0:
        raise SensorError(f"t_s: found shape {times.shape}, expected (T,) with T of at least 1")
    bad = np.flatnonzero(~np.isfinite(times))
    if bad.size:
        raise SensorError(f"t_s[{bad[0]}]: found {times[bad[0]]}, expected a time in seconds")
    bad = np.flatnonzero(np.diff(times) <= 0)
    if bad.size:
        k = int(bad[0]) + 1
        raise SensorError(
            f"t_s[{k}]: found {times[k]} after {times[k - 1]}, expected strictly increasing times"
        )
    return times


def check_spans(t_s: NDArray[np.float64], max_interval_us: int, speed: float) -> None:
    """Check that times (T,), seconds at a speed, fit into 64-bit microseconds and follow in order.

    Raises
    ------
    SensorError
        A time is beyond +-`MAX_TIME_S`, or two frames are too far apart, or the speed leaves no
        time between two frames.
    """
    at_speed = "" if speed == 1 else f" at speed {speed:g}"
    far = np.flatnonzero(~(np.abs(t_s) <= MAX_TIME_S))
    if far.size:
        raise SensorError(
            f"t_s[{far[0]}]: found {t_s[far[0]]:g} s{at_speed}, expected at most {MAX_TIME_S:g} s "
            "from 0, so that it has a number of microseconds"
        )
    interval_s = np.diff(t_s)
    if interval_s.size and interval_s.min() <= 0:
        raise SensorError(f"speed: found {speed:g}, which leaves no time between two frames")
    if interval_s.size and interval_s.max() * 1e6 > max_interval_us:
        raise SensorError(
            f"t_s: found {interval_s.max():.0f} s between two frames{at_speed}, expected less than "
            f"{max_interval_us * 1e-6:.0f} s"
        )


def whole_microseconds(
    t_s: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Times in whole microseconds, rounded half up, and how far each lies after its own, in µs.

    Whole seconds are taken apart, so that at any time, such as one since 1970, neither loses a
    digit that t_s has.
    """
    seconds = np.floor(t_s)
    us = (t_s - seconds) * 1e6
    whole_us = np.floor(us + 0.5)
    return seconds.astype(np.int64) * 1_000_000 + whole_us.astype(np.int64), us - whole_us


class FrameReader:
    """Frames in order: `first`, then `chunks`, of one size and a float type."""

    def __init__(self, frames: Frames, count: int) -> None:
        self._count = count
        self._array: NDArray[np.floating] | None = None
        self._rest: Iterator[NDArray[np.floating]] = iter(())
        if isinstance(frames, np.ndarray):
            if frames.ndim != 3 or len(frames) != count:
                raise SensorError(
                    f"frames: found shape {frames.shape}, expected ({count}, H, W): "
                    "one frame for each entry of t_s"
                )
            self._array = frames
            first = frames[0]
        else:
            self._rest = iter(frames)
            try:
                first = np.asarray(next(self._rest))
            except StopIteration:
                raise SensorError(f"frames: found none, expected {count}") from None
        self.shape: tuple[int, ...] = first.shape
        self.first = self._checked(first[None], 0)[0]
        self._room: NDArray[np.floating] = np.empty((0, *self.shape), self.first.dtype)
        refuse_bad_radiance(self.first[None], 0)

    def chunks(self, size: int) -> Iterator[NDArray[np.floating]]:
        """The frames after the first as arrays (F, H, W), F at most `size`.

        Raises
        ------
        SensorError
            A frame of another size or dtype; fewer or more frames than times. Whether their
            radiance is one is for the kernels to see, which read it anyway.
        """
        done = 1
        while done < self._count:
            wanted = min(size, self._count - done)
            if self._array is not None:
                chunk = self._array[done : done + wanted]
            else:
                chunk = self._read(done, wanted)
            yield self._checked(chunk, done)
            done += wanted
        if next(self._rest, None) is not None:
            raise SensorError(f"frames: found more than {self._count}, the length of t_s")

    def _read(self, index: int, wanted: int) -> NDArray[np.floating]:
        """The next frames, in memory that is used again for those after them."""
        if len(self._room) < wanted:
            self._room = np.empty((wanted, *self.shape), self.first.dtype)
        found = 0
        for frame in map(np.asarray, itertools.islice(self._rest, wanted)):
            self._checked(frame[None], index + found)
            if frame.shape != self.shape:
                raise SensorError(
                    f"frame {index + found}: found shape {frame.shape}, "
                    f"expected {self.shape} as the first"
                )
            if frame.dtype.itemsize > self._room.dtype.itemsize:
                self._room = self._room.astype(np.float64)
            self._room[found] = frame
            found += 1
        if found < wanted:
            raise SensorError(
                f"frames: ended after {index + found}, "
                f"expected {self._count}, one for each entry of t_s"
            )
        return self._room[:wanted]

    def _checked(self, chunk: NDArray[np.floating], index: int) -> NDArray[np.floating]:
        if chunk.ndim != 3 or chunk.size == 0:
            raise SensorError(f"frame {index}: found shape {chunk.shape[1:]}, expected (H, W)")
        if chunk.dtype.kind != "f":
            advice = (
                "; images of integers are encoded for a screen as a rule, and "
                "sensor.to_linear(frames, 'srgb') makes radiance of them"
            )
            raise SensorError(
                f"frame {index}: found {chunk.dtype}, expected linear radiance as float32 or "
                f"float64{advice if chunk.dtype.kind in 'ui' else ''}"
            )
        wide = chunk.dtype if chunk.dtype == np.float64 else np.dtype(np.float32)
        return np.ascontiguousarray(chunk, dtype=wide)


def refuse_bad_radiance(chunk: NDArray[np.floating], index: int) -> None:
    """Raise for the first pixel of a chunk (F, H, W) whose radiance is negative or not finite.

    Raises
    ------
    SensorError
        Names the frame, `index` being that of the chunk's first, the pixel and what was found.
    """
    bad = np.argwhere(~((chunk >= 0) & (chunk < np.inf)))  # NaN fails both comparisons
    if bad.size:
        f, y, x = bad[0]
        raise SensorError(
            f"frame {index + f}, pixel x={x} y={y}: found radiance {chunk[f, y, x]}, "
            "expected a finite number of at least 0"
        )


def warn_of_long_intervals(t_s: NDArray[np.float64]) -> None:
    """Warn where times may be in another unit than seconds: their median interval is above 1 s."""
    if len(t_s) > 1 and (median_s := float(np.median(np.diff(t_s)))) > _LONG_INTERVAL_S:
        _log.warning(
            "t_s: found a median of %.6g s between two frames; are the times in ms or us? "
            "They are taken as seconds",
            median_s,
        )


def warn_of_whole_numbers(frame: NDArray[np.floating]) -> None:
    """Warn where a frame (H, W) looks like an 8-bit image: many values, all of 0 to 255 and whole.

    Photon counts look the same, so this is no error.
    """
    highest = frame.max()
    if highest > 255 or not (_whole(frame[0]) and _whole(frame)):
        return
    levels = np.count_nonzero(np.bincount(frame.astype(np.uint8).ravel()))
    if levels >= _LEVELS_OF_AN_IMAGE:
        _log.warning(
            "frames: all values of the first are whole numbers from %d to %d, %d different ones, "
            "as in an 8-bit image, and are taken as linear radiance; if they are encoded for a "
            "screen, sensor.to_linear(frames.astype(np.uint8), 'srgb') makes radiance of them",
            *(frame.min(), highest, levels),
        )


def _whole(values: NDArray[np.floating]) -> bool:
    return bool(np.all(np.trunc(values) == values))
