"""Do the steps of a docs page: write its files, run its Python and its commands, in order."""

import io
import logging
import re
import shlex
from pathlib import Path

import pytest

from tasks import cli
from tasks.cli import terminal

DOCS = Path(__file__).parents[2] / "docs"
# A fenced block: language, then perhaps the name of the file that it is.
BLOCK = re.compile(r"^```(\w+)(?: (\S+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def follow(page: str, folder: Path) -> str:
    """Do all steps of a page in a folder; return the output of its commands."""
    said = io.StringIO()
    listener = logging.StreamHandler(said)
    logging.getLogger("eres_render").addHandler(listener)
    logging.getLogger("eres_render").setLevel(logging.INFO)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(terminal, "out", terminal.Console(file=said, width=200))
        patch.setattr(terminal, "err", terminal.Console(file=said, width=200))
        for language, name, text in BLOCK.findall((DOCS / page).read_text()):
            if name:
                Path(name).parent.mkdir(exist_ok=True)
                Path(name).write_text(text)
            elif language == "python":
                exec(text, {})
            else:
                for line in text.splitlines():
                    patch.setattr("sys.argv", shlex.split(line))
                    with pytest.raises(SystemExit) as end:
                        cli.main()
                    assert end.value.code == 0, f"{line}\n{said.getvalue()}"
    logging.getLogger("eres_render").removeHandler(listener)
    logging.getLogger("eres_render").setLevel(logging.NOTSET)
    return said.getvalue()
