"""Threads and their memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Self, TypeVar

import numpy as np

from sensor.memory import MEMORY

Item = TypeVar("Item")
Result = TypeVar("Result")

_BANDS_A_THREAD = 4  # so that other threads take over the work of a delayed one
_POOL_EVENTS = 1 << 24  # 128 MiB of address space; the system allocates pages on first use


class Workers:
    """Threads with memory for unsorted events. A single one is the caller's own."""

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._others = ThreadPoolExecutor(threads) if threads > 1 else None
        bands = 1 if threads == 1 else _BANDS_A_THREAD * threads
        events = _POOL_EVENTS // bands
        self.pools = [MEMORY.array(events, np.uint64) for _ in range(bands)]  # one for each band

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._others is not None:
            self._others.shutdown()

    def map(self, function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
        """Call a function on all items."""
        apply = map if self._others is None else self._others.map
        return list(apply(function, items))

    def enlarge_pool(self, band: int) -> None:
        """Double the pool of a band and keep its content."""
        pool = self.pools[band]
        self.pools[band] = MEMORY.array(2 * pool.size, np.uint64)
        self.pools[band][: pool.size] = pool
