"""How well events alone solve the rig at the sizes of real cameras."""

import math

import numpy as np
import pytest

from benchmark_files import benchmark
from tasks.rig.bundle import CORNER_BIAS, LATENCY
from tasks.rig.calibration import compare, read_truth, solve_recording
from tasks.rig.markers import detect

rig = benchmark("rig")

UNKNOWNS = LATENCY, CORNER_BIAS
SETTINGS = [  # width, depth and travel in meters
    (346, 0.236, 0.1),  # where markers leave the view in a longer stroke
    (346, 0.436, 0.2),
    (1280, 0.236, 0.05),  # for time: errors shrink with the length of the stroke
    (1280, 0.436, 0.05),
]


@pytest.fixture(scope="module", params=SETTINGS, ids=lambda setting: "{}px_{}m".format(*setting))
def folder(request, tmp_path_factory):
    """A rendered recording with the events of the benchmark's two sensors."""
    out = tmp_path_factory.mktemp("rig") / "near"
    rig.events_of(out, rig.light_of(out, *request.param))
    return out


@pytest.mark.slow
def test_markers_in_high_pass_images_solve_the_rig(folder):
    """Promise: with noise, mismatch, leak and hot pixels, a quarter of the visible markers is
    found; true images are right to 0.1 px, flow to 0.01 px and positions to 0.5 mm."""
    recording = rig.recording_of(folder, "noisy")
    found = detect(recording, "hf", images=rig.IMAGES)
    solved = solve_recording(recording, found, UNKNOWNS, 2.0)
    truth = read_truth(recording)
    errors = compare(solved.pose.on(recording.camera), truth, solved.x_m)
    assert errors.image_px < 0.1
    assert errors.flow_px < 0.01
    assert errors.position_mm < 0.5
    visible = rig.visible(recording, truth, np.unique(found.t_us).tolist())
    assert len(found.t_us) > 0.25 * visible


@pytest.mark.slow
def test_integrated_events_measure_the_cutoff(folder):
    """Promise: the latency of event integration is the photoreceptor's 2 / (2 pi f), to 10 %; at
    1280 px with a blur of 2 px."""
    recording = rig.recording_of(folder, "clean")
    blur_px = 0.0 if recording.camera.width < rig.FINE_PX else rig.BLUR_PX
    found = detect(recording, "ei", images=rig.IMAGES, blur_px=blur_px)
    solved = solve_recording(recording, found, UNKNOWNS, 2.0)
    delay_ms = 1e3 / (math.pi * rig.CUTOFF_HZ)
    assert solved.latency_ms == pytest.approx(delay_ms, rel=0.1)
