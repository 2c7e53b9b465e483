"""The wheel, installed into an empty environment, away from the checkout: first without extras,
then with what a study needs."""

import fcntl
import os
import re
import subprocess
import sys
import tarfile
import zipfile
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sensor import shipped

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parent.parent
PINNED = ("-c", ROOT / "constraints.txt")
PACKAGES = ("eres_events", "eres_render", "sensor", "tasks")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir"]
    subprocess.run([*pip, str(folder), str(ROOT)], check=True)
    (file,) = folder.glob("*.whl")
    return file


@pytest.fixture(scope="module")
def run(wheel, tmp_path_factory):
    """Run a program of an environment that has only the wheel and what it needs without extras."""
    environment, elsewhere = (tmp_path_factory.mktemp(name) for name in ("venv", "elsewhere"))
    bin_ = environment / "bin"
    subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
    install = [bin_ / "pip", "install", "--quiet", "--disable-pip-version-check", *PINNED, wheel]
    subprocess.run(list(map(str, install)), check=True)
    variables = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}

    def run(program, *args, **more):
        done = subprocess.run(
            [str(bin_ / program), *args],
            capture_output=True,
            text=True,
            cwd=elsewhere,
            env=variables | {"COLUMNS": "200"} | more,
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
    assert wheel.stat().st_size < 24e6  # 12.5 MB are weights, 8.6 baked light, 2.4 kernels
    tops = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert tops == {*PACKAGES, f"eres_events-{version('eres-events')}.dist-info"}


def test_the_source_archive_is_small(tmp_path):
    """Promise: the source archive has what a wheel is built from, and knows its commit. Tests and
    pages, which need the stored runs, are in a checkout only."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(tmp_path)]
    subprocess.run(build, check=True, cwd=ROOT, capture_output=True)
    (archive,) = tmp_path.glob("*.tar.gz")
    assert archive.stat().st_size < 23e6  # 12.5 MB are weights, 8.6 baked light
    with tarfile.open(archive) as files_in:
        names = [name.partition("/")[2] for name in files_in.getnames()]
    assert {
        "tasks/commit.txt",
        "CITATION.cff",
        "constraints.txt",
        "hatch_build.py",
        "hatch_kernels.py",
    } < set(names)
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
    version_ = f"eres {version('eres-events')} \\({commit}\\)\n"
    assert re.fullmatch(version_, run("eres", "--version"))
    said = run("eres", "doctor")
    assert "renders use:" in said
    assert str(run.environment) in said
    assert str(ROOT) not in said
    listed = run("eres", "scenes")
    for scene in ("carpet", "rocks", "room"):
        assert scene in listed


def test_it_is_light_without_extras(run):
    """Promise: at most 670 MB, bytecode aside, turn images into events that one can look at."""
    files = (f for f in run.environment.rglob("*") if f.is_file() and f.suffix != ".pyc")
    assert sum(f.stat().st_size for f in files) < 670e6
    (run.folder / "frames").mkdir()
    for k in range(5):
        wave = 128 + 99 * np.sin(0.3 * (np.arange(32) + k)) * np.ones((24, 1))
        Image.fromarray(wave.astype(np.uint8)).save(run.folder / "frames" / f"{k}.png")
    assert "e.h5: " in run("eres", "simulate", "frames", "--fps", "500", "--out", "e.h5")
    run("eres", "view", "e.h5", "--out", "e.png")
    assert "pip install 'eres-events[study]'" in run("eres", "doctor")


FIRST = """
import resource
import numpy as np
from sensor import SensorModel, simulate

model = SensorModel(width=32, height=32, cutoff_hz=200.0)
simulate(np.ones((2, 32, 32)), [0.0, 1e-3], model)
used = resource.getrusage(resource.RUSAGE_SELF)
print(used.ru_utime + used.ru_stime)
"""
BITS = """
import hashlib, sys
import numpy as np
from sensor import SensorModel, shipped, simulate
from sensor.kernels.advance import advance_pixels

for target in sys.argv[1:]:
    del shipped.TARGETS[target]
rng = np.random.default_rng(0)
t_s = np.cumsum(rng.choice([2e-4, 1e-3, 5e-3, 0.03], size=40))
frames = np.exp(rng.normal(size=(40, 90, 120)).cumsum(axis=0) / 4)
noise = {"shot_noise_hz": 50.0, "hot_pixel_fraction": 0.01, "leak_hz": 1.0, "random_start": True}
noise |= {"threshold_mismatch": 0.03, "refractory_s": 1e-4}
digest, count = hashlib.sha256(), 0
for filter in ({}, {"cutoff_hz": 200.0}, {"cutoff_hz": 200.0, "cutoff_reference": 1.0}):
    for width, height in (120, 90), (70, 53):
        model = SensorModel(width=width, height=height, **noise, **filter)
        events = simulate(frames, t_s, model, seed=1)
        count += len(events)
        for column in (events.t_us, events.x, events.y, events.p):
            digest.update(column.tobytes())
print(digest.hexdigest(), count, sum(advance_pixels.stats.cache_misses.values()))
"""


@pytest.fixture
def cache(tmp_path):
    """An empty cache; in tests nothing is compiled in the background unless it is asked for."""
    return {"NUMBA_CACHE_DIR": str(tmp_path / "numba")}


needs_v3 = pytest.mark.skipif(not shipped.runs_here("x86-64-v3"), reason="needs x86-64-v3")


@needs_v3
def test_the_first_simulation_does_not_compile(run, cache):
    """Promise: it takes 2 s of CPU time at most, Python's start included."""
    assert float(run("python", "-c", FIRST, **cache)) < 2.0


@needs_v3
def test_the_wheels_code_fires_the_events_of_the_hosts(run, cache):
    """Promise: to the bit, so that runs may mix them, with noise, filters and coarse pixels."""
    found = [run("python", "-c", BITS, *without, **cache) for without in ((), ("x86-64-v4",))]
    host = run("python", "-c", BITS, **cache, ERES_COMPILE="host")
    assert [int(one.split()[2]) for one in (*found, host)] == [0, 0, 1]
    assert len({one.split()[0] for one in (*found, host)}) == 1
    assert int(host.split()[1]) > 5e5


@needs_v3
def test_the_next_start_has_the_code_of_the_host(run, cache):
    """Promise: a first start begins one process that compiles, which others do not wait for."""
    run("python", "-c", FIRST, **cache, ERES_COMPILE="on")
    (lock,) = Path(cache["NUMBA_CACHE_DIR"]).rglob("eres_background.lock")
    with lock.open() as file:
        with pytest.raises(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        assert float(run("python", "-c", FIRST, **cache, ERES_COMPILE="on")) < 2.0
        fcntl.flock(file, fcntl.LOCK_EX)  # waits
    assert float(run("python", "-c", FIRST, **cache, ERES_COMPILE="host")) < 2.0


def test_a_study_runs_to_its_report(run, wheel):
    """Promise: the smallest study, from the packaged scene to the report, with its extra."""
    run("pip", "install", "--quiet", *PINNED, f"{wheel}[study]")
    small = ("--resolution", "256", "--samples", "1")
    said = run("eres", "study", "--preset", "quick", *small, "--out", "run")
    assert "report: run/report.html" in said
    report = (run.folder / "run" / "report.html").read_text()
    assert "carpet" in report
    assert (run.folder / "run" / "tables.csv").is_file()
    assert "as installed" in (run.folder / "run" / "environment.json").read_text()
    run("eres", "report", "run")
