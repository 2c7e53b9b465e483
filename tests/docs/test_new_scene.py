"""docs/new_scene.md and moving_objects.md: the test writes their files and runs their commands."""

import pytest

from docs_page import follow
from sensor.formats import read_events

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Return a folder after all steps of the page, and the output of its commands."""
    folder = tmp_path_factory.mktemp("new_scene")
    return folder, follow("new_scene.md", folder) + follow("moving_objects.md", folder)


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
