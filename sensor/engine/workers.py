"""Threads and their memory."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from sensor.memory import MEMORY

_BANDS_A_THREAD = 4  # so that other threads take over the work of a delayed one
_POOL_EVENTS = 1 << 24  # 128 MiB of address space; the system allocates pages on first use


class Workers(ThreadPoolExecutor):
    """Threads with memory for unsorted events."""

    def __init__(self, threads: int) -> None:
        super().__init__(threads)
        self.threads = threads
        bands = 1 if threads == 1 else _BANDS_A_THREAD * threads
        events = _POOL_EVENTS // bands
        self.pools = [MEMORY.array(events, np.uint64) for _ in range(bands)]  # one for each band

    def enlarge_pool(self, band: int) -> None:
        """Double the pool of a band and keep its content."""
        pool = self.pools[band]
        self.pools[band] = MEMORY.array(2 * pool.size, np.uint64)
        self.pools[band][: pool.size] = pool
