"""Several processes on one folder wait for each other, and none waits for a dead one."""

import errno
import os
import signal
import subprocess
import sys

import pytest

from another_process import environment
from eres_render import Clip, Renderer, load_scene, render_clip
from eres_render.errors import RenderError
from eres_render.rendering import lightmaps as bake
from eres_render.rendering.backend import select_variant
from eres_render.storage.checksums import read_sums
from eres_render.storage.exr import write_luminance
from eres_render.storage.locks import LockedError, locked
from light_scenes import room_folder, small_carpet_folder
from tasks.study.run import frame_cache


@pytest.fixture
def start():
    """Start processes that find the tests' modules, and kill them after the test."""
    started = []

    def begin(code):
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        command = [sys.executable, "-c", f"import sys; {code}"]
        process = subprocess.Popen(command, text=True, env=environment(), **pipes)
        started.append(process)
        return process

    yield begin
    for process in started:
        process.kill()
        process.communicate()


def tell(process, line):
    process.stdin.write(f"{line}\n")
    process.stdin.flush()


@pytest.fixture
def holder(start, tmp_path):
    """Start a process that holds a shared lock on `held` until it is killed."""
    process = start(
        "from pathlib import Path; from eres_render.storage.locks import locked\n"
        f"with locked(Path({str(tmp_path / 'held')!r}), shared=True):\n"
        "    print('holds', flush=True); sys.stdin.readline()"
    )
    assert process.stdout.readline() == "holds\n"
    return process


def test_a_lock_is_held_alone_or_shared_until_death(holder, tmp_path):
    """Promise: others can share a shared lock, but not own it alone; a killed holder holds
    nothing."""
    file = tmp_path / "held"
    with locked(file, shared=True, wait=False):
        pass
    with pytest.raises(LockedError), locked(file, wait=False):
        pass
    os.kill(holder.pid, signal.SIGKILL)
    holder.wait()
    with locked(file):
        assert file.exists()
        with pytest.raises(LockedError), locked(file, shared=True, wait=False):
            pass
    assert not file.exists()


def test_where_no_lock_can_be_the_folder_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    said = "file: found a file, expected a folder"
    with pytest.raises(RenderError, match=said), locked(tmp_path / "file/x"):
        pass


def test_a_disk_without_locks_is_named(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSYS, "Function not implemented")

    monkeypatch.setattr("fcntl.flock", refuse)
    said = rf"{tmp_path}: cannot be locked: Function not implemented; use a local disk"
    with pytest.raises(RenderError, match=said), locked(tmp_path / "x"):
        pass


@pytest.mark.slow
def test_one_at_a_time_though_the_file_comes_and_goes(start, tmp_path):
    """Promise: of three processes that take turns with a lock, only one is inside at a time."""
    code = (
        "import os; from pathlib import Path; from eres_render.storage.locks import locked\n"
        f"folder = Path({str(tmp_path)!r})\n"
        "print('ready', flush=True); sys.stdin.readline()\n"
        "for _ in range(400):\n"
        "    with locked(folder / 'lock'):\n"
        "        os.mkdir(folder / 'within'); os.rmdir(folder / 'within')"
    )
    crowd = [start(code) for _ in range(3)]
    assert [one.stdout.readline() for one in crowd] == ["ready\n"] * 3
    for one in crowd:
        tell(one, "go")
    assert [one.wait() for one in crowd] == [0] * 3
    assert not list(tmp_path.iterdir())


def test_clips_that_other_processes_use_are_not_removed(holder, tmp_path, monkeypatch):
    """Promise: the cache exceeds its limit rather than remove frames that are being read."""
    monkeypatch.setenv("ERES_CACHE", str(tmp_path))
    monkeypatch.setattr(frame_cache, "LIMIT_BYTES", 0)
    folder = tmp_path / "frames" / "clip"
    folder.mkdir(parents=True)
    (tmp_path / "held").rename(folder.with_name(".clip.lock"))
    frame_cache.make_room(1)
    assert folder.exists()
    os.kill(holder.pid, signal.SIGKILL)
    holder.wait()
    frame_cache.make_room(1)
    assert not list((tmp_path / "frames").iterdir())


RENDER = """
from pathlib import Path
from eres_render import Clip, Renderer, load_scene, render_clip
renderer = Renderer(load_scene({scene!r}), 64, 4)
print("ready", flush=True)
last = sys.stdin.readline().strip()
frames = []
def told(stage, done, total):
    frames.append(done)
    if str(done) == last:
        print("waits", flush=True)
        sys.stdin.readline()
render_clip(renderer, Clip(0, 1.0, 1.0, 1.2), Path({out!r}), 0.25, told)
print(len(frames))
"""


@pytest.mark.slow
def test_processes_that_render_one_clip_share_the_work(start, tmp_path):
    """Promise: no frame is rendered twice, even if the first process is killed; the clip is
    complete."""
    scene = small_carpet_folder(tmp_path / "carpet")
    code = RENDER.format(scene=str(scene), out=str(tmp_path / "clip"))
    crowd = first, second = [start(code) for _ in range(2)]
    renderer = Renderer(load_scene(scene), 64, 4)
    assert [one.stdout.readline() for one in crowd] == ["ready\n"] * 2
    tell(first, 5)
    assert first.stdout.readline() == "waits\n"
    tell(second, "none")
    begun = len(read_sums(tmp_path / "clip"))  # the fifth frame may still be on its way to disk
    assert begun >= 4
    first.kill()
    frames = []
    clip = Clip(0, 1.0, 1.0, 1.2)
    sequence = render_clip(renderer, clip, tmp_path / "clip", 0.25, lambda *at: frames.append(at))
    rendered = sorted([len(frames), int(second.stdout.readline())])
    assert second.wait() == 0
    assert rendered[0] == 0 < rendered[1] <= len(sequence) - begun
    assert sum(1 for _ in sequence) == len(sequence)
    assert not [f.name for f in (tmp_path / "clip").rglob("*") if f.name.startswith(".")]


@pytest.mark.slow
def test_a_bake_that_was_stopped_leaves_no_half_of_the_lightmaps(tmp_path, monkeypatch):
    """Promise: the cache has all lightmaps of a scene or none, because others look there too."""
    monkeypatch.setenv("ERES_CACHE", str(tmp_path / "cache"))
    lamp = '<emitter type="point"><point name="position" value="0 0 2.5"/></emitter></scene>'
    folder = room_folder(tmp_path / "room", ("</scene>", lamp))  # of seven surfaces
    for lightmap in folder.glob("lightmap_*.exr"):
        lightmap.unlink()
    scene = load_scene(folder)
    if select_variant().startswith("scalar"):
        pytest.skip("only vectorized variants bake")
    written = []

    def stopped(path, *image):
        if written:
            raise KeyboardInterrupt
        written.append(path)
        write_luminance(path, *image)

    with monkeypatch.context() as patch:
        patch.setattr(bake, "write_luminance", stopped)
        with pytest.raises(KeyboardInterrupt):
            bake.lightmaps(scene)
    assert len(written) == 1, "one of seven lightmaps was written before the stop"
    assert not bake.has_lightmaps(scene)
    assert len(bake.lightmaps(scene)) == 7
    assert [folder.suffix for folder in (tmp_path / "cache" / "lightmaps").iterdir()] == [""]
