"""Kernels that a wheel has compiled, so that the first simulation does not have to.

The build of a wheel compiles them for two kinds of processors, see `hatch_kernels.py`. A kernel's
code is used where the cache of the user has none, by the Python, the Numba and the sources that it
was compiled with, on a processor that has the instructions. Then a process in the background
compiles all of them for this very processor, for the next start.

`ERES_COMPILE=off` leaves out the process in the background, which tests and continuous integration
leave out in any case unless it is `on`. `ERES_COMPILE=host` leaves out the wheel's code too: Numba
then compiles for this processor at the first use. (The process in the background has `background`.)
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba
from numba.core.caching import CompileResultCacheImpl, IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

from sensor.file_lock import locked

FOLDER = Path(__file__).parent / "_compiled"

_V3 = {
    *("avx", "avx2", "bmi", "bmi2", "cx16", "f16c", "fma", "lzcnt", "movbe", "popcnt", "sahf"),
    *("sse3", "sse4.1", "sse4.2", "ssse3", "xsave"),
}
_V4 = {*_V3, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}
TARGETS = {"x86-64-v4": _V4, "x86-64-v3": _V3}
"""LLVM's names of processors, the best first, and of the instructions that each has."""


def fall_back(kernel: Any, stamp: str) -> None:
    """Let a kernel use the wheel's code where its own cache has none.

    `kernel` is Numba's dispatcher, `stamp` a digest of the sources of the kernels that it calls.
    """
    kernel.stamp = stamp
    cache_file = kernel._cache._cache_file
    load_own = cache_file.load

    def load(key: Any) -> Any:
        code = load_own(key)
        if code is None and not len(kernel.typingctx.callstack):
            return _load(kernel, key)
        return code  # within a caller: that is being compiled for this processor

    cache_file.load = load


def runs_here(target: str) -> bool:
    """Return whether this machine can run code of a target."""
    features = llvmlite.binding.get_host_cpu_features()
    linux = sys.platform == "linux"
    return linux and all(features.get(name) for name in TARGETS[target])


def is_in_background() -> bool:
    """Return whether this is the process that compiles in the background."""
    return os.environ.get("ERES_COMPILE") == "background"


def lock_files(kernel: Any, lock: str) -> None:
    """Lock the cache of a kernel while it is read or written, not while it is compiled.

    The process in the background compiles slowly where others work, and they must not wait for it.
    """
    cache_file = kernel._cache._cache_file
    load, save = cache_file.load, cache_file.save

    def load_alone(key: Any) -> Any:
        with locked(lock):
            return load(key)

    def save_alone(key: Any, data: Any) -> None:
        with locked(lock):
            save(key, data)

    cache_file.load, cache_file.save = load_alone, save_alone


def is_shipped(kernel: Any) -> bool:
    """Return whether the wheel has code of a kernel, for arguments of any types."""
    features = kernel.targetctx.codegen().magic_tuple()[2]
    return any(_code_file(kernel, target, FOLDER)._load_index() for target in _usable(features))


def ship(kernel: Any, signature: Any, target: str, folder: Path) -> None:
    """Compile a kernel without running it, and copy its code into a folder for wheels.

    `kernel` is Numba's dispatcher, `signature` the types of the arguments. `target` is this
    process's `NUMBA_CPU_NAME`; its `NUMBA_CPU_FEATURES` add none.
    """
    kernel.compile(signature)
    key = kernel._cache._index_key(signature, kernel.targetctx.codegen())
    shipped = _code_file(kernel, target, folder)
    Path(shipped._cache_path).mkdir(parents=True, exist_ok=True)
    shipped.save(_for_target(key, target), kernel._cache._cache_file.load(key))


def contents(target: str, folder: Path) -> Iterator[tuple[Any, Any]]:
    """Yield the kernels that are compiled for a target, and the types of their arguments."""
    for place in sorted((folder / target).iterdir()):
        with suppress(ImportError):  # of what a module of the methods needs
            for kernel in vars(import_module(place.name)).values():
                if isinstance(kernel, Dispatcher) and kernel.__module__ == place.name:
                    for signature, *_ in _code_file(kernel, target, folder)._load_index():
                        yield kernel, signature


def compile_for_this_processor() -> None:
    """Compile what the wheel has into the cache of the user, in the process in the background."""
    os.nice(19)
    for kernel, signature in contents("x86-64-v3", FOLDER):
        kernel.compile(signature)


def _load(kernel: Any, key: Any) -> Any:
    for target in _usable(key[1][2]):
        code = _code_file(kernel, target, FOLDER).load(_for_target(key, target))
        if code is not None:
            _compile_in_background()
            return code
    return None


def _code_file(kernel: Any, target: str, folder: Path) -> Any:
    """Return Numba's index of a kernel's code for a target, which need not exist."""
    place = str(folder / target / kernel.__module__)
    index: Any = IndexDataCacheFile(place, kernel._cache._impl.filename_base, None)
    own = hashlib.sha256(Path(kernel.__code__.co_filename).read_bytes()).hexdigest()
    index._version = f"{numba.__version__} {llvmlite.__version__} {own} {kernel.stamp}"
    return index


def _for_target(key: Any, target: str) -> Any:
    signature, (triple, _, _), code = key
    return signature, (triple, target, ""), code


@cache
def _usable(features: str) -> list[str]:
    """Return the targets for a processor; features are such as "+avx,-avx512f"."""
    if os.environ.get("ERES_COMPILE") in ("host", "background") or not FOLDER.is_dir():
        return []
    present = {feature[1:] for feature in features.split(",") if feature.startswith("+")}
    return [target for target, needed in TARGETS.items() if needed <= present]


@cache  # once in a process
def _compile_in_background() -> object:
    """Start the process, unless another one runs with the same cache."""
    tested = {"CI", "PYTEST_CURRENT_TEST"} & {*os.environ}
    if os.environ.get("ERES_COMPILE", "off" if tested else "on") == "off":
        return None
    code = f"from {__name__} import compile_for_this_processor as compile; compile()"
    with suppress(OSError, ImportError):  # no locks: on Windows, in some folders
        import fcntl

        locator: Any = CompileResultCacheImpl(contents)._locator
        with open(Path(locator.get_cache_path()) / "eres_background.lock", "ab") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return subprocess.Popen(
                [sys.executable, "-P", "-c", code],
                env=os.environ | {"ERES_COMPILE": "background"},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
                pass_fds=[lock.fileno()],  # it holds the lock to its end
            )
    return None
