"""Wall-clock, user and system time of this process.

Benchmarks of memory-bound work print system time beside user time: most of it is for new memory,
which can take many times as long where the host has taken its memory back. Linux divides CPU time
into the two by samples that are milliseconds apart: the sum is exact, but parts as short as that
are not.
"""

from __future__ import annotations

import resource
import time
from typing import NamedTuple


class Times(NamedTuple):
    """Times in seconds: at a moment or, as a difference, of the work since then."""

    wall_s: float
    user_s: float
    system_s: float

    @property
    def cpu_s(self) -> float:
        """User and system time."""
        return self.user_s + self.system_s

    def __sub__(self, start: Times) -> Times:
        return Times(*(a - b for a, b in zip(self, start, strict=True)))


def times_now() -> Times:
    """Return the times of this process, all its threads included."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return Times(time.perf_counter(), usage.ru_utime, usage.ru_stime)
