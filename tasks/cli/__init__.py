"""The command line, a file a subject; `main` is the command `eres`."""

from tasks.cli.main import main

__all__ = ["main"]
