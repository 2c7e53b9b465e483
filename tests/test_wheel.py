"""The wheel: installed into an empty environment, away from the checkout, it runs a complete
study."""

import os
import re
import subprocess
import sys
import tarfile
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parent.parent
PACKAGES = ("eres_render", "sensor", "tasks")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir"]
    subprocess.run([*pip, str(folder), str(ROOT)], check=True)
    (file,) = folder.glob("*.whl")
    return file


@pytest.fixture(scope="module")
def run(wheel, tmp_path_factory):
    """Run a program of an environment that has only the wheel and its dependencies."""
    environment, elsewhere = (tmp_path_factory.mktemp(name) for name in ("venv", "elsewhere"))
    bin_ = environment / "bin"
    subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
    install = [bin_ / "pip", "install", "--quiet", "--disable-pip-version-check", wheel]
    subprocess.run(list(map(str, install)), check=True)
    variables = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}

    def run(program, *args):
        done = subprocess.run(
            [str(bin_ / program), *args],
            capture_output=True,
            text=True,
            cwd=elsewhere,
            env=variables | {"COLUMNS": "200"},
        )
        assert done.returncode == 0, f"{program} {args}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    run.folder = elsewhere
    run.environment = environment
    return run


def test_every_scene_and_template_is_in_it(wheel):
    """Promise: the wheel contains scenes, lightmaps and the report's parts, to the byte."""
    in_wheel = zipfile.ZipFile(wheel)
    expected = {f"eres_render/_scenes/{f.relative_to(ROOT / 'scenes')}": f for f in files("scenes")}
    assert len([name for name in expected if name.endswith(".exr")]) > 20
    commit = in_wheel.read("tasks/commit.txt").decode()
    assert re.fullmatch(r"[0-9a-f]{12}(-dirty)?\n", commit)
    for package in PACKAGES:
        expected |= {str(f.relative_to(ROOT)): f for f in files(package)}
    for name, file in expected.items():
        assert in_wheel.read(name) == file.read_bytes(), name


def test_nothing_else_is_in_it(wheel):
    """Promise: the wheel contains no tests, benchmarks or caches, and is small."""
    assert wheel.stat().st_size < 22e6  # 12.5 MB are weights, 8.6 baked light
    tops = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert tops == {*PACKAGES, f"eres_events-{version('eres-events')}.dist-info"}


def test_the_source_archive_is_small(tmp_path):
    """Promise: the source archive has what a wheel is built from, and knows its commit. Tests and
    pages, which need the stored runs, are in a checkout only."""
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--target", str(tmp_path / "tool")]
    subprocess.run([*pip, "hatchling"], check=True)
    build = [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(tmp_path)]
    found = {**os.environ, "PYTHONPATH": str(tmp_path / "tool")}
    subprocess.run(build, check=True, cwd=ROOT, env=found, capture_output=True)
    (archive,) = tmp_path.glob("*.tar.gz")
    assert archive.stat().st_size < 23e6  # 12.5 MB are weights, 8.6 baked light
    with tarfile.open(archive) as files_in:
        names = [name.partition("/")[2] for name in files_in.getnames()]
    assert {"tasks/commit.txt", "CITATION.cff", "hatch_build.py"} < set(names)
    assert {name.split("/")[0] for name in names if "/" in name} == {*PACKAGES, "scenes"}
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir"]
    subprocess.run([*pip, str(tmp_path), str(archive)], check=True)
    (wheel,) = tmp_path.glob("*.whl")
    assert "eres_render/_scenes/carpet/scene.xml" in zipfile.ZipFile(wheel).namelist()


def files(folder):
    found = (ROOT / folder).rglob("*")
    return [f for f in found if f.is_file() and "__pycache__" not in f.parts]


def test_the_import_names_are_its_own(run):
    """Promise: `sensor` and `tasks`, which are common names, are loaded from this wheel."""
    code = (
        "import importlib.metadata as m, importlib.util as u\n"
        f"for name in {PACKAGES}:\n"
        "    print(name, *m.packages_distributions()[name], u.find_spec(name).origin)"
    )
    for name, line in zip(PACKAGES, run("python", "-c", code).splitlines(), strict=True):
        found, owner, origin = line.split()
        assert (found, owner) == (name, "eres-events")
        assert Path(origin).is_relative_to(run.environment)
    run("pip", "check")


def test_the_command_works(run):
    commit = r"git [0-9a-f]{12}(-dirty)? as installed"
    version_ = f"eres {version('eres-events')} \\({commit}\\), Mitsuba {version('mitsuba')}\n"
    assert re.fullmatch(version_, run("eres", "--version"))
    said = run("eres", "doctor")
    assert "renders use:" in said
    assert str(run.environment) in said
    assert str(ROOT) not in said
    listed = run("eres", "scenes")
    for scene in ("carpet", "rocks", "room"):
        assert scene in listed


def test_a_study_runs_to_its_report(run):
    """Promise: the smallest study, from the packaged scene to the report."""
    small = ("--resolution", "256", "--samples", "1")
    said = run("eres", "study", "--preset", "quick", *small, "--out", "run")
    assert "report: run/report.html" in said
    report = (run.folder / "run" / "report.html").read_text()
    assert "carpet" in report
    assert (run.folder / "run" / "tables.csv").is_file()
    assert "as installed" in (run.folder / "run" / "environment.json").read_text()
    run("eres", "report", "run")
