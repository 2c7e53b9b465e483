"""The command line: arguments in, library calls, results on stdout, errors in one line."""

from __future__ import annotations

import io
import itertools
import logging
import os
import re
import sys
import warnings
from importlib.metadata import version
from types import ModuleType

from rich.text import Text
from tyro.conf import DisallowNone, FlagCreatePairsOff

from eres_render.errors import RenderError, suggestion
from sensor.errors import EventError, SensorError
from tasks import DISTRIBUTION
from tasks.cli import rig, terminal, train
from tasks.cli.advise import advise
from tasks.cli.app import commands, wrapped
from tasks.cli.dataset import dataset
from tasks.cli.evaluate import evaluate
from tasks.cli.events import convert, info, simulate, video, view
from tasks.cli.fit import fit
from tasks.cli.light import bake, convergence, images, render, stereo, truth
from tasks.cli.lists import doctor, methods, scenes, sensors
from tasks.cli.study import claims, report, study
from tasks.errors import TaskError, UsageError
from tasks.extras import advice

_DESCRIPTION = """Which event-camera resolution serves a task best, at what bandwidth? Renders HDR
radiance, turns it into events at any resolution, and scores what can be done with them.
`eres --version` prints the version."""
_UNIT = re.compile(r"_(s|px|hz|m|lux)$")  # at the end of a field
_OF_SCENES = doctor, scenes, sensors, methods, bake, render, stereo, truth, images, convergence
_OF_EVENTS = simulate, convert, fit, dataset, view, video, evaluate
_OF_STUDIES = study, report, claims, info, advise
_COMMANDS = *_OF_SCENES, *_OF_EVENTS, *_OF_STUDIES
# The extra that is named if it has the package that is missing.
_NEED_LIGHT = "bake", "convergence", "dataset", "evaluate", "render", "truth", "view"
_JOBS = {
    **dict.fromkeys(_NEED_LIGHT, "render"),
    **dict.fromkeys(("claims", "report", "rig", "study"), "study"),
    "train": "learned",
}
_GROUPS = {
    rig: (rig.page, rig.render, rig.intrinsics, rig.detect, rig.solve, rig.crop, rig.evaluate),
    train: (train.reconstruction, train.flow, train.card),
}


def command_names() -> list[str]:
    """Return the names of all commands."""
    names = [command.__name__ for command in _COMMANDS]
    for group, inner in _GROUPS.items():
        names += [f"{_name(group)} {command.__name__}" for command in inner]
    return names


def _name(group: ModuleType) -> str:
    return group.__name__.rpartition(".")[2]


def _check_command(given: list[str]) -> None:
    """Refuse an unknown command, with the names that are most like it."""
    names = [name.split() for name in command_names()]
    for k, word in enumerate(itertools.takewhile(lambda word: word[:1] != "-", given)):
        known = dict.fromkeys(name[k] for name in names if name[:k] == given[:k] and name[k:])
        if known and word not in known:
            command = " ".join(["eres", *given[:k]])
            raise UsageError(f"{command} has no command {word!r}; {suggestion(word, known)}")


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
    if sys.argv[1:] == [] or sys.argv[1:] in [[_name(group)] for group in _GROUPS]:
        sys.argv.append("--help")
    try:
        if sys.argv[1:] == ["--version"]:
            from tasks.provenance import code

            terminal.say(f"eres {version(DISTRIBUTION)} ({code()})")
            return
        _check_command(sys.argv[1:])
        app = commands(_COMMANDS, given=sys.argv[1:2])
        for group, inner in _GROUPS.items():
            nested = commands(inner, given=sys.argv[2:3])
            app.command(nested, name=_name(group), help=group.__doc__)
        status = app.cli(
            prog="eres",
            config=(DisallowNone, FlagCreatePairsOff),
            description=wrapped(_DESCRIPTION),
        )
    except UsageError as error:
        _fail(str(error), 2)
    except (RenderError, SensorError, EventError, TaskError, ModuleNotFoundError) as error:
        missing = advice(error, _JOBS.get(sys.argv[1]))
        if missing is None and isinstance(error, ModuleNotFoundError):
            raise
        _fail(missing or str(error))
    except BrokenPipeError:  # the reader has what it wants; Python would complain at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)  # as Rich does
    except OSError as error:
        _fail(f"{error.filename or 'system'}: {error.strerror or error}")
    except MemoryError as error:
        _fail(f"out of memory: {error}; choose a lower resolution")
    sys.exit(status or 0)


def _with_option(text: str) -> str:
    """Return an error with the option that was given in place of the field that it begins with."""
    field, colon, rest = text.partition(":")
    option = f"--{_UNIT.sub('', field).replace('_', '-')}"
    given = any(word.partition("=")[0] == option for word in sys.argv)
    return f"{option}{colon}{rest}" if given else text


def _fail(text: str, code: int = 1) -> None:
    line = _with_option(text).replace("\n", r"\n")  # of names in files
    terminal.err.print(Text("error:", "red"), line, soft_wrap=True, highlight=False)
    sys.exit(code)
