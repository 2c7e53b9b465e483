"""Light that is looked up is what rays to every sample find."""

import numpy as np
import pytest

from eres_render import Camera, Distortion, Renderer
from eres_render.rendering import renderer as renderer_module
from eres_render.rendering.backend import select_variant
from light_scenes import log_difference


def glowing(mi, vertices, faces, radiance, texcoords=None, **other):
    """A mesh of uniform or textured radiance; `other` settings of the texture."""
    texture = {"type": "uniform", "value": radiance}
    if texcoords is not None:
        bitmap = mi.Bitmap(radiance.astype(np.float32)[..., None])
        texture = {"type": "bitmap", "bitmap": bitmap, "raw": True, "format": "fp16"}
        texture = {**texture, "wrap_mode": "clamp", **other}
    emitter = mi.load_dict({"type": "area", "radiance": texture})
    properties = mi.Properties()
    properties["emitter"] = emitter
    mesh = mi.Mesh("mesh", len(vertices), len(faces), properties, False, texcoords is not None)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.ravel(vertices).astype(np.float32)
    parameters["faces"] = np.ravel(faces).astype(np.uint32)
    if texcoords is not None:
        parameters["vertex_texcoords"] = np.ravel(texcoords).astype(np.float32)
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


WIDTH = 160


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
    """Compare what is looked up with what is traced, of 300 things in front of a wall."""
    import mitsuba as mi

    rng = np.random.default_rng(int(10 * width_px) + parallel)
    pixel = 1.0 / WIDTH  # m, on the plane 1 m away of a camera with 53 degrees
    length = 0.4 if length_px is None else length_px * width_px * pixel
    corners = quads(rng, 300, length, width_px * pixel, 1.0, parallel)
    faces = np.arange(len(corners)).reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    things = glowing(mi, corners, faces, 100.0)
    shapes = {"wall": wall(mi, rng), "things": things}
    looked_up, traced = renderers(monkeypatch, scene, camera, shapes)
    monkeypatch.setattr("eres_render.rendering.lookup._SAMPLES_AN_EDGE", 0)
    monkeypatch.setattr("eres_render.rendering.lookup._SAMPLES_A_FRAME", 0)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    difference = log_difference(looked_up, traced, pose)
    assert np.max(np.abs(difference)) < 1e-2
    assert np.any(difference != 0), "nothing was looked up"
    lit = traced.frame(pose)
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
    if not select_variant().startswith("llvm"):
        pytest.skip("other variants trace every sample")
    import mitsuba as mi

    if "to_uv" in other:
        other = {"to_uv": mi.ScalarTransform3f().scale(other["to_uv"])}
    image = np.exp(np.random.default_rng(0).normal(0, 0.3, (48, 64)))
    uv = np.array([[-0.4, -0.3], [1.2, -0.3], [1.2, 1.4], [-0.4, 1.4]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    corners = np.array([[-1.4, -1.4, -4.0], [1.5, -1.4, -4.2], [1.5, 1.4, -4.1], [-1.4, 1.4, -3.9]])
    black = {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([1.8, 0.0, -4.5])}
    shapes = {"print": glowing(mi, corners, faces, image, uv, **other), "black": black}
    world = mi.load_dict({"type": "scene", **shapes})
    monkeypatch.setattr(renderer_module, "load_mi_scene", lambda *_: world)
    camera = Camera(WIDTH, WIDTH, fx=float(WIDTH))
    renderer = Renderer(small_carpet, spp=16, integrator="emission", camera=camera)
    frame = renderer.frame(np.diag([1.0, -1.0, -1.0, 1.0]))
    assert (renderer._look_up.traced < 0.1 * frame.size) == looked_up
    renderer._look_up = None
    traced = renderer.frame(np.diag([1.0, -1.0, -1.0, 1.0]))
    np.testing.assert_allclose(frame, traced, rtol=2e-3, atol=1e-6)
    assert np.ptp(traced) > 0.5
    assert np.any(traced == 0)
