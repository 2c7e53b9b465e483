"""Compile kernels with Numba once among all processes, and never run an outdated one."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

from sensor.file_lock import locked
from sensor.shipped import fall_back, is_in_background, is_shipped, lock_files

_Kernel = TypeVar("_Kernel", bound=Callable[..., Any])


def compiler(*folders: Path, **options: Any) -> Callable[[_Kernel], _Kernel]:
    """Return a decorator that compiles kernels and caches them until one of them is edited.

    Numba caches a compiled function until its own file changes. A kernel contains the code of the
    kernels that it calls, so the cache of each depends on all files with kernels in `folders`; a
    kernel that calls no other needs none. Of several processes that need a kernel, one compiles it
    and the others wait for it.
    """
    files = sorted(file for folder in folders for file in folder.rglob("*.py"))
    sources = (source for source in map(Path.read_bytes, files) if b"jit" in source)
    stamp = hashlib.sha256(b"".join(sources)).hexdigest()
    options |= {"cache": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}

    def compiled(kernel: _Kernel) -> _Kernel:
        jitted: Any = numba.njit(**options)(kernel)
        if hasattr(jitted, "_cache"):  # not if Numba is disabled
            index = jitted._cache._cache_file
            # Numba compares it before it unpickles types, which an edit may have renamed.
            index._version = f"{index._version} {index._source_stamp} {stamp}"
            _compile_once(jitted)
            fall_back(jitted, stamp)
        return jitted

    return compiled


def is_cached(kernel: Any) -> bool:
    """Return whether code of a kernel is in the cache or the wheel, for arguments of any types."""
    cache: Any = getattr(kernel, "_cache", None)
    if not isinstance(kernel, Dispatcher):
        return False
    return bool(cache._cache_file._load_index()) or is_shipped(kernel)


def _compile_once(kernel: Any) -> None:
    """Let one process at a time compile a kernel; the next finds it in the cache.

    Without the lock, Numba compiles it in each process, and two processes that write to the cache
    at once may store the code of one signature as that of another.
    """
    compile_or_load = kernel.compile
    lock = f"{kernel._cache._cache_file._index_path}.lock"
    if is_in_background():
        lock_files(kernel, lock)
        return

    def compile_alone(signature: Any) -> Any:
        # Numba's lock first: a thread that compiles a caller holds it and waits for the file's.
        with global_compiler_lock:
            if kernel._compiling_counter:  # a kernel that calls itself
                return compile_or_load(signature)
            with locked(lock):
                return compile_or_load(signature)

    kernel.compile = compile_alone
