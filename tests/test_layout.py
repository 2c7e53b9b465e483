"""The house keeps its rules: who may import whom, and what importing costs."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = {"eres_render", "sensor", "tasks"}
ALLOWED = {"sensor": set(), "eres_render": set(), "tasks": {"eres_render", "sensor"}}


def imports(path):
    """(top-level name, whether at module level) of everything a file imports."""
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names = [node.module]
        for name in names:
            yield name.split(".")[0], node in tree.body


@pytest.mark.parametrize("package", sorted(PACKAGES))
def test_packages_import_only_what_lies_below_them(package):
    """tasks -> eres_render, tasks -> sensor; the two never meet."""
    for path in (ROOT / package).rglob("*.py"):
        used = {name for name, _ in imports(path)} & PACKAGES - {package}
        assert used <= ALLOWED[package], f"{path} imports {used}"


def test_only_the_rendering_folder_touches_mitsuba():
    """Choosing a variant can take seconds, or end the process: it happens in one place."""
    users = {
        path.relative_to(ROOT).parent.as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if {"mitsuba", "drjit"} & {name for name, _ in imports(path)}
    }
    assert users == {"eres_render/rendering"}


@pytest.mark.parametrize("module", ["sensor", "eres_render", "tasks.cli"])
def test_importing_loads_neither_mitsuba_nor_torch(module):
    """`import sensor` and `eres --help` are for machines without a renderer too."""
    code = (
        f"import sys, {module}; print(sorted({{'mitsuba', 'drjit', 'torch'}} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip() == "[]"
