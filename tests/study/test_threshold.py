"""A run with several contrast thresholds: the page shows the first, one section compares them."""

from __future__ import annotations

import csv
import html
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from drawn import comparison_html, section, without_space
from finished_runs import page_of
from study_rows import CM, EI, EPF, nothing_rows, paper_rows
from tasks.errors import ResultError
from tasks.row import Row, read_rows, write_rows
from tasks.study.report.finished_run import FinishedRun
from tasks.study.report.plot import Plot
from tasks.study.report.sections.tradeoff import compare_thresholds, tradeoff_plots
from tasks.study.results.asked import Series
from tasks.study.results.comparison import comparison_table, to_csv
from tasks.study.results.paper import CUTOFFS_HZ, WIDTHS
from tasks.study.results.run_files import scores_of_run
from tasks.study.results.scores import Scores, by_photoreceptor
from tasks.study.results.words import capitalized

GAIN_DB = {0.2: 0.0, 0.1: 1.0, 0.4: -3.0}
"""Gain of 1280 px at event integration, by threshold; no other score depends on it."""


def at(threshold: float, rows: list[Row]) -> list[Row]:
    """Return rows of another threshold; the event rate is proportional to 1 / C."""
    gains = {(EI.method, 1280): GAIN_DB[threshold]}
    return [
        replace(
            r,
            contrast_threshold=threshold,
            value=r.value + gains.get((r.method, r.width), 0.0),
            event_rate_hz=r.event_rate_hz * 0.2 / threshold,
        )
        for r in rows
    ]


def usual_rows(series: Series = EI, nothing: float = 12.0, samples: int = 7) -> list[Row]:
    """The paper's medians on carpet, 100 events per second and pixel, and doing nothing."""
    rows = paper_rows(series, samples=samples, scenes=["carpet"], rate=lambda w, _: 100.0 * w**2)
    return rows + nothing_rows(rows, nothing)


def several(rows: list[Row], thresholds: tuple[float, ...] = (0.2, 0.1, 0.4)) -> list[Row]:
    return [row for threshold in thresholds for row in at(threshold, rows)]


def run_of(folder: Path, rows: list[Row]) -> Path:
    write_rows(folder / "rows.parquet", rows)
    for name in ("environment.json", "study.json"):
        (folder / name).write_text(json.dumps({}))
    return folder


def by_threshold(rows: list[Row]) -> list[Scores]:
    return by_photoreceptor(rows)["two_pole"]


def text_of(page: str) -> str:
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", page)).split())


def section_of(page: str) -> str:
    found = re.search(r'<section id="threshold".*?</section>', page, re.DOTALL)
    assert found
    return found[0]


def run_with(found: list[Scores]) -> FinishedRun:
    return FinishedRun(Path(), found, {}, {})


def threshold_html(found: list[Scores], series: Series) -> str:
    """Return the section, starting at the part on one series."""
    page = section("threshold.html", run=run_with(found))
    return page.partition(f"<summary>{capitalized(series.title)}</summary>")[2]


def points_of(plot: Plot) -> list[int]:
    """Return the number of points of each panel."""
    return [sum(len(line.points) for line in panel.lines) for panel in plot.panels]


def choices_of(content: str) -> dict[str, list[str]]:
    """Return recommended widths by cutoff, thresholds ascending, of a section on one scene."""
    found = re.search(r'aria-label="Choice .*?</table>', content, re.DOTALL)
    assert found
    return {
        line[1]: re.findall(r"<td[^>]*>(?:<s>)?(\d+) px", line[0])
        for line in re.finditer(r'<tr><th scope="row">(\w+) .*?</tr>', found[0], re.DOTALL)
    }


def test_the_first_threshold_of_the_rows_comes_first() -> None:
    """The first threshold of the study, not the smallest, determines its report."""
    found = by_threshold(several(usual_rows()))
    assert [scores.contrast_threshold for scores in found] == [0.2, 0.1, 0.4]
    for scores in found:
        assert [one.width for one in scores.sensors(EI)] == list(WIDTHS)
    with pytest.raises(ResultError, match="no rows"):
        by_threshold([])


def test_a_width_that_is_struck_out_names_no_tie() -> None:
    """Promise: the section shows the choices as the top of the page does. The lead of 1280 px
    changes sign from sample to sample, so 640 px is tied, unless doing nothing is as good."""
    lead = (-0.6, 0.7, -0.5, 0.6, 0.5, 0.7, -0.4, 0.5, 0.6)
    rows = [
        Row("carpet", *EI[:2], width, 50.0, 0.2, 1.0, i, "psnr_db", 20 + of_width * one, 1e6)
        for width, of_width in {640: 0.0, 1280: 1.0}.items()
        for i, one in enumerate(lead)
    ]
    for nothing, tied in ((19.9, "tied 640"), ({640: 19.9, 1280: 20.45}, "")):
        idle = [
            replace(
                row,
                method="no_events",
                value=nothing[row.width] if isinstance(nothing, dict) else nothing,
            )
            for row in rows
        ]
        found = by_threshold(several(rows + idle, (0.2,)))
        _, choices, _ = compare_thresholds(run_with(found), EI)["carpet"]
        ((cells,),) = (block.values() for block in choices.blocks.values())
        assert cells[0].text == "1280 px"
        assert (cells[0].small, cells[0].kind) == (tied, "" if tied else "struck")


def test_the_recommended_resolution_is_answered_for_each_threshold() -> None:
    """By day 1280 px leads 640 px by 1.25 dB at 0.2; at 0.4 it has 3 dB less: 640 px is enough."""
    answers = choices_of(threshold_html(by_threshold(several(usual_rows())), EI))
    assert answers["ideal"] == ["1280", "1280", "1280"]
    assert answers["day"] == ["1280", "1280", "640"]


def test_the_section_has_every_score_and_event_rate() -> None:
    """1280 px ideal: 24.09 dB at 0.2, and 1 dB more for twice the events at 0.1."""
    content = threshold_html(by_threshold(several(usual_rows())), EI)
    for place in ("25.09 <small>328 Mev/s", "24.09 <small>164 Mev/s", "21.09 <small>81.9 Mev/s"):
        assert place in content
    curves, *_ = compare_thresholds(run_with(by_threshold(several(usual_rows()))), EI)["carpet"]
    assert points_of(curves) == [len(WIDTHS) * 3] * len(CUTOFFS_HZ)
    heads = re.findall(r">C = ([\d.]+)", content)
    assert heads == ["0.1", "0.2", "0.4"] * 2  # of choices and of numbers


def test_a_condition_with_lost_samples_has_no_answer() -> None:
    """A sample of 346 px at night is lost at 0.4: a gap there, answers at the other thresholds."""
    rows = several(usual_rows())
    lost = next(
        r
        for r in rows
        if (r.method, r.width, r.cutoff_hz, r.speed, r.contrast_threshold)
        == (EI.method, 346, 50.0, 1.0, 0.4)
    )
    rows.remove(lost)
    content = threshold_html(by_threshold(rows), EI)
    assert len(choices_of(content)["night"]) == 2
    assert "samples are missing" in content
    curves, *_ = compare_thresholds(run_with(by_threshold(rows)), EI)["carpet"]
    assert sum(points_of(curves)) == len(CUTOFFS_HZ) * len(WIDTHS) * 3 - 1


def test_a_threshold_that_was_not_scored_leaves_gaps() -> None:
    """Flow at the first threshold only: a column of gaps, not an error."""
    flow = usual_rows(EPF, 3.5)
    found = by_threshold(several(usual_rows()) + flow)
    content = threshold_html(found, EPF)
    assert [len(widths) for widths in choices_of(content).values()] == [1, 1, 1]


def test_what_does_not_beat_doing_nothing_is_struck_out() -> None:
    """1280 px at night has 12.70 dB at 0.4, doing nothing 14: struck out; 15.70 at 0.2 is not."""
    content = threshold_html(by_threshold(several(usual_rows(nothing=14.0))), EI)
    assert "<s>12.70</s>" in content
    assert re.search(r"<td[^>]*>15.70 <small>", content)


def test_failures_are_told_beside_the_scores() -> None:
    """One of seven samples failed at 1280 px in ideal light: 14 % there, nothing elsewhere."""
    rows = [
        replace(r, failure="no convergence" * (r.width == 1280 and r.sample == 0))
        for r in paper_rows(EPF, samples=7, scenes=["carpet"])
    ]
    ideal = [r for r in rows if r.cutoff_hz == float("inf")]
    content = threshold_html(by_threshold(several(ideal)), EPF)
    assert re.findall(r"Mev/s, (\d+)\u202f% fail", content) == ["14"] * 3


def test_errors_that_span_decades_get_a_logarithmic_axis() -> None:
    """Flow from 0.2 to 4 px: ticks at 0.5, 1 and 2 px."""
    run = run_with(by_threshold(several(usual_rows(EPF, 3.5))))
    curves, *_ = compare_thresholds(run, EPF)["carpet"]
    axis = curves.y
    assert axis.log
    assert {"0.5", "1", "2"} <= {label for _, label in axis.ticks_within(0.2, 4.0)}
    assert "less is better" in axis.label


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> tuple[Path, str]:
    """A run of two tasks at three thresholds."""
    rows = usual_rows() + usual_rows(EPF, 3.5, samples=1)
    rows += paper_rows(CM, samples=1, scenes=["carpet"])
    run = run_of(tmp_path_factory.mktemp("run"), several(rows))
    return run, without_space(page_of(run))


def test_the_page_is_about_the_first_threshold_and_says_so(page, tmp_path) -> None:
    """Answer, plots, tables and claims equal those of a run of 0.2 alone, except for its
    mention."""
    alone = run_of(
        tmp_path, [r for r in read_rows(page[0] / "rows.parquet") if r.contrast_threshold == 0.2]
    )
    lone = without_space(page_of(alone))
    said = "The whole page uses a contrast threshold of 0.2"
    assert said in page[1]
    assert "compares it with 0.1 and 0.4" in text_of(page[1])
    assert said not in lone
    for part in ("tradeoff", "tables"):
        pattern = rf'<section id="{part}".*?</section>'
        both = [re.search(pattern, p, re.DOTALL) for p in (page[1], lone)]
        assert both[0]
        assert both[1]
        assert both[0][0] == both[1][0]
    assert "threshold" not in re.findall(r'<section id="(\w+)"', lone)
    assert 'href="#threshold"' not in lone


def test_every_main_method_is_compared(page) -> None:
    """The section has a part for each task and method, the first one open, and a link to it."""
    section = section_of(page[1])
    titles = re.findall(r"<summary>([^<]* by [^<]*)</summary>", section)
    assert titles == [
        "Reconstruction by event integration",
        "Optical flow by photometric flow",
        "Optical flow by contrast maximization",
    ]
    assert section.count("<details open>") == 1
    assert '<a href="#threshold">Threshold</a>' in page[1]


def test_the_tables_hold_all_thresholds(page) -> None:
    """A column names the threshold; only rows of the paper's own, 0.2, are next to the paper's."""
    records = list(csv.DictReader((page[0] / "tables.csv").read_text().splitlines()))
    thresholds = [record["contrast_threshold"] for record in records]
    assert {name: thresholds.count(name) for name in thresholds} == {
        name: len(records) / 3 for name in ("0.2", "0.1", "0.4")
    }
    (fine,) = (
        record
        for record in records
        if (record["contrast_threshold"], record["width"], record["cutoff_hz"], record["speed"])
        == ("0.1", "1280", "inf", "1.0")
        and record["method"] == EI.method
    )
    assert float(fine["median"]) == pytest.approx(24.093 + 1)
    assert {r["paper"] != "" for r in records if r["contrast_threshold"] != "0.2"} == {False}
    assert any(r["paper"] for r in records if r["contrast_threshold"] == "0.2")


def test_a_camera_with_its_own_threshold_is_in_the_tables_once() -> None:
    """Its lines name it and its own threshold, however many thresholds the plain sensors have."""
    own = [
        replace(row, sensor="dvs", contrast_threshold=0.33)
        for row in usual_rows()
        if row.width == 346
    ]
    plain = several([row for row in usual_rows() if row.width != 346], (0.2, 0.1))
    tables = [comparison_table(scores, EI) for scores in by_threshold(plain + own)]
    records = list(csv.DictReader(to_csv(tables).splitlines()))
    found = [(r["sensor"], r["contrast_threshold"]) for r in records if r["width"] == "346"]
    assert found == [("dvs", "0.33")] * 9  # lights and speeds
    for threshold in ("0.2", "0.1"):
        lines = [r for r in records if r["contrast_threshold"] == threshold and r["width"]]
        assert {(r["width"], r["sensor"]) for r in lines} == {
            (str(width), "") for width in WIDTHS if width != 346
        }


def test_a_camera_with_its_own_threshold_names_none_of_the_run(tmp_path) -> None:
    """Promise: where all sensors have names, scores are named by the thresholds of the study, also
    if the first camera has its own."""
    named = [replace(row, sensor=f"cam {row.width}") for row in usual_rows()]
    own = [replace(row, contrast_threshold=0.3) for row in named if row.width == 128]
    others = several([row for row in named if row.width != 128], (0.1, 0.2))
    run = run_of(tmp_path, own + others)
    ((first, second),) = scores_of_run(run).values()
    assert (first.contrast_threshold, second.contrast_threshold) == (0.1, 0.2)
    found = {sensor.label: threshold for sensor, threshold in first.contrast_thresholds.items()}
    assert found == {f"cam {width}": 0.3 if width == 128 else 0.1 for width in WIDTHS}
    page = page_of(run)
    assert "The whole page uses a contrast threshold of 0.1" in page
    assert re.findall(r">C = ([\d.]+)", page) == ["0.1", "0.2"] * 2


def test_another_threshold_has_no_numbers_of_the_paper() -> None:
    """At 0.4 alone no comparison is possible: the page has no column of the paper, and says so."""
    (scores,) = by_threshold(several(usual_rows(), (0.4,)))
    table = comparison_table(scores, EI)
    assert "not in the paper at a contrast threshold of 0.4" in table.footnote(table.columns)
    entries = [e for block in table.blocks for line in block.lines for e in line.entries]
    assert all(entry.paper is None for entry in entries)
    assert "paper" not in repr(tradeoff_plots(run_with([scores]), EI))
    assert '<td class="paper">' not in comparison_html(table)


@pytest.mark.parametrize(
    ("thresholds", "said"),
    [
        ((0.2,), ""),
        ((0.2, 0.1), "Judged at a contrast threshold of 0.2, that of the paper's sensors."),
        ((0.4,), "Judged at a contrast threshold of 0.4; the paper's sensors have 0.2."),
        ((0.1, 0.2), "Judged at a contrast threshold of 0.1; the paper's sensors have 0.2."),
    ],
)
def test_claims_say_at_which_threshold_they_are_judged(eres, tmp_path, thresholds, said) -> None:
    """Terminal and report name the first threshold of the run, unless it alone is the paper's."""
    run = run_of(tmp_path, several(usual_rows(samples=1), thresholds))
    code, out, _ = eres("claims", run)
    assert code == 0
    page = page_of(run)
    if said:
        assert said in out
        assert said in html.unescape(page)
    else:
        assert "Judged at" not in out
        assert "Judged at" not in page


def test_a_report_of_several_thresholds_from_the_command_line(eres, tmp_path, monkeypatch) -> None:
    """`eres report` writes the file and prints its path."""
    monkeypatch.setattr("tasks.study.report.page.figure_files", lambda plots: {})
    run = run_of(tmp_path, several(usual_rows(samples=1)))
    code, out, _ = eres("report", run)
    assert code == 0
    assert "report.html" in out
    assert section_of((tmp_path / "report.html").read_text())


def test_the_terminal_prints_the_first_threshold(tmp_path, monkeypatch, eres) -> None:
    """`eres study` prints the first threshold's scores, and where the others are."""
    run = run_of(tmp_path, several(usual_rows(samples=1)))
    monkeypatch.setattr("tasks.study.run.run_study", lambda *given, **options: None)
    monkeypatch.setattr("tasks.study.report.page.figure_files", lambda plots: {})
    code, out, _ = eres("study", "--out", run)
    assert code == 0
    assert "24.09" in out
    assert "25.09" not in out
    assert "contrast threshold 0.2; the scores at 0.1 and 0.4" in out
    assert "other speeds are in the report" in out
    assert out.count("Reconstruction by event integration") == 1
