"""Figures of docs/real.md, on public recordings that are not part of this repository."""

import os
import re
from pathlib import Path

import numpy as np
import pytest

from tasks.events.reading import ReadOptions
from tasks.recording.evaluate import evaluate_recording
from tasks.recording.frames import open_frames
from tasks.recording.recording import open_recording

SLIDER = Path(os.environ.get("ERES_RECORDINGS", "recordings")) / "slider_depth"


@pytest.fixture(scope="module")
def slider():
    if not (SLIDER / "events_chunk.txt").exists():
        pytest.skip(f"put slider_depth (docs/real.md) into {SLIDER}, or set ERES_RECORDINGS")
    recording = open_recording(SLIDER / "events_chunk.txt", reading=ReadOptions(size=(240, 180)))
    frames = open_frames(SLIDER, time_unit="s", exposure_us=0, encoding="linear")
    return {"recording": recording, "frames": frames, "shift_us": None}


def scores_of(found, method):
    return [score.value for score in found.rows if score.method == method]


def test_flow_from_zero_on_the_slider(slider):
    """Promise: contrast maximization is within a fifth of the tracks' length of them."""
    found = evaluate_recording(task="flow", **slider)
    length = np.median(scores_of(found, "initial_flow"))
    assert length > 3
    assert np.median(scores_of(found, "contrast_maximization")) < 0.2 * length
    assert np.median(scores_of(found, "contrast_maximization_by_gradient")) < 0.2 * length


def test_frames_of_the_slider_predicted_from_events(slider):
    """Promise: event integration is 2 dB better than the frame before, in each of four pairs."""
    found = evaluate_recording(task="reconstruction", **slider)
    predicted, before = (scores_of(found, name) for name in ("event_integration", "no_events"))
    assert len(predicted) == 4
    assert np.all(np.subtract(predicted, before) > 2)
    assert min(predicted) > 24


@pytest.mark.parametrize("held_out", ["second", "first"])
def test_a_camera_of_half_of_the_slider_has_the_events_of_the_other(
    slider, eres, tmp_path, held_out
):
    """Promise: within a tenth, by the command alone; docs/fit.md has the figures."""
    code, printed, _ = eres(
        *("fit", SLIDER / "events_chunk.txt", "--out", tmp_path / "davis.toml", "--size", 240, 180),
        *("--frames", SLIDER, "--frames-time-unit", "s", "--exposure-us", 0, "--encoding"),
        *("linear", "--estimate-shift", "--sensor", "davis240", "--check", held_out),
    )
    (ratio,) = re.findall(r"^ *events .* (\S+) *$", printed, re.MULTILINE)
    assert (code, float(ratio)) == (0, pytest.approx(1, abs=0.1))
