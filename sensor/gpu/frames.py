"""Frames on the GPU: uploaded a few at a time, or already there."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numba import cuda

from sensor.engine.frames import FrameInput, FrameReader, checked_frames, refuse_bad_radiance
from sensor.errors import SensorError
from sensor.gpu.memory import DeviceArray, Scratch, Uploader


class ToDevice:
    """Brings frames onto the GPU, into memory that the next call reuses."""

    def __init__(self, threads: int) -> None:
        self.scratch = Scratch("frames")
        self._uploader = Uploader(threads)

    def __call__(self, chunk: Any, index: int) -> DeviceArray:
        """Return frames on the GPU, checked as by `checked_frames`.

        Parameters
        ----------
        chunk, index
            (F, H, W) linear radiance, in host memory or on the GPU, and index of its first frame.

        Returns
        -------
        (F, H, W) linear radiance on the GPU, until the next call.
        """
        if _is_there(chunk):
            return _checked(chunk, index, 3)
        host = checked_frames(chunk, index)
        room = self.scratch.array("frames", host.shape, host.dtype)
        self._uploader.copy(host, room)
        return room


class DeviceReader:
    """Reads frames in order as `FrameReader` does, into the memory of a GPU."""

    def __init__(self, frames: FrameInput, count: int, to_device: ToDevice) -> None:
        self._count = count
        self._to_device = to_device
        self._host: FrameReader | None = None
        self._whole: DeviceArray | None = None
        self._rest: Iterator[Any] = iter(())
        if _is_there(frames):
            self._whole = _checked(frames, 0, 3)
            if len(self._whole) != count:
                raise SensorError(
                    f"frames: found shape {self._whole.shape}, expected ({count}, H, W): "
                    "one frame for each entry of t_s"
                )
            first = self._whole[0]
        elif isinstance(frames, np.ndarray) or not isinstance(frames, Iterable):
            self._host = FrameReader(frames, count)
        else:
            self._rest = iter(frames)
            start = list(itertools.islice(self._rest, 1))
            if start and _is_there(start[0]):
                first = start[0]
            else:
                self._host = FrameReader(itertools.chain(start, self._rest), count)
        if self._host is not None:
            self.first, self.shape = self._host.first, self._host.shape
            return
        self.first = _checked(first, 0, 2).copy_to_host()
        self.shape = self.first.shape
        refuse_bad_radiance(self.first[None], 0)

    def chunk(self, done: int, most: int) -> DeviceArray:
        """Return the next frames.

        Returns
        -------
        (F, H, W) linear radiance on the GPU, until the next call.
        """
        wanted = min(most, self._count - done)
        if self._host is not None:
            return self._to_device(self._host.chunk(done, wanted), done)
        if self._whole is not None:
            return self._whole[done : done + wanted]
        room = self._to_device.scratch.array("frames", (wanted, *self.shape), self.first.dtype)
        found = 0
        for frame in itertools.islice(self._rest, wanted):
            there = _checked(frame, done + found, 2)
            if there.shape != self.shape or there.dtype != self.first.dtype:
                raise SensorError(
                    f"frame {done + found}: found {there.dtype} of shape {there.shape}, "
                    f"expected {self.first.dtype} of {self.shape} like the first"
                )
            room[found].copy_to_device(there)
            found += 1
        if found < wanted:
            raise SensorError(
                f"frames: ended after {done + found}, "
                f"expected {self._count}, one for each entry of t_s"
            )
        return room

    def check_end(self) -> None:
        """Raise `SensorError` if there are more frames than times."""
        if self._host is not None:
            self._host.check_end()
        elif next(self._rest, None) is not None:
            raise SensorError(f"frames: found more than {self._count}, the length of t_s")


def _is_there(frames: object) -> bool:
    return hasattr(frames, "__cuda_array_interface__")


def _checked(frames: object, index: int, ndim: int) -> DeviceArray:
    """Return frames on the GPU of that many dimensions, with rows one after the other."""
    if not _is_there(frames):
        raise SensorError(
            f"frame {index}: found a {type(frames).__name__}, expected an array on the GPU like "
            "the first"
        )
    there = cuda.as_cuda_array(frames)
    shape = "(T, H, W)" if ndim == 3 else "(H, W)"
    if there.dtype not in (np.float32, np.float64) or there.ndim != ndim or there.size == 0:
        raise SensorError(
            f"frame {index}: found {there.dtype} of shape {there.shape} on the GPU, expected "
            f"linear radiance as float32 or float64, {shape}"
        )
    if not there.is_c_contiguous():
        raise SensorError(
            f"frame {index}: found rows on the GPU that are not one after the other, expected a "
            "contiguous array"
        )
    return there
