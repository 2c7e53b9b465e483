"""Memory of a GPU that is used again, and host memory from and to which it copies at full speed."""

from __future__ import annotations

import itertools
import math
import os
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
_LEAST_BYTES = 1 << 20  # smaller arrays are not worth the time that locking their pages takes
_BUFFER_BYTES = 1 << 24
_MOST_COPIERS = 8  # they reach the speed of the bus


def _locked(size: int) -> NDArray[np.uint8]:
    if size < _LEAST_BYTES:
        return np.empty(size, np.uint8)
    return cuda.pinned_array(size, np.uint8)


PINNED = Memory(_KEPT_BYTES, _locked)
"""Host memory with locked pages: the GPU copies to it several times as fast as to any other."""


DeviceArray = Any  # an array on the GPU of Numba, which has no types

_FREE: dict[str, list[dict[str, DeviceArray]]] = {}  # blocks of simulations that ended, by user


class Scratch:
    """Arrays on the GPU by name. One is valid until the same name is asked for again.

    The memory is that of an earlier simulation, if one has ended.

    Parameters
    ----------
    user
        What it is for.
    """

    def __init__(self, user: str) -> None:
        free = _FREE.setdefault(user, [])
        self._blocks = free.pop() if free else {}
        weakref.finalize(self, _keep, user, self._blocks)

    def array(self, name: str, shape: int | tuple[int, ...], dtype: DTypeLike) -> DeviceArray:
        """Return an array of arbitrary content.

        Parameters
        ----------
        name, shape, dtype
            Name of its memory, and as in `numpy.empty`.

        Returns
        -------
        Numba's array on the GPU.
        """
        shape = shape if isinstance(shape, tuple) else (shape,)
        size = max(1, math.prod(shape))
        bytes_ = size * np.dtype(dtype).itemsize
        block = self._blocks.get(name)
        if block is None or block.size < bytes_:
            self._blocks.pop(name, None)
            block = self._blocks[name] = cuda.device_array(
                -(-bytes_ * 5 // 4) // 8 * 8 + 8, np.uint8
            )
        return block[:bytes_].view(dtype)[: math.prod(shape)].reshape(shape)


def upload(array: NDArray) -> DeviceArray:
    """Copy a small array, such as the state of the pixels, to new memory of the GPU."""
    with _enough_memory(array.nbytes):
        return cuda.to_device(array.copy())


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
            f"device: the GPU has too little memory: {size / 1e9:.1f} GB do not fit into "
            f"{free / 1e9:.1f} free of {whole / 1e9:.1f} GB; choose smaller sensors or frames"
        ) from error


def _keep(user: str, blocks: dict[str, DeviceArray]) -> None:
    _FREE[user] = [blocks]  # of the latest only


def _release() -> None:
    PINNED.release()
    _FREE.clear()


RELEASES.append(_release)


class Uploader:
    """Copies arrays to the GPU: threads fill one of two buffers while the GPU reads the other."""

    def __init__(self) -> None:
        self._threads = min(_MOST_COPIERS, len(os.sched_getaffinity(0)))
        self._pool = ThreadPoolExecutor(self._threads, "upload")

    def copy(self, source: NDArray, target: DeviceArray) -> None:
        """Copy an array; return when the GPU has it.

        Parameters
        ----------
        source, target
            C-contiguous arrays of the same shape and dtype, the second on the GPU.
        """
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
