"""The part of the frames that a flat sensor sees: pixels, camera and truth of the same part."""

from __future__ import annotations

import numpy as np
import pytest

from eres_render import Clip, Renderer, clip_in_progress, ground_truth
from eres_render.progress import silent
from sensor import SensorModel
from tasks.evaluation.evaluate import evaluate
from tasks.evaluation.reference import central_part
from tasks.evaluation.sensor_setting import Setting
from tasks.evaluation.settings import Flow, Reconstruction, Tracking


@pytest.mark.parametrize(("height", "rows"), [(32, slice(16, 48)), (31, slice(16, 47))])
def test_a_part_has_the_pixels_and_the_truth_of_its_place(small_carpet, tmp_path, height, rows):
    """Promise: frames are cropped, not scaled; depth and the pixel of a point are those of the
    whole frame at the same place, also if the crop is not centered to half a pixel."""
    renderer = Renderer(small_carpet, width=64, spp=1)
    with clip_in_progress(renderer, Clip(0, 0.24, 0.25, 0.3), tmp_path / "clip", 2.0) as whole:
        truth = ground_truth(whole)
        part, of_part = central_part(whole, truth, 64, height)
        assert (part.width, part.height) == (64, height)
        for seen, frame in zip(part, whole, strict=True):
            np.testing.assert_array_equal(seen, frame[rows])
        np.testing.assert_array_equal(part.frame(1), whole.frame(1)[rows])
        np.testing.assert_array_equal(of_part.depth(0.3, 64), truth.depth(0.3, 64)[rows])
        point = [0.1, 0.05, 1.0]
        moved = whole.camera.project(point) - part.camera.project(point)
        np.testing.assert_allclose(moved, [0, rows.start], atol=1e-9)
        assert len(part) == len(whole)
        assert part.window_s == whole.window_s


def test_a_sensor_that_sees_all_has_the_whole(small_carpet, tmp_path):
    renderer = Renderer(small_carpet, width=64, spp=1)
    with clip_in_progress(renderer, Clip(0, 0.24, 0.25, 0.3), tmp_path / "clip", 2.0) as whole:
        truth = ground_truth(whole)
        assert central_part(whole, truth, 32, 32) == (whole, truth)


def test_an_upright_sensor_is_scored_at_its_own_height(small_carpet, tmp_path):
    """Promise: a sensor higher than wide is scored in every task, although the part of the frames
    that it sees has whole pixels, and so only nearly its shape."""
    renderer = Renderer(small_carpet, width=96, spp=4)
    heights = {}
    with clip_in_progress(renderer, Clip(0, 0.24, 0.25, 0.3), tmp_path / "clip", 2.0) as whole:
        for height in (94, 95, 96):
            truth = ground_truth(whole)
            model = SensorModel(width=60, height=height, dark_level=1e-3)
            tasks = {
                "reconstruction": Reconstruction(methods=("no_events",)),
                "flow": Flow(methods=("initial_flow",), features=5),
                "tracking": Tracking(methods=("initial_path",)),
            }
            setting = Setting(model, 1.0, 250_000, 300_000)
            found = evaluate(whole, truth, [setting], tasks, silent)
            assert len(found.rows) == 1 + 5 + 1
            camera = found.reference.camera(60, height)
            assert (camera.width, camera.height) == (60, height)
            assert camera.fy == pytest.approx(camera.fx, rel=0.01)
            _, of_part = central_part(whole, truth, 60, height)
            heights[height] = of_part.camera(60).height
    assert heights == {94: 94, 95: 94, 96: 96}  # of square pixels, and a case for this test


def test_sensors_of_two_shapes_share_their_frames(small_carpet, tmp_path):
    """Promise: each shape reads the frames, which are rendered once; the times are of one job."""
    renderer = Renderer(small_carpet, width=64, spp=1)
    with clip_in_progress(renderer, Clip(0, 0.24, 0.25, 0.3), tmp_path / "clip", 2.0) as whole:
        models = [SensorModel(width=32, height=height, dark_level=1e-3) for height in (32, 24, 16)]
        settings = [Setting(model, 1.0, 250_000, 300_000) for model in (models[0], *models)]
        tasks = {"reconstruction": Reconstruction(methods=("no_events",))}
        found = evaluate(whole, ground_truth(whole), settings, tasks, silent)
        timings = found.timings
        assert (timings.frames, timings.rendered_frames) == (3 * len(whole), len(whole))
        assert (timings.resolution, timings.height, timings.sensors) == (64, 64, 3)
        assert timings.pixel_frames == len(whole) * 32 * (32 + 24 + 16)
        assert (len(found.rows), len(timings.methods)) == (4, 3)
        assert found.reference.sequence is whole
