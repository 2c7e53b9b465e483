"""Make items in other threads before they are wanted, and hand them out in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice
from typing import TypeVar

T = TypeVar("T")


@contextmanager
def made_ahead(
    make: Callable[[int], T], numbers: range, *, threads: int, most: int
) -> Iterator[Iterator[T]]:
    """Make the items of some numbers in order, up to `most` in advance."""
    with ThreadPoolExecutor(threads, "ahead") as pool:

        def items() -> Iterator[T]:
            ahead: deque[Future[T]] = deque()
            left = iter(numbers)
            for _ in numbers:
                ahead += [pool.submit(make, k) for k in islice(left, most - len(ahead))]
                yield ahead.popleft().result()

        try:
            yield items()
        finally:
            pool.shutdown(cancel_futures=True)
