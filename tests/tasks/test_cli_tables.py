"""Tables on stdout: every word is complete, at any width of the screen and in a pipe."""

import ast
import io
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.table import Table

from finished_runs import make_run
from light_scenes import small_carpet_folder
from study_rows import EI, EPF, EPPT, nothing_rows, paper_rows
from tasks import cli
from tasks.cli import terminal
from tasks.evaluation import convergence
from tasks.rig.calibration import SolvedRecording, StoredPose

ROOT = Path(__file__).parents[2]
SCREENS = {"40": (40, True), "80": (80, True), "pipe": (80, False)}
OWN = "my_group.my_own_methods_of_this_year:photometric_flow_with_everything"


SOLVED = SolvedRecording(
    recording="/recordings/a_recording_with_a_name_that_is_longer_than_the_screen",
    source="hf",
    width=346,
    height=260,
    pose=StoredPose(
        ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), (0.0,) * 3, (1.0, 0.0, 0.0), 1.0
    ),
    latency_ms=1.5,
    corner_bias_px=0.1,
    estimated=("x",),
    covariance=((1.0,),),
    rms_px=0.5,
    markers=20,
    inliers=19,
    images=5,
    x_m=(0.0, 0.2),
)


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """A clip in a folder with a name longer than the screen is wide, and its events."""
    folder = tmp_path_factory.mktemp("a_folder_of_which_the_name_is_much_longer_than_the_screen")
    scene = small_carpet_folder(folder / "scene_with_a_long_name_that_would_be_cut")
    options = ("--resolution", "64", "--spp", "1", "--samples", "1", "--out", str(folder / "clips"))
    events = folder / "events.npz"
    clip = folder / "clips" / "clip_000"
    run("render", scene, *options)
    run("simulate", clip, "--out", events, "--resolution", 32)
    return clip, events


@pytest.fixture(scope="module")
def finished_run(tmp_path_factory):
    """A run with a method of long name next to the paper's, with all data of its tables."""
    rows = [row for series in (EI, EPF, EPPT) for row in paper_rows(series, samples=2)]
    rows += paper_rows(EPF, samples=2, method=OWN)
    numbers = {}
    for row in [*rows, *nothing_rows(rows, 3.0)]:
        numbers.setdefault((row.task, row.method, row.variant, row.scene, row.width), {})[
            row.cutoff_hz, row.speed, row.sample, row.item
        ] = row
    rows = [row for cells in numbers.values() for row in cells.values()]
    return make_run(tmp_path_factory.mktemp("run"), rows)


def run(*args, screen="80"):
    """Run a command on a screen; return its output, and each table's words by their origin."""
    width, is_terminal = SCREENS[screen]
    out = io.StringIO()
    made = {}
    add_row = Table.add_row

    def watch(table, *cells, **options):
        code = sys._getframe(1).f_code
        words = made.setdefault((Path(code.co_filename).name, code.co_name), set())
        for cell in (*cells, *(column.header for column in table.columns)):
            words.update(str(cell).split())
        return add_row(table, *cells, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Table, "add_row", watch)
        patch.setattr(sys, "argv", ["eres", *map(str, args)])
        options = {"file": out, "width": width, "force_terminal": is_terminal, "color_system": None}
        patch.setattr(terminal, "out", terminal.Console(**options))
        with pytest.raises(SystemExit) as end:
            cli.main()
    assert end.value.code == 0, out.getvalue()
    return out.getvalue(), made


def every_table(clip, finished_run, screen):
    """Return the output of every command with a table, and the words of each table."""
    sequence, events = clip
    folder = Path(tempfile.mkdtemp(dir=events.parent))
    outcome = convergence.Outcome(convergence.USUAL, 123, 4_567_890, 12.345)
    fast = {"converge": lambda *_, **__: iter([outcome, outcome])}
    with pytest.MonkeyPatch.context() as patch:
        for name, function in fast.items():
            patch.setattr(convergence, name, function)
        patch.setattr("tasks.study.run.run_study", lambda *_, **__: [])
        patch.setattr("tasks.study.report.write_report", lambda run: run.folder / "report.html")
        patch.setattr("tasks.rig.recording.RigRecording", lambda path: SimpleNamespace(folder=path))
        patch.setattr("tasks.rig.calibration.solve_recording", lambda *_: SOLVED)
        patch.setattr("tasks.rig.calibration.read_truth", lambda _: None)
        patch.setattr("tasks.rig.markers.read_detections", lambda _: None)
        patch.setattr("tasks.rig.evaluate.evaluate_rig", lambda *_, **__: paper_rows(samples=1))
        problem = SimpleNamespace(score="PSNR [dB]", baselines=("high-pass filter", "gray"))
        trained = problem, {"200 Hz": [12.5, 11.5, 10.8]}
        without_torch = SimpleNamespace(start=lambda *_, **__: trained)
        patch.setitem(sys.modules, "tasks.learned.training.loop", without_torch)
        for args in (
            ("train", "reconstruction", "--out", folder),
            ("doctor",),
            ("scenes",),
            ("sensors",),
            ("methods",),
            ("convergence", "carpet"),
            ("evaluate", sequence, "--task", "flow", "--resolution", 32),
            ("evaluate", sequence, "--task", "tracking", "--resolution", 32),
            ("study", "--out", finished_run),
            ("claims", finished_run),
            ("fit", events, "--still", 0, 0.05, "--out", folder / "profile.toml"),
            ("sensors", "dvs128"),
            ("rig", "solve", sequence, "--out", folder / "calibration.json"),
            ("rig", "evaluate", folder, "--out", folder),
            ("advise", "--speed", 1, "--distance", 1, "--lux", 100, "--sensor", "davis346"),
            ("info", sequence),
            ("info", events),
        ):
            yield args, *run(*args, screen=screen)


def tables_in_code():
    """Return file and function of every table that a command may print."""
    found = set()
    for file in (ROOT / "tasks" / "cli").rglob("*.py"):
        for function in ast.walk(ast.parse(file.read_text())):
            if not isinstance(function, ast.FunctionDef):
                continue
            names = (
                getattr(call.func, "id", getattr(call.func, "attr", ""))
                for call in ast.walk(function)
                if isinstance(call, ast.Call)
            )
            if "Table" in names:
                found.add((file.name, function.name))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("screen", SCREENS)
def test_no_table_shortens_a_word(clip, finished_run, screen):
    """Promise: users can copy names from any table; the test covers every table of the code."""
    seen = set()
    for args, out, made in every_table(clip, finished_run, screen):
        printed = set(out.split())
        assert "…" not in out, args
        for place, words in made.items():
            assert words <= printed, (args, place, sorted(words - printed))
        seen.update(made)
    assert seen == tables_in_code()


def test_names_are_printed_as_they_are(clip, tmp_path, eres):
    """Promise: brackets and colons in a file's name are neither styles nor pictures."""
    _, events = clip
    (tmp_path / "[b]").mkdir()
    for name in ("a[day].h5", "[x] :smile:.h5"):
        code, out, err = eres("convert", events, tmp_path / "[b]" / name)
        assert (code, err) == (0, "")
        assert str(tmp_path / "[b]" / name) in out


def test_tables_wrap_between_words_where_that_is_enough(clip):
    """Promise: prose stays within a terminal; in a pipe a row is one line."""
    out, _ = run("scenes", screen="80")
    assert max(map(len, out.splitlines())) <= 80
    assert len(out.splitlines()) > 4
    assert len(run("scenes", screen="pipe")[0].splitlines()) == 4
    assert len(run("methods", screen="40")[0].splitlines()) == len(
        run("methods", screen="pipe")[0].splitlines()
    )


def test_a_row_in_a_pipe_has_no_blanks_at_its_end(clip):
    """Promise: the longest cell of a table does not widen the lines of the others."""
    out, _ = run("info", clip[1], screen="pipe")
    assert all(line == line.rstrip() for line in out.splitlines())
