"""SHA-256 of every frame, in a file that `sha256sum -c SHA256SUMS` reads."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from eres_render.errors import RenderError
from eres_render.storage.atomic import write_text

FILE_NAME = "SHA256SUMS"


def sha256(file: Path) -> str:
    """Return the SHA-256 of a file's bytes, 64 hexadecimal digits."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def read_sums(folder: Path) -> dict[str, str]:
    """Return the digests by path in the folder, {} without a file; damaged lines are ignored."""
    try:
        text = (folder / FILE_NAME).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return {}
    lines = (line for line in text.splitlines(keepends=True) if line.endswith("\n"))
    pairs = (line.rstrip("\n").split("  ", 1) for line in lines)
    return {name: digest for digest, name in (pair for pair in pairs if len(pair) == 2)}


def append_sum(folder: Path, name: str, digest: str) -> None:
    """Add the line of a file, with the SHA-256 of its bytes, as soon as that file is complete."""
    path = folder / FILE_NAME
    try:
        with path.open("a", encoding="utf-8") as file:
            file.write(f"{digest}  {name}\n")
    except OSError as error:
        raise RenderError(f"{path}: cannot be written: {error.strerror}") from error


def write_sums(folder: Path, sums: Mapping[str, str]) -> None:
    """Write SHA256SUMS, sorted by name, in place of an existing one."""
    lines = (f"{digest}  {name}\n" for name, digest in sorted(sums.items()))
    write_text(folder / FILE_NAME, "".join(lines))
