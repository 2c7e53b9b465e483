"""Commands of `eres rig`: their options reach the functions that need them."""

import json
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from tasks.errors import RigError
from tasks.events.frame_camera_options import FrameCameraOptions
from tasks.rig.bundle import CORNER_BIAS, LATENCY, SCALE
from tasks.rig.evaluate import RigEvaluation
from tasks.rig.intrinsics import Board

PAGE = """
camera = {width = 200, height = 150, fx = 260.0}
[page]
width_m = 0.12
height_m = 0.09
picture = "pebbles"
picture_width_m = 0.05
picture_height_m = 0.03
marker_m = 0.01
marker_pitch_m = 0.014
dictionary = "DICT_4X4_100"
"""

NEAR = SimpleNamespace(folder=Path("near"))  # an open recording
RENDERED = {
    "images": 7,
    "frame_camera": FrameCameraOptions(exposure=0.004),
    "spp": 4,
    "max_displacement_px": 0.25,
    "seed": 5,
}
DETECTED = {
    "images": 9,
    "max_speed_mps": 0.3,
    "contrast_threshold": 0.15,
    "blur_px": 1.5,
    "refinement": "subpix",
}
ALL = LATENCY, SCALE, CORNER_BIAS
EVALUATED = RigEvaluation(
    places=3,
    travel_m=0.004,
    contrast_threshold=0.3,
    cutoff_hz=90.0,
    initial_sigma_mm=2.0,
    seed=8,
    video=(),
)


@pytest.mark.parametrize(
    ("command", "function", "expected"),
    [
        (
            "render rig.toml --out near --depth 0.3 --images 7 --exposure 0.004 --spp 4 "
            "--max-displacement 0.25 --seed 5",
            "virtual.render_rig",
            ((Path("rig.toml"), Path("near"), 0.3), RENDERED),
        ),
        (
            "intrinsics a.raw b.raw --out camera.yaml --board 9 6 --square 0.03 --size 346 260",
            "intrinsics.intrinsics",
            (([Path("a.raw"), Path("b.raw")], Board(9, 6, 0.03)), {"size": (346, 260)}),
        ),
        (
            "detect near --out c.parquet --source ei --images 9 --max-speed 0.3 --threshold 0.15 "
            "--blur 1.5 --refinement subpix",
            "markers.detect",
            ((NEAR, "ei"), DETECTED),
        ),
        (
            "solve near --out c.json --corners mine.parquet --latency --scale --corner-bias "
            "--max-rms 0.7",
            "calibration.solve_recording",
            ((NEAR, Path("near/mine.parquet"), ALL, 0.7), {}),
        ),
        (
            "evaluate crops --out run --tasks flow tracking --places 3 --travel 0.004 --threshold "
            "0.3 --cutoff 90 --initial-sigma-mm 2 --seed 8",
            "evaluate.evaluate_rig",
            (((Path("crops"),), EVALUATED), {}),
        ),
    ],
)
def test_each_option_reaches_its_function(eres, tmp_path, monkeypatch, command, function, expected):
    """Promise: no option is dropped, or taken for another."""
    asked = []

    def record(*given, on_progress=None, **options):
        asked.append((given, options))
        raise RigError("asked")

    monkeypatch.chdir(tmp_path)
    opened = "tasks.rig.recording.RigRecording"
    monkeypatch.setattr(opened, lambda path: SimpleNamespace(folder=path))
    monkeypatch.setattr("tasks.rig.markers.read_detections", lambda file: file)
    monkeypatch.setattr(f"tasks.rig.{function}", record)
    code, _, err = eres("rig", *command.split())
    assert (code, err) == (1, "error: asked\n")
    assert asked == [expected]


@pytest.mark.parametrize("command", ["detect", "solve"])
@pytest.mark.parametrize("name", ["events.raw", "page.json", "slider.csv", "rig.toml"])
def test_results_never_replace_what_was_recorded(eres, tmp_path, command, name):
    """Promise: --overwrite is about results; a mistyped --out loses no recording."""
    (tmp_path / name).write_bytes(b"recorded")
    code, _, err = eres("rig", command, tmp_path, "--out", tmp_path / name, "--overwrite")
    assert (code, f"{name}: would overwrite the input" in err) == (1, True)
    assert (tmp_path / name).read_bytes() == b"recorded"


@pytest.mark.parametrize("text", ['{"name": "quick"}', "{", "5", '"recorded"'])
def test_scores_are_not_put_into_the_run_of_a_study(eres, tmp_path, text):
    """Promise: a study that is not finished, or is damaged, keeps its study.json."""
    (tmp_path / "study.json").write_text(text)
    code, _, err = eres("rig", "evaluate", tmp_path / "crops", "--out", tmp_path, "--overwrite")
    assert (code, err.startswith(f"error: {tmp_path / 'study.json'}: ")) == (1, True)
    assert (tmp_path / "study.json").read_text() == text


def test_a_page_is_printed_with_its_markers(eres, tmp_path):
    """Promise: the file to print, its image and its markers; nothing is replaced unless told."""
    (tmp_path / "rig.toml").write_text(PAGE)
    asked = "rig", "page", tmp_path / "rig.toml", "--out", tmp_path / "print.pdf"
    code, _, err = eres(*asked[:-1], tmp_path / "print.svg")
    assert (code, "print.svg: " in err) == (1, True)
    assert [one.name for one in tmp_path.iterdir()] == ["rig.toml"]
    code, out, _ = eres(*asked)
    page = json.loads((tmp_path / "page.json").read_text())
    assert code == 0
    assert f"print.pdf: 12.0 x 9.0 cm, {len(page['markers_m'])} markers of" in out
    assert (tmp_path / "print.pdf").read_bytes().startswith(b"%PDF")
    assert np.ptp(cv2.imread(str(tmp_path / "page.png"), -1)) > 100
    code, _, err = eres(*asked)
    assert (code, "already exists" in err) == (1, True)
    assert eres(*asked, "--overwrite")[0] == 0
