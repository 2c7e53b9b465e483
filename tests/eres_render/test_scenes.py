"""The packaged scenes: calibrated paths, light that is looked up, sound geometry.

Only the carpet has its texture here; `test_scenes_in_full.py` has those of all scenes.
"""

from functools import cache

import numpy as np
import pytest

from eres_render import Renderer, clips, list_scenes, load_scene
from eres_render.interior.atlas import CELL_M
from eres_render.interior.pieces import PIECES
from eres_render.rendering import backend
from eres_render.rendering import renderer as renderer_module
from eres_render.rendering.lightmaps import baked_scene
from eres_render.scene.texture_recipes import TextureRecipe
from eres_render.storage.exr import read_attributes, read_luminance, write_luminance
from light_scenes import assert_looked_up_as_traced

SPEEDS_MPS = {"carpet": 0.9, "rocks": 0.7, "room": 1.2}
COARSER = 8  # texels of a gray texture: large ones take seconds to load


@pytest.fixture(scope="module", autouse=True)
def loaded(tmp_path_factory):
    """Load each scene once for all renderers: the room and its textures take seconds."""
    backend.select_variant()
    real_file, gray = TextureRecipe.file, tmp_path_factory.mktemp("gray")

    def file(recipe):
        """Return the carpet's texture alone; the others take long to make, and are gray here."""
        if recipe.kind == "carpet":
            return real_file(recipe)
        rows, columns = (-(-side // COARSER) for side in recipe.shape)
        path = gray / f"{rows}x{columns}.exr"
        if not path.exists():
            write_luminance(path, np.full((rows, columns), 0.3))
        return path

    load = cache(lambda name: baked_scene(load_scene(name)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TextureRecipe, "file", file)
        patch.setattr(renderer_module, "baked_scene", lambda scene, _: load(scene.name))
        yield


@pytest.fixture(scope="module")
def renderers(loaded):
    """Return one small renderer of each scene."""
    return {name: Renderer(load_scene(name), 48, 4, integrator="baked") for name in SPEEDS_MPS}


@pytest.fixture(scope="module")
def pieces():
    return {name: (piece, piece.atlas()) for name, piece in PIECES.items()}


def follow(renderer, times_s):
    """Return where points of the first image go, (T, N, 2) pixels of a 1280-pixel view."""
    camera, poses = renderer.camera, renderer.trajectory.pose(times_s)
    points = camera.grid(9)
    depth = 1 / renderer.inverse_depth(poses[0], points)
    world = poses[0, :3, 3] + depth[:, None] * (camera.rays(points) @ poses[0, :3, :3].T)
    moved = [camera.project((world - T[:3, 3]) @ T[:3, :3]) for T in poses]
    return np.array(moved) * 1280 / camera.width


def mean_motion_px_per_s(renderer, times=24, dt_s=1e-4):
    """Return the mean speed of image points."""
    speeds = []
    for t in (np.arange(times) + 0.5) * renderer.scene.duration_s / times:
        first, second = follow(renderer, [t, t + dt_s])
        speeds.append(np.linalg.norm(second - first, axis=1).mean() / dt_s)
    return np.mean(speeds)


def test_three_scenes_are_packaged():
    assert list_scenes() == sorted(SPEEDS_MPS)


@pytest.mark.parametrize("name", SPEEDS_MPS)
def test_path_is_calibrated_and_keeps_clear(renderers, name):
    """The speed is exact, and the image's motion within 5 %; `trajectory` checks the clearance."""
    renderer = renderers[name]
    assert renderer.trajectory.mean_speed_mps(10.0) == pytest.approx(SPEEDS_MPS[name], rel=1e-9)
    assert mean_motion_px_per_s(renderer) == pytest.approx(550, rel=0.05)


@pytest.mark.parametrize("name", SPEEDS_MPS)
def test_flow_is_even_within_a_window(renderers, name):
    """Tasks assume constant flow within a window: half-way, points are where it predicts.

    To a third of a pixel at 1280 px, in the median clip.
    """
    off_px = []
    for clip in clips(renderers[name].scene):
        window_s = np.linspace(clip.t_window_start_s, clip.t_window_end_s, 3)
        start, middle, end = follow(renderers[name], window_s)
        off_px.append(np.linalg.norm(middle - 0.5 * (start + end), axis=1).mean())
    assert np.median(off_px) < 1 / 3


@pytest.mark.parametrize("name", SPEEDS_MPS)
def test_packaged_lightmaps_belong_to_the_scene(name):
    scene = load_scene(name)
    files = sorted(scene.folder.glob("lightmap_*.exr"))
    assert files
    for file in files:
        image = read_luminance(file)
        assert read_attributes(file)["eresLightDigest"] == scene.light_digest
        assert np.isfinite(image).all()
        assert image.min() >= 0


@pytest.mark.parametrize(("name", "most_rms"), [("carpet", 1e-4), ("room", 2e-4)])
def test_light_that_is_looked_up_is_what_rays_to_every_sample_find(name, most_rms):
    """Promise: log radiance within 1e-4 rms on planes and 2e-4 in the room, along the path."""
    assert_looked_up_as_traced(load_scene(name), most_rms)


def test_no_part_of_the_room_is_black_and_no_lamp_in_view(renderers):
    """A leak or a hole would have radiance 0; a lamp or bright window would determine the white.

    White would then be 40 times the median, and all of the room but the lamp nearly black in its
    units.
    """
    renderer = renderers["room"]
    for T in renderer.trajectory.pose(np.linspace(0, 10, 6)):
        frame = renderer.frame(T)
        assert frame.min() > 1e-3
        assert np.median(frame) > 0.1 * renderer.white_level


def test_packaged_meshes_are_what_the_code_makes(pieces):
    folder = load_scene("room").folder
    assert {file.stem for file in folder.glob("*.ply")} == set(pieces)
    for name, (_, atlas) in pieces.items():
        assert atlas.ply() == (folder / f"{name}.ply").read_bytes()


@pytest.mark.slow
def test_no_two_surfaces_of_the_room_coincide(pieces):
    """Where two faces lie in one plane, rounding would choose which of them is seen."""
    charts = [chart for _, atlas in pieces.values() for chart in atlas.charts]
    faces = [triangles_of(chart) for chart in charts]
    low = np.array([face.min((0, 1)) for face in faces]) - COPLANAR_M
    high = np.array([face.max((0, 1)) for face in faces]) + COPLANAR_M
    for k, face in enumerate(faces):
        near = np.all((low[k + 1 :] <= high[k]) & (high[k + 1 :] >= low[k]), axis=1)
        for j in k + 1 + np.flatnonzero(near):
            depth_m = overlaps_m(within(face, low[j], high[j]), within(faces[j], low[k], high[k]))
            at = charts[k].points.mean((0, 1)), charts[j].points.mean((0, 1))
            assert depth_m.max(initial=0.0) < OVERLAP_M, at


COPLANAR_M, OVERLAP_M = 1e-5, 1e-4


def triangles_of(chart):
    """Return the triangles of a chart as its mesh has them, (N, 3, 3), without empty ones."""
    points = chart.points.astype(np.float32).astype(float)
    a, b = points[:-1, :-1][chart.solid], points[:-1, 1:][chart.solid]
    c, d = points[1:, :-1][chart.solid], points[1:, 1:][chart.solid]
    triangles = np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])
    return triangles[np.linalg.norm(normals_of(triangles), axis=1) > 1e-9]


def within(triangles, low, high):
    """Return the triangles whose bounding boxes touch a box."""
    return triangles[np.all((triangles.min(1) <= high) & (triangles.max(1) >= low), axis=1)]


def normals_of(triangles):
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def overlaps_m(some, others):
    """Return the penetration depth of coplanar triangles, m: the shortest shift that separates
    them, along one of the six normals of their sides in the plane."""
    normals = normals_of(some)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    off_plane = np.einsum("nj,nmvj->nmv", normals, others[None] - some[:, None, :1])
    n, m = np.nonzero(np.abs(off_plane).max(2) < COPLANAR_M)
    if not len(n):
        return np.empty(0)
    pair = some[n], others[m]
    depth_m = np.full(len(n), np.inf)
    for triangles in pair:
        for k in range(3):
            axis = np.cross(normals[n], triangles[:, k] - triangles[:, k - 1])
            axis /= np.linalg.norm(axis, axis=1, keepdims=True)
            one, other = (np.einsum("nvj,nj->nv", corners, axis) for corners in pair)
            apart = np.maximum(one.min(1) - other.max(1), other.min(1) - one.max(1))
            depth_m = np.minimum(depth_m, -apart)
    return depth_m


def test_overlaps_are_found():
    """Two squares of 1 m in a plane that share 0.1 m of it, or an edge; or are 1 mm apart."""
    square = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0], [0, 1, 0]]], float)

    def moved(*by_m):
        return square + np.array(by_m)

    assert overlaps_m(square, moved(0.9, 0.2, 0.0)).max() == pytest.approx(0.1)
    assert overlaps_m(square, moved(0.9, 0.2, 0.0)[:, ::-1]).max() == pytest.approx(0.1)
    assert overlaps_m(square, moved(1.0, 0.3, 0.0)).max() == pytest.approx(0.0, abs=1e-12)
    assert not len(overlaps_m(square, moved(0.5, 0.0, 0.001)))


def test_charts_lie_apart_on_their_atlas(pieces):
    """Each chart has an empty cell all around, so that no light bleeds from one to the next."""
    for _, atlas in pieces.values():
        taken = np.zeros((atlas.rows, atlas.columns), dtype=int)
        for at in atlas.places:
            assert at.row >= 1
            assert at.column >= 1
            taken[
                at.row - 1 : at.row + at.rows + 1, at.column - 1 : at.column + at.columns + 1
            ] += 1
        assert taken.max() == 1


def test_charts_are_stretched_little(pieces):
    """A chart's cells are squares of 2 cm, except for rounding to a whole number of cells."""
    for _, atlas in pieces.values():
        for chart, at in zip(atlas.charts, atlas.places, strict=True):
            for size_m, cells in zip(chart.size_m, (at.columns, at.rows), strict=True):
                assert abs(size_m - cells * CELL_M) <= max(0.5 * CELL_M, 0.02) + 1e-9


def test_normals_point_out_of_the_front(pieces):
    """The front is the side where u runs right and v down; normals have length 1."""
    for _, atlas in pieces.values():
        for chart in atlas.charts:
            np.testing.assert_allclose(np.linalg.norm(chart.normals, axis=-1), 1, atol=1e-6)
            p = chart.points
            front = np.cross(p[1:, :-1] - p[:-1, :-1], p[:-1, 1:] - p[:-1, :-1])
            facing = np.einsum("ijk,ijk->ij", front, chart.normals[:-1, :-1])
            assert (facing > -1e-9).mean() > 0.95
