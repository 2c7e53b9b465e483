"""Before the first job, two processes compile the kernels of the sensor and of the methods."""

import subprocess

import pytest

from another_process import run_python
from light_scenes import light_evenly, small_carpet_folder
from tasks.methods import load_method
from tasks.study.config import Evaluate, Flow, Tracking
from tasks.study.run import compile_ahead
from tasks.study.run.compile_ahead import compile_methods, compiling_ahead

TASKS = {
    "flow": ("photometric_flow", "photometric_flow_with_delay", "contrast_maximization"),
    "tracking": ("photometric_tracking", "photometric_tracking_with_delay"),
}
METHODS = [(task, name) for task, names in TASKS.items() for name in names]


@pytest.mark.parametrize(("task", "name"), METHODS)
def test_methods_succeed_on_the_made_up_sample(task, name):
    """Promise: the sample leads each method through its search, and so through all of its
    kernels."""
    answer = load_method(task, name)(compile_ahead._SAMPLES[task]())
    if task == "flow":
        assert answer.failure == ""
    else:
        assert answer.diagnostics is not None
        assert answer.diagnostics.passes > 5


class NoProcess:
    """Stands for a process; remembers its command."""

    def __init__(self, command, **_):
        self.commands.append(command)

    def kill(self):
        self.killed.append(self)

    def wait(self):
        pass


@pytest.fixture
def commands(monkeypatch):
    """Return the commands of the processes that are started, none of which runs."""
    NoProcess.commands, NoProcess.killed = [], []
    monkeypatch.setattr(subprocess, "Popen", NoProcess)
    return NoProcess.commands


@pytest.mark.parametrize(
    ("cores", "cached", "methods", "starts"),
    [
        (2, (), ("photometric_flow", "initial_flow"), ["sensor", "methods"]),
        (1, (), ("photometric_flow",), []),
        (2, ("sensor", "tasks"), ("photometric_flow",), []),
        (2, ("sensor",), ("photometric_flow",), ["methods"]),
        (2, ("tasks",), ("photometric_flow",), ["sensor"]),
        (2, (), (), ["sensor"]),
        (2, (), ("mine.flow:estimate",), ["sensor"]),
    ],
)
def test_processes_start_where_they_save_time(
    monkeypatch, commands, cores, cached, methods, starts
):
    """Promise: with a second core, and where no kernel is compiled yet; they end with the jobs."""

    def is_cached(kernel):
        place = getattr(getattr(kernel, "py_func", None), "__module__", "")
        return place.split(".")[0] in cached

    monkeypatch.setattr(compile_ahead, "cores", lambda: cores)
    monkeypatch.setattr(compile_ahead, "is_cached", is_cached)
    tasks = Evaluate(flow=Flow(methods=methods), tracking=Tracking(methods=()))
    with compiling_ahead(tasks.items()):
        calls = [command[-1].partition("; compile_")[2] for command in commands]
        assert [call.partition("(")[0] for call in calls] == starts
        assert not NoProcess.killed
    assert len(NoProcess.killed) == len(starts)
    if starts[1:]:
        assert "('flow', 'initial_flow'), ('flow', 'photometric_flow')" in calls[1]


RUN = """
import sys
from dataclasses import replace
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from small_study import tiny_study
from tasks.study.config import Evaluate, Flow, Render, Simulate, Tracking
from tasks.study.run import run_study

names = {names!r}
tasks = Evaluate(
    flow=Flow(methods=names["flow"], features=2),
    tracking=Tracking(methods=names["tracking"]),
)
study = replace(
    tiny_study(sys.argv[1]),
    render=Render(resolution=320, spp=1, max_displacement_px=1.0, samples=1),
    simulate=Simulate(widths=(320,), cutoffs_hz=(50.0,), speeds=(1.0,)),
    evaluate=tasks,
)
run_study(study, Path(sys.argv[2]))
places = ("tasks.methods.", "tasks.numerics.", "sensor.kernels.")
kernels = {{
    f"{{value.py_func.__module__}}.{{value.py_func.__name__}}": value
    for name, module in sys.modules.items() if name.startswith(places)
    for value in vars(module).values() if isinstance(value, Dispatcher)
}}
print(sum(sum(one.stats.cache_hits.values()) for one in kernels.values()))
print([name for name, one in kernels.items() if one.stats.cache_misses])
"""


@pytest.mark.slow
def test_a_study_compiles_nothing_that_was_compiled_ahead(tmp_path):
    """Promise: the samples' arrays have the types of a study's, for the sensor and the methods of
    preset quick."""
    quick = {task: tuple(n for n in names if "delay" not in n) for task, names in TASKS.items()}
    methods = [(task, name) for task, names in quick.items() for name in names]
    folder = light_evenly(small_carpet_folder(tmp_path / "carpet"), "carpet", 3.0)
    cache = {"NUMBA_CACHE_DIR": str(tmp_path / "numba")}
    run_python(
        f"from {compile_methods.__module__} import compile_methods, compile_sensor;"
        f"compile_sensor(); compile_methods({methods!r})",
        **cache,
    )
    found = run_python(RUN.format(names=quick), folder, tmp_path / "run", **cache).stdout
    hits, misses = found.splitlines()[-2:]
    assert int(hits) > 5
    assert misses == "[]"
