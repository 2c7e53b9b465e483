"""The command line, one file per subject; `main` is the command `eres`."""

from tasks.cli.main import main

__all__ = ["main"]
