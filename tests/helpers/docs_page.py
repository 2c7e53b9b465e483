"""Do the steps of a docs page: write its files, run its Python and its commands, in order.

A block ```` ```text output ```` shows what the block before it printed, and is compared with it:
`...` stands for anything, and lengths of white space do not matter. In ```` ```text output 5% ````
numbers may differ by 5 %, for light from a renderer.
"""

import io
import logging
import re
import shlex
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path

import pytest

from tasks import cli
from tasks.cli import terminal

DOCS = Path(__file__).parents[2] / "docs"
PACKAGES = ("eres_render", "sensor", "tasks")
# A fenced block: language, then perhaps the name of the file to write.
BLOCK = re.compile(r"^```(\w+)(?: ([^\n]+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
OUTPUT = re.compile(r"output(?: (\d+)%)?")
# Several pages begin with this clip, which takes seconds to render: the first of them renders it.
THE_CLIP = re.compile(r"eres render carpet --out (\w+) --resolution 128 --spp 4 --samples 1")
ANYTHING_OR_NUMBER = re.compile(r"(\.\.\.|\d+(?:\.\d+)?)")


_rendered: list[tuple[Path, str]] = []
"""The clip of `THE_CLIP` where a page has rendered it, and what was printed."""


def follow(page: str, folder: Path) -> str:
    """Do all steps of a page in a folder; return the output of its commands and its Python.

    Reports have no static figures, which take longest and are on no page.
    """
    said = io.StringIO()
    before = 0
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(said), logged(said):
        patch.chdir(folder)
        patch.setattr("tasks.study.report.page.figure_files", lambda plots: {})
        patch.setattr(terminal, "out", terminal.Console(file=said, width=200))
        patch.setattr(terminal, "err", terminal.Console(file=said, width=200))
        for language, name, text in BLOCK.findall((DOCS / page).read_text()):
            if output := OUTPUT.fullmatch(name):
                printed = said.getvalue()[before:]
                differs = f"{page} shows\n{text}\nthis was printed\n{printed}"
                assert matches(text, printed, int(output[1] or 0) / 100), differs
            elif name:
                Path(name).parent.mkdir(exist_ok=True)
                Path(name).write_text(text)
            else:
                before = said.tell()
                run(language, text, said, patch)
    return said.getvalue()


@contextmanager
def logged(said: io.StringIO) -> Iterator[None]:
    """Capture what the command line writes to stderr."""
    listener = logging.StreamHandler(said)
    for package in PACKAGES:
        logging.getLogger(package).addHandler(listener)
        logging.getLogger(package).setLevel(logging.INFO)
    try:
        yield
    finally:
        for package in PACKAGES:
            logging.getLogger(package).removeHandler(listener)
            logging.getLogger(package).setLevel(logging.NOTSET)


def run(language: str, text: str, said: io.StringIO, patch: pytest.MonkeyPatch) -> None:
    """Run the Python of a block, or its commands, one per line."""
    if language == "python":
        exec(text, {})
        return
    for line in text.splitlines():
        if (same := THE_CLIP.fullmatch(line)) and _rendered:
            clips, printed = _rendered[0]
            shutil.copytree(clips, same[1])
            said.write(printed.replace(clips.name, same[1]))
            continue
        start = said.tell()
        patch.setattr("sys.argv", shlex.split(line))
        with pytest.raises(SystemExit) as end:
            cli.main()
        assert end.value.code == 0, f"{line}\n{said.getvalue()}"
        if same:
            _rendered.append((Path(same[1]).absolute(), said.getvalue()[start:]))


def matches(shown: str, printed: str, tolerance: float = 0.0) -> bool:
    """Return whether a page shows what was printed, its numbers to a relative tolerance."""
    parts = ANYTHING_OR_NUMBER.split(" ".join(shown.split()))
    numbers = [float(part) for part in parts[1::2] if part != "..."]
    parts[::2] = map(re.escape, parts[::2])
    parts[1::2] = [".*" if part == "..." else r"(\d+(?:\.\d+)?)" for part in parts[1::2]]
    found = re.fullmatch("".join(parts), " ".join(printed.split()))
    return found is not None and all(
        abs(float(one) - number) <= tolerance * max(float(one), number)
        for one, number in zip(found.groups(), numbers, strict=True)
    )
