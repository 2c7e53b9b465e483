"""docs/methods.md: the test writes its files and runs its commands, from top to bottom."""

import os

import pytest

from another_process import environment, run_python
from docs_page import follow
from eres_render import open_sequence
from tasks.errors import TaskError
from tasks.evaluation.sequence import evaluate_sequence
from tasks.methods import METHOD_VERSIONS, code_of, load_method, task_of
from tasks.registry import TASKS
from tasks.row import read_rows

DOOR_LINES = 20
"""From outside, a method or a task takes fewer lines of code than this."""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own_method")
    yield folder, follow("methods.md", folder)
    del TASKS["rate"]


def code_lines(file):
    """Return the lines that are not blank."""
    return sum(bool(line.strip()) for line in file.read_text().splitlines())


def test_your_own_method_is_scored_next_to_ours(page):
    """Promise: `eres evaluate` and `eres study` accept a function from outside the project."""
    folder, said = page
    assert code_lines(folder / "my_flow.py") < DOOR_LINES
    assert "my_flow:estimate" in said
    rows = [r for r in read_rows(folder / "run" / "rows.parquet") if r.method == "my_flow:estimate"]
    assert {row.task for row in rows} == {"flow"}
    assert len({(row.width, row.cutoff_hz, row.speed) for row in rows}) == 9


def test_your_own_task_is_scored(page):
    """Promise: one registry entry adds a task from outside the project, which makes rows of a
    sequence's events; so do your own methods for it."""
    folder, _ = page
    assert code_lines(folder / "my_rate.py") < DOOR_LINES
    (folder / "my_count.py").write_text("def estimate(events, seconds): return 2 * events\n")
    names = ("per_second", "my_count:estimate")
    clip = open_sequence(folder / "clips" / "clip_000")
    rows = evaluate_sequence(clip, "rate", methods=names, width=32)
    assert [(row.task, row.method, row.metric) for row in rows] == [
        ("rate", name, "events_per_s") for name in names
    ]
    rate, count = rows
    assert rate.value == rate.event_rate_hz > 0
    start_s, end_s = clip.window_s
    assert count.value == pytest.approx(2 * rate.value * (end_s - start_s), rel=1e-4)
    with pytest.raises(TaskError, match="rate: no method 'no_events'"):
        evaluate_sequence(clip, "rate", methods=("no_events",))


def test_a_study_knows_the_metric_of_your_own_task(page):
    """Promise: with the entry in the registry, rows of the task are scores like any others."""
    folder, _ = page
    code = """if True:
        import my_rate
        from tasks.row import Row
        from tasks.study.results.metrics import METRICS
        from tasks.study.results.scores import Scores
        row = Row("carpet", "rate", "own", 32, 50.0, 0.2, 1.0, 0, "events_per_s", 1e6, 1e6)
        (series,) = Scores([row]).series()
        print(series.title, METRICS[series.metric].text(row.value))
    """
    path = f"{folder}{os.pathsep}{environment()['PYTHONPATH']}"
    assert run_python(code, PYTHONPATH=path).stdout == "event rate by own 1000000\n"


def test_code_of_own_methods_names_their_rows(tmp_path, monkeypatch):
    """Promise: an edit of the method's file changes its version, so old scores are not reused. The
    version of our own methods is their number."""
    monkeypatch.syspath_prepend(tmp_path)
    file = tmp_path / "edited_method.py"
    file.write_text("def estimate(sample): ...\n")
    before = code_of(["contrast_maximization", "edited_method:estimate"])
    file.write_text("def estimate(sample): return 1\n")
    assert list(before) == ["edited_method:estimate"]
    assert code_of(["edited_method:estimate"]) != before
    monkeypatch.setitem(METHOD_VERSIONS, "contrast_maximization", 2)
    assert code_of(["contrast_maximization"]) == {"contrast_maximization": "2"}


def test_methods_that_are_not_there_are_refused(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "odd_method.py").write_text("value = 3\ndef untyped(sample): ...\n")
    with pytest.raises(TaskError, match="did you mean 'photometric_flow'"):
        load_method("flow", "fotometric_flow")
    with pytest.raises(TaskError, match="cannot be imported"):
        load_method("flow", "no_such_package:estimate")
    with pytest.raises(TaskError, match="found no function 'value' in odd_method"):
        load_method("flow", "odd_method:value")
    with pytest.raises(TaskError, match="expected one of ReconstructionSample, FlowSample"):
        task_of("odd_method:untyped")
