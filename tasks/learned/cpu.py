"""Run networks on this machine's cores, one at a time, and count their CPU time.

All networks run in one thread, which keeps PyTorch's helper threads. Two networks at a time would
need twice the memory and share the same cores.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import torch

from eres_render.cores import cores
from sensor.memory import memory_bytes
from tasks.cpu_time import add_cpu_s, cpu_s
from tasks.errors import WeightsError

T = TypeVar("T")
_THREADS = Path("/proc/self/task")  # Linux
_PARALLEL = 1 << 20  # elements that PyTorch spreads over all threads
_networks = ThreadPoolExecutor(1, "networks")


def run(function: Callable[..., T], *arguments: Any) -> T:
    """Run a function in the networks' thread, without gradients.

    Its CPU time, helper threads included, counts as that of the calling thread
    (`tasks.cpu_time`). Convolutions are in bfloat16 if the processor supports it.
    """
    answer, spent_s = _networks.submit(_counted, function, arguments).result()
    add_cpu_s(spent_s)
    return answer


def check_memory(name: str, width: int, height: int, needed: int) -> None:
    """Refuse a network that needs more bytes of memory than this machine has."""
    if needed > memory_bytes():
        raise WeightsError(
            f"{name}: at {width}x{height} px it needs {needed / 1e9:.1f} GB of memory, but this "
            f"machine has {memory_bytes() / 1e9:.1f} GB; choose a smaller sensor"
        )


def has_bfloat16() -> bool:
    """Return whether the processor has instructions for bfloat16."""
    return bool(torch.cpu._is_avx512_bf16_supported())


def _counted(function: Callable[..., T], arguments: tuple[Any, ...]) -> tuple[T, float]:
    helpers = _helpers()
    started_s = cpu_s() + _cpu_s_of(helpers)
    with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=has_bfloat16()):
        answer = function(*arguments)
    return answer, cpu_s() + _cpu_s_of(helpers) - started_s


@cache
def _helpers() -> tuple[str, ...]:
    """Start PyTorch's helper threads and return their ids; where their times are unknown, none."""
    if not Path("/proc/self/schedstat").exists():
        torch.set_num_threads(1)
        return ()
    torch.set_num_threads(cores())
    before = _running()
    torch.ones(_PARALLEL).add_(1)
    ours = {str(thread.native_id) for thread in threading.enumerate()}
    return tuple(_running() - before - ours)


def _running() -> set[str]:
    return {thread.name for thread in _THREADS.iterdir()}


def _cpu_s_of(threads: tuple[str, ...]) -> float:
    return 1e-9 * sum(
        int((_THREADS / thread / "schedstat").read_text().split()[0]) for thread in threads
    )
