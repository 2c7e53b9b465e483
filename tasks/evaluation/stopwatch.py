"""Wall-clock time of the stages of an evaluation."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager


class Stopwatch:
    """Adds up wall-clock seconds by stage: `with stopwatch("reading"): ...`."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Add the time spent in this context to a stage."""
        started_s = time.perf_counter()
        yield
        self.seconds[stage] += time.perf_counter() - started_s
