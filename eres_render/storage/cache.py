"""The folder for results that can be computed again."""

from __future__ import annotations

import os
from pathlib import Path


def cache_dir() -> Path:
    """Return the user's cache folder, which may not exist yet.

    `$ERES_CACHE` if set, else `$XDG_CACHE_HOME/eres`, else `~/.cache/eres`.
    """
    if own := os.environ.get("ERES_CACHE"):
        return Path(own)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "eres"
