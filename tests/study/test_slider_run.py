"""docs/virtual_slider.md has the scores of the stored run on the virtual slider."""

from pathlib import Path

import pytest

from tasks.row import read_rows
from tasks.study.claims.judge import judge_all
from tasks.study.claims.slider import ON_THE_SLIDER
from tasks.study.results.asked import Condition, Series
from tasks.study.results.scores import Scores
from tasks.study.results.slider import FIELD_PX, PRINTS, light_label

DOCS = Path(__file__).parents[2] / "docs"
FAST = 3.0  # 0.6 m/s
COLUMNS = (
    ("flow", "photometric_flow", ""),
    ("flow", "photometric_flow_with_delay", ""),
    ("flow", "contrast_maximization", ""),
    ("flow", "contrast_maximization", "61 px patch"),
    ("tracking", "photometric_tracking", "sigma 2.5 mm"),
    ("tracking", "photometric_tracking_with_delay", "sigma 2.5 mm"),
)


@pytest.fixture(scope="module")
def scores() -> Scores:
    return Scores(read_rows(DOCS / "results" / "slider" / "rows.parquet"))


def medians(scores: Scores, series: Series, scene: str, hz: float) -> str:
    """Return the medians of the three widths, the least in bold."""
    found = [scores.cell(series, Condition(scene, w, hz, FAST)).median for w, _ in FIELD_PX]
    texts = [f"{value:.2f}" for value in found]
    least = min(texts, key=float)
    return ", ".join(f"**{text}**" if text == least else text for text in texts)


def test_the_page_has_the_medians_of_the_run(scores: Scores) -> None:
    """Promise: every line of the table at 0.6 m/s."""
    page = (DOCS / "virtual_slider.md").read_text()
    of = {(one.task, one.method, one.variant): one for one in scores.series()}
    for scene in PRINTS:
        for hz in scores.cutoffs_hz(of[COLUMNS[0]]):
            cells = [medians(scores, of[column], scene, hz) for column in COLUMNS]
            assert f"| {scene} | {light_label(hz)} | {' | '.join(cells)} |\n" in page


def test_the_page_has_the_numbers_of_claim_22(scores: Scores) -> None:
    """Promise: what `eres claims` prints about the run."""
    (verdict,) = judge_all(scores, {}, [ON_THE_SLIDER])
    page = " ".join((DOCS / "virtual_slider.md").read_text().split())
    assert " ".join(verdict.ours.split()) in page
