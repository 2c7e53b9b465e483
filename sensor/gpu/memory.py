"""Memory of a GPU that is used again, and host memory from and to which it copies at full speed."""

from __future__ import annotations

import itertools
import math
import weakref
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import numpy as np
from numba import cuda
from numpy.typing import DTypeLike, NDArray

from sensor.errors import SensorError
from sensor.memory import RELEASES, Memory

_KEPT_BYTES = 1 << 30
_LOCKED_BYTES = 1 << 32  # at most, with the parts of streams that somebody holds
_BUFFER_BYTES = 1 << 24
_MAX_COPIERS = 8  # they reach the speed of the bus


class _Locked:
    """Allocates host memory with locked pages, as long as not too much is in use."""

    def __init__(self) -> None:
        self._used = 0

    def __call__(self, size: int) -> NDArray[np.uint8]:
        if self._used + size > _LOCKED_BYTES:
            return np.empty(size, np.uint8)
        block: NDArray[np.uint8] = cuda.pinned_array(size, np.uint8)
        self._used += size
        weakref.finalize(block, self._freed, size).atexit = False
        return block

    def _freed(self, size: int) -> None:
        self._used -= size


PINNED = Memory(_KEPT_BYTES, _Locked())
"""Host memory that the GPU copies to several times as fast as to any other."""


DeviceArray = Any  # an array on the GPU of Numba, which has no types

_FREE: dict[str, dict[str, DeviceArray]] = {}  # blocks of the latest that ended, by user


class Scratch:
    """Arrays on the GPU by name. One is valid until the same name is asked for again.

    The memory is that of an earlier simulation, if one has ended.
    """

    def __init__(self, user: str) -> None:
        self._blocks = _FREE.pop(user, {})
        weakref.finalize(self, _FREE.__setitem__, user, self._blocks).atexit = False

    def array(self, name: str, shape: int | tuple[int, ...], dtype: DTypeLike) -> DeviceArray:
        """Return an array of arbitrary content on the GPU."""
        shape = shape if isinstance(shape, tuple) else (shape,)
        size = max(1, math.prod(shape))
        bytes_ = size * np.dtype(dtype).itemsize
        block = self._blocks.get(name)
        if block is None or block.size < bytes_:
            block = None  # to free it before there is a larger one
            self._blocks.pop(name, None)
            with _enough_memory(bytes_):
                block = self._blocks[name] = cuda.device_array(bytes_ * 5 // 4, np.uint8)
        return block[:bytes_].view(dtype)[: math.prod(shape)].reshape(shape)


def upload(array: NDArray) -> DeviceArray:
    """Copy a small array, such as the state of the pixels, to new memory of the GPU."""
    with _enough_memory(array.nbytes):
        return cuda.to_device(np.array(array))  # with strides, unlike a single value repeated


@contextmanager
def _enough_memory(size: int) -> Iterator[None]:
    """Say what happened where the GPU does not have so many bytes."""
    try:
        yield
    except Exception as error:
        if "OUT_OF_MEMORY" not in str(error):
            raise
        free, whole = cuda.current_context().get_memory_info()
        raise SensorError(
            f"device: the GPU has too little memory: {size / 1e9:.1f} GB are needed, but only "
            f"{free / 1e9:.1f} of {whole / 1e9:.1f} GB are free; choose smaller sensors or frames"
        ) from error


def free_bytes() -> float:
    """Return the memory of the GPU that simulations may use, bytes."""
    unused = sum(block.nbytes for blocks in list(_FREE.values()) for block in blocks.values())
    return float(cuda.current_context().get_memory_info()[0] + unused)


def _release() -> None:
    PINNED.release()
    _FREE.clear()
    pending = getattr(cuda.current_context(), "deallocations", None)  # not in the simulator
    if pending is not None:  # Numba frees only when much is to be freed
        pending.clear()


RELEASES.append(_release)


class Uploader:
    """Copies arrays to the GPU: threads fill one of two buffers while the GPU reads the other."""

    def __init__(self, threads: int) -> None:
        self._threads = min(_MAX_COPIERS, threads)
        self._pool = ThreadPoolExecutor(self._threads, "upload")

    def copy(self, source: NDArray, target: DeviceArray) -> None:
        """Copy a C-contiguous array to a target like it; return when the GPU has it."""
        source, target = source.reshape(-1), target.reshape(source.size)
        stream, most = cuda.stream(), _BUFFER_BYTES // source.itemsize
        buffers = [PINNED.array(most, source.dtype) for _ in range(2)]
        read = [cuda.event() for _ in buffers]
        starts = range(0, source.size, most)
        for k, start in zip(itertools.cycle((0, 1)), starts, strict=False):
            part = source[start : start + most]
            read[k].synchronize()
            self._fill(buffers[k], part)
            target[start : start + part.size].copy_to_device(buffers[k][: part.size], stream=stream)
            read[k].record(stream)
        stream.synchronize()

    def _fill(self, buffer: NDArray, part: NDArray) -> None:
        def copy(edge: tuple[int, int]) -> None:
            buffer[slice(*edge)] = part[slice(*edge)]

        edges = np.linspace(0, part.size, self._threads + 1).astype(int).tolist()
        list(self._pool.map(copy, itertools.pairwise(edges)))
