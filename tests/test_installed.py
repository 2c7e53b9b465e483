"""Methods and formats of installed distributions, found by their entry points."""

import json
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


ASKED = """
import contextlib, io, json, sys
import sensor.formats, tasks.registry
from sensor.own_modules import installed
from tasks.cli import main

sys.argv, shown = ["eres", "--help"], io.StringIO()
with contextlib.redirect_stdout(shown), contextlib.suppress(SystemExit):
    main()
of_help = shown.getvalue().count("\\n"), installed.cache_info().misses

from sensor.formats import FORMATS, find_format
of_formats = [find_format("a.h5").name, "others" in sys.modules]
of_formats += [find_format("a.rows").title, find_format("a", "rows").title, [*FORMATS][-1]]

from tasks.errors import TaskError
from tasks.methods import check_method, code_of_tasks, load_method, task_of
from tasks.registry import TASKS
of_methods = [task_of("still"), [*TASKS["flow"].methods][-2:], len(TASKS["flow"].methods)]
of_methods += [load_method("flow", name).__module__ for name in ("still", "photometric_flow")]
of_methods += code_of_tasks({"flow": ["still", "photometric_flow"]})
for task, name in (("flow", "still"), ("video", "absent"), ("tracking", "still")):
    try:
        check_method(task, name)
    except TaskError as error:
        of_methods.append(str(error))
print(json.dumps({"help": of_help, "formats": of_formats, "methods": of_methods}))
"""


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What a process finds where the distribution is installed."""
    folder = tmp_path_factory.mktemp("installed")
    for name, text in FILES.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    path = f"{environment()['PYTHONPATH']}{os.pathsep}{folder}"
    return json.loads(run_python(ASKED, PYTHONPATH=path).stdout)


def test_a_distribution_adds_methods(found):
    """Promise: they are listed by name and load like ours, and their code is part of a job's key;
    they do not replace ours. One that is not there is one error, where it is used."""
    methods = found["methods"]
    assert methods[:3] == ["flow", ["initial_flow", "still"], 9]
    assert methods[3:6] == ["others", "tasks.methods.photometric_flow", "others:still"]
    assert methods[6] == "video, method 'absent': found no function 'absent' in others"
    assert methods[7].startswith("tracking: no method 'still'")


def test_a_distribution_adds_formats(found):
    """Promise: its name and its extension are known; its code is imported only if none of ours
    fits."""
    assert found["formats"] == ["dsec", False, "rows of others", "rows of others", "rows"]


def test_help_looks_nothing_up(found):
    """Promise: `eres --help` and importing the packages do not look up our entry points."""
    lines, looked_up = found["help"]
    assert lines > 10
    assert looked_up == 0
