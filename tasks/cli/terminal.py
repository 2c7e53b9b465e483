"""Where the command line prints: results on stdout, all else on stderr."""

from __future__ import annotations

from rich.console import Console

out = Console()
err = Console(stderr=True)
