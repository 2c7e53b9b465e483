"""Methods and formats of installed distributions, found by their entry points."""

import os

import pytest

from another_process import environment, run_python

FILES = {
    "others-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: others\nVersion: 1.0\n",
    "others-1.0.dist-info/entry_points.txt": (
        "[eres.methods]\nflow.still = others:still\nflow.photometric_flow = others:still\n"
        "video.absent = others:absent\n[eres.formats]\nrows = others:rows\n"
    ),
    "others.py": """
from dataclasses import replace
from sensor.formats import FORMATS
from tasks.flow import FlowEstimate, FlowSample

def still(sample: FlowSample) -> FlowEstimate:
    return FlowEstimate(0 * sample.initial)

def rows():
    return replace(FORMATS["text"], name="rows", title="rows of others", suffixes=(".rows",))
""",
}


@pytest.fixture
def python(tmp_path):
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    path = f"{environment()['PYTHONPATH']}{os.pathsep}{tmp_path}"
    return lambda code: run_python(code, PYTHONPATH=path).stdout.split("\n")[:-1]


def test_a_distribution_adds_methods(python):
    """Promise: they are listed by name and load like ours, and their code is part of a job's key;
    they do not replace ours. One that is not there is one error, where it is used."""
    found = python("""
from tasks.errors import TaskError
from tasks.methods import check_method, code_of_tasks, load_method, task_of
from tasks.registry import TASKS
print(task_of("still"), [*TASKS["flow"].methods][-2:], len(TASKS["flow"].methods))
print(load_method("flow", "still").__module__, load_method("flow", "photometric_flow").__module__)
print(*code_of_tasks({"flow": ["still", "photometric_flow"]}))
for task, name in (("flow", "still"), ("video", "absent"), ("tracking", "still")):
    try:
        check_method(task, name)
    except TaskError as error:
        print(error)
""")
    assert found[:3] == [
        "flow ['initial_flow', 'still'] 9",
        "others tasks.methods.photometric_flow",
        "others:still",
    ]
    assert found[3] == "video, method 'absent': found no function 'absent' in others"
    assert found[4].startswith("tracking: no method 'still'")


def test_a_distribution_adds_formats(python):
    """Promise: its name and its extension are known; its code is imported only if none of ours
    fits."""
    found = python("""
import sys
from sensor.formats import FORMATS, find_format
print(find_format("a.h5").name, "others" in sys.modules)
print(find_format("a.rows").title, find_format("a", "rows").title, [*FORMATS][-1])
""")
    assert found == ["dsec False", "rows of others rows of others rows"]


def test_help_looks_nothing_up(python):
    """Promise: `eres --help` and importing the packages do not look up our entry points."""
    found = python("""
import sys, sensor.formats, tasks.registry
from sensor.own_modules import installed
from tasks.cli import main
sys.argv = ["eres", "--help"]
try:
    main()
except SystemExit:
    pass
print(installed.cache_info().misses)
""")
    assert len(found) > 10
    assert found[-1] == "0"
