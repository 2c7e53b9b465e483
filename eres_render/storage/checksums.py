"""SHA-256 of every frame, in a file that `sha256sum -c SHA256SUMS` understands."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from eres_render.errors import RenderError
from eres_render.storage.atomic import write_text

FILE_NAME = "SHA256SUMS"


def sha256(file: Path) -> str:
    """Return the digest of a file's bytes."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def read_sums(folder: Path) -> dict[str, str]:
    """Return the digests by path within the folder; none if there is no such file.

    A last line that a killed render left half written is passed over.
    """
    try:
        lines = (folder / FILE_NAME).read_text(encoding="utf-8").splitlines(keepends=True)
    except OSError:
        return {}
    pairs = (line.rstrip("\n").split("  ", 1) for line in lines if line.endswith("\n"))
    return {name: digest for digest, name in (pair for pair in pairs if len(pair) == 2)}


def append_sum(folder: Path, name: str, digest: str) -> None:
    """Add a line for one file, as soon as the file is whole."""
    path = folder / FILE_NAME
    try:
        with path.open("a", encoding="utf-8") as file:
            file.write(f"{digest}  {name}\n")
    except OSError as error:
        raise RenderError(f"{path}: cannot be written: {error.strerror}") from error


def write_sums(folder: Path, sums: Mapping[str, str]) -> None:
    """Write all lines anew, sorted by name."""
    lines = (f"{digest}  {name}\n" for name, digest in sorted(sums.items()))
    write_text(folder / FILE_NAME, "".join(lines))
