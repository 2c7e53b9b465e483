"""The folder for results that can be computed again."""

from __future__ import annotations

import os
from pathlib import Path


def cache_dir() -> Path:
    """Return `$ERES_CACHE`, `$XDG_CACHE_HOME/eres` or `~/.cache/eres`, which may not exist."""
    if own := os.environ.get("ERES_CACHE"):
        return Path(own)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "eres"
