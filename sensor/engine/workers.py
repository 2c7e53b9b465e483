"""Threads and their memory."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue

import numpy as np
from numpy.typing import NDArray

_BANDS_A_THREAD = 4  # so that other threads take over the work of a delayed one
_POOL_EVENTS = 1 << 22  # 32 MiB of address space; the system allocates pages on first use


class Workers(ThreadPoolExecutor):
    """Threads with memory for unsorted events and for sorting."""

    def __init__(self, threads: int) -> None:
        super().__init__(threads)
        bands = 1 if threads == 1 else _BANDS_A_THREAD * threads
        self.pools = [np.empty(_POOL_EVENTS, np.uint64) for _ in range(bands)]  # one for each band
        self.scratch: SimpleQueue[NDArray[np.uint64]] = SimpleQueue()  # one for each thread
        for _ in range(threads):
            self.scratch.put(np.empty((2, 0), np.uint64))

    def enlarge_pool(self, band: int) -> None:
        """Double the pool of a band and keep its content."""
        pool = self.pools[band]
        self.pools[band] = np.empty(2 * pool.size, np.uint64)
        self.pools[band][: pool.size] = pool
