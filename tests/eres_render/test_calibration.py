"""Cameras in the YAML files of OpenCV, ROS and Kalibr."""

import cv2
import numpy as np
import pytest

from eres_render import Camera, Distortion, RenderError
from eres_render.calibration import read_camera, write_camera

LENS = Distortion(k1=-0.27695497, k2=0.06712482, p1=0.00087538, p2=1e-5, k3=0.0)
CAMERA = Camera(752, 480, fx=461.629, fy=460.152, cx=363.18, cy=246.549, distortion=LENS)

# Two cameras as Kalibr writes them: its documentation's example.
CHAIN = """cam0:
  camera_model: pinhole
  intrinsics: [461.629, 460.152, 362.680, 246.049]
  distortion_model: radtan
  distortion_coeffs: [-0.27695497, 0.06712482, 0.00087538, 1e-5]
  T_cam_imu:
  - [0.01779318, 0.99967549,-0.01822936, 0.07008565]
  - [-0.9998017, 0.01795239, 0.00860714,-0.01771023]
  - [0.00893160, 0.01807260, 0.99979678, 0.00399246]
  - [0.0, 0.0, 0.0, 1.0]
  timeshift_cam_imu: -8.121e-05
  rostopic: /cam0/image_raw
  resolution: [752, 480]
cam1:
  camera_model: omni
  intrinsics: [0.80065662, 833.006, 830.345, 373.850, 253.749]
  distortion_model: radtan
  distortion_coeffs: [-0.33518750, 0.13211436, 0.00055967, 0.00057686]
  resolution: [752, 480]
"""
OPENCV = """%YAML:1.0
---
image_width: 752
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 4.61629e+02, 0., 362.68, 0., 460.152, 246.049, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.27695497, 0.06712482, 8.7538e-04, 1e-05, 0. ]
avg_reprojection_error: 0.18
"""
ND_MATRIX = "_coefficients: !!opencv-nd-matrix\n   sizes: [ 5 ]"  # of a vector


def same(found, expected):
    """Whether two cameras agree to the rounding of half a pixel."""
    values = [(c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.distortion) for c in (found, expected)]
    return values[0][-1] == values[1][-1] and np.allclose(
        *(v[:-1] for v in values), rtol=1e-14, atol=0
    )


def written(folder, text):
    (folder / "camera.yaml").write_text(text)
    return folder / "camera.yaml"


@pytest.mark.parametrize(
    "text",
    [
        CHAIN[: CHAIN.index("cam1")],
        OPENCV,
        OPENCV.replace("%YAML:1.0\n---\n", "distortion_model: plumb_bob\n").replace(
            " !!opencv-matrix", ""
        ),
        OPENCV.replace("_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1", ND_MATRIX),
        OPENCV.replace("1e-05, 0. ]", "1e-05 ]"),
        OPENCV.replace("1e-05, 0. ]", "1e-05, 0., 0., 0, 0. ]"),
    ],
    ids=["kalibr", "opencv", "ros", "opencv 5", "four coefficients", "eight, zeros beyond"],
)
def test_the_same_camera_from_every_program(tmp_path, text):
    """Promise: a principal point counts from a pixel's corner here, from its center there."""
    assert same(read_camera(written(tmp_path, text)), CAMERA)


def test_a_camera_of_a_chain_is_named(tmp_path):
    file = written(tmp_path, CHAIN)
    assert same(read_camera(file, "cam0"), CAMERA)
    with pytest.raises(RenderError, match=r"found cam0, cam1, expected a choice"):
        read_camera(file)
    with pytest.raises(RenderError, match=r"found cam0, cam1, expected 'cam2'"):
        read_camera(file, "cam2")
    with pytest.raises(RenderError, match=r"found one camera without a name, expected 'cam1'"):
        read_camera(written(tmp_path, OPENCV), "cam1")


@pytest.mark.parametrize("kind", ["opencv", "kalibr"])
@pytest.mark.parametrize("camera", [CAMERA, Camera(64, 48, fx=1e-5)], ids=["lens", "pinhole"])
def test_what_was_written_is_read_again(tmp_path, camera, kind):
    file = tmp_path / "out" / "camera.yaml"
    write_camera(file, camera, kind)
    assert same(read_camera(file), camera)


def test_opencv_reads_what_was_written_and_projects_alike(tmp_path):
    """Promise: cv2.projectPoints with the file's matrices gives the same pixels, 0.5 less."""
    lens = Distortion(-0.28, 0.07, 1e-4, -2e-5, 0.01)
    camera = Camera(752, 480, fx=461.6, fy=460.2, cx=363.2, cy=246.5, distortion=lens)
    write_camera(tmp_path / "camera.yaml", camera)
    storage = cv2.FileStorage(str(tmp_path / "camera.yaml"), cv2.FILE_STORAGE_READ)
    K, coefficients = (
        storage.getNode(name).mat() for name in ("camera_matrix", "distortion_coefficients")
    )
    assert storage.getNode("image_width").real() == 752
    points = camera.rays(camera.grid(7))
    seen, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, coefficients)
    np.testing.assert_allclose(seen.reshape(-1, 2) + 0.5, camera.project(points), atol=1e-9)


def test_no_other_kind_of_file_is_written(tmp_path):
    with pytest.raises(RenderError, match="kind: found 'ros', expected 'opencv' or 'kalibr'"):
        write_camera(tmp_path / "camera.yaml", Camera(64, 48, fx=60.0), "ros")
    assert not (tmp_path / "camera.yaml").exists()


def test_kalibr_has_no_k3(tmp_path):
    camera = Camera(64, 48, fx=60.0, distortion=Distortion(k3=0.1))
    with pytest.raises(RenderError, match=r"found k3 = 0.1, expected 0 for Kalibr's radtan"):
        write_camera(tmp_path / "camera.yaml", camera, "kalibr")
    assert not (tmp_path / "camera.yaml").exists()


@pytest.mark.parametrize(
    ("text", "old", "new", "message"),
    [
        (CHAIN, "radtan", "equidistant", "cam0.distortion_model: found 'equidistant', expected ra"),
        (CHAIN, "pinhole", "omni", "cam0.camera_model: found 'omni', expected pinhole"),
        (CHAIN, ", 1e-5]", "]", r"cam0.distortion_coeffs: found \[.*\], expected 4 numbers"),
        (CHAIN, "[752, 480]", "752", "cam0.resolution: found 752, expected width and height"),
        (CHAIN, "461.629", "-461", r"cam0: Camera.fx: found -461.0, not in \(0, inf\)"),
        (CHAIN, "-0.27695497", "-2.7", r"cam0: Camera.distortion: .* folds the image"),
        (OPENCV, "1e-05, 0. ]", "1e-05, 0., 0.1, 0, 0. ]", "expected zeros after k1, k2, p1, p2"),
        (OPENCV, "8.7538e-04, 1e-05, 0.", "0.", r"coefficients.data: found .*, expected 4 or 5"),
        (OPENCV, "752\n", "7.5\n", "image_width: found 7.5, expected a number of pixels"),
        (OPENCV, "image_height", "height", "image_height: found None, expected a number of pix"),
        (OPENCV, "02, 0., 362", "02, 0.1, 362", r"camera_matrix: found .*, expected \[\[fx, 0"),
        (OPENCV, "4.61629e+02", "many", r"camera_matrix.data: found .*, expected 9 numbers"),
        (OPENCV, "avg_", "distortion_model: equidistant\navg_", "found 'equidistant', expected pl"),
        (OPENCV, "avg_", "fisheye_model: 1\navg_", "fisheye_model: found 1"),
        (OPENCV, "camera_matrix", "K", "found neither camera_matrix nor cam0"),
        (OPENCV, "data: [", "data: {", "could not be read as YAML: while parsing"),
        (OPENCV, "!!opencv-matrix", "!!python/object:os.system", "as YAML: could not determine"),
        (OPENCV, OPENCV, "3", "found int, expected a table"),
        (OPENCV, "image_height", "date: 2020-13-45\nimage_height", "as YAML: month must be in 1"),
    ],
)
def test_other_models_and_damaged_files_are_refused(tmp_path, text, old, new, message):
    """Promise: the error says which field, what was found and what was expected."""
    assert old in text
    with pytest.raises(RenderError, match=message):
        read_camera(written(tmp_path, text.replace(old, new, 1)), "cam0" if text is CHAIN else None)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(RenderError, match=r"none.yaml: no such file"):
        read_camera(tmp_path / "none.yaml")
