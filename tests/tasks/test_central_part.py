"""The part of the frames that a flat sensor sees: pixels, camera and truth of the same part."""

from __future__ import annotations

import numpy as np
import pytest

from eres_render import Clip, Renderer, clip_in_progress, ground_truth
from tasks.evaluation.central_part import central_part


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
