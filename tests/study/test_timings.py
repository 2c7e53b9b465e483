"""The costs of a run: stored for each job, reported as rates and times of an estimate."""

import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from types import SimpleNamespace

import pytest

from drawn import section
from finished_runs import FLOW, JOB
from tasks.errors import ResultError
from tasks.evaluation.timings import (
    JobTimings,
    read_timings,
    split_shared_time,
    timings_file,
)


def test_costs_are_read_as_they_were_written(tmp_path: Path) -> None:
    """Promise: one file for each job, in order of scene and sample; without a folder, no costs."""
    assert read_timings(tmp_path / "costs") == []
    jobs = [JOB, replace(JOB, sample=3), replace(JOB, scene="rocks", methods=())]
    for job, name in zip(jobs, "cab", strict=True):
        (tmp_path / f"{name}.json").write_bytes(timings_file(job))
    assert read_timings(tmp_path) == jobs


def test_costs_of_earlier_studies_are_left_out(tmp_path: Path) -> None:
    """Promise: a folder that a run shares with an earlier study has the times of this one."""
    for name, sample in (("mine", 1), ("earlier", 2)):
        (tmp_path / f"{name}.json").write_bytes(timings_file(replace(JOB, sample=sample)))
    assert [one.sample for one in read_timings(tmp_path, ["mine", "not finished"])] == [1]


def test_samples_are_those_of_the_frames_shape() -> None:
    """Analytic case: 50 frames of 1280 x 640 px with 4 samples are 164 M samples."""
    assert "164 M samples" in costs_html([replace(JOB, height=640)])
    assert "328 M samples" in costs_html([JOB])


def test_damaged_costs_are_named(tmp_path: Path) -> None:
    """Promise: the error for invalid JSON or other fields names the file."""
    file = tmp_path / "job.json"
    file.write_text("{")
    with pytest.raises(ResultError, match=r"job\.json: could not be read as JSON"):
        read_timings(tmp_path)
    file.write_bytes(timings_file(JOB).replace(b'"estimates"', b'"fits"'))
    with pytest.raises(ResultError, match=r"job\.json: methods\[0\]\.fits: unknown"):
        read_timings(tmp_path)


def test_times_of_stages_that_share_the_cores_add_up() -> None:
    """Promise: half of the shared time counts for each side, and no time is lost or counted twice:
    frames that come from the cache, render all of the time, or render between other work."""
    for rendering_s, waiting_s, expected in (
        (0.0, 2.0, (0.0, 2.0, 6.0, 3.0)),
        (1.5, 2.0, (1.5, 0.5, 6.0, 3.0)),
        (5.0, 2.0, (3.5, 0.0, 5.0, 2.5)),
        (11.0, 2.0, (6.5, 0.0, 3.0, 1.5)),
    ):
        found = split_shared_time(rendering_s, waiting_s, simulating_s=6.0, collecting_s=3.0)
        names = ("rendering_s", "reading_s", "simulating_s", "collecting_s")
        assert tuple(found[name] for name in names) == pytest.approx(expected)
        assert sum(found.values()) == pytest.approx(waiting_s + 9.0)


def costs_html(parts: list[JobTimings]) -> str:
    return section("timings.html", run=SimpleNamespace(timings=parts))


def cells(page: str) -> dict[str, list[str]]:
    """Return the texts of the cells of each line of the tables, by the line's head."""
    lines = re.findall(r'<tr><th scope="row">(.*?)</th>(.*?)</tr>', page, re.DOTALL)
    return {
        head: [
            unescape(re.sub("<[^>]*>", "", cell.replace(" <small>", "; "))).replace("\n", "; ")
            for cell in re.findall(r"<td.*?</td>", line, re.DOTALL)
        ]
        for head, line in lines
    }


def test_rates_and_times_are_those_of_the_jobs() -> None:
    """Promise: amounts over times by hand; the job that compiled first changes no median, and
    frames from the cache do not count as rendered."""
    compiling = replace(JOB, simulating_s=30.0, methods=(replace(FLOW, cpu_s=22.0),))
    cached = replace(JOB, rendered_frames=0, rendering_s=0.0)
    table = cells(costs_html([compiling, JOB, cached]))
    assert table["rendering"] == [
        *("24 s", "32\u202f%"),  # of 24 + 6 + 36 + 1.5 + 7.5 s
        "100 frames; 655 M samples",
        "4.17 frames/s; 27.3 M samples/s",
    ]
    assert table["simulating sensors"][0] == "36 s"
    assert table["simulating sensors"][3] == "100 M pixel-frames/s; 20 Mev/s"
    assert cells(costs_html([cached]))["rendering"] == [
        "–",
        "0\u202f%",
        "0 frames; 0 M samples",
        "–; –",
    ]
    assert table["reading frames"][3] == "50 frames/s"
    # 50 ms an estimate; 20 of them had 0.4 million events.
    assert table["optical flow by photometric flow"] == ["50 ms; 2.5 s / Mev", "60", "26 s"]
    assert "initial flow" not in "".join(table)


def test_methods_have_a_column_for_each_camera_by_its_name() -> None:
    """Promise: as in the rest of the page; a sensor without a name has its width."""
    assert ">640 px<" in costs_html([JOB])
    flow = [replace(FLOW, sensor=name) for name in ("my camera", "theirs")]
    named = costs_html([replace(JOB, methods=tuple(flow))])
    assert ">my camera<" in named
    assert ">theirs<" in named
    assert ">640 px<" not in named
