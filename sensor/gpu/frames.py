"""Frames on the GPU: uploaded a few at a time, or already there."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numba import cuda

from sensor.engine.frames import (
    FrameInput,
    FrameReader,
    check_all_read,
    check_end,
    check_shape,
    checked_frames,
    refuse_bad_radiance,
)
from sensor.errors import SensorError
from sensor.gpu.memory import DeviceArray, Scratch, Uploader


class ToDevice:
    """Brings frames onto the GPU, into memory that the next call reuses."""

    def __init__(self, threads: int) -> None:
        self.scratch = Scratch("frames")
        self._uploader = Uploader(threads)

    def __call__(self, chunk: Any, index: int) -> DeviceArray:
        """Return (F, H, W) frames on the GPU, valid until the next call; `index` is the first."""
        if _on_gpu(chunk):
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
        if _on_gpu(frames):
            self._whole = _checked(frames, 0, 3)
            check_shape(self._whole.shape, count)
            first = self._whole[0]
        elif isinstance(frames, np.ndarray) or not isinstance(frames, Iterable):
            self._host = FrameReader(frames, count)
        else:
            self._rest = iter(frames)
            start = list(itertools.islice(self._rest, 1))
            if start and _on_gpu(start[0]):
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
        """Return the next frames, (F, H, W) on the GPU, valid until the next call."""
        wanted = min(most, self._count - done)
        if self._host is not None:
            return self._to_device(self._host.chunk(done, wanted), done)
        if self._whole is not None:
            return self._whole[done : done + wanted]
        room = self._to_device.scratch.array("frames", (wanted, *self.shape), self.first.dtype)
        read = 0
        for given in itertools.islice(self._rest, wanted):
            frame = _checked(given, done + read, 2)
            if frame.shape != self.shape or frame.dtype != self.first.dtype:
                raise SensorError(
                    f"frame {done + read}: found {frame.dtype} of shape {frame.shape}, expected "
                    f"{self.first.dtype} of shape {self.shape}, like the first frame"
                )
            room[read].copy_to_device(frame)
            read += 1
        check_all_read(done + read, done + wanted, self._count)
        return room

    def check_end(self) -> None:
        """Raise `SensorError` if there are more frames than times."""
        if self._host is not None:
            self._host.check_end()
        else:
            check_end(self._rest, self._count)


def _on_gpu(frames: object) -> bool:
    return hasattr(frames, "__cuda_array_interface__")


def _checked(frames: object, index: int, ndim: int) -> DeviceArray:
    """Return frames on the GPU with `ndim` dimensions and contiguous rows."""
    if not _on_gpu(frames):
        raise SensorError(
            f"frame {index}: found type {type(frames).__name__}, expected an array on the GPU, "
            "like the first frame"
        )
    array = cuda.as_cuda_array(frames)
    shape = "(T, H, W)" if ndim == 3 else "(H, W)"
    is_float = array.dtype in (np.float32, np.float64)
    if not is_float or array.ndim != ndim or array.size == 0 or not array.is_c_contiguous():
        raise SensorError(
            f"frame {index}: found {array.dtype} of shape {array.shape} and strides "
            f"{array.strides} on the GPU, expected linear radiance as contiguous float32 or "
            f"float64, {shape}"
        )
    return array
