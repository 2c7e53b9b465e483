"""docs/new_scene.md: its files are written and its commands run, top to bottom."""

import io
import logging
import re
import shlex
from pathlib import Path

import pytest

from sensor.formats import read_events
from tasks import cli

PAGE = Path(__file__).parent.parent / "docs" / "new_scene.md"
# A fenced block: language, then perhaps the name of the file that it is.
BLOCK = re.compile(r"^```(\w+)(?: (\S+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A folder after everything on the page was done in it, and what the commands said."""
    folder, said = tmp_path_factory.mktemp("new_scene"), io.StringIO()
    listener = logging.StreamHandler(said)
    logging.getLogger("eres_render").addHandler(listener)
    logging.getLogger("eres_render").setLevel(logging.INFO)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(cli, "_out", cli.Console(file=said, width=200))
        patch.setattr(cli, "_err", cli.Console(file=said, width=200))
        for language, name, text in BLOCK.findall(PAGE.read_text()):
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
    return folder, said.getvalue()


def test_the_page_leads_to_events(page):
    folder, _ = page
    for name, side in (("events.h5", 64), ("gallery.h5", 32)):
        parts = list(read_events(folder / name))
        assert sum(map(len, parts)) > 100
        assert {(events.width, events.height) for events in parts} == {(side, side)}


def test_the_page_leads_to_ground_truth(page):
    folder, _ = page
    assert len(list((folder / "truth" / "depth").glob("*.exr"))) == 2
    assert (folder / "truth" / "flow" / "000000.png").is_file()


def test_the_commands_say_what_the_page_says(page):
    _, said = page
    assert "shape 'floor' has a reflectance that is neither" in said
    assert "gallery is path-traced at 16 spp: log noise" in said
    assert "64 spp" in said
