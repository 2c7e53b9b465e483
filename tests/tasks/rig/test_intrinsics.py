"""Intrinsics from a flashing board: the true camera is found."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eres_render import Camera, Distortion
from sensor import SensorModel, simulate
from sensor.formats import write_events
from tasks.errors import RigError
from tasks.rig.intrinsics import Board, calibrate, find_board, intrinsics

pytestmark = pytest.mark.slow
BOARD = Board(7, 5, 0.03)
TRUTH = Camera(160, 128, fx=150.0, fy=151.0, cx=83.0, cy=61.0, distortion=Distortion(k1=-0.15))
VIEWS = [  # turns in degrees, distance in m
    ((0, 0, 0), 0.30),
    ((28, 0, 5), 0.34),
    ((-28, 4, 0), 0.34),
    ((0, 30, -6), 0.34),
    ((3, -30, 0), 0.34),
    ((20, 22, 12), 0.36),
]


def pose(turn_deg, distance_m):
    """Return R and t from the board to the camera, which looks at the board's middle."""
    R = Rotation.from_euler("XYZ", turn_deg, degrees=True).as_matrix()
    middle = 0.5 * BOARD.square_m * np.array([BOARD.columns - 1, BOARD.rows - 1, 0])
    return R, np.array([0, 0, distance_m]) - R @ middle


def corners_px(turn_deg, distance_m):
    R, t = pose(turn_deg, distance_m)
    return TRUTH.project(BOARD.points_m() @ R.T + t)


FINER = 4


@cache
def rays_of_camera():
    """Return the rays of `FINER` x `FINER` points of each pixel."""
    x, y = ((np.arange(FINER * side) + 0.5) / FINER for side in (TRUTH.width, TRUTH.height))
    return TRUTH.rays(np.stack(np.meshgrid(x, y), axis=-1))


def light_of_board(turn_deg, distance_m):
    """Return the light of a board that is on, (H, W), averaged over pixels."""
    R, t = pose(turn_deg, distance_m)
    rays = rays_of_camera() @ R  # along the board's axes
    eye = -R.T @ t
    at = (eye[:2] - rays[..., :2] * (eye[2] / rays[..., 2:])) / BOARD.square_m + 1
    inside = np.all((at > 0) & (at < [BOARD.columns + 1, BOARD.rows + 1]), axis=-1)
    black = inside & (np.floor(at).sum(axis=-1) % 2 == 0)
    light = np.where(black, 0.02, 0.9)
    return light.reshape(TRUTH.height, FINER, TRUTH.width, FINER).mean(axis=(1, 3))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Recordings of the flashing board, one for each view."""
    folder = tmp_path_factory.mktemp("board")
    model = SensorModel(width=TRUTH.width, height=TRUTH.height, dark_level=0.0)
    found = []
    for k, view in enumerate(VIEWS):
        on = light_of_board(*view) + 0.05
        flashes = np.stack([on if n % 2 else np.full_like(on, 0.05) for n in range(6)])
        path = folder / f"view_{k}.npz"
        write_events(path, simulate(flashes, 0.05 * np.arange(6), model))
        found.append(path)
    return found


def test_perfect_corners_give_the_camera():
    """Promise: pixels count from the image's corner, and the distortion is found."""
    camera, sigmas, rms_px = calibrate([corners_px(*view) for view in VIEWS], BOARD, 160, 128)
    for name in ("fx", "fy", "cx", "cy"):
        assert getattr(camera, name) == pytest.approx(getattr(TRUTH, name), abs=0.02), name
    assert camera.distortion.k1 == pytest.approx(-0.15, abs=1e-3)
    assert rms_px < 1e-3
    assert set(sigmas) == {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"}


def test_standard_deviations_are_those_of_the_noise():
    """Promise: over draws of the noise, numbers spread as their standard deviations say."""
    rng = np.random.default_rng(0)
    drawn = []
    for _ in range(40):
        views = [corners_px(*view) for view in VIEWS]
        noisy = [one + rng.normal(0, 0.02, one.shape) for one in views]
        camera, sigmas, _ = calibrate(noisy, BOARD, 160, 128)
        numbers = camera.fx, camera.fy, camera.cx, camera.cy, camera.distortion.k1
        drawn.append([numbers, [sigmas[name] for name in ("fx", "fy", "cx", "cy", "k1")]])
    numbers, sigmas = np.array(drawn).transpose(1, 0, 2)
    np.testing.assert_allclose(numbers.std(axis=0), sigmas.mean(axis=0), rtol=0.35)


@pytest.mark.parametrize("tilt_deg", [0.0, 1.0])
def test_views_that_tell_little_are_refused(tilt_deg):
    """Promise: boards parallel to the sensor give no focal length, whatever the fit returns."""
    rng = np.random.default_rng(1)
    views = [
        corners_px(tilt_deg * rng.uniform(-1, 1, 3), 0.3 + 0.02 * k)
        + rng.normal(0, 0.05, (len(BOARD.points_m()), 2))
        for k in range(6)
    ]
    with pytest.raises(RigError, match=r"intrinsics: .*tilt the board more"):
        calibrate(views, BOARD, 160, 128)


def test_corners_of_a_board_count_from_the_corner_of_the_image():
    codes = np.round(255 * light_of_board(*VIEWS[0])).astype(np.uint8)
    found = find_board(codes, BOARD)
    truth = corners_px(*VIEWS[0])
    nearest = np.linalg.norm(found[:, None] - truth, axis=-1).argmin(axis=1)
    off = found - truth[nearest]
    assert np.abs(off.mean(axis=0)).max() < 0.06
    assert np.abs(off).max() < 0.5


def test_events_of_a_flashing_board_give_the_camera(files):
    """Promise: from events alone, focal lengths to 1 % and the principal point to a pixel."""
    found = intrinsics(files, BOARD)
    assert len(found.views) >= 5
    assert found.rms_px < 0.4
    assert found.camera.fx == pytest.approx(TRUTH.fx, rel=0.01)
    assert found.camera.fy == pytest.approx(TRUTH.fy, rel=0.01)
    assert found.camera.cx == pytest.approx(TRUTH.cx, abs=1.5)
    assert found.camera.cy == pytest.approx(TRUTH.cy, abs=1.5)


def test_too_few_views_are_refused(files, monkeypatch):
    with pytest.raises(RigError, match="board in 2 files"):
        intrinsics(files[:2], BOARD)
    monkeypatch.setattr("tasks.rig.intrinsics._IMAGES", 2)
    with pytest.raises(RigError, match="board in 0 files"):
        intrinsics(files[:1], Board(12, 9, 0.03))
    with pytest.raises(RigError, match="board: 2x5"):
        Board(2, 5, 0.03)
