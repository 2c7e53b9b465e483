"""Choose a Mitsuba variant that works on this machine.

With some LLVM releases Mitsuba's `llvm_*` variants end the whole process ("Cannot select:
fminimum"), which no `except` can catch. So each candidate first renders a few pixels in its own
process, and the verdict is cached until Mitsuba or the libraries change.
"""

from __future__ import annotations

import ctypes
import functools
import glob
import hashlib
import json
import logging
import os
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from importlib.metadata import version

from eres_render.errors import BackendError, RenderError
from eres_render.storage.atomic import write_text
from eres_render.storage.cache import cache_dir
from eres_render.storage.settings_reader import read_json

_log = logging.getLogger(__name__)

VARIANTS = ("cuda_ad_mono", "llvm_ad_mono", "scalar_rgb")
"""The candidates, best first."""

_ADVICE = {
    "cuda_ad_mono": "needs an NVIDIA GPU with its driver",
    "llvm_ad_mono": "install a newer LLVM: apt-get install libllvm19",
    "scalar_rgb": "reinstall mitsuba",
}

_LIBRARIES = ("libLLVM*.so*", "libcuda.so*", "libnvoptix.so*")
_LIBRARY_FOLDERS = (
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
    "/usr/local/lib",
    "/usr/lib/wsl/lib",
)
_LIBRARY_VARIABLES = ("DRJIT_LIBLLVM_PATH", "DRJIT_LIBCUDA_PATH", "LD_LIBRARY_PATH")

_PROBE = """
import sys
import mitsuba as mi
mi.set_variant(sys.argv[1])
scene = mi.load_dict({
    "type": "scene",
    "integrator": {"type": "path", "max_depth": 2},
    "sensor": {
        "type": "perspective",
        "to_world": mi.ScalarTransform4f().look_at([0, 0, 2], [0, 0, 0], [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}},
        "sampler": {"type": "multijitter", "sample_count": 4},
    },
    "floor": {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(9)},
    "sky": {"type": "constant"},
})
mean = float(__import__("numpy").asarray(mi.render(scene)).mean())
assert 0.4 < mean < 0.6, f"a gray floor under a white sky came out as {mean}, expected 0.5"
"""
_PROBE_LIMIT_S = 180.0
_OUT_OF_MEMORY = ("out of memory", "MemoryError", "bad_alloc")


@dataclass(frozen=True, slots=True)
class VariantVerdict:
    """Whether a Mitsuba variant works on this machine.

    `lasting` is False if the machine was too busy or had too little memory to tell.
    """

    name: str
    works: bool
    seconds: float
    reason: str
    lasting: bool = True


def probe_variants() -> list[VariantVerdict]:
    """Return the verdict on every candidate, best first; takes seconds where none is cached."""
    return [probe_variant(name) for name in VARIANTS]


def select_variant() -> str:
    """Make Mitsuba use `$ERES_VARIANT`, else the best variant that works, and return its name."""
    name = os.environ.get("ERES_VARIANT") or None
    if name is None:
        name = _best_variant()
    elif name not in VARIANTS:
        raise BackendError(f"ERES_VARIANT: found {name!r}, expected one of {', '.join(VARIANTS)}")
    elif not (verdict := probe_variant(name)).works:
        raise BackendError(
            f"ERES_VARIANT: {name} does not work here: {verdict.reason} ({_ADVICE[name]})"
        )
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(name)
    if dr.thread_count() < 2:  # with one, Mitsuba 3.9 deadlocks on an EXR image
        dr.set_thread_count(2)
    return name


def release_render_memory() -> None:
    """Give the system the memory that Dr.Jit and glibc keep after a render, up to 1 GB."""
    import drjit as dr

    dr.flush_malloc_cache()
    if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "malloc_trim"):
        libc.malloc_trim(0)


@functools.cache  # variants passed over are logged once per process
def _best_variant() -> str:
    passed_over: list[VariantVerdict] = []
    for name in VARIANTS:
        verdict = probe_variant(name)
        if verdict.works:
            if passed_over:
                # A missing GPU is no reason for a warning; missing LLVM is.
                level = logging.WARNING if name.startswith("scalar") else logging.DEBUG
                slow = ", 25x to 60x slower than with LLVM" if name.startswith("scalar") else ""
                _log.log(level, "rendering with %s%s; %s", name, slow, _explain(passed_over[-1:]))
            return name
        passed_over.append(verdict)
    raise BackendError(f"no Mitsuba variant works here: {_explain(passed_over)}")


def _explain(verdicts: list[VariantVerdict]) -> str:
    return "; ".join(f"{v.name} fails: {v.reason} ({_ADVICE[v.name]})" for v in verdicts)


def probe_variant(name: str) -> VariantVerdict:
    """Return the verdict on one variant; takes seconds if it is not cached."""
    surroundings = json.dumps([name, _PROBE, version("mitsuba"), version("drjit"), _libraries()])
    digest = hashlib.sha256(surroundings.encode()).hexdigest()[:16]
    path = cache_dir() / "variants" / f"{name}-{digest}.json"
    try:
        return read_json(VariantVerdict, path, BackendError)
    except BackendError:
        pass  # not cached, or unreadable: probe again
    verdict = _probe(name)
    if not verdict.lasting:
        return verdict
    try:
        write_text(path, json.dumps(asdict(verdict)))
    except RenderError as error:
        _log.debug("the verdict on %s is not cached: %s", name, error)
    return verdict


def _libraries() -> list[tuple[str, int]]:
    """Return the JIT libraries and drivers: settings, paths, times of change."""
    settings = *_LIBRARY_VARIABLES, "CUDA_VISIBLE_DEVICES"
    values = [(f"{name}={os.environ.get(name, '')}", 0) for name in settings]
    patterns = [os.path.join(f, library) for f in _LIBRARY_FOLDERS for library in _LIBRARIES]
    paths = sorted({path for pattern in patterns for path in glob.glob(pattern)})
    paths += [os.environ.get(name, "") for name in _LIBRARY_VARIABLES]
    paths.append("/proc/driver/nvidia/version")
    for path in paths:
        if os.path.isfile(path):
            values.append((path, os.stat(path).st_mtime_ns))
    return values


def _probe(name: str) -> VariantVerdict:
    """Render a few pixels with a variant, in its own process."""
    start = time.perf_counter()
    try:
        run = subprocess.run(
            [sys.executable, "-c", _PROBE, name],
            capture_output=True,
            text=True,
            timeout=_PROBE_LIMIT_S,
        )
        works, reason, lasting = run.returncode == 0, "", run.returncode != -9
        if not works:
            output = run.stderr + run.stdout
            reason = _last_words(output) or f"exit status {run.returncode}"
            # A machine that is full now may not be full the next time.
            lasting &= not any(words in output for words in _OUT_OF_MEMORY)
    except subprocess.TimeoutExpired:
        works, reason, lasting = False, f"no answer within {_PROBE_LIMIT_S:g} s", False
    return VariantVerdict(name, works, round(time.perf_counter() - start, 3), reason, lasting)


def _last_words(output: str) -> str:
    """Return the line that best says why a process ended: LLVM's own, else the last one."""
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    for line in lines:
        if "LLVM ERROR" in line:
            return line
    return lines[-1] if lines else ""
