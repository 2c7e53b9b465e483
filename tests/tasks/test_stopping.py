"""Commands that a signal ends, and files that appear or are left meanwhile."""

import os
import shutil
import signal
import subprocess
import sys

import cv2
import numpy as np
import pytest

from another_process import environment
from eres_render.errors import RenderError
from eres_render.storage import atomic
from event_streams import assert_same, random_events
from sensor.formats import dsec, load_events, write_events

EVENTS = random_events(500)


@pytest.fixture
def source(tmp_path):
    """Write a file of events, beside the folder that the tests write to."""
    write_events(tmp_path / "in.npz", EVENTS)
    (tmp_path / "out").mkdir()
    return tmp_path / "in.npz"


@pytest.fixture
def while_writing(monkeypatch):
    """Return a function that sets what happens once while HDF5 is written."""

    def set_action(action):
        append, actions = dsec._append, [action]

        def acting(*arguments):
            if actions:
                actions.pop()()
            append(*arguments)

        monkeypatch.setattr(dsec, "_append", acting)

    return set_action


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
@pytest.mark.parametrize("command", ["convert", "simulate"])
def test_a_signal_ends_a_command(source, while_writing, eres, name, command):
    """Promise: exit code 128 + N, one line, no file; the handlers are those from before."""
    number, out = getattr(signal, name), source.parent / "out" / "events.h5"
    arguments = [source, out]
    if command == "simulate":
        images = source.parent / "images"
        images.mkdir()
        for k in range(3):
            image = np.random.default_rng(k).integers(0, 255, (8, 8), np.uint8)
            cv2.imwrite(str(images / f"{k}.png"), image)
        arguments = [images, "--fps", 30, "--out", out]
    before = signal.getsignal(number)
    while_writing(lambda: signal.raise_signal(number))
    code, _, err = eres(command, *arguments)
    assert (code, err.splitlines()[-1]) == (128 + number, "stopped")
    assert "Traceback" not in err
    assert list(out.parent.iterdir()) == []
    assert signal.getsignal(number) is before


# What the command line does is code of the tests: its imports alone would take a second.
COMMAND = """
import ctypes, signal, sys, time, types
from tasks.cli import main

def run():
{}

stub = types.ModuleType("tasks.cli.command_line")
stub.run = run
sys.modules[stub.__name__] = stub
main.__globals__["_TOGETHER_S"] = 0.2
main()
"""


def ended(code, **how):
    """Run a command of its own in a process; return its exit status and lines of stderr."""
    lines = "\n".join(f"    {line}" for line in code.strip().splitlines())
    run = [sys.executable, "-c", COMMAND.format(lines)]
    done = subprocess.run(run, capture_output=True, text=True, env=environment(), **how)
    return done.returncode, done.stderr.splitlines()


def test_errors_on_the_way_out_do_not_hide_the_signal():
    """Promise: a closed terminal, which raises an error as a bar is removed, is not a failure."""
    code = """
try:
    signal.raise_signal(signal.SIGHUP)
finally:
    raise OSError(5, "Input/output error")
"""
    assert ended(code) == (129, ["stopped"])


@pytest.mark.parametrize("where", ["a call from C", "a finalizer"])
def test_no_signal_is_lost(where):
    """Promise: it ends the command also if it comes where Python drops all exceptions."""
    code = {
        "a call from C": "ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGTERM))()",
        "a finalizer": "class A:\n    __del__ = lambda _: signal.raise_signal(signal.SIGTERM)\nA()",
    }[where]
    assert ended(f"{code}\ntime.sleep(20)") == (143, ["stopped"])


def test_a_second_signal_ends_a_cleanup_that_takes_long():
    """Promise: one that comes with the first changes nothing; a later one ends the process."""
    code = """
try:
    signal.raise_signal(signal.SIGTERM)
finally:
    signal.raise_signal(signal.SIGHUP)
    print("cleaning up", file=sys.stderr, flush=True)
    time.sleep(0.3)
    signal.raise_signal(signal.SIGTERM)
    time.sleep(20)
"""
    assert ended(code) == (-signal.SIGTERM, ["cleaning up"])


def test_nohup():
    """Promise: a signal that is ignored at the start does not end a command."""
    ignoring = {"preexec_fn": lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN)}
    assert ended("signal.raise_signal(signal.SIGHUP)", **ignoring) == (0, [])


# Is killed while both packages write files.
KILLED = """
import os, signal, sys
from pathlib import Path
from eres_render.storage.atomic import new_file
from event_streams import random_events
from sensor.formats import batching, write_events

batching.PART_EVENTS = 100

def parts():
    yield random_events(1000)
    os.kill(os.getpid(), signal.SIGKILL)

folder = Path(sys.argv[1])
with new_file(folder / "card.md") as file:
    file.write_bytes(b"half")
    write_events(folder / "events.h5", parts())
"""


def test_what_a_killed_process_leaves_is_removed(source, eres, caplog):
    """Promise: by the next command on that file; what is being written, or was left by another
    machine, is kept, and the latter named."""
    folder = source.parent / "out"
    subprocess.run([sys.executable, "-c", KILLED, str(folder)], env=environment())
    of_card, of_events = sorted(folder.glob("*.unfinished"))
    assert of_card.name.startswith(f".card.md.{atomic._machine()}.")
    assert of_events.name.startswith(f".events.h5.{atomic._machine()}.")
    elsewhere = folder / of_events.name.replace(f".{atomic._machine()}.", ".node7.")
    shutil.copy(of_events, elsewhere)
    shutil.copy(of_events.with_suffix(".lock"), elsewhere.with_suffix(".lock"))
    with atomic.new_file(folder / "events.h5") as written:
        written.write_bytes(b"half")
        out = folder / "events.h5"
        code = eres("convert", source, out)[0]
        assert (code, str(elsewhere) in caplog.text, "node7" in caplog.text) == (0, True, True)
        assert set(folder.glob("*.unfinished")) == {of_card, elsewhere, written}
        assert_same(load_events(out), EVENTS)
    atomic.clear_unfinished(folder)
    assert set(folder.iterdir()) == {elsewhere, elsewhere.with_suffix(".lock"), out}


@pytest.mark.parametrize("links", [True, False])
def test_a_file_that_appears_meanwhile_is_kept(source, while_writing, eres, links, monkeypatch):
    """Promise: without --overwrite a command replaces no file, also not at its end."""
    if not links:
        monkeypatch.setattr(os, "link", no_links)
    out = source.parent / "out" / "events.h5"
    while_writing(lambda: out.write_bytes(b"mine"))
    code, _, err = eres("convert", source, out)
    assert (code, f"error: {out}: appeared meanwhile" in err) == (1, True)
    assert (out.read_bytes(), list(out.parent.iterdir())) == (b"mine", [out])
    assert eres("convert", source, out, "--overwrite")[0] == 0
    assert_same(load_events(out), EVENTS)
    out.unlink()
    assert eres("convert", source, out)[0] == 0
    assert_same(load_events(out), EVENTS)


def no_links(*_):
    """Fail as a file system without links does."""
    raise PermissionError(1, "Operation not permitted")


@pytest.mark.parametrize("links", [True, False])
def test_other_files_that_appear_meanwhile_are_kept(tmp_path, links, monkeypatch):
    """Promise: the same for all other files."""
    if not links:
        monkeypatch.setattr(os, "link", no_links)
    file = tmp_path / "profile.toml"
    atomic.write_text(file, "first", overwrite=False)
    with pytest.raises(RenderError, match=f"^{file}: appeared meanwhile"):
        atomic.write_text(file, "second", overwrite=False)
    assert (file.read_text(), list(tmp_path.iterdir())) == ("first", [file])
    atomic.write_text(file, "third")
    assert file.read_text() == "third"
