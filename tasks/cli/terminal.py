"""Consoles of the command line: `out` prints results to stdout, `err` the rest to stderr.

They print brackets and colons as they are: names of files may have them. Colors are `Text`.
"""

from __future__ import annotations

from functools import partial

import rich.console

Console = partial(rich.console.Console, markup=False, emoji=False)

out = Console()
err = Console(stderr=True)
