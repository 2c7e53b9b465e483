"""Pages have the scores of stored runs: docs/methods.md those of the preset `paper`,
docs/contrast_threshold.md those of its own study."""

import csv
from pathlib import Path

import pytest

from tasks.study.results.words import rate_label

DOCS = Path(__file__).parents[2] / "docs"
WIDTHS = ("128", "240", "346", "640", "1280")
SERIES = {
    "EPF, RNEPE [px]": ("photometric_flow", "", ("carpet", "rocks", "room")),
    "CM, RNEPE [px]": ("contrast_maximization", "", ("carpet", "rocks", "room")),
    "EPPT [mm], start 20 mm off": ("photometric_tracking", "sigma 20 mm", ("carpet", "rocks")),
}


def lines_of(run):
    with (DOCS / "results" / run / "tables.csv").open() as file:
        return [*csv.DictReader(file)]


@pytest.fixture(scope="module")
def cells():
    """Return the lines of the run's table in ideal light at base speed."""
    keys = "method", "variant", "scene", "width"
    lines = [one for one in lines_of("paper") if one["cutoff_hz"] == "inf"]
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


@pytest.mark.parametrize("method", ["event_integration", "photometric_flow"])
def test_the_page_has_the_scores_at_each_contrast_threshold(method):
    """Promise: every line of both tables, with the best of each column in bold."""
    page = (DOCS / "contrast_threshold.md").read_text()
    keys = "scene", "contrast_threshold", "cutoff_hz", "width"
    found = {tuple(o[k] for k in keys): o for o in lines_of("threshold") if o["method"] == method}
    columns = [(scene, C) for scene in ("carpet", "room") for C in ("0.1", "0.2", "0.4")]
    best = max if method == "event_integration" else min
    for name, cutoff_hz in (("ideal", "inf"), ("day", "200.0"), ("night", "50.0")):
        for width in WIDTHS:
            texts = []
            for column in columns:
                medians = {w: float(found[*column, cutoff_hz, w]["median"]) for w in WIDTHS}
                text = f"{medians[width]:.2f}"
                if medians[width] == best(medians.values()):
                    text = f"**{text}**"
                one = found[*column, cutoff_hz, width]
                more = rate_label(1e6 * float(one["event_rate_mev_s"]))
                if method == "photometric_flow":
                    more = f"{round(100 * float(one['failure_share']))} %"
                texts.append(f"{text} ({more})")
            assert f"| {name}, {width} px | {' | '.join(texts)} |\n" in page
