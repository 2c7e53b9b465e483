"""The build: wheels and source archives know their commit, and wheels have compiled kernels.

This file is Hatch's hook, and the backend that asks for what the kernels need. An editable
installation needs neither: it asks git while it runs, and compiles when a kernel is first used.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import hatchling.build
from hatchling.build import *  # noqa: F403
from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_COMMIT = "tasks/commit.txt"
_KERNELS = "sensor/_compiled"
_KERNELS_NEED = (
    *("filelock", "numba", "numpy", "opencv-python-headless", "OpenEXR", "pillow", "psutil"),
    *("pyyaml", "scipy"),
)
# LLVM would use vectors of 256 bits for x86-64-v4, which takes 1.1 to 1.4 times as long on Zen 5.
_STEPS = (
    ("run", "x86-64-v3", ""),
    ("run", "x86-64-v3", ""),
    ("compile", "x86-64-v4", "-prefer-256-bit"),
)


def get_requires_for_build_wheel(  # type: ignore[no-redef]
    config_settings: dict[str, Any] | None = None,
) -> list[str]:
    """Return what has to be installed where a wheel is built."""
    return [*hatchling.build.get_requires_for_build_wheel(config_settings), *_KERNELS_NEED]


class BuildHook(BuildHookInterface):
    """Adds `tasks/commit.txt` to wheels and source archives, and `sensor/_compiled` to wheels."""

    _folder: TemporaryDirectory[str] | None = None

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Make the files and add them."""
        if version == "editable":
            return
        self._folder = TemporaryDirectory()
        made = Path(self._folder.name)
        if (Path(self.root) / ".git").exists():  # a source archive has the file
            (made / "commit.txt").write_text(_commit(self.root))
            build_data["force_include"][str(made / "commit.txt")] = _COMMIT
        if self.target_name == "wheel":
            if problem := _compile_kernels(self.root, made):
                self.app.display_warning(f"eres: the wheel has no compiled kernels: {problem}")
            else:
                build_data["force_include"][str(made / "kernels")] = _KERNELS

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Delete the files, which the artifact has now."""
        del version, build_data, artifact_path
        if self._folder:
            self._folder.cleanup()


def _commit(root: str) -> str:
    git = ["git", "--no-optional-locks", "-C", root]
    head, changes = (
        subprocess.run([*git, *arguments], capture_output=True, text=True, check=True).stdout
        for arguments in (("rev-parse", "--short=12", "HEAD"), ("status", "--porcelain"))
    )
    return head.strip() + ("-dirty" if changes else "") + "\n"


def _compile_kernels(root: str, made: Path) -> str:
    """Compile the kernels into the folder `kernels`; return why that did not work, or nothing."""
    usual = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    path = os.pathsep.join(filter(None, (root, usual.get("PYTHONPATH"))))
    for how, target, features in _STEPS:
        variables = {
            "ERES_COMPILE": "host",
            "NUMBA_CPU_NAME": target,
            "NUMBA_CPU_FEATURES": features,  # besides those of the name
            "NUMBA_DISABLE_INTEL_SVML": "1",  # a library that others may lack
            "NUMBA_CACHE_DIR": str(made / target),
            "PYTHONPATH": path,
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        program = [str(Path(root) / "hatch_kernels.py"), how, target, str(made / "kernels")]
        done = subprocess.run(
            [sys.executable, *program], capture_output=True, text=True, env=usual | variables
        )
        if done.returncode:
            return (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
    return ""
