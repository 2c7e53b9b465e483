"""Claims 1 and 2, and the section on scaling, follow the statistics alone."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from drawn import section
from made_scaling import EDGES_US, made, peak
from study_rows import paper_rows
from tasks.errors import ResultError
from tasks.study.claims.judge import judge_all
from tasks.study.claims.verdict import Status, Verdict
from tasks.study.report.finished_run import FinishedRun
from tasks.study.report.sections.scaling import interval_plot
from tasks.study.results.paper import WIDTHS
from tasks.study.results.scaling import Scaling, Slopes, read_scaling
from tasks.study.results.scores import Scores
from tasks.study.run.highlights import measure_scaling, scaling_files


def verdicts(scaling: Scaling | None, **kwargs) -> tuple[Verdict, Verdict]:
    found = {scaling.scene: scaling} if scaling else {}
    first, second, *_ = judge_all(paper_rows(scenes=("carpet",), **kwargs), found)
    return first, second


def test_what_the_paper_says_holds() -> None:
    """Rates that grow faster than the pixels, a falling |L_t| and falling modes: both hold."""
    one, two = verdicts(made())
    assert (one.number, one.status) == (1, Status.HOLDS)
    assert (two.number, two.status) == (2, Status.HOLDS)
    assert "γ = 0.90 [0.80, 1.00] everywhere, 1.30 [1.20, 1.40] at edges" in one.ours
    # Rates as width^3: 1 more than the pixels.
    assert "γ = 1.00 [1.00, 1.00; n 1]; |L_t|" in one.ours
    assert "128,000 → 240,000 → 346,000 → 640,000 → 1,280,000 events/s per pixel" in one.ours
    assert "night, speed 2: 4.5 → 2.8 → 1.8 → 1.1 → 0.45 ms" in two.ours


def test_a_pixel_rate_that_does_not_rise_fails_claim_1() -> None:
    """Rates that grow less than the pixel count, or a slope that falls: does not hold.

    A slope that may be flat is undecided.
    """
    one, _ = verdicts(made(), rate=lambda width, cutoff_hz: float(width) ** 1.9)
    assert one.status is Status.DOES_NOT_HOLD
    one, _ = verdicts(made(exponent=-0.2))
    assert one.status is Status.DOES_NOT_HOLD
    one, _ = verdicts(made(exponent=0.05))
    assert one.status is Status.UNDECIDED
    one, _ = verdicts(made(), rate=lambda width, cutoff_hz: 0.0)
    assert one.status is Status.NOT_MEASURED


@pytest.mark.parametrize(("cutoff", "speed"), [(math.inf, 1.0), (50.0, 2.0)])
def test_one_mode_that_rises_fails_claim_2(cutoff: float, speed: float) -> None:
    """In any measured light and at any measured speed."""
    scaling = made()
    rising = tuple(
        replace(one, counts=peak(8_000))
        if (one.width, one.cutoff_hz, one.speed) == (640, cutoff, speed)
        else one
        for one in scaling.intervals
    )
    _, two = verdicts(replace(scaling, intervals=rising))
    assert two.status is Status.DOES_NOT_HOLD
    assert two.ours.count("(not monotone)") == 1


def test_not_measured_is_never_holds() -> None:
    """No statistics, one speed, one light, or a width or its events missing: not measured."""
    assert [v.status for v in verdicts(None)] == [Status.NOT_MEASURED] * 2
    scaling = made()
    for kept in (
        [one for one in scaling.intervals if one.speed == 1.0],
        [one for one in scaling.intervals if math.isinf(one.cutoff_hz)],
        [one for one in scaling.intervals if (one.width, one.speed) != (346, 2.0)],
    ):
        assert verdicts(replace(scaling, intervals=tuple(kept)))[1].status is Status.NOT_MEASURED
    silent = replace(scaling.intervals[0], counts=(0,) * (len(EDGES_US) - 1))
    _, two = verdicts(replace(scaling, intervals=(silent, *scaling.intervals[1:])))
    assert two.status is Status.NOT_MEASURED
    assert "not measured at 128 px, ideal, speed 1" in two.ours


def write_made(folder: Path) -> None:
    slope = np.random.default_rng(0).normal(size=(64, 64))
    for name, data in scaling_files(made(), slope).items():
        (folder / name).write_bytes(data)


def test_numbers_survive_the_disk(tmp_path: Path) -> None:
    """The reader returns the written values, and names a damaged file."""
    write_made(tmp_path)
    assert read_scaling(tmp_path) == {"carpet": made()}
    assert read_scaling(tmp_path / "none") == {}
    (tmp_path / "carpet.json").write_text(json.dumps({"scene": "carpet"}))
    with pytest.raises(ResultError, match=r"carpet\.json: clip: missing"):
        read_scaling(tmp_path)


def test_statistics_of_another_study_are_left_out(tmp_path: Path) -> None:
    """Promise: a second study that was stopped in the folder of a finished one changes nothing."""
    write_made(tmp_path)
    stored = json.loads((tmp_path / "carpet.json").read_text())
    (tmp_path / "carpet.json").write_text(json.dumps({**stored, "job": "of another"}))
    assert read_scaling(tmp_path, ["own"]) == {}
    assert set(read_scaling(tmp_path, ["of another"])) == {"carpet"}


def section_of(folder: Path) -> str:
    """Return the section of a run on the carpet, with its numbers in `folder` / scaling."""
    run = FinishedRun(folder, [Scores(paper_rows(scenes=("carpet",)))], {}, {})
    return section("scaling.html", run=run)


def test_the_section_shows_each_scene_it_has(tmp_path: Path) -> None:
    """The picture, the law, and a histogram in the best light and at night at both speeds."""
    folder = tmp_path / "scaling"
    folder.mkdir()
    write_made(folder)
    for file in list(folder.iterdir()):  # another scene, of which there are no scores
        (folder / file.name.replace("carpet", "room")).write_bytes(
            file.read_bytes().replace(b"carpet", b"room")
        )
    page = section_of(tmp_path)
    slopes, intervals = map(json.loads, re.findall(r'json">(.*?)</script>', page))
    assert page.count("<img") == 1
    assert len(slopes["panels"]) == 1
    assert [panel["label"] for panel in intervals["panels"]] == ["(c) ideal", *["(c) night"] * 2]
    assert slopes["keys"][1]["name"] == "everywhere: γ = 0.90 [0.80, 1.00]"
    assert [key["name"] for key in intervals["keys"]] == [f"{width} px" for width in WIDTHS]
    (mode,) = intervals["panels"][0]["lines"][0]["points"]
    assert mode["lines"][:2] == ["128 px", "mode: 11 ms"]
    assert "room" not in page
    (folder / "carpet.png").unlink()
    assert section_of(tmp_path).count("<img") == 0  # pictures may be deleted


class Still:
    """Two equal frames."""

    t_s = np.array([0.0, 0.01])
    manifest = SimpleNamespace(scene="carpet", clip=0)

    def __len__(self) -> int:
        return len(self.t_s)

    def frame(self, index: int) -> np.ndarray:
        return np.random.default_rng(0).uniform(0.1, 1.0, (96, 96)).astype(np.float32)


def test_where_nothing_moves_there_is_no_law(tmp_path: Path) -> None:
    """Promise: a camera that stands still in the statistics' clip costs the run only its power law;
    the page says so, and claim 1 is not measured."""
    one, slope = measure_scaling(Still(), 1e-3, {})
    assert one.everywhere == one.edges == Slopes((0.0,) * len(one.sizes_px), None)
    still = replace(made(), everywhere=one.everywhere, edges=one.edges, sizes_px=one.sizes_px)
    (tmp_path / "scaling").mkdir()
    for name, content in scaling_files(still, slope).items():
        (tmp_path / "scaling" / name).write_bytes(content)
    assert read_scaling(tmp_path / "scaling") == {"carpet": still}
    assert "everywhere: 0, nothing moves" in section_of(tmp_path)
    assert verdicts(still)[0].status is Status.NOT_MEASURED


def test_sensors_with_other_cutoffs_in_the_same_light_share_a_plot() -> None:
    """Promise: a sensor whose profile gives it another cutoff has a line only where it has one."""
    one = made()
    widest = max(interval.width for interval in one.intervals)
    mixed = [
        replace(i, cutoff_hz=i.cutoff_hz * (10 if i.width == widest else 1)) for i in one.intervals
    ]
    shown = interval_plot(replace(one, intervals=tuple(mixed)))
    drawn = [sum(bool(line.points) for line in panel.lines) for panel in shown.panels]
    assert drawn == [5, 4, 4]  # in ideal light no cutoff is another


def test_sensors_have_their_names_in_the_plot() -> None:
    """Promise: keys and marks have the name of a camera, and the width of one without; two of one
    width have a curve each."""
    of_small = [one for one in made().intervals if one.width == 128]
    cameras = [replace(one, sensor=name) for name in ("small", "other") for one in of_small]
    plain = [one for one in made().intervals if one.width > 128]
    shown = interval_plot(replace(made(), intervals=(*cameras, *plain)))
    names = ["other", "small", *(f"{width} px" for width in WIDTHS[1:])]
    assert [key.name for key in shown.keys] == names
    points = [point for panel in shown.panels for line in panel.lines for point in line.points]
    assert {point.lines[0] for point in points} == {*names}


def test_no_events_have_a_plot_without_peaks() -> None:
    """Promise: with a contrast threshold that nothing exceeds, the report is still written."""
    silent = [replace(one, counts=(0,) * len(one.counts)) for one in made().intervals]
    shown = interval_plot(replace(made(), intervals=tuple(silent)))
    assert len(shown.panels) == 3
    assert not any(line.points for panel in shown.panels for line in panel.lines)
