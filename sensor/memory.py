"""Memory for large arrays, reused once nothing refers to them.

The first touch of a page of new memory costs 0.5 to 9 us, so a simulation that allocates its
arrays anew spends up to half of its time in the operating system.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Lock

import numpy as np
import psutil
from numpy.typing import DTypeLike, NDArray

_MAX_SHARE = 0.7  # of the limit: a larger block would push out most of the others
_MIN_BYTES = 1 << 20  # the allocator reuses smaller arrays itself
_CACHE_LINE = 64  # vectors across two lines are slower


def memory_bytes() -> int:
    """Return the memory of this machine, or of the container if that is less, bytes.

    `eres_render.rendering.memory` has the same, as neither package imports the other.
    """
    physical = int(psutil.virtual_memory().total)
    try:
        return min(physical, int(Path("/sys/fs/cgroup/memory.max").read_text(encoding="utf-8")))
    except (OSError, ValueError):  # no such file, or "max"
        return physical


def _references(blocks: list[NDArray[np.uint8]], k: int) -> int:
    return sys.getrefcount(blocks[k])


_FREE = _references([np.empty(0, np.uint8)], 0)  # by the list and, in most versions, by the call


class Memory:
    """Blocks of memory that are kept for the next arrays, up to a limit in bytes.

    An array is a view of a block and holds a reference to it, as do all views of the array. So a
    block is free if only the list refers to it, and no array in use is overwritten.
    """

    def __init__(
        self,
        limit: int,
        allocate: Callable[[int], NDArray[np.uint8]] = lambda size: np.empty(size, np.uint8),
    ) -> None:
        self._limit = limit
        self._allocate = allocate  # (size,) array of a number of bytes
        self._blocks: list[NDArray[np.uint8]] = []  # the latest used last
        self._lock = Lock()

    def array(self, shape: int | tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray:
        """Return an array of arbitrary content that starts at a cache line."""
        size = math.prod(shape if isinstance(shape, tuple) else (shape,)) * np.dtype(dtype).itemsize
        if size < _MIN_BYTES:
            block = np.empty(size + _CACHE_LINE, np.uint8)
        else:
            with self._lock:
                block = self._block(size + _CACHE_LINE)
        start = -block.ctypes.data % _CACHE_LINE
        return block[start : start + size].view(dtype).reshape(shape)

    def release(self) -> None:
        """Free all blocks; a block that an array still uses is freed together with the array."""
        with self._lock:
            self._blocks.clear()

    def _block(self, size: int) -> NDArray[np.uint8]:
        free = [k for k in range(len(self._blocks)) if _references(self._blocks, k) == _FREE]
        fitting = [k for k in free if size <= self._blocks[k].size <= 2 * size]
        if fitting:
            block = self._blocks.pop(min(fitting, key=lambda k: self._blocks[k].size))
        else:
            # Round up, so that the block also fits arrays of similar size.
            step = 1 << (size.bit_length() - 3)
            block = self._allocate(-(-size // step) * step)
            if block.size > _MAX_SHARE * self._limit:
                return block
            # Results that the caller keeps are forgotten too, or they would fill the limit.
            sizes = np.cumsum([0, *(old.size for old in self._blocks)])
            excess = block.size + sizes[-1] - self._limit
            del self._blocks[: np.searchsorted(sizes, excess)]
        self._blocks.append(block)
        return block


# The limit is on address space, of which only a part is touched.
MEMORY = Memory(min(1 << 30, max(1 << 29, memory_bytes() // 16)))

RELEASES = [MEMORY.release]
"""What `release_memory` calls."""


def release_memory() -> None:
    """Free the memory that simulations keep for later simulations.

    That is at most a 16th of the machine's memory, limited to between 512 MiB and 1 GiB. After
    simulations on a GPU it is also their memory there, and at most 1 GiB of page-locked memory.

    Examples
    --------
    Between a large simulation and work that needs the memory for itself:

    >>> from sensor import release_memory
    >>> release_memory()
    """
    for release in RELEASES:
        release()
