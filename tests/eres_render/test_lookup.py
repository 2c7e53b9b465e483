"""Light that is looked up is what rays to every sample find."""

import numpy as np
import pytest

from eres_render import Camera, Distortion, Renderer
from eres_render.rendering import lightmaps as lightmaps_module
from eres_render.rendering import renderer as renderer_module
from eres_render.rendering.backend import select_variant
from light_scenes import log_difference


def glowing(mi, vertices, faces, radiance, texcoords=None, normals=None, **other):
    """A mesh of uniform or textured radiance; `other` settings of the texture."""
    texture = {"type": "uniform", "value": radiance}
    if texcoords is not None:
        bitmap = mi.Bitmap(radiance.astype(np.float32)[..., None])
        texture = {"type": "bitmap", "bitmap": bitmap, "raw": True, "format": "fp16"}
        texture = {**texture, "wrap_mode": "clamp", **other}
    emitter = mi.load_dict({"type": "area", "radiance": texture})
    properties = mi.Properties()
    properties["emitter"] = emitter
    has = normals is not None, texcoords is not None
    mesh = mi.Mesh("mesh", len(vertices), len(faces), properties, *has)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.ravel(vertices).astype(np.float32)
    parameters["faces"] = np.ravel(faces).astype(np.uint32)
    if texcoords is not None:
        parameters["vertex_texcoords"] = np.ravel(texcoords).astype(np.float32)
    if normals is not None:
        parameters["vertex_normals"] = np.ravel(normals).astype(np.float32)
    parameters.update()
    return mesh


def quads(rng, n, length, width, distance, parallel):
    """(4 n, 3) corners of thin rectangles that face the camera at z = 0, which looks along -z."""
    angle = np.zeros(n) if parallel else rng.uniform(0, np.pi, n)
    center = np.stack([*rng.uniform(-0.5, 0.5, (2, n)), np.full(n, -distance)], -1)
    if parallel:  # along columns, in the middle of a pixel
        center[:, 0] = (np.floor(center[:, 0] * WIDTH) + 0.5) / WIDTH
    along = np.stack([-np.sin(angle), np.cos(angle), rng.uniform(-0.3, 0.3, n)], -1)
    across = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], -1)
    sides = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    corners = [center + a * width / 2 * across + b * length / 2 * along for a, b in sides]
    return np.stack(corners, 1).reshape(-1, 3)


WIDTH = 96


@pytest.fixture(autouse=True)
def even_small_frames(monkeypatch):
    """Look light up in small frames too, which are faster to trace."""
    for least in ("_SAMPLES_AN_EDGE", "_SAMPLES_A_FRAME", "_MIN_SAMPLES"):
        monkeypatch.setattr(f"eres_render.rendering.lookup.{least}", 0)


def renderers(monkeypatch, scene, camera, shapes):
    """A renderer that looks up, and one that traces, of our own world in place of the scene's."""
    import mitsuba as mi

    world = mi.load_dict({"type": "scene", **shapes})
    monkeypatch.setattr(renderer_module, "baked_scene", lambda *_: (world, {"wall"}))
    return (
        Renderer(scene, spp=16, integrator="baked", camera=camera),
        Renderer(scene, spp=16, integrator="baked-full", camera=camera),
    )


def wall(mi, rng):
    """A textured wall 4 m before the camera, tilted."""
    image = np.exp(rng.normal(0, 0.3, (512, 512)))
    corners = np.array([[-6, -6, -4.5], [6, -6, -3.5], [6, 6, -4.0], [-6, 6, -5.0]])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    mesh = glowing(mi, corners, np.array([[0, 1, 2], [0, 2, 3]]), image, uv)
    mesh.set_id("wall")
    return mesh


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("length_px", [None, 1.0])
@pytest.mark.parametrize("width_px", [0.1, 0.3, 1.0, 3.0])
def test_no_thin_thing_is_missed(small_carpet, monkeypatch, width_px, length_px, parallel):
    """Rods and specks between the corners of pixels: no pixel is off by more than 1e-2."""
    select_variant()
    pinhole = Camera(WIDTH, WIDTH, fx=float(WIDTH))
    compare_things(small_carpet, monkeypatch, pinhole, width_px, length_px, parallel)


@pytest.mark.parametrize("length_px", [None, 1.0])
@pytest.mark.parametrize("width_px", [0.1, 1.0])
def test_no_thin_thing_is_missed_through_a_lens(small_carpet, monkeypatch, width_px, length_px):
    """The same where the lens bends the rods, and pixels with them."""
    if select_variant().startswith("scalar"):
        pytest.skip("scalar variants render pinholes only")
    lens = Distortion(k1=-0.35, k2=0.15, p1=0.004, p2=-0.003)
    camera = Camera(WIDTH, WIDTH, fx=float(WIDTH), fy=0.9 * WIDTH, distortion=lens)
    compare_things(small_carpet, monkeypatch, camera, width_px, length_px, parallel=False)


def compare_things(scene, monkeypatch, camera, width_px, length_px, parallel):
    """Compare what is looked up with what is traced, of 100 things in front of a wall."""
    import mitsuba as mi

    rng = np.random.default_rng(int(10 * width_px) + parallel)
    pixel = 1.0 / WIDTH  # m, on the plane 1 m away of a camera with 53 degrees
    length = 0.4 if length_px is None else length_px * width_px * pixel
    corners = quads(rng, 100, length, width_px * pixel, 1.0, parallel)
    faces = np.arange(len(corners)).reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    things = glowing(mi, corners, faces, 100.0)
    shapes = {"wall": wall(mi, rng), "things": things}
    looked_up, traced = renderers(monkeypatch, scene, camera, shapes)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    lit = traced.frame(pose)
    difference = log_difference(looked_up.frame(pose), lit)
    assert np.max(np.abs(difference)) < 1e-2
    assert np.any(difference != 0), "nothing was looked up"
    assert np.any(lit > 5), "nothing was in front"


@pytest.mark.parametrize(
    ("other", "looked_up"),
    [
        ({}, True),
        ({"wrap_mode": "repeat"}, False),
        ({"wrap_mode": "mirror"}, False),
        ({"filter_type": "nearest"}, False),
        ({"format": "variant"}, False),  # floats
        ({"to_uv": 0.5}, False),
    ],
)
def test_what_surfaces_emit_is_looked_up(small_carpet, monkeypatch, other, looked_up):
    """Promise: a texture that Mitsuba reads as a baked one is looked up, also beyond its sides, any
    other is traced; surfaces that emit nothing are black."""
    mi = mitsuba_that_looks_up()
    if "to_uv" in other:
        other = {"to_uv": mi.ScalarTransform3f().scale(other["to_uv"])}
    image = np.exp(np.random.default_rng(0).normal(0, 0.3, (48, 64)))
    uv = np.array([[-0.4, -0.3], [1.2, -0.3], [1.2, 1.4], [-0.4, 1.4]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    corners = np.array([[-1.4, -1.4, -4.0], [1.5, -1.4, -4.2], [1.5, 1.4, -4.1], [-1.4, 1.4, -3.9]])
    black = {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([1.8, 0.0, -4.5])}
    shapes = {"print": glowing(mi, corners, faces, image, uv, **other), "black": black}
    frame, traced, share = emission(small_carpet, monkeypatch, shapes)
    assert (share < 0.1) == looked_up
    np.testing.assert_allclose(frame, traced, rtol=2e-3, atol=1e-6)
    assert np.ptp(traced) > 0.5
    assert np.any(traced == 0)


def mitsuba_that_looks_up():
    if not select_variant().startswith("llvm"):
        pytest.skip("other variants trace every sample")
    import mitsuba as mi

    return mi


def emission(scene, monkeypatch, shapes):
    """Return a frame of what shapes emit, the same traced, and the share of traced pixels in it."""
    import mitsuba as mi

    world = mi.load_dict({"type": "scene", **shapes})
    monkeypatch.setattr(renderer_module, "load_mi_scene", lambda *_: world)
    camera = Camera(WIDTH, WIDTH, fx=float(WIDTH))
    renderer = Renderer(scene, spp=16, integrator="emission", camera=camera)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    frame, share = renderer.frame(pose), renderer._look_up.traced / WIDTH**2
    renderer._look_up = None
    return frame, renderer.frame(pose), share


FACES = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])


def two_quads():
    """Return the corners of a large and a small rectangle of one plane, which fill the view."""
    across = np.array([-2.5, 1.0, 1.0, -2.5, 1.0, 2.5, 2.5, 1.0])
    down = np.array([-2.5, -2.5, 2.5, 2.5] * 2)
    return np.stack([across, down, np.full(8, -4.0)], 1)


@pytest.mark.parametrize("large_side", [1.0, -1.0])
def test_parts_of_a_plane_that_are_lit_from_opposite_sides_stay_apart(
    small_carpet, monkeypatch, large_side
):
    """Promise: shading normals decide which side glows, for each triangle of a plane."""
    mi = mitsuba_that_looks_up()
    normals = np.repeat([[0.0, 0.0, large_side], [0.0, 0.0, -large_side]], 4, axis=0)
    shapes = {"plane": glowing(mi, two_quads(), FACES, 1.0, normals=normals)}
    frame, traced, share = emission(small_carpet, monkeypatch, shapes)
    assert share < 0.1
    np.testing.assert_allclose(frame, traced, atol=1e-6)
    assert (traced.min(), traced.max()) == (0.0, 1.0)


def test_a_plane_with_some_bent_normals_keeps_its_straight_part(small_carpet, monkeypatch):
    """Promise: tilted shading normals of a strip do not darken the rest of its plane."""
    mi = mitsuba_that_looks_up()
    normals = np.repeat([[0.0, 0.0, 1.0], [0.99, 0.0, -0.14]], 4, axis=0)
    shapes = {"plane": glowing(mi, two_quads(), FACES, 1.0, normals=normals)}
    frame, traced, share = emission(small_carpet, monkeypatch, shapes)
    np.testing.assert_allclose(frame, traced, atol=1e-6)
    assert share < 0.5
    assert (traced.min(), traced.max()) == (0.0, 1.0)


@pytest.mark.parametrize("least", [np.float16(-0.0), np.float16(-1e-3)])
def test_a_negative_zero_is_black(small_carpet, monkeypatch, least):
    """Promise: half-floats below +0.0, as a resampled texture has, are what Mitsuba reads."""
    mi = mitsuba_that_looks_up()
    image = np.random.default_rng(0).uniform(0.1, 1.0, (64, 64))
    image[20:24, 30:40] = least
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    shapes = {"print": glowing(mi, two_quads()[:4], FACES[:2], image, uv)}
    frame, traced, _ = emission(small_carpet, monkeypatch, shapes)
    np.testing.assert_allclose(frame, traced, rtol=2e-3, atol=1e-3)
    assert traced.max() < 1.1


def test_a_very_wide_texture_is_looked_up(small_carpet, monkeypatch):
    """Promise: sides of more than 32,767 texels are read as any other."""
    mi = mitsuba_that_looks_up()
    image = np.random.default_rng(0).uniform(0.1, 1.0, (2, 40_000))
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    shapes = {"print": glowing(mi, two_quads()[:4], FACES[:2], image, uv)}
    frame, traced, share = emission(small_carpet, monkeypatch, shapes)
    assert share < 0.1
    np.testing.assert_allclose(frame, traced, atol=0.2)  # 16 samples of some 400 texels each


def test_a_lamp_that_glows_in_one_direction_is_traced(small_carpet, monkeypatch):
    """Promise: only Mitsuba's area lights are looked up."""
    mi = mitsuba_that_looks_up()
    lamp = mi.load_dict({"type": "directionalarea", "radiance": 5.0})
    properties = mi.Properties()
    properties["emitter"] = lamp
    mesh = mi.Mesh("lamp", 4, 2, properties, False, False)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.ravel(two_quads()[:4]).astype(np.float32)
    parameters["faces"] = np.ravel(FACES[:2]).astype(np.uint32)
    parameters.update()
    print_ = glowing(mi, two_quads()[4:], FACES[:2], 1.0)
    frame, traced, _ = emission(small_carpet, monkeypatch, {"lamp": mesh, "print": print_})
    np.testing.assert_allclose(frame, traced, atol=1e-6)
    assert traced.max() == 1.0


def test_a_resampled_reflectance_may_ring_below_black(small_carpet, monkeypatch):
    """Promise: baked textures have no negative zeros and no negative light."""
    mi = mitsuba_that_looks_up()
    texels = np.random.default_rng(0).uniform(0.0, 0.5, (64, 64)).astype(np.float32)
    texels[10:20, 10:20], texels[30:40, 30:40] = -1e-9, -0.01
    monkeypatch.setattr(lightmaps_module.light, "reflectance", lambda *_: texels)
    world, _ = lightmaps_module.baked_scene(small_carpet)
    (carpet,) = (shape for shape in world.shapes() if shape.id() == "carpet")
    found = np.asarray(mi.traverse(carpet.emitter())["radiance.data"])
    assert not np.any(np.signbit(found))
    assert np.count_nonzero(found == 0) >= 200
