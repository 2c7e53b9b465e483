"""docs/learned.md has the scores of the stored run of our networks on scenes."""

from pathlib import Path

import pytest

from tasks.row import read_rows
from tasks.study.claims.judge import judge_all
from tasks.study.claims.training import TRAINING_CLAIMS
from tasks.study.results.metrics import Series
from tasks.study.results.scores import Condition, Scores
from tasks.study.results.words import cutoff_label

DOCS = Path(__file__).parents[2] / "docs"
METHODS = "our_reconstruction_all_light", "our_reconstruction_ideal_light", "high_pass_filter"
WIDTHS = 240, 640, 1280


@pytest.fixture(scope="module")
def scores() -> Scores:
    return Scores(read_rows(DOCS / "results" / "twins" / "rows.parquet"))


def test_the_page_has_the_medians_of_the_run(scores: Scores) -> None:
    """Promise: every line of the table at base speed."""
    page = (DOCS / "learned.md").read_text()
    series = [Series("video", method, "psnr_db") for method in METHODS]
    for scene in scores.scenes(series[0]):
        for hz in scores.cutoffs_hz(series[0]):
            cells = [
                " / ".join(
                    f"{scores.cell(one, Condition(scene, width, hz, 1.0)).median:.2f}"
                    for one in series
                )
                for width in WIDTHS
            ]
            assert f"| {scene} | {cutoff_label(hz)} | {' | '.join(cells)} |\n" in page


def test_the_page_has_the_numbers_of_claim_23(scores: Scores) -> None:
    """Promise: what `eres claims` prints about the run."""
    verdict = judge_all(scores, {}, TRAINING_CLAIMS[:1])[0]
    assert verdict.ours in (DOCS / "learned.md").read_text()
