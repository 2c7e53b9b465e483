"""Examples in docstrings run as they stand and print what they show."""

import doctest
import importlib
import inspect
import io
import re
from pathlib import Path

import pytest

import eres_render
import sensor
import sensor.formats
import sensor.optics
import sensor.representations
import tasks.datasets
from docs_page import run

ROOT = Path(__file__).parents[2]
FILES = [
    path
    for package in ("sensor", "eres_render", "tasks")
    for path in sorted((ROOT / package).rglob("*.py"))
    if ">>> " in path.read_text()
]


def module_name(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@pytest.fixture(scope="session")
def clips(tmp_path_factory):
    """The clip that some examples open, by the command that they name."""
    folder = tmp_path_factory.mktemp("rendered")
    command = "eres render carpet --out clips --resolution 128 --spp 4 --samples 1"
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        run("sh", command, io.StringIO(), patch)
    return folder / "clips"


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=module_name)
def test_examples_print_what_they_show(path, tmp_path, monkeypatch, request):
    """Promise: pasted into an interpreter, in any folder, each example by itself works."""
    monkeypatch.chdir(tmp_path)
    if "--out clips`" in path.read_text():
        (tmp_path / "clips").symlink_to(request.getfixturevalue("clips"))
    said = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS, verbose=False)
    module = importlib.import_module(module_name(path))
    examples = doctest.DocTestFinder().find(module, globs={})
    assert any(one.examples for one in examples)
    for one in examples:
        runner.run(one, out=said.append)
    assert not said, "".join(said)


def defined_in(module):
    """Return the public functions and classes that a module defines."""
    return [
        name
        for name, one in vars(module).items()
        if getattr(one, "__module__", None) == module.__name__ and not name.startswith("_")
    ]


@pytest.mark.parametrize(
    ("module", "names"),
    [
        (sensor, sensor.__all__),
        (sensor.formats, sensor.formats.__all__),
        (sensor.representations, sensor.representations.__all__),
        (sensor.optics, defined_in(sensor.optics)),
        (tasks.datasets, tasks.datasets.__all__),
        (eres_render, eres_render.__all__),
    ],
    ids=lambda given: getattr(given, "__name__", ""),
)
def test_public_names_have_an_example(module, names):
    """Promise: `help(sensor.simulate)` shows a typical call and its result, so do all others."""
    assert names
    described = [one for name in names if callable(one := getattr(module, name))]
    lacking = [
        one.__name__
        for one in described
        if not re.search(r"^Examples\n-{8}\n.*^>>> ", inspect.getdoc(one) or "", re.M | re.S)
    ]
    assert not lacking, lacking
