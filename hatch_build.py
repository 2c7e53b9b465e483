"""Write the commit into wheels and source archives, as they have no repository to ask."""

from __future__ import annotations

import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_COMMIT = "tasks/commit.txt"


class CommitHook(BuildHookInterface):
    """Adds `tasks/commit.txt`; an editable installation asks git while it runs."""

    _folder: TemporaryDirectory[str] | None = None

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the file, unless the build starts from a source archive, which has it."""
        root = Path(self.root)
        if version == "editable" or not (root / ".git").exists():
            return
        git = ["git", "--no-optional-locks", "-C", str(root)]
        head, changes = (
            subprocess.run([*git, *arguments], capture_output=True, text=True, check=True).stdout
            for arguments in (("rev-parse", "--short=12", "HEAD"), ("status", "--porcelain"))
        )
        self._folder = TemporaryDirectory()
        file = Path(self._folder.name) / "commit.txt"
        file.write_text(head.strip() + ("-dirty" if changes else "") + "\n")
        build_data["force_include"][str(file)] = _COMMIT

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Delete the file, which the artifact has now."""
        del version, build_data, artifact_path
        if self._folder:
            self._folder.cleanup()
