"""`eres_events` works beside files of a user that have the names of its packages."""

import subprocess
import sys
import warnings
from collections import Counter
from importlib import import_module

import pytest

from another_process import ROOT, environment

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # other tests may put folders on the path
    import eres_events

NAMES = ("sensor", "eres_render", "tasks")


def run(folder, code):
    """Run a script of a folder, which is first on Python's path."""
    (folder / "script.py").write_text(code)
    return subprocess.run(
        [sys.executable, folder / "script.py"],
        env=environment() | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )


@pytest.fixture(params=["modules", pytest.param("packages", marks=pytest.mark.slow)])
def folder(request, tmp_path):
    """A folder of a user with modules or packages of these names."""
    for name in NAMES:
        file = tmp_path / f"{name}.py"
        if request.param == "packages":
            (tmp_path / name).mkdir()
            file = tmp_path / name / "__init__.py"
        file.write_text("mine = 1\n")
    return tmp_path


USE = """
import multiprocessing
import eres_events as eres
from eres_events import EventDataset, load_scene, simulate, voxel_grid
from tasks.registry import TASKS

if __name__ == "__main__":
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        print(pool.apply(eres.plain_camera, (4, 3)).size, len(TASKS))
"""


def test_a_script_works_beside_files_of_these_names(folder):
    """Promise: public names, submodules and spawned workers come from eres, and one warning per
    name tells both files."""
    ran = run(folder, USE)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.startswith("(4, 3)")
    for name in NAMES:
        assert f"{ROOT / name} from now on, not {folder / name}" in ran.stderr


@pytest.mark.parametrize("name", NAMES)
def test_imported_too_late_it_names_the_file(folder, name):
    """Promise: a file that was imported before is not replaced; the error names both."""
    ran = run(folder, f"import {name}\nimport eres_events")
    assert ran.returncode == 1
    last = ran.stderr.splitlines()[-1]
    assert last.startswith("ImportError")
    assert f"{folder / name}" in last
    assert f"{ROOT / name}" in last


def test_alone_it_warns_of_nothing(tmp_path):
    """Promise: without such files there is no warning, and nothing heavy is loaded."""
    code = "import sys, eres_events; print({'numba', 'h5py', 'mitsuba', 'scipy'} & {*sys.modules})"
    ran = run(tmp_path, code)
    assert (ran.stdout, ran.stderr) == ("set()\n", "")


def test_each_public_name_is_there_once():
    """Promise: the names are those of the packages, and no two packages share one."""
    counts = Counter(dir(eres_events))
    assert [name for name, count in counts.items() if count > 1] == []
    assert {*import_module("sensor").__all__, "EventDataset", "load_events"} <= counts.keys()
    assert all(hasattr(eres_events, name) for name in counts)
    with pytest.raises(AttributeError, match="simulates"):
        eres_events.simulates  # noqa: B018
