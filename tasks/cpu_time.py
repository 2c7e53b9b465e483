"""CPU time of a thread, including that of other threads that worked for it."""

from __future__ import annotations

import threading
import time

_others = threading.local()


def cpu_s() -> float:
    """Return the CPU time of this thread and of others that worked for it, in seconds."""
    return time.thread_time() + getattr(_others, "seconds", 0.0)


def add_cpu_s(seconds: float) -> None:
    """Count CPU time that another thread needed for this one."""
    _others.seconds = getattr(_others, "seconds", 0.0) + seconds
