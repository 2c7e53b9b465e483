"""Promise: the estimate of a study follows the pace of the machine's latest jobs."""

from __future__ import annotations

import itertools
import shutil

import pytest

from tasks.evaluation.timings import JobTimings
from tasks.provenance import VARIANT
from tasks.study.run.estimate import JobEstimate, add_job, pace_of

HERE = {"processor": "fast", "cores": "2", VARIANT: "llvm_ad_mono"}
FRAMES = 50
ESTIMATE = JobEstimate(FRAMES, 1e6, frames_s=250.0, samples_s=350.0, render_s=120.0)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """The folder of an empty cache, which does not exist yet."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("ERES_CACHE", str(folder))
    return folder


def timings(core_s, rendered_frames=FRAMES):
    """The timings of a job of two cores, whose stages take different times."""
    shares = {"reading_s": 0.05, "simulating_s": 0.25, "collecting_s": 0.1, "scoring_s": 0.4}
    stages = {name: share * core_s / 2 for name, share in shares.items()}
    work = dict.fromkeys(("frames", "resolution", "spp", "sensors", "pixel_frames", "events"), 1)
    return JobTimings(
        *("rocks", 0, 2),
        **(work | stages),
        methods=(),
        rendered_frames=rendered_frames,
        rendering_s=0.2 * core_s / 2,
    )


def test_a_machine_without_jobs_has_no_pace():
    assert pace_of(HERE) is None
    assert pace_of({}) is None  # workers of a cluster come and go


@pytest.mark.parametrize("pace", [0.3, 1.0, 2.5, 40.0])
def test_the_pace_is_that_of_the_jobs(pace):
    """Promise: within a few percent of the ratio of their times, after two hours of jobs."""
    for _ in range(12):
        add_job(HERE, ESTIMATE, timings(600.0 * pace))
    assert pace_of(HERE) == pytest.approx(pace, rel=0.03)


def test_small_jobs_decide_little():
    """Promise: a job of seconds, in which files are read for the first time, is no measurement."""
    small = JobEstimate(FRAMES, 1e6, frames_s=1.0, samples_s=1.0, render_s=0.5)
    add_job(HERE, small, timings(20.0))
    assert 1.0 < pace_of(HERE) < 1.4


def test_machines_that_share_a_cache_have_their_own_pace():
    """Promise: another processor, number of cores or device is another machine."""
    names = {"processor": ("fast", "slow"), "cores": ("2", "16"), VARIANT: ("llvm", "cuda")}
    every = itertools.product(*names.values())
    machines = [dict(zip(names, values, strict=True)) for values in every]
    for pace, machine in enumerate(machines, 1):
        for _ in range(12):
            add_job(machine, ESTIMATE, timings(600.0 * pace))
    for pace, machine in enumerate(machines, 1):
        assert pace_of(machine) == pytest.approx(pace, rel=0.03)


@pytest.mark.parametrize("rendered", [0, FRAMES // 2, FRAMES, 2 * FRAMES])
def test_frames_of_the_cache_do_not_make_a_machine_fast(rendered):
    """Promise: the estimate leaves out what was not rendered."""
    expected_s = 600.0 - 120.0 * (1 - min(1, rendered / FRAMES))
    for _ in range(20):
        add_job(HERE, ESTIMATE, timings(2 * expected_s, rendered))
    assert pace_of(HERE) == pytest.approx(2.0, rel=0.02)


def test_older_jobs_are_forgotten():
    """Promise: when other work on the machine has ended, the pace follows in a night."""
    for pace in (5.0, 1.0):
        for _ in range(100):
            add_job(HERE, ESTIMATE, timings(600.0 * pace))
        assert pace_of(HERE) == pytest.approx(pace, rel=0.1)


@pytest.mark.parametrize("content", ["", "[1]", '{"fast, 2": 3}', '{"fast": [1, NaN]}', "\0"])
def test_a_damaged_file_is_replaced(cache, content):
    cache.mkdir()
    (cache / "pace.json").write_text(content)
    assert pace_of(HERE) is None
    add_job(HERE, ESTIMATE, timings(600.0))
    assert pace_of(HERE) == pytest.approx(1.0)


def test_a_cache_that_cannot_be_written_stops_no_study(cache):
    (cache / "pace.json" / "inner").mkdir(parents=True)
    add_job(HERE, ESTIMATE, timings(600.0))
    assert pace_of(HERE) is None
    shutil.rmtree(cache)
    cache.write_text("a file")
    add_job(HERE, ESTIMATE, timings(600.0))
    assert pace_of(HERE) is None
