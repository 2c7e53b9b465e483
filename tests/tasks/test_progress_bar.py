"""Progress on the command line."""

import io
import time

import pytest
from rich.console import Console

from sensor import compiling
from tasks.cli import terminal
from tasks.cli.events import _without_compiling


@pytest.fixture
def lines(monkeypatch):
    """Return a function that reports progress to a log: (second, stage, done, total) each."""

    def written(*reports):
        file = io.StringIO()
        now_s = [0.0]
        monkeypatch.setattr(time, "monotonic", lambda: now_s[0])
        monkeypatch.setattr(terminal, "err", Console(file=file, width=20))
        with terminal.progress() as on_progress:
            for now_s[0], stage, done, total in reports:
                on_progress(stage, done, total)
        return file.getvalue().splitlines()

    return written


def test_a_log_has_a_line_a_minute_with_the_time_left(lines):
    """Promise: hours of work in a log or a batch job say how far they are; short work is quiet."""
    halves = [(30.0 * k, "carpet", k, 100) for k in range(5)]
    assert lines(*halves[:2]) == []
    assert lines(*halves) == [
        "carpet: 0:01:00 elapsed, 0:49:00 left",
        "carpet: 0:02:00 elapsed, 0:48:00 left",
    ]


def test_time_left_counts_what_this_start_did(lines):
    """Promise: what an earlier start or another stage did does not change the pace."""
    resumed = (0.0, "5/10 jobs: rocks", 5, 10), (60.0, "6/10 jobs: rocks", 6, 10)
    assert lines(*resumed) == ["6/10 jobs: rocks: 0:01:00 elapsed, 0:04:00 left"]
    stages = (0.0, "baking", 9, 10), (100.0, "rendering", 0, 4), (160.0, "rendering", 2, 4)
    assert lines(*stages) == [
        "rendering: 0:00:00 elapsed",
        "rendering: 0:01:00 elapsed, 0:01:00 left",
    ]


def test_time_left_waits_for_a_hundredth_of_the_work(lines):
    """Promise: what runs for an hour is not said to take days because loading took a minute."""
    reports = (0.0, "rocks", 0, 1000), (60.0, "rocks", 9, 1000), (120.0, "rocks", 60, 1000)
    assert lines(*reports) == [
        "rocks: 0:01:00 elapsed",
        "rocks: 0:02:00 elapsed, 0:31:20 left",
    ]
    assert lines((0.0, "done", 9, 9), (60.0, "done", 9, 9)) == ["done: 0:01:00 elapsed"]


def test_compiling_does_not_set_the_pace(monkeypatch):
    """Promise: while Numba compiles, a first simulation says that in place of a time left."""
    said = []
    for cached in (False, True):
        monkeypatch.setattr(compiling, "is_cached", lambda kernel, cached=cached: cached)
        shown = _without_compiling(lambda *report: said.append(report))
        shown("measuring", 1, 9)
        shown("simulating", 5, 9)
    (_, (stage, done, total), *rest) = said
    assert stage.startswith("compiling")
    assert (done, total) == (0, 1)
    assert rest == [("measuring", 1, 9), ("simulating", 5, 9)]
