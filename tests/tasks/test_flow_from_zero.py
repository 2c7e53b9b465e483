"""Flow on recordings of which nothing is known: windows by motion, no preference for zero flow."""

import re

import numpy as np
import pytest

from rotating_camera import rotating_camera
from sensor import Events, SensorModel, simulate
from sensor.formats import write_events
from tasks.methods.contrast_maximization import UNDETERMINED, determined
from tasks.recording.evaluate import evaluate_recording
from tasks.recording.options import FlowOptions
from tasks.recording.recording import open_recording
from tasks.recording.window_length import ENOUGH_PX

SIZE = 128, 96
OPTIONS = FlowOptions(windows=2, features=10)
NOISY = SensorModel(
    width=SIZE[0],
    height=SIZE[1],
    contrast_threshold=0.25,
    cutoff_hz=200.0,
    dark_level=0.02,
    random_start=True,
    threshold_mismatch=0.03,
    leak_hz=0.1,
    shot_noise_hz=5.0,
    shot_noise_exponent=0.0,
)


def recorded(light, t_s, folder):
    """Record light with a noisy sensor, into a file that does not know the sensor."""
    events = simulate(light, t_s, NOISY, seed=3)
    write_events(folder / "events.h5", Events(*events.columns, *SIZE))
    return open_recording(folder / "events.h5")


def turning(folder, axis=(0, 1, 0), motion_px=1.0, duration_s=0.5):
    """Record a camera whose image moves by `motion_px` in 30 ms, in the middle or beside it."""
    lever_px = SIZE[0] if axis != (0, 0, 1) else SIZE[0] / 4
    path_px = motion_px * duration_s / 0.03
    rotation = rotating_camera(
        axis, path_px / lever_px / duration_s, duration_s, int(4 * path_px) + 2, SIZE
    )
    return recorded(rotation.light, rotation.t_s, folder), rotation


def still(folder):
    """Record a camera at rest: only noise."""
    rotation = rotating_camera((0, 1, 0), 0.0, 1.0, 2, SIZE)
    return recorded(rotation.light, rotation.t_s, folder)


@pytest.mark.parametrize(
    ("axis", "motion_px", "duration_s"),
    [
        ((0, 1, 0), 0.3, 0.9),
        pytest.param((0, 1, 0), 1.0, 0.5, marks=pytest.mark.slow),
        ((0, 1, 0), 3.0, 0.3),
        ((0, 0, 1), 1.0, 0.3),
    ],
)
def test_flow_of_turning_cameras(axis, motion_px, duration_s, tmp_path, monkeypatch):
    """Promise: from 0.3 to 3 px in 30 ms, with leak, shot noise and mismatch, the median error of
    contrast maximization by default is under 15 % of the motion, no answer is that nothing moves,
    and the output says how long windows are and how far events move in them."""
    answers = []

    def noted(method, sample):
        answers.append((sample, determined(method, sample)))
        return answers[-1][1]

    monkeypatch.setattr("tasks.evaluation.scorers.flow.determined", noted)
    recording, rotation = turning(tmp_path, axis, motion_px, duration_s)
    methods = ["contrast_maximization"]
    found = evaluate_recording(recording, "flow", methods=methods, flow=OPTIONS)
    (note,) = found.notes
    window_ms, said_px = float(note.split()[2]), float(note.split()[-2])
    moved_px, errors = [], []
    for sample, answer in answers:
        place_px = np.array([sample.x_px.mean(), sample.y_px.mean()])
        true_px = rotation.motion(place_px, 1e-3 * window_ms)
        moved_px.append(np.linalg.norm(true_px))
        if not answer.failure:
            errors.append(np.linalg.norm(answer.flow - true_px) / moved_px[-1])
            assert answer.flow.any()
    assert said_px == pytest.approx(ENOUGH_PX, rel=0.1)
    assert np.median(moved_px) == pytest.approx(said_px, rel=0.25)
    assert len(errors) > 0.8 * len(answers)
    assert np.median(errors) < 0.15


def test_a_camera_at_rest_does_not_move(tmp_path):
    """Promise: noise has no flow, neither zero nor fast, and the notes say so."""
    methods = ["contrast_maximization"]
    found = evaluate_recording(still(tmp_path), "flow", methods=methods, flow=OPTIONS)
    failed = [score for score in found.rows if score.failure]
    assert len(failed) > 0.8 * len(found.rows)
    assert {score.value for score in failed} == {1.0}
    assert found.notes == [
        "windows of 500 ms (the longest), in which most events show no clear motion of 2 px or "
        "more",
        f"contrast_maximization: {len(failed)} of {len(found.rows)} answers failed, mostly with "
        f"{UNDETERMINED!r}; more motion helps: a longer --window-ms",
    ]


def test_too_little_motion_is_undetermined(tmp_path):
    """Promise: --window-ms holds; where events move by a quarter of a pixel in it, most answers
    fail, and none is zero flow, for each objective."""
    recording, _ = turning(tmp_path, duration_s=0.2)
    options = FlowOptions(window_ms=8.0, windows=3, features=10)
    found = evaluate_recording(recording, "flow", flow=options)
    searched = [score for score in found.rows if score.method != "initial_flow"]
    assert len({score.method for score in searched}) == 3
    assert sum(bool(score.failure) for score in searched) > 0.8 * len(searched)
    assert all(score.value != 1.0 or score.failure for score in searched)
    assert not any(note.startswith("windows") for note in found.notes)


def test_dense_flow_has_windows_by_motion_and_one_before(tmp_path):
    """Promise: methods of dense flow get windows by motion, too, at most half of the recording."""
    recording, _ = turning(tmp_path, motion_px=0.5, duration_s=0.3)
    found = evaluate_recording(recording, "dense_flow", methods=["zero_flow"], flow=OPTIONS)
    (note,) = found.notes
    assert re.fullmatch(r"windows of 1[45]0 ms \(the longest\), in which .* about 2\.\d px", note)
