"""Run Python code in its own process: another Mitsuba variant, one core, a fresh heap."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]

HELPERS = Path(__file__).parent


def environment() -> dict[str, str]:
    """Return this process's environment, with the checkout's packages and the helpers."""
    return os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{HELPERS}"}


def run_python(
    code: str, *arguments: object, timeout_s: float | None = None, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run code with the checkout's packages and the helpers; return its output."""
    run = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        env=environment() | variables,
        capture_output=True,
        text=True,
        timeout=timeout_s,
    )
    assert run.returncode == 0, run.stderr
    return run
