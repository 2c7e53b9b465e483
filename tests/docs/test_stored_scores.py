"""docs/methods.md has the scores of the stored run of the preset `paper`."""

import csv
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
WIDTHS = ("128", "240", "346", "640", "1280")
SERIES = {
    "EPF, RNEPE [px]": ("photometric_flow", "", ("carpet", "rocks", "room")),
    "CM, RNEPE [px]": ("contrast_maximization", "", ("carpet", "rocks", "room")),
    "EPPT [mm], start 20 mm off": ("photometric_tracking", "sigma 20 mm", ("carpet", "rocks")),
}


@pytest.fixture(scope="module")
def cells():
    """Return the lines of the run's table in ideal light at base speed."""
    with (DOCS / "results" / "paper" / "tables.csv").open() as file:
        lines = [one for one in csv.DictReader(file) if one["cutoff_hz"] == "inf"]
    keys = "method", "variant", "scene", "width"
    return {tuple(one[k] for k in keys): one for one in lines if float(one["speed"]) == 1}


@pytest.mark.parametrize("head", SERIES)
def test_the_page_has_the_best_scores_of_the_run(cells, head):
    """Promise: every line of ours, with its best score in bold and the share of failed paths."""
    method, variant, scenes = SERIES[head]
    page = (DOCS / "methods.md").read_text()
    for scene in scenes:
        found = [cells[method, variant, scene, width] for width in WIDTHS]
        texts = [f"{float(one['median']):.2f}" for one in found]
        least = min(texts, key=float)
        texts = [f"**{text}**" if text == least else text for text in texts]
        if method == "photometric_tracking":
            shares = [round(100 * float(one["failure_share"])) for one in found]
            texts = [f"{t} ({n} %)" if n else t for t, n in zip(texts, shares, strict=True)]
        start = f"| {head} | {scene} |" if scene == scenes[0] else f"| | {scene} |"
        assert f"{start} {' | '.join(texts)} |\n" in page
