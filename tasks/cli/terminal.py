"""Consoles of the command line: `out` prints results to stdout, `err` the rest to stderr."""

from __future__ import annotations

from rich.console import Console

out = Console()
err = Console(stderr=True)
