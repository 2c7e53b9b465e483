"""The page: markers are where page.json says, at the printed size."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from tasks.errors import RigError
from tasks.rig.page import (
    INK,
    PAPER,
    check_print,
    draw,
    json_text,
    lay_out,
    markers,
    read_page,
    read_page_image,
    reflectance,
    write_print,
)
from tasks.rig.settings import PageSettings, RigCamera, RigSettings, SliderSettings, read_rig

SMALL = PageSettings(
    width_m=0.12,
    height_m=0.09,
    picture="pebbles",
    picture_width_m=0.05,
    picture_height_m=0.03,
    marker_m=0.01,
    marker_pitch_m=0.014,
    dictionary="DICT_4X4_100",
)


@pytest.fixture(scope="module")
def page():
    return lay_out(SMALL)


@pytest.fixture(scope="module")
def image(page):
    return draw(page, SMALL, Path())


def test_every_marker_is_where_the_file_says(page, image):
    """Promise: the corners in page.json are those in the image, to a tenth of a printed dot, and
    all markers can be read."""
    finder = cv2.aruco.ArucoDetector(markers(page.dictionary))
    quads, numbers, _ = finder.detectMarkers(image)
    assert sorted(numbers.ravel().tolist()) == list(range(len(page.markers_m)))
    for quad, number in zip(quads, numbers.ravel().tolist(), strict=True):
        # Without refinement OpenCV gives the outermost black dots, counted from their centers.
        dots = page.corners()[number] / page.dot_m
        inner = dots + 0.5 * np.sign(dots.mean(axis=0) - dots) - 0.5
        assert np.abs(quad[0] - inner).max() < 1.01


def test_a_picture_of_one_s_own_is_beside_the_rig(page, tmp_path, monkeypatch):
    """Promise: rig.toml means the same from every working directory."""
    cv2.imwrite(str(tmp_path / "photo.png"), np.full((30, 50), 128, np.uint8))
    own = replace(SMALL, picture="photo.png")
    left, top, right, bottom = (round(edge / page.dot_m) for edge in page.picture_m)
    inside = draw(page, own, tmp_path)[top:bottom, left:right]
    assert inside.min() == inside.max() == 255  # white is its brightest
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RigError, match=r"rig.photo\.png: no such image"):
        draw(page, own, tmp_path / "rig")


def test_layout_is_in_whole_dots_apart_from_each_other_and_the_picture(page):
    left, top, right, bottom = (edge / page.dot_m for edge in page.picture_m)
    starts = np.array(page.markers_m) / page.dot_m
    assert np.allclose(starts, np.round(starts))
    side = page.marker_m / page.dot_m
    white = 0.24 * side
    for x, y in starts:
        assert white <= x <= page.width_m / page.dot_m - side - white + 1
        assert white <= y <= page.height_m / page.dot_m - side - white + 1
        apart = max(left - x - side, x - right, top - y - side, y - bottom)
        assert apart >= white
    distances = np.abs(starts[:, None] - starts).max(axis=-1) + 1e9 * np.eye(len(starts))
    assert distances.min() >= side + white


def test_reflectance_runs_from_ink_to_paper(page, image):
    light = reflectance(image)
    assert light.max() == pytest.approx(PAPER)
    assert light.min() == pytest.approx(INK, abs=2e-3)
    left, top, right, bottom = (round(edge / page.dot_m) for edge in page.picture_m)
    assert light[top:bottom, left:right].std() > 0.05  # there is a picture


def test_files_come_back_and_have_their_size_on_paper(page, image, tmp_path):
    """Promise: PNG and PDF have the printed size; page.json is read back bit by bit."""
    (tmp_path / "page.json").write_text(json_text(page))
    assert read_page(tmp_path / "page.json") == page
    for name in ("page.png", "page.pdf"):
        write_print(tmp_path / name, image, page)
    assert np.array_equal(read_page_image(tmp_path / "page.png", page), image)
    with Image.open(tmp_path / "page.png") as opened:
        assert opened.info["dpi"][0] == pytest.approx(360, abs=0.5)
    pdf = (tmp_path / "page.pdf").read_bytes()
    points = pdf[pdf.index(b"MediaBox") :].split(b"[")[1].split(b"]")[0].split()
    assert float(points[2]) == pytest.approx(72 * page.width_m / 0.0254, rel=1e-3)
    with pytest.raises(RigError, match=r"page\.jpg: .*\.pdf or \.png"):
        check_print(tmp_path / "page.jpg")


def test_an_image_file_can_be_the_picture(tmp_path):
    cv2.imwrite(str(tmp_path / "mine.png"), np.tile(np.arange(256, dtype=np.uint8), (64, 1)))
    settings = PageSettings(
        width_m=0.12,
        height_m=0.09,
        picture="mine.png",
        picture_width_m=0.05,
        picture_height_m=0.03,
        marker_m=0.01,
    )
    page = lay_out(settings)
    light = reflectance(draw(page, settings, tmp_path))
    left, top, right, bottom = (round(edge / page.dot_m) for edge in page.picture_m)
    row = light[(top + bottom) // 2, left:right]
    assert np.all(np.diff(row) >= -1e-6)
    assert row[-1] > 0.9 * PAPER


RIG = """
camera = {width = 346, height = 260, pitch_um = 18.5, focal_mm = 8.0, k1 = -0.1}

[page]
width_m = 0.44
height_m = 0.29
picture = "pebbles"
picture_width_m = 0.12
picture_height_m = 0.0675

[slider]
travel_m = 0.2
speeds_mps = [0.2, 0.4]
"""


def test_settings_are_read(tmp_path):
    file = tmp_path / "rig.toml"
    file.write_text(RIG)
    rig = read_rig(file)
    assert isinstance(rig, RigSettings)
    camera = rig.camera_in(tmp_path)
    assert camera.fx == pytest.approx(8000 / 18.5)
    assert camera.distortion.k1 == -0.1
    assert rig.slider.speeds_mps == (0.2, 0.4)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("width_m = 0.44", "width_m = 0.44\ndpi = 300", "dpi: found 300"),
        ("width_m = 0.44", "width_m = 0.44\ndpi = 1e9", "dpi: found 1000000000.0"),
        ("width_m = 0.44", "width_m = 0.44\nseed = -1", "seed: found -1"),
        ("width_m = 0.12", "width_m = 0.00001", "picture_width_m: found 1e-05"),
        ("width_m = 0.44", "width_m = 0.1", "picture_width_m: found 0.12"),
        ("focal_mm = 8.0, ", "", "either fx, or both pitch_um and focal_mm"),
        ("pitch_um = 18.5", "fx = 400.0", "either fx, or both pitch_um and focal_mm"),
        ("[0.2, 0.4]", "[0.2, 4.0]", "speeds_mps: .* 2 m/s"),
        ("[0.2, 0.4]", "[]", "speeds_mps: found"),
        ("[0.2, 0.4]", "[1e200]", "speeds_mps: .* 2 m/s"),
        ("pitch_um = 18.5", "pitch_um = 0", "pitch_um: found 0.0, expected a positive"),
        ("travel_m = 0.2", "travel_m = -1.0", "travel_m: found -1.0"),
        ("travel_m", "travels_m", "travels_m: unknown"),
        ('picture = "pebbles"', 'picture = "../photo.png"', "your own file beside rig.toml"),
        ('picture = "pebbles"', 'picture = "page.png"', "your own file beside rig.toml"),
        ("camera = {", 'camera_file = "c.yaml"\ncamera = {', "give either camera or camera_file"),
    ],
)
def test_wrong_settings_are_refused(tmp_path, old, new, expected):
    """Promise: an error names the file and the field."""
    file = tmp_path / "rig.toml"
    file.write_text(RIG.replace(old, new))
    with pytest.raises(RigError, match=expected) as refused:
        read_rig(file)
    assert "rig.toml" in str(refused.value)


def test_layouts_without_room_are_refused():
    with pytest.raises(RigError, match="room for 0 markers"):
        lay_out(
            PageSettings(
                width_m=0.02,
                height_m=0.02,
                picture="pebbles",
                picture_width_m=0.02,
                picture_height_m=0.02,
            )
        )
    for width_m in (2.4, 1e305):
        large = PageSettings(
            width_m=width_m,
            height_m=0.02,
            picture="pebbles",
            picture_width_m=0.01,
            picture_height_m=0.01,
            dpi=360,
        )
        with pytest.raises(RigError, match=r"page: .* dots .* 32766"):
            lay_out(large)
    with pytest.raises(RigError, match="marker_pitch_m: found"):
        PageSettings(
            width_m=0.12,
            height_m=0.09,
            picture="pebbles",
            picture_width_m=0.05,
            picture_height_m=0.03,
            marker_m=0.01,
            marker_pitch_m=0.011,
        )
    assert SliderSettings(travel_m=0.2, speeds_mps=(0.1,)).travel_m == 0.2
    assert RigCamera(width=64, height=48, fx=50.0).camera().cx == 32.0
