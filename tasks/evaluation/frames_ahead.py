"""Frames that a thread reads or renders while sensors process earlier ones."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

T = TypeVar("T")

FRAMES_AHEAD = 12  # as many as sensors take at once, so that neither side waits for the other


@contextmanager
def frames_ahead(frames: Iterable[T], count: int) -> Iterator[Iterator[T]]:
    """Take frames in a separate thread, up to `FRAMES_AHEAD` in advance.

    Rendering and simulating use all cores, but not all of the time. Together they leave few idle.
    """
    source = iter(frames)
    with ThreadPoolExecutor(1, thread_name_prefix="frames") as taker:

        def wanted() -> Iterator[T]:
            ahead: deque[Future[T]] = deque()
            for k in range(count):
                while len(ahead) < min(FRAMES_AHEAD, count - k):
                    ahead.append(taker.submit(next, source))
                yield ahead.popleft().result()

        try:
            yield wanted()
        finally:
            taker.shutdown(cancel_futures=True)
