"""How well events alone solve the rig at the sizes of real cameras."""

import numpy as np
import pytest

from tasks.events.frame_camera_options import FrameCameraOptions
from tasks.events.sensor_options import PixelOptions
from tasks.events.simulation import SimulationOptions, sensor_for, simulate_sequence
from tasks.rig.bundle import Unknowns
from tasks.rig.calibration import compare, read_truth, solve_recording
from tasks.rig.detect import detect
from tasks.rig.recording import open_recording
from tasks.rig.virtual import render_rig

RIG = """
camera = {{width = {width}, height = {height}, pitch_um = {pitch_um}, focal_mm = 8.0}}

[page]
width_m = 0.44
height_m = 0.29
picture = "pebbles"
picture_width_m = 0.12
picture_height_m = 0.0675

[slider]
travel_m = {travel_m}
speeds_mps = [0.2]
direction = [1.0, 0.01, -0.008]

[mount]
turn_deg = [0.5, -0.7, 0.4]
"""
NOISY = PixelOptions(
    cutoff=200.0, threshold_mismatch=0.03, leak=0.1, hot_pixels=0.001, hot_pixel_rate=20.0
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("width", "height", "pitch_um", "depth_m", "travel_m"),
    [
        (346, 260, 18.5, 0.236, 0.1),  # where markers leave the view in a longer stroke
        (346, 260, 18.5, 0.436, 0.2),
        (1280, 720, 4.86, 0.236, 0.05),  # for time: errors shrink with the length of the stroke
    ],
)
def test_markers_in_high_pass_images_solve_the_rig(
    tmp_path, width, height, pitch_um, depth_m, travel_m
):
    """Promise: with noise, mismatch, leak and hot pixels, a quarter of the visible markers is
    found; true images are right to 0.1 px, flow to 0.01 px and positions to 0.5 mm."""
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG.format(width=width, height=height, pitch_um=pitch_um, travel_m=travel_m))
    light = render_rig(
        *(rig, tmp_path / "near", depth_m),
        frame_camera=FrameCameraOptions(exposure=0.001),
        spp=4 if width < 640 else 1,
        max_displacement_px=0.5 if width < 640 else 1.0,
    )
    model = sensor_for(light, resolution=light.width, pixel=NOISY)
    events = tmp_path / "near" / "events.h5"
    simulate_sequence(light, model, events, SimulationOptions(seed=1))
    recording = open_recording(tmp_path / "near")
    found = detect(recording, "hf", images=20)
    solved = solve_recording(recording, found, Unknowns(latency=True, corner_bias=True), 2.0)
    truth = read_truth(recording)
    errors = compare(solved.pose.pose(), truth, recording.camera, solved.x_m)
    assert errors.image_px < 0.1
    assert errors.flow_px < 0.01
    assert errors.position_mm < 0.5

    corners_m = np.array([recording.page.corners(k) for k in range(len(recording.page.markers_m))])
    visible = 0
    for t_us in np.unique(found.t_us).tolist():
        x_m = recording.slider.position_m(t_us)
        at_px = truth.project(recording.camera, corners_m.reshape(-1, 2), x_m).reshape(-1, 4, 2)
        visible += np.all((at_px > 0) & (at_px < (width, height)), axis=(1, 2)).sum()
    assert len(found.t_us) > 0.25 * visible
