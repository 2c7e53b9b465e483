"""Compile kernels with Numba, and never run an outdated one."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.dispatcher import Dispatcher

_Kernel = TypeVar("_Kernel", bound=Callable[..., Any])


def compiler(folder: Path, **options: Any) -> Callable[[_Kernel], _Kernel]:
    """Return a decorator that compiles kernels and caches them until one of them is edited.

    Numba caches a compiled function until its own file changes. A kernel contains the code of the
    kernels that it calls, so the cache of each depends on all files with kernels in their folder.

    Parameters
    ----------
    folder
        Folder of the kernels and of those that they call.
    options
        Options of `numba.njit`, in addition to a cache, no GIL and the error model of numpy.

    Returns
    -------
    The decorator.
    """
    sources = map(Path.read_bytes, sorted(folder.glob("*.py")))
    stamp = hashlib.sha256(b"".join(one for one in sources if b"@jit" in one)).hexdigest()

    def compiled(kernel: _Kernel) -> _Kernel:
        found: Any = numba.njit(cache=True, nogil=True, error_model="numpy", **options)(kernel)
        if isinstance(found, Dispatcher):  # not if Numba is disabled
            kept: Any = found
            index = kept._cache._cache_file
            index._source_stamp = (index._source_stamp, stamp)
        return found

    return compiled
