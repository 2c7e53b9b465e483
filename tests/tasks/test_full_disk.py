"""A full disk: one line that names the file, exit code 1, no partial files.

A limit on the size of files, which any system has, acts as the full disk; if the test can mount a
file system, it also fills a real one.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from eres_render import load_scene, render_scene
from event_streams import SUFFIXES, random_events
from light_scenes import small_carpet_folder
from sensor import SensorModel
from sensor.formats import write_events

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
NOTES = ("1 job to do: ", "jit_kernel_write(): ")  # a study's cost; Dr.Jit on a cache of its own

# Commands, one after the other in one process, each under its limit; then the process ends, which
# is when HDF5 releases files that it could not close.
COMMANDS = """
import json, resource, sys
from tasks import cli

codes = []
for limit, arguments in json.loads(sys.argv[1]):
    none = resource.RLIM_INFINITY
    resource.setrlimit(resource.RLIMIT_FSIZE, (none if limit is None else limit, none))
    sys.argv = ["eres", *arguments]
    try:
        cli.main()
        codes.append(0)
    except SystemExit as stop:
        codes.append(stop.code or 0)
    print("----", file=sys.stderr, flush=True)
print("codes", codes)
"""


def run(*commands):
    """Run (limit in bytes or None, arguments) pairs; return the exit code and stderr of each."""
    asked = json.dumps([(limit, list(map(str, arguments))) for limit, arguments in commands])
    # Or a limit would cut off the bytecode of a module, which Python then cannot load any more.
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", COMMANDS, asked], capture_output=True, text=True, env=environment
    )
    assert done.returncode == 0, f"{done.returncode}\n{done.stdout}\n{done.stderr}"
    codes = json.loads(done.stdout.splitlines()[-1].removeprefix("codes "))
    return list(zip(codes, done.stderr.split("----\n")[:-1], strict=True))


def assert_refused(outcome, path, reason):
    """Check for exit code 1 and one line: the file, and the system's words for the error."""
    code, err = outcome
    (line,) = (line for line in err.splitlines() if not line.startswith(NOTES))
    assert code == 1
    assert line.startswith(f"error: {path}: ")
    assert line.rstrip(".").endswith(reason)
    assert "unfinished" not in err


@pytest.fixture(scope="module")
def events(tmp_path_factory):
    """Return a file of 200,000 events of a sensor, and its size in each format."""
    folder = tmp_path_factory.mktemp("events")
    source = folder / "events.npz"
    stream = random_events(200_000, model=SensorModel(width=640, height=480))
    write_events(source, stream, origin={"seed": 3})
    sizes = {}
    for name in SUFFIXES:
        write_events(folder / "a", stream, format=name)
        sizes[name] = (folder / "a").stat().st_size
    return source, sizes


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    """Render a clip of 32 x 32 px."""
    folder = tmp_path_factory.mktemp("clip")
    scene = load_scene(small_carpet_folder(folder / "carpet"))
    return render_scene(
        scene, folder / "r", resolution=32, spp=1, max_displacement_px=1.0, samples=1
    )[0]


def test_no_room_for_events(events, tmp_path):
    """Promise: for a full disk anywhere in the file, in any format, also within its last bytes.
    HDF5 used to end the process there with a segmentation fault."""
    source, sizes = events
    out = {name: tmp_path / f"{name}{SUFFIXES[name]}" for name in SUFFIXES}
    tried = [(name, size) for name in SUFFIXES for size in (0, 5000, sizes[name] // 2, sizes[name])]
    outcomes = run(
        *(
            (max(0, size - 1), ["convert", source, out[name], "--format", name])
            for name, size in tried
        )
    )
    for (name, _), outcome in zip(tried, outcomes, strict=True):
        assert_refused(outcome, out[name], "File too large")
    assert list(tmp_path.iterdir()) == []


def test_no_room_for_truth(sequence, tmp_path, eres):
    """Promise: a file of events with truth that does not fit does not appear, made or copied."""
    whole, out = tmp_path / "whole" / "out.h5", tmp_path / "out.h5"
    whole.parent.mkdir()
    simulate = ["simulate", sequence.folder, "--resolution", 32, "--truth", 0.005, "--out"]
    assert eres(*simulate, whole)[0] == 0
    limits = [whole.stat().st_size * k // 10 for k in (1, 5, 7, 9)]
    copied = [(limit, ["convert", whole, out]) for limit in limits]
    for outcome in run(*((limit, [*simulate, out]) for limit in limits), *copied):
        assert_refused(outcome, out, "File too large")
    shutil.rmtree(whole.parent)
    assert list(tmp_path.iterdir()) == []


def test_no_room_for_frames_for_a_folder_of_truth_or_for_a_study(sequence, tmp_path):
    """Promise: a render names the file, keeps complete files, and leaves no partial ones; a folder
    of truth is complete, or absent; a study names the file as well."""
    scene, out = sequence.manifest.scene_source, tmp_path / "r"
    render = ["render", scene, "--resolution", 32, "--spp", 1, "--samples", 1, "--out"]
    true, study = tmp_path / "truth", tmp_path / "run"
    first = sequence.folder / "frames" / "000000.exr"
    *_, text, frame, depth, job = run(
        (None, [*render, tmp_path / "one"]),  # compiles and caches, without a limit
        (None, [*render, tmp_path / "two"]),
        (100, [*render, out]),
        (first.stat().st_size - 1, [*render, out]),
        (1500, ["truth", sequence.folder, "--out", true, "--width", 32, "--step", 0.01]),
        (100, ["study", "--out", study, "--samples", 1, "--resolution", 128]),
    )
    assert_refused(text, out / "clip_000" / "poses.txt", "File too large")
    assert_refused(frame, out / "clip_000" / "frames" / "000000.exr", "File too large")
    kept = {path.name for path in out.rglob("*") if path.is_file()}
    assert kept == {"manifest.json", "poses.txt", "path.txt", "SHA256SUMS"}
    assert_refused(depth, true / "depth" / "000000.exr", "File too large")
    assert not true.exists()
    assert_refused(job, study / "study.json", "File too large")
    assert list(study.iterdir()) == []


def test_a_file_system_that_is_full(events, tmp_path):
    """Promise: the same when no file is too large, but the disk is full."""
    mounted = ["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(tmp_path)]
    if shutil.which("mount") is None or subprocess.run(mounted, capture_output=True).returncode:
        pytest.skip("no file system can be mounted here")
    try:
        out = {name: tmp_path / f"{name}{SUFFIXES[name]}" for name in SUFFIXES}
        outcomes = run(*((None, ["convert", events[0], out[n], "--format", n]) for n in SUFFIXES))
        for name, outcome in zip(SUFFIXES, outcomes, strict=True):
            assert_refused(outcome, out[name], "No space left on device")
        assert list(tmp_path.iterdir()) == []
    finally:
        subprocess.run(["umount", str(tmp_path)], check=True)
