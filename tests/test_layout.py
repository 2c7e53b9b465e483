"""The code follows the rules of docs/house.md: allowed imports, and their costs."""

import ast
import functools
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = {"eres_render", "sensor", "tasks"}
STATEMENTS = ast.stmt, ast.excepthandler, ast.match_case
ALLOWED = {"sensor": set(), "eres_render": set(), "tasks": {"eres_render", "sensor"}}


@functools.cache
def imports(path):
    """Return the modules that a file imports, anywhere in it."""
    found, left = set(), [ast.parse(path.read_text())]
    while left:
        node = left.pop()
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module)
        # Most nodes are parts of expressions, which have no imports.
        left += [inner for inner in ast.iter_child_nodes(node) if isinstance(inner, STATEMENTS)]
    return found


def packages(path):
    """Return the top-level names of what a file imports."""
    return {module.partition(".")[0] for module in imports(path)}


def test_the_page_shows_the_folders_that_there_are():
    """Promise: docs/house.md has every folder of code, and no removed one."""
    tree = (ROOT / "docs" / "house.md").read_text().split("```")[1]
    shown = set(re.findall(r"\b(\w+)/(?= )", tree)) | set(re.findall(r"\b(\w+)/\n", tree))
    there = {
        path.parent.name for package in PACKAGES for path in (ROOT / package).rglob("__init__.py")
    }
    assert shown == there - {
        "contrast_maximization",
        "photometric_tracking",
        "scorers",
        "sections",
    }  # a level lower


@pytest.mark.parametrize("package", sorted(PACKAGES))
def test_the_page_shows_the_files_at_the_top_of_a_package(package):
    """Promise: docs/house.md has every module that is in no folder below the package."""
    tree = (ROOT / "docs" / "house.md").read_text().split("```")[1]
    part = re.search(rf"^{package}/.*\n((?:  .*\n)+)", tree, re.MULTILINE)[1]
    shown = {
        word for line in part.splitlines() for word in re.findall(r"\w+", line.split("   ")[0])
    }
    files = {path.stem for path in (ROOT / package).glob("*.py")} - {"__init__"}
    assert files <= shown, files - shown


@pytest.mark.parametrize("package", sorted(PACKAGES))
def test_packages_import_only_what_lies_below_them(package):
    """tasks -> eres_render, tasks -> sensor; these two import neither each other nor tasks."""
    for path in (ROOT / package).rglob("*.py"):
        used = packages(path) & PACKAGES - {package}
        assert used <= ALLOWED[package], f"{path} imports {used}"


def test_only_the_rendering_folder_touches_mitsuba():
    """Choosing a variant can take seconds, or end the process: it happens in one place."""
    users = {
        path.relative_to(ROOT).parent.as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if {"mitsuba", "drjit"} & packages(path)
    }
    assert users == {"eres_render/rendering"}


def test_only_the_folder_of_networks_touches_torch():
    """Promise: everything else works without PyTorch, which is an extra."""
    users = {
        path.relative_to(ROOT).parent.as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if "torch" in packages(path)
    }
    assert users == {"tasks/learned", "tasks/learned/training"}


# Folders that a folder may import; one that is not listed may import none of the others here.
WINGS = {
    "sensor.kernels": set(),
    "sensor.engine": {"sensor.kernels"},
    "sensor.gpu": {"sensor.engine", "sensor.kernels"},
    "sensor.formats": set(),
    "sensor.cameras": {"sensor.engine", "sensor.formats"},
    "sensor.representations": set(),
    "sensor.emulators": set(),
    "sensor.statistics": set(),
    "eres_render.storage": set(),
    "eres_render.trajectory": set(),
    "eres_render.textures": set(),
    "eres_render.interior": {"eres_render.textures"},
    "eres_render.random_scenes": {
        *("eres_render.interior", "eres_render.textures"),
        *("eres_render.storage", "eres_render.trajectory"),
    },
    "eres_render.scene": {
        *("eres_render.interior", "eres_render.textures"),
        *("eres_render.storage", "eres_render.trajectory"),
    },
    "eres_render.rendering": {
        *("eres_render.scene", "eres_render.storage", "eres_render.trajectory"),
    },
    "eres_render.sequence": {
        *("eres_render.rendering", "eres_render.scene"),
        *("eres_render.storage", "eres_render.trajectory"),
    },
    "tasks.numerics": set(),
    "tasks.learned": {"tasks.methods", "tasks.random_crops"},
    "tasks.random_crops": set(),
    "tasks.methods": {"tasks.numerics"},
    "tasks.evaluation": {"tasks.methods"},
    "tasks.footage": set(),
    "tasks.events": {"tasks.footage"},
    "tasks.recording": {
        *("tasks.events", "tasks.evaluation", "tasks.footage", "tasks.methods", "tasks.numerics"),
    },
    "tasks.advice": {"tasks.footage"},
    "tasks.datasets": set(),
    "tasks.fitting": {"tasks.footage", "tasks.numerics", "tasks.recording"},
    "tasks.generation": {"tasks.evaluation", "tasks.events", "tasks.study.run"},
    "tasks.view": {"tasks.events", "tasks.footage", "tasks.recording.recording"},
    "tasks.rig": {"tasks.events", "tasks.evaluation", "tasks.footage", "tasks.methods"},
    "tasks.study.results": set(),
    "tasks.study.claims": {"tasks.study.results"},
    "tasks.study.report": {
        *("tasks.study.claims", "tasks.study.results", "tasks.evaluation.timings"),
    },
    "tasks.study.run": {
        *("tasks.study.results", "tasks.study.config", "tasks.evaluation", "tasks.methods"),
    },
}
KEPT_APART = {*WINGS, "tasks.study.config", "tasks.cli"}
WHERE_A_GPU_IS_ASKED_FOR = {("sensor/engine/devices.py", "sensor.gpu")}


def test_every_folder_is_kept_apart():
    """Promise: a new folder gets its place in the order of folders."""
    folders = {
        ".".join(path.parent.relative_to(ROOT).parts)
        for package in PACKAGES
        for path in (ROOT / package).rglob("__init__.py")
    }
    free = {folder for folder in folders if wing(folder, KEPT_APART) is None}
    assert free == {*PACKAGES, "tasks.study"}


def wing(module, wings):
    """Return the most specific of the wings that contain a module, or None."""
    inside = [one for one in wings if module == one or module.startswith(f"{one}.")]
    return max(inside, key=len, default=None)


def imported(path):
    """Return the modules of its own package that a file imports."""
    package = path.relative_to(ROOT).parts[0]
    return [module for module in imports(path) if module.partition(".")[0] == package]


@pytest.mark.parametrize("name", sorted(WINGS))
def test_wings_depend_one_way(name):
    """Promise: no folder imports a higher one: engine -> kernels, sequence -> rendering -> scene,
    report -> claims -> results, run -> results, evaluation -> methods."""
    for path in (ROOT / name.replace(".", "/")).rglob("*.py"):
        for module in imported(path):
            other = wing(module, KEPT_APART)
            if (path.relative_to(ROOT).as_posix(), other) in WHERE_A_GPU_IS_ASKED_FOR:
                continue
            if other not in (None, name):
                assert wing(module, WINGS[name]), f"{path} imports {module}"


def test_problems_know_no_folder():
    """Promise: tasks/flow.py and similar modules work alone; what they run, they find by name."""
    for path in (ROOT / "tasks").glob("*.py"):
        for module in imported(path):
            assert wing(module, {*KEPT_APART, "tasks.study"}) is None, f"{path} imports {module}"


def test_tasks_know_no_engine():
    """Promise: how a simulation runs can change without a change in tasks."""
    for path in (ROOT / "tasks").rglob("*.py"):
        for module in imports(path):
            assert wing(module, {"sensor.engine"}) is None, f"{path}: {module}"


def test_only_the_command_line_draws_on_the_terminal():
    """Promise: libraries report progress (eres_render.progress); only the command line draws bars
    and tables."""
    users = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if "rich" in packages(path)
    }
    assert {user.rpartition("/")[0] for user in users} == {"tasks/cli"}


def test_results_and_claims_have_no_html_and_no_terminal():
    """Promise: results and claims have no HTML and no terminal output, so any program can draw
    them."""
    for name in ("results", "claims"):
        for path in (ROOT / "tasks" / "study" / name).rglob("*.py"):
            assert not re.search(r"</\w+>", path.read_text()), path
            assert "rich" not in packages(path), path


@pytest.mark.parametrize("package", ["sensor", "eres_render"])
def test_no_module_takes_the_name_of_what_its_package_exports(package):
    """Promise: `from sensor import simulate` is the function, after any other import.

    Names load on request, and a module of that name would come first.
    """
    exported = set(importlib.import_module(package).__all__)
    modules = {path.stem for path in (ROOT / package).iterdir() if not path.name.startswith("_")}
    assert not exported & modules


@pytest.mark.parametrize("package", ["sensor", "eres_render"])
def test_all_that_a_package_exports_is_there(package):
    """Promise: each name that loads on request exists, and no other."""
    module = importlib.import_module(package)
    assert set(module.__all__) <= set(dir(module))
    for name in module.__all__:
        assert getattr(module, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = module.nothing


def test_the_command_line_answers_at_once():
    """Promise: `eres --help` does not load Numba, SciPy, OpenCV, pyarrow or matplotlib. With
    `import sensor` it also works on machines without a renderer."""
    slow = {"numba", "scipy", "cv2", "pyarrow", "matplotlib", "mitsuba", "drjit", "torch"}
    code = f"""
import sys, tasks.cli, tasks.row
print(sorted({slow} & set(sys.modules)))
import sensor, eres_render, tasks.datasets
print(sorted({{"mitsuba", "drjit", "torch"}} & set(sys.modules)))
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert run.stdout == "[]\n[]\n", run.stderr
