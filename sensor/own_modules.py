"""Modules of a user, named on the command line or in a file."""

from __future__ import annotations

import importlib
import os
import sys
from types import ModuleType


def import_own(module: str) -> ModuleType:
    """Import a user's module, also from the working directory, as `python -m` does."""
    if "" not in sys.path and os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    return importlib.import_module(module)
