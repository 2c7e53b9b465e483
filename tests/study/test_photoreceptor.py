"""Several photoreceptors in one study: the same frames, a page for one, a section for the rest."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import pytest

from eres_render import load_scene
from finished_runs import make_run, page_of
from made_scaling import made
from study_rows import EI, nothing_rows, paper_rows
from tasks.errors import ResultError
from tasks.row import Row
from tasks.study.claims.judge import changed_verdicts, judge_all, judge_readings
from tasks.study.claims.verdict import Status
from tasks.study.config import Simulate, Study
from tasks.study.report.sections.photoreceptor import leads
from tasks.study.results.paper import CUTOFFS_HZ, WIDTHS
from tasks.study.results.scores import Scores, by_photoreceptor
from tasks.study.run.jobs import Job, jobs_of

GAIN_DB = 2.0
"""Gain of v2e at 1280 px in all light but the ideal."""


def of_v2e(rows: list[Row]) -> list[Row]:
    def gains(row: Row) -> bool:
        return row.width == 1280 and row.method == EI.method and row.cutoff_hz < math.inf

    return [
        replace(row, photoreceptor="v2e", value=row.value + GAIN_DB * gains(row)) for row in rows
    ]


def both_rows(samples: int = 7) -> list[Row]:
    rows = paper_rows(EI, samples=samples, scenes=["carpet"])
    rows += nothing_rows(rows, 12.0)
    return of_v2e(rows) + rows


@pytest.fixture(scope="module")
def job() -> Job:
    sensors = Simulate(widths=(64, 128), photoreceptors=("two_pole", "v2e"), speeds=(1.0,))
    study = Study(name="both", scenes=("carpet",), simulate=sensors)
    return jobs_of(study, load_scene("carpet"))[0]


def test_one_job_has_every_reading_and_ideal_pixels_once(job) -> None:
    """Promise: both readings see the same frames; an ideal pixel, the same in both, is simulated
    once: 2 widths x (1 ideal + 2 cutoffs x 2 readings)."""
    models = [setting.model for setting in job.settings(2.0)]
    assert len(models) == 2 * (1 + 2 * 2)
    assert {(m.cutoff_hz, m.photoreceptor) for m in models} == {
        (math.inf, "two_pole"),
        *((hz, kind) for hz in (200.0, 50.0) for kind in ("two_pole", "v2e")),
    }
    assert {m.cutoff_reference for m in models if m.photoreceptor == "v2e"} == {2.0}
    assert {m.cutoff_reference for m in models if m.photoreceptor == "two_pole"} == {None}


def test_rows_of_ideal_pixels_are_those_of_every_reading(job) -> None:
    ideal, day = paper_rows(EI, samples=1)[0], paper_rows(EI, samples=1)[3]
    assert (ideal.cutoff_hz, day.cutoff_hz) == (math.inf, 200.0)
    found = job.with_every_reading([ideal, day])
    assert found == [ideal, day, replace(ideal, photoreceptor="v2e")]


def test_readings_are_apart_and_two_poles_come_first() -> None:
    """Promise: whatever the order of the rows; no score mixes readings."""
    found = by_photoreceptor(both_rows())
    assert list(found) == ["two_pole", "v2e"]
    for name, (scores,) in found.items():
        assert scores.photoreceptor == name
        assert [one.width for one in scores.sensors(EI)] == list(WIDTHS)
    with pytest.raises(ResultError, match="two rows of sample 0, item 0"):
        Scores(both_rows())


def test_a_camera_with_its_own_pixels_is_among_all_readings_and_thresholds() -> None:
    """Promise: it is compared with the sensors of each photoreceptor and threshold."""
    plain = paper_rows(EI, samples=1, scenes=["carpet"])
    own = [
        replace(r, width=304, sensor="atis", photoreceptor="v2e", contrast_threshold=0.13)
        for r in plain
        if r.width == 346
    ]
    squares = plain + [replace(r, contrast_threshold=0.4) for r in plain]
    rows = squares + [replace(r, photoreceptor="one_pole") for r in squares] + own
    found = by_photoreceptor(rows)
    assert list(found) == ["two_pole", "one_pole"]
    for thresholds in found.values():
        assert [one.contrast_threshold for one in thresholds] == [0.2, 0.4]
        assert all((304, "atis") in one.sensors(EI) for one in thresholds)
    (alone,) = by_photoreceptor(own)["v2e"]
    assert (alone.contrast_threshold, alone.photoreceptor) == (0.13, "v2e")


def test_a_camera_with_its_own_photoreceptor_names_no_reading() -> None:
    """Promise: where all sensors have names, readings have the photoreceptors of the study, also if
    the first camera has its own."""
    rows = [replace(row, sensor=f"cam {row.width}") for row in both_rows()]
    own = [row for row in rows if row.width == 128 and row.photoreceptor == "v2e"]
    found = by_photoreceptor(own + [row for row in rows if row.width != 128])
    assert {name: scores.photoreceptor for name, (scores,) in found.items()} == {
        "two_pole": "two_pole",
        "v2e": "v2e",
    }
    assert all(
        [one.width for one in scores.sensors(EI)] == [*WIDTHS] for (scores,) in found.values()
    )


def test_leads_by_reading_are_beside_the_papers() -> None:
    """Analytic case: 1280 px has 2 dB more with v2e; the paper's lead by day is 1.25 dB."""
    readings = {name: found[0] for name, found in by_photoreceptor(both_rows()).items()}
    found = leads(readings, EI)
    assert {one.cutoff_hz for one in found} == {*CUTOFFS_HZ} - {math.inf}
    day = next(one for one in found if (one.cutoff_hz, one.speed) == (200.0, 1.0))
    assert day.paper == pytest.approx(1.25, abs=0.01)
    two, v2e = day.intervals["two_pole"], day.intervals["v2e"]
    assert two is not None
    assert v2e is not None
    assert two.value == pytest.approx(day.paper)
    assert v2e.value - two.value == pytest.approx(GAIN_DB)


def test_the_page_is_about_two_poles_and_shows_the_other_reading(tmp_path, eres) -> None:
    """Promise: the section and a table of its own have v2e; the rest is that of two poles."""
    run, alone = tmp_path / "both", tmp_path / "alone"
    for folder, rows in ((run, both_rows()), (alone, both_rows()[len(both_rows()) // 2 :])):
        folder.mkdir()
        make_run(folder, rows)
        (folder / "study.json").write_text(json.dumps({"base_m_per_s": {"carpet": 3.0}}))
    (alone / "tables_v2e.csv").write_text("of an earlier study in this folder")
    page, lone = page_of(run), page_of(alone)
    assert (run / "tables.csv").read_text() == (alone / "tables.csv").read_text()
    assert (run / "tables_v2e.csv").read_text() != (run / "tables.csv").read_text()
    assert not (alone / "tables_v2e.csv").exists()
    assert 'id="photoreceptor"' in page
    assert 'id="photoreceptor"' not in lone
    assert "v2e&#39;s limit for small steps" in page or "v2e's limit for small steps" in page
    assert "lead of 1280 px over 640 px" in page
    (section,) = re.findall(r'<section id="photoreceptor".*?</section>', page, re.DOTALL)
    assert "day, 3 m/s" in section
    code, out, _ = eres("claims", run)
    assert code == 0
    assert "With v2e's limit for small steps: " in out


def test_sensors_have_their_names_in_the_section(tmp_path) -> None:
    """Promise: leads and what is enough have the names of cameras, as the rest of the page."""
    rows = [replace(row, sensor=f"cam {row.width}") for row in both_rows()]
    page = page_of(make_run(tmp_path, rows))
    (section,) = re.findall(r'<section id="photoreceptor".*?</section>', page, re.DOTALL)
    assert "lead of cam 1280 over cam 640" in section
    assert re.search(r"enough: cam \d+", section)
    assert not re.search(r"\d px", section)


def test_speeds_that_print_alike_have_a_row_each(tmp_path) -> None:
    """Promise: no lead is lost where two digits do not tell speeds apart."""
    rows = [row for row in both_rows() if row.speed == 1.0]
    near = [replace(row, speed=1.001) for row in rows]
    page = page_of(make_run(tmp_path, rows + near))
    (section,) = re.findall(r'<section id="photoreceptor".*?</section>', page, re.DOTALL)
    heads = re.findall(r'<th scope="row">(\w+), 0\.9 m/s\s*(<small>1\.001 times)?', section)
    assert heads == [
        (light, words) for words in ("", "<small>1.001 times") for light in ("day", "night")
    ]


def test_a_width_that_is_no_better_than_nothing_is_not_enough(tmp_path) -> None:
    """Promise: the section says of a condition what the matrix above says."""
    rows = paper_rows(EI, samples=7, scenes=["carpet"])
    rows += nothing_rows(rows, 15.0)  # better than any width at night and twice the speed
    make_run(tmp_path, of_v2e(rows) + rows)
    page = page_of(tmp_path)
    section = page.partition('<section id="photoreceptor"')[2].partition("</section>")[0]
    text = re.sub(r"<[^>]*>|\s+", " ", section)
    assert re.search(r"day, 0.9 m/s .{0,40}enough: 1280 px", text)
    assert re.search(r"night, 1.8 m/s .{0,40}doing nothing is as good .{0,40}enough: 1280 px", text)


def test_claims_are_judged_on_the_rows_of_a_run() -> None:
    """Promise: `judge_all` takes what `read_rows` returns, and judges the first reading."""
    verdicts = judge_all(both_rows(), {})
    of_two_poles = next(iter(by_photoreceptor(both_rows()).values()))[0]
    assert verdicts == judge_all(of_two_poles, {})


def test_the_order_of_readings_does_not_matter() -> None:
    """Promise: two poles come first, in the report and in the films; results are the same jobs."""
    one, other = (
        Study(name="both", scenes=("carpet",), simulate=Simulate(photoreceptors=kinds))
        for kinds in (("two_pole", "v2e"), ("v2e", "two_pole"))
    )
    keys = [[job.key for job in jobs_of(study, load_scene("carpet"))] for study in (one, other)]
    assert keys[0] == keys[1]
    assert other.simulate.photoreceptors == ("two_pole", "v2e")


def test_times_between_events_are_of_one_reading() -> None:
    """Promise: claim 2 is not judged with v2e on the histograms of two poles, and a claim that is
    not measured with one reading is not among those with another verdict."""
    readings = {name: found[0] for name, found in by_photoreceptor(both_rows()).items()}
    scaling = {"carpet": made()}
    found = judge_readings({}, readings, scaling)
    with_two, with_v2e = (
        next(one for one in verdicts if one.number == 2) for verdicts in found.values()
    )
    assert with_two.status is Status.HOLDS
    assert with_v2e.status is Status.NOT_MEASURED
    assert all(2 not in {one.number for one in of} for of in changed_verdicts(found))
