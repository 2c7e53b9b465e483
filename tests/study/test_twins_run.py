"""docs/our_networks.md and our_networks_flow.md have the scores of the stored runs."""

import re
import runpy
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tasks.row import read_rows
from tasks.study.claims.judge import judge_all
from tasks.study.claims.training import TRAINING_CLAIMS
from tasks.study.claims.verdict import Status
from tasks.study.results.asked import Condition, Series
from tasks.study.results.run_files import scores_of_run
from tasks.study.results.scores import Scores
from tasks.study.results.words import cutoff_label

DOCS = Path(__file__).parents[2] / "docs"
PAGES = [DOCS / "our_networks.md", DOCS / "our_networks_flow.md"]
RUNS = {
    "twins_2": [
        Series("video", method, "psnr_db")
        for method in (
            *("our_reconstruction_all_light", "our_reconstruction_ideal_light"),
            "high_pass_filter",
        )
    ],
    "flow_twins_2": [
        Series("dense_flow", method, "rnepe_px")
        for method in ("our_flow_all_light", "our_flow_ideal_light")
    ],
}
TRAININGS = {  # with seeds 0, 1 and 2
    "twins_2": ("twins", "twins_1", "twins_2"),
    "flow_twins_2": ("flow_twins", "flow_twins_1", "flow_twins_2"),
}
WIDTHS = 240, 640, 1280


@cache
def text() -> str:
    return "\n".join(page.read_text() for page in PAGES)


@cache
def scores_of(run: str) -> Scores:
    return Scores(read_rows(DOCS / "results" / run / "rows.parquet"))


@pytest.mark.parametrize("run", RUNS)
def test_the_page_has_the_medians_of_the_run(run: str) -> None:
    """Promise: every line of the table at base speed."""
    page, scores, series = text(), scores_of(run), RUNS[run]
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


@pytest.mark.parametrize(("run", "claim"), [("twins_2", 0), ("flow_twins_2", 1)])
def test_the_page_has_the_numbers_of_claim_23(run: str, claim: int) -> None:
    """Promise: what `eres claims` prints about the run."""
    verdict = judge_all(scores_of(run), {}, TRAINING_CLAIMS[claim : claim + 1])[0]
    page = " ".join(text().split())
    assert " ".join(verdict.ours.split()) in page


@pytest.mark.parametrize(("run", "sign"), [("twins_2", 1), ("flow_twins_2", -1)])
def test_the_page_has_what_training_at_night_brings_with_each_seed(run: str, sign: int) -> None:
    """Promise: the difference of the twins' medians, with seeds 0, 1 and 2."""
    page, seeds = text(), list(map(scores_of, TRAININGS[run]))
    all_light, ideal_light, *_ = RUNS[run]

    def gain(scores: Scores, where: Condition) -> float:
        medians = (scores.cell(one, where).median for one in (all_light, ideal_light))
        return sign * float(np.subtract(*medians))

    for scene in seeds[1].scenes(all_light):
        for hz in seeds[1].cutoffs_hz(all_light):
            where = [Condition(scene, width, hz, 1.0) for width in WIDTHS]
            cells = [" / ".join(f"{gain(one, at):+.2f}" for one in seeds) for at in where]
            line = f"| {scene} | {cutoff_label(hz)} | {' | '.join(cells)} |\n"
            assert line.replace("-", "−") in page


@pytest.mark.parametrize("run", RUNS)
def test_the_page_has_our_networks_next_to_the_paper_s(
    run: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Promise: what benchmarks/beside_paper.py prints about the run."""
    script = DOCS.parent / "benchmarks" / "beside_paper.py"
    monkeypatch.setattr(sys, "argv", [str(script), str(DOCS / "results" / run)])
    runpy.run_path(str(script), run_name="__main__")
    assert capsys.readouterr().out in text()


def test_the_page_has_the_verdict_on_all_seeds_together() -> None:
    """Promise: undecided, with the leads at night and what training at night brings."""
    page = " ".join(text().split())
    folders = (DOCS / "results" / run for run in TRAININGS["twins_2"])
    (scores,) = scores_of_run(*folders)["two_pole"]
    (verdict,) = judge_all(scores, {}, TRAINING_CLAIMS[:1])
    assert verdict.status is Status.UNDECIDED
    for scene in verdict.ours.splitlines():
        (lead, *_), gains = (
            re.findall(rf"{words} ([+−].*?\]) dB", scene)
            for words in ("lead of 1280 px", "over the twin")
        )
        at_night, at_100_hz, _ = gains
        assert lead in page
        assert at_100_hz in page
        if scene.startswith("carpet"):
            assert at_night in page
