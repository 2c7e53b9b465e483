"""The spline path: smooth, calibrated, in bounds."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eres_render import (
    Plane,
    Trajectory,
    TrajectoryError,
    load_scene,
    path_through,
    plane_homography,
    random_path,
    waypoint_loop,
)
from eres_render.camera import map_pixels
from eres_render.trajectory.generators import facing_plane
from eres_render.trajectory.tum import read_tum, tum_text

HOME = facing_plane(Plane((0.0, 0.0, 1.0), 0.0), (0.0, 0.0, 0.0), 1.8)


def a_path(**changes):
    settings = {
        "duration_s": 10.0,
        "mean_speed_mps": 0.9,
        "knot_interval_s": 0.6,
        "sway": (1.0, 1.0, 0.25),
        "turn_rad": (0.05, 0.05, 0.15),
        "seed": 3,
    }
    return random_path(HOME, **(settings | changes))


def test_home_looks_down_with_the_image_upright():
    """Over the plane z = 0: image right is world x, image down is world -y, forward is -z."""
    np.testing.assert_allclose(HOME[:3, :3], np.diag([1.0, -1.0, -1.0]), atol=1e-15)
    np.testing.assert_allclose(HOME[:3, 3], [0, 0, 1.8])


@pytest.mark.parametrize("changes", [{"duration_s": 1e300}, {"knot_interval_s": 1e-12}])
def test_a_random_path_has_an_end(changes):
    """Promise: what no memory holds is refused, with the shortest knot interval."""
    with pytest.raises(TrajectoryError, match=r"knot_interval_s: found .* s, expected at least"):
        a_path(**changes)


def test_a_path_has_its_own_poses():
    """Promise: an array that is changed later changes no path, whose own cannot be changed."""
    controls = np.tile(np.eye(4), (5, 1, 1))
    controls[:, 0, 3] = [-0.1, 0.0, 0.1, 0.2, 0.3]
    path = Trajectory(0.1 * np.arange(-1.0, 4.0), controls)
    controls[:, 0, 3] *= 2
    assert path.pose(0.05)[0, 3] == pytest.approx(0.05)
    with pytest.raises(ValueError, match="read-only"):
        path.controls[0] = np.eye(4)


def test_position_and_rotation_are_twice_continuously_differentiable():
    """Across a knot, the value and both derivatives agree from the left and from the right."""
    path, h = a_path(), 1e-3
    for knot_s in 0.6 * np.arange(1, 6):
        left = path.pose(knot_s - h * np.arange(5))
        right = path.pose(knot_s + h * np.arange(5))
        for part in (np.s_[:, :3, 3], np.s_[:, :3, :3]):
            a, b = left[part], right[part]
            first = (-25 * a[0] + 48 * a[1] - 36 * a[2] + 16 * a[3] - 3 * a[4]) / (-12 * h)
            other = (-25 * b[0] + 48 * b[1] - 36 * b[2] + 16 * b[3] - 3 * b[4]) / (12 * h)
            np.testing.assert_allclose(first, other, atol=1e-6)
            second = (2 * a[0] - 5 * a[1] + 4 * a[2] - a[3]) / h**2
            other = (2 * b[0] - 5 * b[1] + 4 * b[2] - b[3]) / h**2
            np.testing.assert_allclose(second, other, atol=5e-3 * max(1, abs(second).max()))


def test_constant_velocity_is_reproduced_exactly():
    """Controls that move and turn steadily give a path that moves and turns steadily."""
    k = np.arange(9)
    controls = np.tile(np.eye(4), (9, 1, 1))
    axis = np.array([0.2, -0.5, 0.3])
    controls[:, :3, :3] = Rotation.from_rotvec(0.1 * k[:, None] * axis).as_matrix()
    controls[:, :3, 3] = k[:, None] * np.array([0.3, 0.1, -0.2])
    path = Trajectory(0.5 * np.arange(-1, len(controls) - 1), controls)
    t = np.linspace(0, path.duration_s, 57)
    s = 1 + t / 0.5  # the path starts at the second control
    T = path.pose(t)
    np.testing.assert_allclose(T[:, :3, 3], s[:, None] * [0.3, 0.1, -0.2], atol=1e-13)
    expected = Rotation.from_rotvec(0.1 * s[:, None] * axis).as_matrix()
    np.testing.assert_allclose(T[:, :3, :3], expected, atol=1e-13)


def test_velocity_is_the_derivative_of_position():
    path, h = a_path(), 1e-5
    t = np.linspace(0.1, 9.9, 101)
    numeric = (path.pose(t + h)[:, :3, 3] - path.pose(t - h)[:, :3, 3]) / (2 * h)
    np.testing.assert_allclose(path.velocity(t), numeric, atol=1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_mean_speed_is_calibrated(seed):
    """Expected: path length over time is 0.9 m/s, measured here by a fine polygon."""
    t = np.linspace(0, 10, 200_001)
    p = a_path(seed=seed).pose(t)[:, :3, 3]
    assert np.linalg.norm(np.diff(p, axis=0), axis=1).sum() / 10 == pytest.approx(0.9, rel=1e-6)


def test_one_seed_one_path():
    np.testing.assert_array_equal(a_path().controls, a_path().controls)
    assert not np.allclose(a_path().controls, a_path(seed=4).controls)


def test_poses_are_vectorized_over_any_shape():
    path = a_path()
    t = np.linspace(0, 10, 6).reshape(2, 3)
    assert path.pose(t).shape == (2, 3, 4, 4)
    np.testing.assert_allclose(path.pose(t)[1, 2], path.pose(10.0), atol=1e-14)


def test_times_off_the_path_are_refused():
    with pytest.raises(TrajectoryError, match=r"the path covers 0 to .* s"):
        a_path().pose([0.0, 11.0])


def test_carpet_moves_550_px_per_second_on_average():
    """Mean image motion over the path and the image, at 1280 px: 550 px/s within 3 %."""
    scene = load_scene("carpet")
    path, camera = scene.trajectory(), scene.camera(1280)
    assert path.mean_speed_mps(10.0) == pytest.approx(0.9, rel=1e-9)
    t, dt, pixels = np.linspace(0, 9.99, 1000), 1e-4, camera.grid(17)
    H = plane_homography(camera.K, path.pose(t), path.pose(t + dt), scene.plane)
    speed = np.linalg.norm(map_pixels(H, pixels) - pixels, axis=-1) / dt
    assert speed.mean() == pytest.approx(550, rel=0.03)


def test_carpet_fills_the_view_at_all_times():
    scene = load_scene("carpet")
    camera, T = scene.camera(64), scene.trajectory().pose(np.linspace(0, 10, 1001))
    rays = camera.rays(camera.grid(3)) @ np.swapaxes(T[:, :3, :3], 1, 2)
    seen = scene.plane.intersect(T[:, None, :3, 3], rays)
    assert abs(seen[..., :2]).max() < 2.5


def test_tum_files_keep_every_bit_of_time_and_the_pose(tmp_path):
    t = np.linspace(0.1, 3.3, 7)
    T = a_path().pose(t)
    (tmp_path / "poses.txt").write_text(tum_text(t, T))
    t_read, T_read = read_tum(tmp_path / "poses.txt")
    np.testing.assert_array_equal(t_read, t)
    np.testing.assert_allclose(T_read, T, atol=1e-14)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0 0 0 0 0 0 0\n", "line 1: found '0 0 0 0 0 0 0', expected 8 numbers"),
        ("# fine\n0 1 2 three 0 0 0 1\n", "line 2: .*expected 8 numbers"),
        ("0 0 0 0 0 0 0 2\n", "quaternion of length 2"),
        ("0 0 0 0 0 0 0 1.002\n", "quaternion of length 1.002"),
        (
            "1 0 0 0 0 0 0 1\n0.5 0 0 0 0 0 0 1\n",
            r"line 2: found time 0\.5 after 1\.0, expected increasing times",
        ),
        ("", "found no pose"),
    ],
)
def test_damaged_tum_files_are_refused(tmp_path, text, message):
    file = tmp_path / "poses.txt"
    file.write_text(text)
    with pytest.raises(TrajectoryError, match=message):
        read_tum(file)


def test_nearly_unit_quaternions_are_normalized(tmp_path):
    file = tmp_path / "poses.txt"
    file.write_text("0 1 2 3 0 0 0.0006 1.0005\n")
    R = read_tum(file)[1][0, :3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)


def test_rotations_must_be_rotations():
    controls = np.tile(np.eye(4), (4, 1, 1))
    controls[2, 0, 0] = math.sqrt(2)
    with pytest.raises(TrajectoryError, match="at index 2, expected a rotation: orthonormal"):
        Trajectory(0.5 * np.arange(-1, len(controls) - 1), controls)


@pytest.mark.parametrize("field", ["duration_s", "mean_speed_mps", "knot_interval_s"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_generators_need_positive_numbers(field, value):
    """Promise: one line names the argument, in place of a division by zero or a path of NaN."""
    with pytest.raises(TrajectoryError, match=f"{field}: found {value}, expected a positive"):
        a_path(**{field: value})
    if field != "knot_interval_s":
        settings = {"duration_s": 1.0, "mean_speed_mps": 1.0} | {field: value}
        none = (0.0, 0.0, 0.0)
        with pytest.raises(TrajectoryError, match=f"{field}: found {value}, expected a positive"):
            waypoint_loop(np.array([HOME, HOME]), sway_m=none, turn_rad=none, seed=0, **settings)


def test_a_loop_needs_two_waypoints():
    """Promise: none are an error too, not a division by zero."""
    settings = {"duration_s": 1.0, "mean_speed_mps": 1.0, "sway_m": (1, 1, 1), "seed": 0}
    with pytest.raises(TrajectoryError, match="waypoints: found 0, expected two or more"):
        waypoint_loop(np.empty((0, 4, 4)), turn_rad=(0, 0, 0), **settings)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_times_and_the_path_of_a_scene_are_finite(value):
    """Promise: a time is never NaN, nor is a pose of a path that a scene gets; only a path that a
    method answers may be, which is a failure."""
    knots_s, controls = 0.5 * np.arange(-1.0, 4.0), np.tile(np.eye(4), (5, 1, 1))
    controls[3, 1, 3] = value
    with pytest.raises(TrajectoryError, match=r"controls: found .* index 3, expected finite num"):
        load_scene("room", Trajectory(knots_s, controls))
    controls[3, 1, 3], knots_s[4] = 0.0, value
    with pytest.raises(TrajectoryError, match=rf"knots_s: found {value} at index 4, expected fin"):
        Trajectory(knots_s, controls)


@pytest.mark.parametrize(
    ("row", "column", "value"),
    [(0, 1, 0.5), (1, 1, 1.5), (0, 0, -1.0), (0, 3, np.nan), (2, 2, np.inf)],
    ids=["sheared", "scaled", "mirrored", "NaN", "infinite"],
)
def test_paths_go_through_poses_only(row, column, value):
    """Promise: a matrix that is no pose is refused with its number, not bent into one."""
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, 0, 3] = [0, 0.1, 0.2, 0.3]
    assert path_through(range(4), poses.tolist()).duration_s == 3
    poses[2, row, column] = value
    with pytest.raises(TrajectoryError, match=r"poses: found .* index 2, expected (a r|fin)"):
        path_through(range(4), poses)
    with pytest.raises(TrajectoryError, match=r"found 4 times and poses of shape \(3, 4, 4\)"):
        path_through(range(4), poses[:3])
