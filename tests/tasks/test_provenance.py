"""A run stores where it was computed."""

import importlib.util
import os
import shlex
import subprocess
import sys
from pathlib import Path

from tasks import provenance


def test_a_runs_own_folder_does_not_make_its_code_dirty(tmp_path):
    """Promise: a run stores the commit of its code, and "dirty" covers its code alone. Asking git
    writes nothing into the checkout: a process killed meanwhile would leave git's lock."""
    copy = tmp_path / "tasks" / "provenance.py"
    copy.parent.mkdir(parents=True)
    copy.write_text(Path(provenance.__file__).read_text())

    def git(*arguments):
        identity = ["-c", "user.name=a", "-c", "user.email=a@b"]
        command = ["git", "-C", str(tmp_path), *identity, *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    (tmp_path / ".gitignore").write_text("__pycache__/\n")
    git("init")
    git("add", ".")
    git("commit", "-m", "code")
    spec = importlib.util.spec_from_file_location("copied_provenance", copy)
    copied = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(copied)
    commit = f"git {git('rev-parse', '--short=12', 'HEAD')}"
    variant = "scalar_rgb"
    index = tmp_path / ".git" / "index"
    os.utime(copy, (1e9, 1e9))  # git would store the new time
    before = index.read_bytes()
    assert copied.environment(variant)["code"] == commit
    assert index.read_bytes() == before
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "rows.parquet").write_text("")
    assert copied.environment(variant)["code"] == commit
    copy.write_text(copy.read_text() + "\n")
    assert copied.environment(variant)["code"] == f"{commit}-dirty"


def test_the_command_can_be_pasted_into_a_shell(monkeypatch):
    """Promise: a shell splits the recorded command into the arguments of the run."""
    arguments = ["study", "my study.toml", "--out", "runs/$HOME & 'co'"]
    monkeypatch.setattr(sys, "argv", ["/usr/bin/eres", *arguments])
    assert shlex.split(provenance.command()) == ["eres", *arguments]
