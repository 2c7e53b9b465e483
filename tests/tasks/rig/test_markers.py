"""Corners of markers: OpenCV's conventions, files, and false detections."""

from functools import cache

import cv2
import numpy as np
import pytest

from tasks.errors import RigError
from tasks.rig.markers import (
    Detections,
    find_markers,
    gray_codes,
    read_detections,
    write_detections,
)
from tasks.rig.page import markers

DICTIONARY = "DICT_4X4_50"
SIDE_PX, FINE = 36, 16  # of a marker, and samples along a pixel
PLACES = [(60.0, 50.0), (60.25, 50.5), (60.5, 50.75), (60.8125, 50.1875)]


@cache
def picture(x, y, width=150, height=120, side_px=SIDE_PX):
    """A marker whose top left corner is at (x, y) px from the image's corner, area-averaged."""
    fine = np.full((height * FINE, width * FINE), 230, np.float32)
    code = cv2.aruco.generateImageMarker(markers(DICTIONARY), 7, side_px * FINE)
    left, top = round(x * FINE), round(y * FINE)
    fine[top : top + code.shape[0], left : left + code.shape[1]] = np.where(code > 0, 230, 20)
    small = fine.reshape(height, FINE, width, FINE).mean(axis=(1, 3))
    return np.round(small).astype(np.uint8)


def wide(gray):
    """Return an image with white to its right, which is wide enough not to be enlarged."""
    return np.pad(gray, ((0, 0), (0, 640 - gray.shape[1])), constant_values=230)


def find(gray, count=50, refinement="contour"):
    return find_markers(gray, DICTIONARY, count, refinement)


def true_corners(x, y):
    return np.array([[x, y], [x + SIDE_PX, y], [x + SIDE_PX, y + SIDE_PX], [x, y + SIDE_PX]])


@pytest.mark.parametrize("enlarged", [False, True])
@pytest.mark.parametrize(
    ("refinement", "tolerance_px"),
    [("none", 0.2), ("subpix", 0.06), ("contour", 0.12), ("apriltag", 0.1)],
)
def test_positions_count_from_the_corner_of_the_image(refinement, enlarged, tolerance_px):
    """Promise: with each of OpenCV's refinements, (0, 0) is the corner of the first pixel. A wrong
    convention shifts all corners by half a pixel of the enlarged image."""
    off = []
    for x, y in PLACES:
        gray = picture(x, y) if enlarged else wide(picture(x, y))
        numbers, corners_px, _ = find(gray, refinement=refinement)
        assert numbers.tolist() == [7]
        off.append((corners_px[0] - true_corners(x, y)).mean(axis=0))
    shift = np.mean(off, axis=0)
    assert np.abs(shift).max() < tolerance_px / (2 if enlarged else 1), shift


@pytest.mark.parametrize("framed", [wide, np.asarray])
def test_corners_are_found_to_half_a_pixel(framed):
    """Promise: with or without enlargement, the common inward shift of all corners is the corner
    bias, which `solve` can estimate."""
    outward = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    off = np.array([find(framed(picture(*at)))[1][0] - true_corners(*at) for at in PLACES])
    bias = np.mean(off * outward)
    assert -0.8 < bias < 0
    assert np.sqrt(np.mean(np.sum(np.square(off - bias * outward), axis=-1))) < 0.45


def test_a_marker_twice_or_not_on_the_page_is_left_out():
    """Promise: a number seen twice is left out, and so are numbers that the page does not have."""
    one = picture(60.0, 50.0)
    twice = np.concatenate([one, one], axis=1)
    assert find(twice)[0].size == 0
    assert find(one, count=7)[0].size == 0
    assert find(one, count=8)[0].tolist() == [7]


def test_score_is_the_contrast():
    strong = find(picture(60.0, 50.0))[2][0]
    weak = find((picture(60.0, 50.0) // 4 + 90).astype(np.uint8))[2][0]
    assert 0.6 < strong < 0.9
    assert weak == pytest.approx(strong / 4, rel=0.05)


def test_gray_codes_span_the_image():
    image = np.linspace(-3.0, 5.0, 1000).reshape(20, 50)
    codes = gray_codes(image)
    assert (codes.min(), codes.max()) == (0, 255)
    assert np.all(np.diff(codes.ravel().astype(int)) >= 0)
    assert not gray_codes(np.full((4, 4), 2.0)).any()  # nothing to see


def test_files_keep_every_digit(tmp_path):
    rng = np.random.default_rng(0)
    found = Detections(
        np.array([5, 5, 9]),
        np.array([0, 3, 3]),
        rng.uniform(0, 300, (3, 4, 2)),
        rng.random(3),
        "hf",
    )
    file = tmp_path / "corners.parquet"
    write_detections(file, found)
    back = read_detections(file)
    for name in ("t_us", "number", "corners_px", "score"):
        assert np.array_equal(getattr(back, name), getattr(found, name)), name
    assert back.source == "hf"
    file.write_bytes(file.read_bytes()[:-10])
    with pytest.raises(RigError, match="a file of `eres rig detect`"):
        read_detections(file)
    with pytest.raises(RigError, match="no such file"):
        read_detections(tmp_path / "none.parquet")


def test_unknown_dictionaries_are_refused():
    with pytest.raises(RigError, match=r"dictionary: .*'DICT_9X9'"):
        markers("DICT_9X9")
