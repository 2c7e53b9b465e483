"""A second camera on the rig of the first."""

import numpy as np
import pytest

from eres_render import clips, load_scene, path_through
from eres_render.trajectory.rig import second_camera, to_the_right
from light_scenes import room_folder
from random_paths import hand_held_path


def test_the_spline_of_the_second_camera_stays_on_the_rig():
    """A hand-held pace, 1 m/s and 1 rad/s: micrometers and microradians, between the poses too."""
    path = hand_held_path(duration_s=1.0, knot_interval_s=0.3, turn_rad=0.3, seed=1)
    T_rig = to_the_right(0.2)
    t_s, poses = second_camera(path, T_rig, path.duration_s)
    assert np.diff(t_s).max() <= 2e-3 * (1 + 1e-9)
    second = path_through(t_s, poses)
    t = np.linspace(0, path.duration_s, 3333)
    difference = np.linalg.inv(path.pose(t)) @ second.pose(t)
    np.testing.assert_allclose(difference, np.tile(T_rig, (len(t), 1, 1)), atol=2e-6)


def test_any_scene_has_a_second_camera(small_carpet, tmp_path, eres):
    out = tmp_path / "right.txt"
    code, said, _ = eres("stereo", small_carpet.source, "--baseline", 0.1, "--out", out)
    assert code == 0
    left, right = load_scene(small_carpet.source), load_scene(small_carpet.source, out)
    assert f"{len(right.trajectory().controls) - 2} poses" in said
    for t in (0.0, 0.1234):
        T = np.linalg.inv(left.trajectory().pose(t)) @ right.trajectory().pose(t)
        np.testing.assert_allclose(T, to_the_right(0.1), atol=1e-5)
    assert right.duration_s == pytest.approx(left.duration_s)
    code, _, error = eres("stereo", small_carpet.source, "--baseline", 0.1, "--out", out)
    assert code == 1
    assert f"{out}: already exists; choose another name" in error
    new = tmp_path / "new.txt"
    code, _, error = eres("stereo", small_carpet.source, "--baseline", "nan", "--out", new)
    assert code == 1
    assert "baseline: found nan m, expected a finite distance" in error
    assert not new.exists()


def test_times_in_nanoseconds_are_refused(small_carpet, tmp_path, eres):
    """Promise: the question that `eres render` asks, before a pose for each 2 ms is made."""
    poses = [f"{1403636579763555584 + k * 50_000_000} 0.0{k} 0 2 1 0 0 0\n" for k in range(3)]
    (tmp_path / "ns.txt").write_text("".join(poses))
    options = ["--trajectory", tmp_path / "ns.txt", "--out", tmp_path / "right.txt"]
    code, _, error = eres("stereo", small_carpet.source, "--baseline", 0.1, *options)
    assert (code, "are the times of the poses in seconds?" in error) == (1, True)
    assert not (tmp_path / "right.txt").exists()


def test_both_cameras_have_the_same_clips(tmp_path, eres):
    """Promise: the second path lasts as long as the scene; the spline goes on to the next waypoint,
    and with it there were more clips, at other light."""
    folder = room_folder(tmp_path / "room", ("duration_s = 10.0", "duration_s = 0.6"))
    assert eres("stereo", folder, "--baseline", 0.1, "--out", tmp_path / "right.txt")[0] == 0
    left, right = load_scene(folder), load_scene(folder, tmp_path / "right.txt")
    assert left.trajectory().duration_s > 1.0
    assert right.duration_s == left.duration_s
    assert clips(right) == clips(left)
