"""docs/tutorials: all commands and Python run, and print what the pages show."""

import pytest

from docs_page import DOCS, follow, matches

PAGES = sorted(page.name for page in (DOCS / "tutorials").glob("*.md"))


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_a_tutorial_prints_what_it_shows(page, tmp_path):
    """Promise: who types what a tutorial says reads what it shows."""
    follow(f"tutorials/{page}", tmp_path)


@pytest.mark.parametrize(
    ("shown", "printed", "tolerance", "same"),
    [
        ("clip: 12 events of 8x8 px", "clip:  12 events\n  of 8x8 px\n", 0, True),
        ("clip: 12 events", "clip: 13 events", 0, False),
        ("clip: 12 events", "clip: 12 frames", 0.1, False),
        ("0.50 dB", "0.5 dB", 0, True),
        ("0.50 dB", "-0.5 dB", 0.1, False),
        ("100 events, 20 px", "104 events, 20 px", 0.05, True),
        ("100 events, 20 px", "106 events, 20 px", 0.05, False),
        ("found at ... rate 3", "found at /tmp/2/x\nfile 7\nrate 3", 0, True),
        ("found at ... rate 3", "found at /tmp/2/x\nfile 7\nrate 4", 0, False),
        ("", "clip: 12 events", 0, False),
    ],
)
def test_what_counts_as_the_output_that_a_page_shows(shown, printed, tolerance, same):
    """Promise: numbers and words must be right; white space and what `...` stands for need not."""
    assert matches(shown, printed, tolerance) is same
