"""Extras: packages that only some commands need, and how to get one that is missing."""

from __future__ import annotations

from importlib.util import find_spec

from tasks import DISTRIBUTION

_NAMES = {
    "av": "PyAV",
    "cv2": "OpenCV",
    "distributed": "Dask",
    "faery": "faery",
    "matplotlib": "Matplotlib",
    "mitsuba": "Mitsuba",
    "numba_cuda": "numba-cuda",
    "pyarrow": "PyArrow",
    "rerun": "Rerun",
    "rosbags": "rosbags",
    "torch": "PyTorch",
}
EXTRAS = {
    "video": ("av", "cv2"),
    "render": ("mitsuba", "cv2"),
    "study": ("mitsuba", "cv2", "pyarrow", "matplotlib"),
    "learned": ("torch", "cv2", "matplotlib"),
    "formats": ("faery", "rosbags"),
    "viewer": ("rerun",),
    "distributed": ("distributed",),
    "cuda": ("numba_cuda",),
}
"""The modules of each extra of pyproject.toml that the base install lacks."""


def install(extra: str) -> str:
    """Return how to get an extra."""
    command = f"pip install '{DISTRIBUTION}[{extra}]'"
    if "torch" not in EXTRAS[extra] or is_installed("torch"):
        return command
    return f"install PyTorch as https://pytorch.org/get-started/locally/ says, then {command}"


def is_installed(module: str) -> bool:
    """Return whether a module can be found, without importing it."""
    return find_spec(module) is not None


def advice(error: BaseException | None, job: str | None = None) -> str | None:
    """Return a line of advice if an error, or its cause, is a missing package.

    It names the extra `job` if that has the package, otherwise the first extra that has it.
    """
    while error is not None:
        if isinstance(error, ModuleNotFoundError) and error.name in _NAMES:
            extras = [extra for extra, modules in EXTRAS.items() if error.name in modules]
            chosen = job if job in extras else extras[0]
            return f"this needs {_NAMES[error.name]}, which is not installed: {install(chosen)}"
        error = error.__cause__
    return None
