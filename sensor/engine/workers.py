"""Threads, and the memory that they work in."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue

import numpy as np
from numpy.typing import NDArray

_BANDS_A_THREAD = 4  # so that a thread that is held up leaves its share to the others
_POOL_EVENTS = 1 << 22  # 32 MiB of addresses; memory is taken as it is filled


class Workers(ThreadPoolExecutor):
    """Threads with room for the kernels' events and for sorting them."""

    def __init__(self, threads: int) -> None:
        super().__init__(threads)
        bands = 1 if threads == 1 else _BANDS_A_THREAD * threads
        self.pools = [np.empty(_POOL_EVENTS, np.uint64) for _ in range(bands)]  # one a band
        self.scratch: SimpleQueue[NDArray[np.uint64]] = SimpleQueue()  # one a thread
        for _ in range(threads):
            self.scratch.put(np.empty((2, 0), np.uint64))

    def enlarge_pool(self, band: int) -> None:
        """Double a band's pool, keeping what it holds."""
        pool = self.pools[band]
        self.pools[band] = np.empty(2 * pool.size, np.uint64)
        self.pools[band][: pool.size] = pool
