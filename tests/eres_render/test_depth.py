"""Scenes with depth: loops through waypoints, image motion from depth, paths that hit things."""

from itertools import pairwise

import numpy as np
import pytest

from eres_render import (
    Clip,
    Renderer,
    RenderError,
    SceneError,
    TrajectoryError,
    load_scene,
    path_through,
    render_clip,
    waypoint_loop,
)
from eres_render.rendering import lightmaps as bake
from eres_render.rendering.backend import select_variant
from eres_render.rendering.clearance import _ends_of_chords, check_clearance
from eres_render.rendering.load import load_mi_scene
from eres_render.rendering.raycast import RayCaster
from eres_render.trajectory import generators, spline
from eres_render.trajectory.frame_times import depth_image_motion, plane_image_motion
from eres_render.trajectory.generators import look_at
from light_scenes import (
    CAMERA,
    edit_scene,
    light_evenly,
    room_folder,
    small_carpet_folder,
    write_scene,
)

UP = (0.0, 0.0, 1.0)
CORNERS = [look_at(p, (0, 0, 1), UP) for p in ((2, 0, 1), (0, 3, 1.5), (-2, 0, 1), (0, -3, 0.5))]


def loop(**changes):
    settings = {
        "duration_s": 10.0,
        "mean_speed_mps": 1.2,
        "sway_m": (0.1, 0.1, 0.1),
        "turn_rad": (0.05, 0.05, 0.1),
        "seed": 1,
    }
    return waypoint_loop(np.array(CORNERS), **(settings | changes))


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    return load_scene(room_folder(tmp_path_factory.mktemp("scenes") / "room"))


def test_a_path_passes_through_the_given_poses_at_their_times():
    """Expected: exact passage at uneven times, with turns of a tenth of a radian between poses."""
    rng = np.random.default_rng(0)
    t = 100.0 + np.cumsum(rng.uniform(0.1, 0.2, 40))
    center, turn = np.cumsum(rng.normal(size=(2, 40, 3)) * 0.1, axis=1)
    ahead = np.column_stack([np.cos(turn[:, 0]), np.sin(turn[:, 0]), 0.3 * turn[:, 1]])
    poses = np.array([look_at(c, c + a, UP) for c, a in zip(center, ahead, strict=True)])
    path = path_through(t, poses)
    assert path.duration_s == pytest.approx(t[-1] - t[0])
    np.testing.assert_allclose(path.pose(t - t[0]), poses, atol=1e-11)
    # Twice differentiable at the poses: velocity has no kink.
    inner, h = (t - t[0])[1:-1], 1e-6
    before, at, after = (path.velocity(inner + k * h) for k in (-1, 0, 1))
    assert abs(after - 2 * at + before).max() < 1e-8


def test_poses_that_no_spline_joins_are_refused():
    with pytest.raises(TrajectoryError, match="found 0 s after 0 s, expected increasing times"):
        path_through([0.0, 0.0], np.array(CORNERS[:2]))
    about = [look_at((k, 0, 0), (k + (-1) ** k, 0.01 * k, 0), UP) for k in range(6)]
    with pytest.raises(TrajectoryError, match="turns too far from pose to pose near t = "):
        path_through(np.arange(6.0), np.array(about))


@pytest.mark.parametrize("duration_s", [1.0, 10.0, 40.0])
def test_a_loop_has_exactly_the_mean_speed_however_many_rounds_it_takes(duration_s):
    """Expected: path length over time is 1.2 m/s, measured here by a fine polygon."""
    path = loop(duration_s=duration_s)
    p = path.pose(np.linspace(0, duration_s, 100_001))[:, :3, 3]
    length_m = np.linalg.norm(np.diff(p, axis=0), axis=1).sum()
    assert length_m / duration_s == pytest.approx(1.2, rel=1e-6)


def test_the_length_of_a_long_path_is_summed_in_parts(monkeypatch):
    """Promise: memory does not grow with the number of poses, and the length is the same."""
    path = loop()
    whole = path.length_m([1.0, 7.5])
    monkeypatch.setattr(spline, "_STRETCHES_AT_ONCE", 7)
    np.testing.assert_array_equal(path.length_m([1.0, 7.5]), whole)


def test_a_loop_without_sway_meets_its_waypoints_in_turn():
    path = loop(sway_m=(0, 0, 0), turn_rad=(0, 0, 0))
    reached = path.pose(path.knots_s[1:5])
    np.testing.assert_allclose(reached, CORNERS, atol=1e-9)


def test_a_loop_does_not_repeat_itself_and_follows_its_seed():
    path = loop(duration_s=40.0)
    first, second = path.controls[1:5], path.controls[5:9]
    assert abs(first - second)[:, :3, 3].max() > 0.01
    np.testing.assert_array_equal(loop().controls, loop().controls)
    assert not np.allclose(loop().controls, loop(seed=2).controls)


def test_a_loop_has_an_end(monkeypatch):
    """Promise: an absurd duration is refused with the longest, before memory is full."""
    monkeypatch.setattr(generators, "_MAX_SEGMENTS", 1000)
    with pytest.raises(
        TrajectoryError, match=r"duration_s: found 1e\+09 s at 1e\+09 m/s, expected"
    ):
        loop(duration_s=1e9, mean_speed_mps=1e9)


def test_waypoints_at_one_place_are_refused():
    with pytest.raises(TrajectoryError, match=r"waypoints\[1\]: has the same position"):
        waypoint_loop(
            np.array([CORNERS[0]] * 2),
            duration_s=1.0,
            mean_speed_mps=1.0,
            sway_m=(0, 0, 0),
            turn_rad=(0, 0, 0),
            seed=0,
        )
    with pytest.raises(TrajectoryError, match="expected a point away from the camera"):
        look_at((0, 0, 1), (0, 0, 2), UP)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('kind = "waypoints"', 'kind = "waypoint"', "path: kind: found 'waypoint', expected one"),
        ('kind = "waypoints"\n', "", "path: kind: found None, expected one of facing_plane, way"),
        ("seed = 5", "sede = 5", r"path\.sede: unknown; did you mean 'seed'"),
        ("min_clearance_m = 0.2", "min_clearance_m = 0", r"path\.min_clearance_m: found 0\.0"),
        ("[-1.0, 0.0, 1.5]", "[-1.0, 0.0]", r"path\.waypoints\[2\]\.position_m: found \[-1\.0, 0"),
    ],
)
def test_each_wrong_field_of_a_path_is_named(tmp_path, old, new, message):
    with pytest.raises(SceneError, match=message):
        load_scene(room_folder(tmp_path, (old, new)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            [("[0.0, 0.0, 1.6]", "[-1.0, 0.0, 9.0]")],
            r"waypoints\[2\]\.target_m: found \[-1\.0, 0\.0, 9\.0\], expected a point away",
        ),
        (
            [
                ("[0.0, 1.0, 1.6]", "[1.0, 0.0, 1.5]"),
                ("sway_m = [0.05, 0.05, 0.05]", "sway_m = [0.0, 0.0, 0.0]"),
            ],
            r"waypoints\[1\]: has the same position .*, \[1\.0, 0\.0, 1\.5\]",
        ),
        (
            [
                ("target_m = [0.0, 0.0, 1.5]", "target_m = [0.0, 2.0, 1.5]"),
                ("target_m = [0.0, 0.0, 1.6]", "target_m = [-0.7, -2.0, 1.6]"),
            ],
            r"waypoints\[\d\]: the camera turns too far to or from it",
        ),
    ],
)
def test_a_loop_that_cannot_be_made_names_the_file_and_the_waypoint(tmp_path, changes, message):
    """Promise: the field of scene.toml, counted as in it, and no meters for seconds."""
    scene = load_scene(room_folder(tmp_path, *changes))
    with pytest.raises(TrajectoryError, match=rf"scene\.toml: path\.{message}"):
        scene.trajectory()


def test_a_path_that_faces_a_plane_needs_one(tmp_path):
    folder = edit_scene(tmp_path / "lost")
    toml = (folder / "scene.toml").read_text()
    start, end = toml.index("[plane]"), toml.index("[camera]")
    (folder / "scene.toml").write_text(toml[:start] + toml[end:])
    with pytest.raises(SceneError, match=r"path\.kind: found 'facing_plane', .*or a \[plane\]"):
        load_scene(folder)


def test_image_motion_from_depth_is_the_homography_where_the_scene_is_a_plane(tmp_path):
    folder = small_carpet_folder(tmp_path / "carpet")
    renderer = Renderer(load_scene(light_evenly(folder, "carpet", 3.0)), 256, 1)
    path, camera = renderer.trajectory, renderer.camera
    from_plane = plane_image_motion(path, camera, renderer.scene.plane, 33)
    from_depth = depth_image_motion(path, camera, renderer.inverse_depth, 33)
    for t_0, t_1 in ((0.1, 0.101), (2.0, 2.02), (5.0, 4.9)):
        assert from_depth(t_0, t_1) == pytest.approx(from_plane(t_0, t_1), rel=1e-5)


def test_frames_of_a_scene_with_depth(tmp_path, room):
    """Expected: consecutive frames are within the limit of each other at any depth."""
    renderer = Renderer(room, 32, 4)
    sequence = render_clip(renderer, Clip(0, 0.24, 0.25, 0.29), tmp_path / "clip", 0.5)
    steps = [renderer.image_motion(a, b) for a, b in pairwise(sequence.t_s)]
    assert max(steps) <= 0.5 * (1 + 1e-4)
    assert len(sequence) > 4
    # The ball, brightest of all, is in the middle of the view.
    assert sequence.frame(0)[16, 16] == pytest.approx(0.9 * 3 / np.pi, rel=1e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            [("0.2\nup", "0.75\nup")],
            r"at t = \d\.\d+ s the camera comes within 0\.\d+ m of shape '",
        ),
        ([("[1.0, 0.0, 1.5]", "[2.5, 0.0, 1.5]")], "the camera is inside a solid or behind a wall"),
        ([("[1.0, 0.0, 1.5]", "[0.1, 0.0, 1.5]")], "inside a solid .* shape 'ball'"),
        ([("0.2\nup", "0.005\nup"), ("[0.0, 1.0, 1.6]", "[0.0, 2.5, 1.6]")], "shape 'north'"),
    ],
)
def test_a_path_into_things_is_refused_before_anything_is_written(tmp_path, changes, message):
    scene = load_scene(room_folder(tmp_path / "room", *changes))
    renderer = Renderer(scene, 16, 1)
    with pytest.raises(TrajectoryError, match=message) as caught:
        render_clip(renderer, Clip(0, 0.24, 0.25, 0.29), tmp_path / "clip", 0.5)
    assert "scene.toml: path: at t = " in str(caught.value)
    assert not (tmp_path / "clip").exists()


def test_a_dash_after_a_long_rest_is_checked_at_every_place(room):
    """Promise: places are half the clearance apart, whatever the speed there."""
    caster = RayCaster(load_mi_scene(room))
    asked = []

    def place(t_s):
        asked.append(np.interp(t_s, [0.0, 9.5, 10.0], [0.0, 0.0, 1.0])[:, None] * [0.2, 0.1, 0.0])
        return asked[-1] + [1.0, 0.0, 1.5]

    check_clearance(place, np.array([0.0, 9.5, 10.0]), 10.0, caster, 0.002, "path")
    places = next(one for one in asked if 100 < len(one) < 10_000)  # of rays in all directions
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps.max() <= 0.001 * (1 + 1e-9)
    assert steps.sum() == pytest.approx(np.hypot(0.2, 0.1))


HOUR_S = 3600.0
HOUR_KNOTS_S = np.linspace(0.0, HOUR_S, 7201)


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    """Rays at a ball of 0.8 m around the origin."""
    shape = '<shape type="sphere" id="ball"><float name="radius" value="0.8"/></shape>'
    select_variant()
    file = write_scene(tmp_path_factory.mktemp("ball"), CAMERA, shape)
    return RayCaster(load_mi_scene(load_scene(file)))


def test_an_hour_around_a_ball_keeps_clear_of_it(ball):
    """Promise: what is said to cross a surface does; places are 1.8 m apart, through the ball."""

    def place(t_s):
        return np.stack([np.cos(t_s), np.sin(t_s), np.zeros_like(t_s)], axis=-1)

    check_clearance(place, HOUR_KNOTS_S, HOUR_S, ball, 0.01, "path")


@pytest.mark.parametrize("dip_s", np.pi / 2 * np.array([1, 786, 2291]))
def test_a_short_dip_in_an_hour_is_refused(ball, dip_s):
    """Promise: the path is followed between the places that look round, at any length."""

    def place(t_s):
        dip = np.interp(abs(t_s - dip_s), [0.0, 0.1], [0.4, 0.0])
        return np.stack([np.sin(2 * t_s), 1.0 - dip, np.zeros_like(t_s)], axis=-1)

    knots_s = np.union1d(HOUR_KNOTS_S, dip_s + np.array([-0.1, 0.0, 0.1]))
    with pytest.raises(TrajectoryError, match="shape 'ball', expected a path") as caught:
        check_clearance(place, knots_s, HOUR_S, ball, 0.01, "path")
    said_s = float(str(caught.value).split(" = ")[1].split(" s ")[0])
    assert said_s == pytest.approx(dip_s, abs=0.1)


@pytest.mark.parametrize("tolerance_m", [0.05, 0.005, 0.0005])
@pytest.mark.parametrize("kind", ["zigzag", "random"])
def test_chords_follow_the_path(kind, tolerance_m):
    """Promise: within the tolerance, where the path bends one way at a knot and back at the next,
    and from ends at which it is straight."""
    t_s, poses = 0.5 * np.arange(9.0), np.tile(np.eye(4), (9, 1, 1))
    poses[:, :3, 3] = np.random.default_rng(0).normal(0, 0.3, (9, 3))
    if kind == "zigzag":
        poses[:, :3, 3] = [(0.1 * k, 0.2 * (-1) ** k, 0.0) for k in range(9)]
    path = path_through(t_s, poses)

    def place(t_s):
        return path.pose(t_s)[..., :3, 3]

    ends_s = _ends_of_chords(place, t_s, tolerance_m)
    share = np.linspace(0, 1, 30)[:, None]
    there = place((ends_s[:-1] + share * np.diff(ends_s)).ravel()).reshape(30, -1, 3)
    places = place(ends_s)
    chords = places[:-1] + share[..., None] * np.diff(places, axis=0)
    off_m = np.linalg.norm(there - chords, axis=2).max()
    assert 0.2 * tolerance_m < off_m < 1.1 * tolerance_m


def test_a_clip_beyond_the_checked_path_is_refused(room, tmp_path):
    """Promise: what is rendered keeps clear of surfaces; the spline may go on after the path."""
    renderer = Renderer(room, 16, 1)
    end_s = room.duration_s
    assert renderer.trajectory.duration_s > end_s
    with pytest.raises(RenderError, match=r"Clip 0: ends at 10\.\d+ s, but .* ends at"):
        render_clip(renderer, Clip(0, 0.1, 0.2, end_s + 0.1), tmp_path / "clip", 0.5)
    assert not (tmp_path / "clip").exists()


def test_a_path_into_things_is_refused_before_anything_is_baked(tmp_path, monkeypatch):
    folder = room_folder(tmp_path / "room", ("[1.0, 0.0, 1.5]", "[0.1, 0.0, 1.5]"))
    for file in folder.glob("lightmap_*.exr"):
        file.unlink()
    monkeypatch.setattr(bake, "bake_scene", None)  # baking would fail
    with pytest.raises(TrajectoryError, match=r"inside a solid .* shape 'ball'"):
        Renderer(load_scene(folder), 16, 1)


def test_distances_alone_are_those_of_whole_hits(room):
    """Equal to the bit, for rays that hit triangles and for those that miss everything."""
    caster = RayCaster(load_mi_scene(room))
    rng = np.random.default_rng(0)
    for origin in (np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 90.0])):
        rays = rng.normal(size=(2000, 3))
        distance = caster.distance(origin, rays)
        np.testing.assert_array_equal(distance, caster.cast(origin, rays).distance)
    assert np.isinf(distance).any()
