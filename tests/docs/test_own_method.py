"""docs/methods.md: the test writes its files and runs its commands, from top to bottom."""

import importlib
import json
import os
import sys
from dataclasses import replace

import pytest

from another_process import environment, run_python
from docs_page import follow
from eres_render import load_scene, open_sequence
from recordings import make_recording
from tasks.errors import StudyError, TaskError
from tasks.evaluation.sequence import evaluate_sequence
from tasks.methods import check_method, code_of, code_of_tasks, load_method, task_of
from tasks.recording.evaluate import evaluate_recording
from tasks.recording.frames import open_frames
from tasks.recording.options import FlowOptions
from tasks.recording.recording import open_recording
from tasks.registry import TASKS
from tasks.row import read_rows
from tasks.study.config import Evaluate
from tasks.study.run.jobs import jobs_of
from tasks.study.study_file import read_study

pytestmark = pytest.mark.slow
DOOR_LINES = 20
"""From outside, a method or a task takes fewer lines of code than this."""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own_method")
    try:
        yield folder, follow("methods.md", folder)
    finally:
        TASKS.pop("rate", None)  # also where the page fails, or later tests see the task


def code_lines(file):
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
    assert code_lines(folder / "my_start_rate.py") < DOOR_LINES
    (folder / "my_count.py").write_text("def estimate(events, us): return 2 * events\n")
    names = ("exact", "my_count:estimate")
    clip = open_sequence(folder / "clips" / "clip_000")
    exact, count = rows = evaluate_sequence(clip, "rate", methods=names, camera=32)
    assert [(row.task, row.method, row.metric) for row in rows] == [
        ("rate", name, "rate_mev_s") for name in names
    ]
    assert exact.value > 0
    assert count.value == pytest.approx(2 * exact.value * 10_000)
    with pytest.raises(TaskError, match="rate: no method 'no_events'"):
        evaluate_sequence(clip, "rate", methods=("no_events",))


def test_your_own_task_is_scored_on_a_recording(page, tmp_path):
    """Promise: the task runs on a file of events alone and between frames: a row
    for each window and method."""
    made = make_recording(tmp_path)
    recording = open_recording(made.events_file)
    options = FlowOptions(window_ms=15.0, windows=4)
    rows = evaluate_recording(recording, "rate", flow=options).rows
    assert [(row.method, row.sample) for row in rows] == [
        (name, k) for k in range(len(rows) // 2) for name in ("exact", "rounded")
    ]
    for row in rows[::2]:
        start_us = row.t_us - 15_000  # the page's task scores the first 10 ms
        first, whole = (
            len(made.events.between(start_us, start_us + us)) for us in (10_000, 15_000)
        )
        assert row.value == pytest.approx(first / 10_000)
        assert row.event_rate_hz == pytest.approx(whole / 0.015)
    frames = open_frames(made.frames, encoding="linear")
    found = evaluate_recording(recording, "rate", frames=frames)
    assert {row.t_us for row in found.rows} <= {*frames.middle_us.tolist()}
    assert not any("threshold" in note for note in found.notes)


def test_a_study_runs_your_own_task(page):
    """Promise: with the registry entry alone, the task has its section in a study's file, jobs with
    those of the other tasks, rows, tables and a place in the report."""
    folder, _ = page
    study = read_study(folder / "rates.toml")
    assert study.evaluate["rate"].first_us == 5000
    (job,) = jobs_of(study, load_scene("carpet"))
    assert list(job.evaluate) == ["reconstruction", "rate"]
    rows = read_rows(folder / "rates" / "rows.parquet")
    rates = [row for row in rows if (row.task, row.method) == ("rate", "exact")]
    assert len(rates) == 2 * len(study.simulate.cutoffs_hz) * len(study.simulate.speeds)
    others = [row for row in rows if row.method == "event_integration"]
    assert [row.event_rate_hz for row in rates] == [row.event_rate_hz for row in others]
    assert all(row.value > 0 for row in rates)
    stored = json.loads((folder / "rates" / "study.json").read_text())
    assert stored["evaluate"]["rate"] == {"methods": ["exact", "rounded"], "first_us": 5000}
    assert "carpet,rate,exact,,rate_mev_s,64,,inf" in (folder / "rates" / "tables.csv").read_text()
    assert "event rate by exact" in (folder / "rates" / "report.html").read_text()


def test_settings_of_your_own_task_are_in_the_key_of_its_jobs(page):
    """Promise: another value computes the jobs that score the task again, and no others."""
    folder, _ = page
    study = read_study(folder / "rates.toml")
    rate = replace(study.evaluate["rate"], first_us=6000)
    without = replace(rate, methods=())
    keys = {
        tuple(job.key for job in jobs_of(replace(study, evaluate=evaluate), load_scene("carpet")))
        for evaluate in (
            study.evaluate,
            Evaluate(**{**study.evaluate, "rate": rate}),
            Evaluate(**{**study.evaluate, "rate": without}),
            Evaluate(**{**study.evaluate, "rate": replace(without, first_us=7000)}),
        )
    }
    assert len(keys) == 3


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        ("first_us = 0", "evaluate.rate.first_us: found 0, expected a positive number"),
        ("first_us = 0.5", "evaluate.rate.first_us: found 0.5, expected an integer"),
        ("last_us = 5", "evaluate.rate.last_us: unknown; did you mean 'first_us'"),
        (
            "[evaluate.rates]",
            "evaluate.rates: unknown; did you mean 'rate'",
        ),
    ],
)
def test_mistakes_in_the_section_of_your_own_task_are_named(page, tmp_path, edit, said):
    folder, _ = page
    file = tmp_path / "rates.toml"
    file.write_text((folder / "rates.toml").read_text().replace("first_us = 5000", edit))
    with pytest.raises(StudyError, match=f"rates.toml: {said}"):
        read_study(file)


def test_it_does_not_matter_when_your_own_task_is_imported(page):
    """Promise: a task that is registered after everything is imported is a task like any other."""
    folder, _ = page
    code = """if True:
        from tasks.row import Row
        from tasks.study.config import preset
        from tasks.study.results.scores import Scores
        quick = preset("quick")
        import my_start_rate
        print(quick.evaluate["rate"])
        row = Row("carpet", "rate", "own", 32, 50.0, 0.2, 1.0, 0, "rate_mev_s", 1.0, 1e6)
        (series,) = Scores([row]).series()
        print(series.title)
    """
    path = f"{folder}{os.pathsep}{environment()['PYTHONPATH']}"
    said = run_python(code, PYTHONPATH=path).stdout
    assert said == "StartRate(methods=(), first_us=10000)\nevent rate by own\n"


def edit(file, text):
    """Edit a module, and load it as a new process would."""
    file.write_text(text)
    importlib.reload(sys.modules[file.stem])


def test_code_of_own_methods_names_their_rows(tmp_path, monkeypatch):
    """Promise: an edit of the method's file changes its version, so old scores are not reused. The
    version of our own methods is their number."""
    monkeypatch.syspath_prepend(tmp_path)
    file = tmp_path / "edited_method.py"
    file.write_text("def estimate(sample): ...\n")
    before = code_of(["event_integration", "edited_method:estimate"])
    edit(file, "def estimate(sample): return 1\n")
    assert list(before) == ["edited_method:estimate"]
    assert code_of(["edited_method:estimate"]) != before
    (tmp_path / "edited_package").mkdir()
    (tmp_path / "edited_package" / "__init__.py").write_text("from edited_method import estimate\n")
    before = code_of(["edited_package:estimate"])
    edit(file, "def estimate(sample): return 2\n")
    importlib.reload(sys.modules["edited_package"])
    assert code_of(["edited_package:estimate"]) != before
    listed = TASKS["reconstruction"].methods
    raised = replace(listed["event_integration"], version=2)
    monkeypatch.setitem(listed, "event_integration", raised)
    assert code_of(["event_integration"]) == {"event_integration": "2"}


def test_code_of_your_own_task_names_its_rows(page, tmp_path, monkeypatch):
    """Promise: an edit of the scorer, of the settings' class or of a method that the task lists
    gives its jobs another key; jobs of our tasks have no entry for it."""
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("edited_scorer", "edited_settings", "edited_listed"):
        (tmp_path / f"{name}.py").write_text("from tasks.evaluation.settings import TaskSettings\n")
    with (tmp_path / "edited_settings.py").open("a") as file:
        file.write("class Own(TaskSettings): ...\n")
    rate = replace(
        TASKS["rate"],
        methods={"exact": "edited_listed:exact", "rounded": "operator:floordiv"},
        scorer="edited_scorer:RateScorer",
        settings="edited_settings:Own",
    )
    study = read_study(page[0] / "rates.toml")
    monkeypatch.setitem(TASKS, "rate", rate)

    def key(**tasks):
        changed = replace(study, evaluate=Evaluate(**{**study.evaluate, **tasks}))
        return next(job.key for job in jobs_of(changed, load_scene("carpet")))

    ours = replace(study.evaluate["rate"], methods=())
    found = [(key(), key(rate=ours))]
    for name in ("edited_scorer", "edited_settings", "edited_listed"):
        file = tmp_path / f"{name}.py"
        edit(file, f"{file.read_text()}# edited\n")
        found.append((key(), key(rate=ours)))
    assert [len({*keys}) for keys in zip(*found, strict=True)] == [4, 1]
    assert code_of_tasks({"flow": ["contrast_maximization"], "video": []}) == {}


def test_several_tasks_can_take_classes(page):
    """Promise: a class is refused only by tasks whose methods are functions of a sample."""
    folder, _ = page
    (folder / "my_class.py").write_text("class Count: ...\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        for task in ("video", "rate"):
            check_method(task, "my_class:Count")
        with pytest.raises(TaskError, match="found a class, which is for video, expected a func"):
            check_method("flow", "my_class:Count")


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
