"""Compile kernels with Numba once among all processes, and never run an outdated one."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.compiler_lock import global_compiler_lock

from eres_render.errors import RenderError
from eres_render.storage.locks import locked

_Kernel = TypeVar("_Kernel", bound=Callable[..., Any])


def compiler(folder: Path, **options: Any) -> Callable[[_Kernel], _Kernel]:
    """Return a decorator that compiles kernels and caches them until a kernel is edited.

    Numba caches a compiled function until its own file changes, but a kernel contains the code of
    the kernels that it calls, so an edit of any file with kernels in the folder counts. Of several
    processes that need a kernel, only a single process compiles it. `options` go to `numba.njit`.
    `sensor.compiling` has the same, as neither package imports the other.
    """
    sources = map(Path.read_bytes, sorted(folder.rglob("*.py")))
    stamp = hashlib.sha256(b"".join(text for text in sources if b"jit" in text)).hexdigest()

    def compiled(kernel: _Kernel) -> _Kernel:
        jitted: Any = numba.njit(cache=True, nogil=True, error_model="numpy", **options)(kernel)
        if hasattr(jitted, "_cache"):  # not if Numba is disabled
            index = jitted._cache._cache_file
            # Numba compares it before it unpickles types, which an edit may have renamed.
            index._version = f"{index._version} {index._source_stamp} {stamp}"
            _compile_once(jitted)
        return jitted

    return compiled


def _compile_once(kernel: Any) -> None:
    """Let one process at a time compile a kernel, as Numba's cache may mix up concurrent writes."""
    compile_or_load = kernel.compile
    lock = Path(f"{kernel._cache._cache_file._index_path}.lock")

    def compile_alone(signature: Any) -> Any:
        # Numba's lock first: a thread that compiles a caller holds it and waits for the file's.
        with global_compiler_lock, ExitStack() as held:
            if not kernel._compiling_counter:  # of a kernel that calls itself, it is held
                with suppress(RenderError):  # where the cache cannot be written
                    held.enter_context(locked(lock))
            return compile_or_load(signature)

    kernel.compile = compile_alone
