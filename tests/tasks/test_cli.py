"""The command line: help, exit codes, one clear line for every mistake, no partial files."""

import errno
import json
import logging
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from another_process import environment
from eres_render.rendering import backend
from eres_render.rendering.backend import VariantVerdict
from sensor import SensorError, SensorModel, camera_names
from sensor.events import no_events
from sensor.formats import write_events
from tasks import provenance
from tasks.cli.camera_options import CameraOptions
from tasks.cli.command_line import _ToTerminal, command_names
from tasks.cli.events import simulate
from tasks.errors import TaskError
from tasks.evaluation.sensor_setting import Setting


def test_version_and_lists(eres):
    """Promise: --version, scenes and methods print to stdout; a version has the commit."""
    said = eres("--version")[1]
    assert re.fullmatch(r"eres \d+\.\d+\.\d+ \([^()]+\)\n", said)
    assert provenance.code() in said
    with open("/dev/full", "w") as full:
        run = [sys.executable, "-c", "import tasks.cli; tasks.cli.main()", "--version"]
        ended = subprocess.run(run, stdout=full, stderr=subprocess.PIPE, text=True)
    assert (ended.returncode, ended.stderr) == (1, "error: system: No space left on device\n")
    code, out, _ = eres("scenes")
    assert (code, "carpet" in out, "0.9 m/s" in out) == (0, True, True)
    assert "event_integration" in eres("methods")[1]


@pytest.mark.parametrize("command", command_names())
def test_every_command_explains_itself(eres, command):
    """Promise: help exits 0 and describes the command and each of its options. An option that is
    not set has no (default: None)."""
    code, out, _ = eres(*command.split(), "--help")
    assert code == 0
    assert len(out.splitlines()) > 3
    boxes = [line for line in out.splitlines() if line.startswith(("│", "╰"))]
    shown = " ".join(" ".join(boxes).replace("│", " ").split())
    next_one = r"\((?:default|required)|--[a-z]|╰"
    assert not re.findall(rf"--[a-z][\w-]* (?:[A-Z{{]\S* )?(?:{next_one})", shown)
    assert not re.findall(r"\(default: (?:None|False)\)", shown)


@pytest.mark.parametrize("command", ["", "simulate", "fit"])
def test_help_breaks_lines_between_words(eres, monkeypatch, command):
    """Promise: no line is wider than the terminal, which would break it inside a word."""
    monkeypatch.setenv("COLUMNS", "80")
    _, *lines = eres(*command.split(), "--help")[1].splitlines()
    assert max(map(len, lines)) <= 80


def test_a_command_may_run_any_number_of_times(eres):
    """Promise: a call leaves commands as they are, so that the thousandth is as fast as the second,
    in a notebook too."""
    parts = simulate, CameraOptions
    eres("methods")
    before = [dict(one.__annotations__) for one in parts]
    eres("methods")
    assert [one.__annotations__ for one in parts] == before


@pytest.mark.parametrize(
    ("command", "hints"),
    [("evaluate", ["1.0", "20"]), ("study", ["quick", "this process"])],
)
def test_help_says_what_an_option_is_that_is_not_given(eres, command, hints):
    """Promise: where None stands for a value that the command chooses, help has that value."""
    shown = " ".join(eres(command, "--help")[1].replace("│", " ").split())
    assert [hint for hint in hints if f"(default: {hint})" not in shown] == []


@pytest.mark.parametrize(
    "arguments",
    [
        ["rig", "solve", "--out", "c.json"],
        ["rig", "crop", "--calibration", "c.json", "--out", "crops"],
        ["rig", "evaluate", "--out", "run"],
        ["rig", "intrinsics", "--out", "c.yaml", "--board", 5, 5, "--square", 0.02],
        ["train", "card"],
        ["view", "--out", "v.png"],
        ["claims"],
    ],
    ids=lambda one: " ".join(map(str, one[:2])),
)
def test_a_missing_argument_is_wrong_usage(eres, tmp_path, monkeypatch, arguments):
    """Promise: exit code 2, also where an argument may be given several times."""
    monkeypatch.chdir(tmp_path)
    code, out, err = eres(*arguments)
    assert (code, out) == (2, "")
    assert err
    assert not [*tmp_path.iterdir()]


def test_a_reader_that_closes_the_pipe_gets_no_error():
    """Promise: `eres render --help | head -1` prints nothing on stderr."""
    code = "import sys; from tasks.cli import main; sys.argv = ['eres', 'render', '--help']; main()"
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, "-c", code], stdout=writing, stderr=subprocess.PIPE, env=environment()
    )
    os.close(writing)
    assert (done.returncode, done.stderr) == (1, b"")


def test_help_lists_the_commands_in_short(eres):
    """Promise: the list of commands fits a screen; each command's own help has the rest."""
    code, out, _ = eres("--help")
    assert (code, len(out.splitlines()) < 45) == (0, True)
    assert all(f"• {command.partition(' ')[0]} " in out for command in command_names())
    assert "After an interruption" not in out
    assert "After an interruption" in eres("render", "--help")[1]


@pytest.mark.parametrize(
    ("args", "code", "text"),
    [
        (["render", "carpt", "--out", "{tmp}/r"], 1, "did you mean 'carpet'"),
        (["render", "carpet", "--out", "{tmp}/r", "--spp", "5"], 1, "spp: found 5"),
        (["render", "carpet", "--out", "{tmp}/r", "--samples", "99"], 1, "samples: found 99"),
        (["render", "carpet", "--out", "{tmp}/file/r", "--resolution", "8"], 1, "file: found a f"),
        (["study", "--preset", "quik", "--out", "{tmp}/r"], 1, "did you mean 'quick'"),
        (["simulat", "clip.mp4"], 2, "eres has no command 'simulat'; did you mean 'simulate'?"),
        (["rig", "sovle", "--out", "{tmp}/r"], 2, "eres rig has no command 'sovle'; did you mean"),
        (["study", "--resolution", "100", "--out", "{tmp}/r"], 1, "at least 128 px"),
        (["study", "--out", "{tmp}/file"], 1, "found a file, expected a folder"),
        (["study", "--out", "{tmp}/file/r"], 1, "file"),
        (["study", "{tmp}/none.toml", "--out", "{tmp}/r"], 1, "none.toml: no such file"),
        (
            ["study", "{tmp}/my.toml", "--preset", "paper", "--out", "{tmp}/r"],
            1,
            "or --preset paper",
        ),
        (["study", "--method", "nowhere:f", "--out", "{tmp}/r"], 1, "cannot be imported"),
        (["evaluate", "{tmp}/none", "--task", "flow"], 1, "none"),
        (["claims", "{tmp}/none"], 1, "none/rows.parquet: no such file"),
        (["report", "{tmp}/none"], 1, "none/rows.parquet: no such file"),
        (["info", "{tmp}/none"], 1, "none"),
        (["bake", "nowhere"], 1, "nowhere"),
        (["studdy"], 2, "studdy"),
        (["study"], 2, "--out"),
        (["render", "carpet", "--out", "{tmp}/r", "--spp", "many"], 2, "many"),
    ],
)
def test_mistakes_get_one_clear_line(eres, tmp_path, args, code, text):
    """Promise: exit code 1 with one line, 2 for usage; no traceback, no files."""
    (tmp_path / "file").write_text("in the way")
    got, out, err = eres(*[arg.format(tmp=tmp_path) for arg in args])
    assert got == code
    assert text in out + err
    if code == 1:
        assert len(err.strip().splitlines()) == 1, err
        assert err.startswith("error: ")
        assert sorted(p.name for p in tmp_path.rglob("*")) == ["file"]


def test_a_speed_leaves_a_microsecond_of_a_window():
    """Promise: a higher one is refused by name, before anything divides by its length."""
    with pytest.raises(TaskError, match=r"speed: 1e\+06 makes a window shorter than 1 us"):
        Setting(SensorModel(width=64, height=64), 1e6, 0, 0)


def test_full_disk_is_said_and_leaves_nothing(eres, tmp_path, monkeypatch):
    """Promise: when the disk is full one line says so, and no file has a final name."""

    def full(self, data):
        raise OSError(errno.ENOSPC, "No space left on device", str(self))

    monkeypatch.setattr(Path, "write_bytes", full)
    code, _, err = eres("study", "--out", tmp_path / "run")
    assert code == 1
    assert "No space left on device" in err
    assert not [p for p in tmp_path.rglob("*") if p.is_file()]


def test_programs_get_json(eres, tmp_path):
    """Promise: lists and descriptions are JSON with --json, without inf and tables."""
    camera = json.loads(eres("sensors", "davis346", "--json")[1])["davis346"]
    assert (camera["width"]["value"], camera["bus"]["unit"]) == (346, "Mev/s")
    assert len(json.loads(eres("sensors", "--json")[1])) == len(camera_names())
    listed = json.loads(eres("methods", "--json")[1])
    assert "photometric_flow" in {row["method"] for row in listed if row["task"] == "flow"}
    write_events(tmp_path / "none.h5", no_events(4, 3, None))
    assert json.loads(eres("info", tmp_path / "none.h5", "--json")[1])["events"] == "0"


@pytest.mark.parametrize("group", [(), ("rig",), ("train",)])
def test_without_a_command_there_is_help(eres, group):
    """Promise: `eres` alone, and a group of commands alone, print what --help prints."""
    assert eres(*group) == eres(*group, "--help")
    assert eres(*group)[0] == 0


@pytest.mark.parametrize("works", [True, False])
def test_the_doctor_says_what_works(eres, monkeypatch, works):
    """Promise: each variant of Mitsuba and the sensor's GPU, with the reason where one fails; exit
    code 1 where nothing renders."""
    verdicts = [
        VariantVerdict("cuda_ad_mono", False, 0.1, "no driver"),
        VariantVerdict("llvm_ad_mono", works, 1.25, "" if works else "no LLVM"),
    ]

    def simulated(*given, device):
        if not works:
            raise SensorError(f"device: found {device!r}, which does not work here: no GPU")

    monkeypatch.setattr(backend, "probe_variants", lambda: verdicts)
    monkeypatch.setattr("sensor.simulate", simulated)
    code, out, _ = eres("doctor")
    lines = {line.split()[0]: line for line in out.splitlines() if line.strip()}
    assert code == (0 if works else 1)
    assert "no driver" in lines["cuda_ad_mono"]
    assert ("first render in 1.2 s" if works else "no LLVM") in lines["llvm_ad_mono"]
    assert f"renders use: {'llvm_ad_mono' if works else 'no variant'}" in out
    assert lines["sensor,"].endswith("works" if works else "no: no GPU")


def test_info_on_nothing_names_the_path(eres, tmp_path):
    code, _, err = eres("info", tmp_path / "no.h5")
    assert code == 1
    assert "no.h5: no such file or folder" in err.replace("\n", "")


def test_a_message_is_a_line(capsys):
    """Promise: in a file or a pipe, messages have no line breaks or blanks that fill a line."""
    text = "found something, expected " + "x " * 200 + "y"
    handler = _ToTerminal()
    handler.emit(logging.LogRecord("eres", logging.WARNING, "", 0, text, None, None))
    assert capsys.readouterr().err == text + "\n"
