"""Python code in a process of its own: another Mitsuba variant, one core, a fresh heap."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent


def run_python(
    code: str, *arguments: object, timeout_s: float | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run code with the checkout's packages; what it printed, or a failure with its stderr."""
    run = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        env=os.environ | {"PYTHONPATH": str(ROOT)} | environment,
        capture_output=True,
        text=True,
        timeout=timeout_s,
    )
    assert run.returncode == 0, run.stderr
    return run
