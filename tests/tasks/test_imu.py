"""The IMU on a camera: exact derivatives, gravity, noise in Kalibr's units."""

import dataclasses

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eres_render import Trajectory, path_through, render_scene
from random_paths import hand_held_path
from tasks.errors import TaskError
from tasks.events.imu import measure
from tasks.events.imu_options import ImuOptions

UP = np.array([0, 0, 9.80665])
EXACT = ImuOptions(
    imu=100.0,
    gyroscope_noise=0.0,
    gyroscope_walk=0.0,
    accelerometer_noise=0.0,
    accelerometer_walk=0.0,
)


def path(rotvec_of=lambda t: np.zeros(3), place_of=lambda t: np.zeros(3)):
    """Return the path with these control poses at tenths of a second."""
    knots = 0.1 * np.arange(-1.0, 13.0)
    controls = np.tile(np.eye(4), (len(knots), 1, 1))
    for T, t in zip(controls, knots, strict=True):
        T[:3, :3] = Rotation.from_rotvec(rotvec_of(t)).as_matrix()
        T[:3, 3] = place_of(t)
    return Trajectory(knots, controls)


def test_at_rest_it_feels_gravity_from_below():
    """A camera that looks down, its y axis along the world's -y: up is its -z."""
    found = measure(path(lambda t: (np.pi, 0, 0)), np.linspace(0, 1, 5), EXACT, 0)
    np.testing.assert_allclose(found.gyroscope, 0, atol=1e-12)
    np.testing.assert_allclose(found.accelerometer, np.tile([0, 0, -9.80665], (5, 1)), atol=1e-12)


def test_in_free_fall_it_feels_nothing():
    """A parabola's control points lie on a parabola of the same bend."""
    fall = path(place_of=lambda t: (2 * t, 0, -0.5 * 9.80665 * t**2))
    np.testing.assert_allclose(
        measure(fall, np.linspace(0, 1.1, 34), EXACT, 0).accelerometer, 0, atol=1e-9
    )


def test_an_even_turn_has_its_rate_about_the_cameras_axis():
    omega = np.array([0.3, -1.0, 2.0])
    found = measure(path(lambda t: omega * t), np.linspace(0, 1.1, 34), EXACT, 0)
    np.testing.assert_allclose(found.gyroscope, np.tile(omega, (34, 1)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(found.accelerometer, axis=1), 9.80665)


def test_derivatives_are_those_of_the_path():
    """Against differences of poses: on a random path, and on one with uneven knots."""
    random = hand_held_path(duration_s=2.0, knot_interval_s=0.2, turn_rad=0.5, seed=3)
    uneven_s = np.array([0.0, 0.3, 0.4, 0.9, 1.3, 2.0])
    for one in (random, path_through(uneven_s, random.pose(uneven_s))):
        t, h = np.linspace(0.05, 1.95, 77), 1e-4
        before, at, after = (one.pose(t + k * h) for k in (-1, 0, 1))
        bend = (after - 2 * at + before)[:, :3, 3] / h**2
        np.testing.assert_allclose(one.acceleration(t), bend, atol=2e-2)
        turn = Rotation.from_matrix(np.swapaxes(before[:, :3, :3], 1, 2) @ after[:, :3, :3])
        np.testing.assert_allclose(one.angular_velocity(t), turn.as_rotvec() / (2 * h), atol=1e-5)
        R = at[:, :3, :3]
        force = np.einsum("nij,ni->nj", R, one.acceleration(t) + UP)
        np.testing.assert_allclose(measure(one, t, EXACT, 0).accelerometer, force, atol=1e-12)
        twice = measure(one, t, EXACT, 0, speed=2.0)
        np.testing.assert_allclose(twice.gyroscope, 2 * one.angular_velocity(t))


@pytest.mark.parametrize("rate_hz", [25.0, 100.0])
def test_noise_has_its_densities_at_any_rate(rate_hz):
    """White noise averages out as n / sqrt(T); a bias wanders by w sqrt(T)."""
    options = ImuOptions(
        imu=rate_hz,
        gyroscope_noise=0.02,
        gyroscope_walk=0.3,
        accelerometer_noise=0.5,
        accelerometer_walk=0.1,
    )
    t_s = np.arange(round(rate_hz) + 1) / rate_hz
    at_rest = path()
    runs = [measure(at_rest, t_s, options, seed) for seed in range(300)]
    for k, name in enumerate(("gyroscope", "accelerometer")):
        bias = np.array([run[k + 2] for run in runs])
        still = (0, 0, 9.80665) if k else (0, 0, 0)
        white = np.array([run[k] for run in runs]) - still - bias
        n, w = getattr(options, f"{name}_noise"), getattr(options, f"{name}_walk")
        assert np.std(white[:, 1:].mean(axis=1)) == pytest.approx(n, rel=0.1)  # over 1 s
        assert np.std(bias[:, -1]) == pytest.approx(w, rel=0.1)  # after 1 s
        assert not bias[:, 0].any()


def test_any_sequence_can_have_one(small_carpet, tmp_path, eres):
    """Promise: `eres simulate --imu` adds it at the sequence's speed, `eres convert` keeps it."""
    (clip,) = render_scene(
        small_carpet, tmp_path / "clips", resolution=16, spp=1, max_displacement_px=2.0, samples=1
    )
    file, copy = tmp_path / "events.h5", tmp_path / "copy.h5"
    size = ["--resolution", 16, "--speed", 2]
    command = ["simulate", clip.folder, "--out", file, *size, "--imu", 200, "--seed", 3]
    assert eres(*command)[0] == 0
    with h5py.File(file) as opened:
        group = opened["imu"]
        t_us = group["t_us"][:]
        assert set(np.diff(t_us)) <= {4999, 5000, 5001}
        assert t_us[0] == round(clip.t_s[0] / 2 * 1e6)
        assert clip.t_s[-1] / 2 * 1e6 - t_us[-1] < 5001
        options = dataclasses.replace(ImuOptions(), imu=200.0)
        times_s = clip.t_s[0] + 0.01 * np.arange(len(t_us))
        expected = measure(clip.trajectory, times_s, options, 3, 2.0)
        for name, values in expected._asdict().items():
            np.testing.assert_allclose(group[name], values, atol=1e-9)
        assert group.attrs["gyroscope_walk"] == options.gyroscope_walk
        assert group.attrs["gravity_mps2"] == 9.80665
    code, _, said = eres("convert", file, copy, "--shift-us", 7)
    assert (code, said) == (0, "")
    with h5py.File(copy) as opened:
        np.testing.assert_array_equal(opened["imu/t_us"], t_us + 7)
    for wrong, found in (
        (["--imu", 0], "imu: found 0 Hz, expected above 0"),
        (["--imu", 9, "--gyroscope-noise", -1], "--gyroscope-noise: found -1.0, expected"),
        (["--imu", 9, "--format", "npz"], "only DSEC's format (.h5) can store imu"),
    ):
        code, _, error = eres("simulate", clip.folder, "--out", tmp_path / "x.h5", *size, *wrong)
        assert code == 1
        assert found in error
    with pytest.raises(TaskError, match="imu: found nan"):
        ImuOptions(imu=float("nan")).check()
