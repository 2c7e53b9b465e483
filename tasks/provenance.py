"""Versions, machine and command of a run: what a reader needs to reproduce its numbers."""

from __future__ import annotations

import functools
import platform
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from itertools import chain
from pathlib import Path

from eres_render.cores import cores
from tasks import DISTRIBUTION
from tasks.errors import StudyError

MITSUBA, VARIANT = "mitsuba", "Mitsuba variant"
"""Names in an environment: Mitsuba's version, and its variant, which names the device."""

_BETWEEN = "; "  # separates the values of one name
_CODE = ("eres_render", "sensor", "tasks", "scenes", "pyproject.toml")
_TORCH = "torch"  # affects only the numbers of networks
_PACKAGES = ("numpy", "numba", "scipy", "mitsuba", "drjit", "opencv-python-headless", _TORCH)


def command() -> str:
    """Return the command line of this process, quoted for a shell."""
    return shlex.join(["eres", *sys.argv[1:]])


def environment(variant: str | None = None) -> dict[str, str]:
    """Return versions, machine and code of this process, by name."""
    return {
        "code": code(),
        **({VARIANT: variant} if variant else {}),
        "python": platform.python_version(),
        **versions(),
        "system": platform.platform(),
        "processor": _processor(),
        "cores": str(cores()),
    }


def code() -> str:
    """Return the commit of the code, or the version if there is no commit."""
    built_from = Path(__file__).with_name("commit.txt")  # only in wheels
    if built_from.exists():
        return f"git {built_from.read_text(encoding='utf-8').strip()} as installed"
    return _git_commit() or f"eres {version(DISTRIBUTION)} as installed"


def versions() -> dict[str, str]:
    """Return the versions of eres and of the packages that affect numbers, by name."""
    by_name = {"eres": _version(DISTRIBUTION)}
    for name in _PACKAGES:
        with suppress(PackageNotFoundError):  # of an extra
            if name != _TORCH or _TORCH in sys.modules:
                by_name[name] = _version(name)
    return by_name


@functools.cache  # reading it takes a millisecond, and each job of a study asks
def _version(name: str) -> str:
    return version(name)


def _git_commit() -> str | None:
    """Return the commit of this file's checkout, None for an installed wheel.

    Only changed code makes it "dirty", as the run's folder may be in the checkout.
    """
    root = Path(__file__).parents[1]
    if not (root / ".git").exists():
        return None
    commit = _git(root, "rev-parse", "--short=12", "HEAD")
    changes = _git(root, "status", "--porcelain", "--", *_CODE)
    if commit is None or changes is None:
        return None
    return f"git {commit}-dirty" if changes else f"git {commit}"


def _git(root: Path, *arguments: str) -> str | None:
    """Return what git prints about a checkout, None if git fails."""
    # Without locks: one of a killed process would stay, and stop the user's own git.
    git = ["git", "--no-optional-locks", "-C", str(root)]
    try:
        run = subprocess.run([*git, *arguments], capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return run.stdout.strip() if run.returncode == 0 else None


def _processor() -> str:
    with suppress(OSError):  # not Linux
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def differing_software(environments: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return the values of the software that differs between environments, by name."""
    software = "code", VARIANT, *_PACKAGES
    values = {name: dict.fromkeys(e.get(name, "?") for e in environments) for name in software}
    return {name: ", ".join(several) for name, several in values.items() if len(several) > 1}


def together(environments: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Join environments of processes, or joined environments, listing all values that differ."""
    values: dict[str, dict[str, None]] = {}
    for name, value in chain.from_iterable(each.items() for each in environments):
        values.setdefault(name, {}).update(dict.fromkeys(value.split(_BETWEEN)))
    return {name: _BETWEEN.join(several) for name, several in values.items()}


def check_renderer(begun: Mapping[str, str], now: Mapping[str, str]) -> None:
    """Refuse a Mitsuba version or device that no finished job had, as numbers would change."""
    for name in (MITSUBA, VARIANT):
        if name in begun and name in now and now[name] not in begun[name].split(_BETWEEN):
            raise StudyError(
                f"{name}: found {now[name]}, but the run started with {begun[name]}; continue with "
                f"{begun[name]}, choose another folder, or mix both with --mix"
            )
