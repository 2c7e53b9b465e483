"""Random scenes: each from its seed alone, closed, and clear of the camera."""

import numpy as np
import pytest

from eres_render import Renderer, load_scene
from eres_render.interior.paints import everywhere
from eres_render.random_scenes.paint import PATTERNS, random_painter
from eres_render.random_scenes.paths import camera_path, object_path
from eres_render.random_scenes.random_scene import write_random_scene
from eres_render.random_scenes.solids import SOLIDS, random_solid, room
from eres_render.storage.exr import MIN_WHITE
from eres_render.textures.masonry import plaster
from moving_objects import BALL, FLOOR, SPHERE, folder_of


def test_a_seed_gives_the_same_bytes_and_another_seed_another_scene(tmp_path):
    for name, seed in (("a", [3, 1]), ("b", [3, 1]), ("c", [3, 2])):
        write_random_scene(tmp_path / name / "scene", seed, 0.2, 16)
    a, b, c = (
        {file.name: file.read_bytes() for file in (tmp_path / name / "scene").iterdir()}
        for name in "abc"
    )
    assert a == b
    assert {"scene.xml", "scene.toml", "camera.txt", "room.ply", "room.exr"} <= set(a)
    assert all(a[name] != c[name] for name in ("camera.txt", "room.exr"))


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(k, marks=pytest.mark.slow) for k in (2, 3))])
def test_the_camera_sees_fronts_everywhere_and_keeps_clear(tmp_path, seed):
    """Backs are black and the room is closed, so no pixel is black. The renderer checks the path,
    against moving objects too."""
    write_random_scene(tmp_path / "scene", seed, 0.4, 48)
    scene = load_scene(tmp_path / "scene")
    renderer = Renderer(scene, 48, 4, integrator="emission")
    path = renderer.trajectory
    assert path.duration_s == 0.4
    assert scene.settings.objects
    frames = [renderer.frame(path.pose(t), t_s=t) for t in (0.0, 0.2, 0.4)]
    assert min(frame.min() for frame in frames) > 0
    assert np.log(frames[0]).std() > 0.05
    assert abs(frames[0] - frames[2]).max() > 0.01 * frames[0].mean()


def test_a_dark_scene_is_light_enough_for_its_frames(tmp_path, caplog):
    """Promise: of a scene with nearly the least light the renderer says nothing."""
    write_random_scene(tmp_path / "scene", [0, 4], 0.1, 32)
    white = Renderer(load_scene(tmp_path / "scene"), 32, 4, integrator="emission").white_level
    assert MIN_WHITE < white < 2 * MIN_WHITE
    assert "half-floats" not in caplog.text


@pytest.mark.parametrize("name", ['a "quoted" one', "back\\slash", "über"])
def test_a_folder_may_have_any_name(tmp_path, name):
    """Promise: scene.toml is TOML, and has the name as its title."""
    write_random_scene(tmp_path / name, 3, 0.2, 16)
    assert load_scene(tmp_path / name).settings.title == name


def test_patterns_have_any_shape():
    for k in range(len(PATTERNS)):
        for shape, texel_m in (((1, 3), 0.02), ((70, 40), 0.004), ((8, 900), 0.001)):
            paint = random_painter(AlwaysThe(k))(True)
            texels = paint(shape, texel_m, np.random.default_rng(k))
            assert texels.shape == shape
            assert np.isfinite(texels).all()
            assert texels.min() > 0


class AlwaysThe(np.random.Generator):
    """Chooses the k-th item of a list; all other numbers are those of a usual generator."""

    def __init__(self, k):
        super().__init__(np.random.PCG64(k))
        self.k = k

    def integers(self, *arguments, **options):
        return self.k


@pytest.mark.parametrize("k", range(len(SOLIDS)))
def test_solids_are_closed_with_fronts_outside_and_fill_their_sphere(k):
    """The divergence theorem: the flux of x/3 through a closed surface is its volume."""
    charts = random_solid(0.4, everywhere(plaster), AlwaysThe(k))
    points = np.concatenate([chart.points.reshape(-1, 3) for chart in charts])
    np.testing.assert_allclose(np.linalg.norm(points, axis=1).max(), 0.4)
    volume, area = flux(charts)
    np.testing.assert_allclose(area, 0, atol=1e-5)  # closed: normals cancel, but for two poles
    assert 0 < volume < 4 / 3 * np.pi * 0.4**3


def test_a_room_has_its_fronts_inside():
    corners = np.array([[-1.0, -2.0, -1.5], [2.0, 1.0, 1.5]])
    volume, area = flux(room(corners, everywhere(plaster)))
    np.testing.assert_allclose(volume, -27.0)
    np.testing.assert_allclose(area, 0, atol=1e-12)


def flux(charts):
    """Return the volume that the triangles of charts enclose, and the sum of their area vectors."""
    volume, area = 0.0, np.zeros(3)
    for chart in charts:
        a, b = chart.points[:-1, :-1], chart.points[:-1, 1:]
        c, d = chart.points[1:, :-1], chart.points[1:, 1:]
        for p, q, r in ((a, c, b), (b, c, d)):  # as in the mesh
            normal = np.cross(q - p, r - p) / 2
            area += normal.sum(axis=(0, 1))
            volume += (normal * p).sum() / 3
    return volume, area


def test_an_object_stays_near_its_place_however_long_it_moves():
    center = np.array([1.0, 2.0, 0.5])
    for seed in range(20):
        path = object_path(center, 8.0, np.random.default_rng(seed))
        assert abs(path.T_world[:, :3, 3] - center).max() <= 0.5
        assert (path.t_s[0], path.t_s[-1]) == (0.0, 8.0)
        steps = np.linalg.norm(np.diff(path.T_world[:, :3, 3], axis=0), axis=1)
        assert steps.max() <= 1.5 * np.diff(path.t_s).max() * (1 + 1e-9)


def test_cameras_have_their_speeds_and_look_ahead():
    for seed in range(20):
        assert camera_path(9.0, np.random.default_rng(seed)).t_s[-1] == 9.0
        eye = camera_path(1.0, np.random.default_rng(seed))
        steps = np.linalg.norm(np.diff(eye.T_world[:, :3, 3], axis=0), axis=1)
        assert 0.09 < steps.sum() < 1.01
        assert np.linalg.norm(eye.T_world[:, :3, 3], axis=1).max() <= 1
        assert eye.T_world[:, 1, 2].min() > 0.3  # along y


def test_emission_is_what_path_tracing_finds_where_nothing_reflects(tmp_path):
    """A ball of radiance 1 above a floor of 0.2: exactly these, and their mix at the edge."""
    scene = load_scene(folder_of(tmp_path / "scene", FLOOR, SPHERE, objects=BALL))
    emitted, traced = (
        Renderer(scene, 32, 16, integrator=integrator) for integrator in ("emission", "path")
    )
    pose = emitted.trajectory.pose(0.3)
    frame = emitted.frame(pose, t_s=0.3)
    assert sorted({*np.unique(frame[[0, 16], [0, 13]])}) == [np.float32(0.2), np.float32(1.0)]
    np.testing.assert_allclose(frame, traced.frame(pose, t_s=0.3), rtol=1e-6)
