"""The command line: arguments in, library calls, results on stdout, errors in one line."""

from __future__ import annotations

import io
import logging
import os
import sys
import warnings
from importlib.metadata import version
from types import ModuleType

from rich.text import Text
from tyro.conf import DisallowNone, FlagCreatePairsOff

from eres_render.errors import RenderError
from sensor.errors import EventError, SensorError
from tasks import DISTRIBUTION
from tasks.cli import (
    dataset,
    evaluate,
    events,
    fit,
    info,
    light,
    lists,
    rig,
    study,
    terminal,
    train,
    video,
    view,
)
from tasks.cli.app import commands
from tasks.errors import TaskError, UsageError

_COMMANDS = (
    *(lists.doctor, lists.scenes, lists.sensors, lists.methods),
    *(light.bake, light.render, light.stereo, light.truth, light.images, light.convergence),
    *(events.simulate, events.convert),
    fit.fit,
    dataset.dataset,
    view.view,
    video.video,
    evaluate.evaluate,
    *(study.study, study.report, study.claims),
    info.info,
)
_RIG_COMMANDS = (
    *(rig.page, rig.render, rig.intrinsics),
    *(rig.detect, rig.solve, rig.crop, rig.evaluate),
)
_TRAIN_COMMANDS = (train.reconstruction, train.flow, train.card)
_GROUPS = {rig: _RIG_COMMANDS, train: _TRAIN_COMMANDS}


def command_names() -> list[str]:
    """Return the names of all commands."""
    names = [command.__name__ for command in _COMMANDS]
    for group, inner in _GROUPS.items():
        names += [f"{_name(group)} {command.__name__}" for command in inner]
    return names


def _name(group: ModuleType) -> str:
    return group.__name__.rpartition(".")[2]


class _ToTerminal(logging.Handler):
    """Prints messages, each as one line: above a progress bar, and in files without line breaks."""

    def emit(self, record: logging.LogRecord) -> None:
        terminal.err.print(self.format(record), soft_wrap=True, highlight=False)


def run() -> None:
    """Run the command line; exit code 1 for an error, 2 for wrong usage."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")  # names of files may not be UTF-8
    # What libraries would print of a damaged image beside its error.
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    warnings.filterwarnings("ignore", category=UserWarning, module="PIL")
    logging.basicConfig(level=logging.INFO, format="%(message)s", handlers=[_ToTerminal()])
    overview = sys.argv[1:] in ([], ["-h"], ["--help"])
    try:
        if sys.argv[1:] == ["--version"]:
            from tasks.provenance import code

            terminal.say(f"eres {version(DISTRIBUTION)} ({code()}), Mitsuba {version('mitsuba')}")
            return
        app = commands(_COMMANDS, overview=overview)
        for group, inner in _GROUPS.items():
            named = sys.argv[1:2] == [_name(group)] and sys.argv[2:] in ([], ["-h"], ["--help"])
            nested = commands(inner, overview=overview or named)
            app.command(nested, name=_name(group), help=group.__doc__)
        status = app.cli(
            prog="eres",
            config=(DisallowNone, FlagCreatePairsOff),
            description="Which event-camera resolution serves a task best, at what bandwidth? "
            "Renders HDR radiance, turns it into events at any resolution, and scores what can "
            "be done with them. `eres --version` prints the version.",
        )
    except UsageError as error:
        _fail(str(error), 2)
    except (RenderError, SensorError, EventError, TaskError) as error:
        _fail(str(error))
    except BrokenPipeError:  # the reader has what it wants; Python would complain at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)  # as Rich does
    except OSError as error:
        _fail(f"{error.filename or 'system'}: {error.strerror or error}")
    except MemoryError as error:
        _fail(f"out of memory: {error}; choose a lower resolution")
    sys.exit(status or 0)


def _fail(text: str, code: int = 1) -> None:
    line = text.replace("\n", r"\n")  # of names in files
    terminal.err.print(Text("error:", "red"), line, soft_wrap=True, highlight=False)
    sys.exit(code)
