"""Color: removed before light transport, in the same way in every variant."""

import json

import cv2
import numpy as np
import OpenEXR
import pytest

from another_process import run_python
from eres_render import Renderer, load_scene
from light_scenes import drop_textures, edit_scene

LUMINANCE = np.array([0.212671, 0.715160, 0.072169])
RED = np.array([0.6, 0.2, 0.1])
BLUISH = np.array([1.0, 2.0, 4.0])


@pytest.fixture
def red_floor(tmp_path):
    """Write a red floor under a bluish sky, half of it an image file, half of it a plain color."""
    folder = edit_scene(tmp_path / "red")
    drop_textures(folder)
    image = np.full((4, 4, 3), RED, dtype=np.float32)
    OpenEXR.File({}, {"RGB": image}).write(str(folder / "red.exr"))
    halves = "".join(
        f"""<shape type="rectangle" id="{name}">
          <transform name="to_world"><scale value="5"/><translate x="{x}"/></transform>
          <bsdf type="diffuse">{reflectance}</bsdf></shape>"""
        for name, x, reflectance in (
            ("plain", -5, '<rgb name="reflectance" value="0.6 0.2 0.1"/>'),
            (
                "image",
                5,
                '<texture type="bitmap" name="reflectance">'
                '<string name="filename" value="red.exr"/></texture>',
            ),
        )
    )
    sky = '<emitter type="constant"><rgb name="radiance" value="1 2 4"/></emitter>'
    (folder / "scene.xml").write_text(f'<scene version="3.0.0">{halves}{sky}</scene>')
    return folder


@pytest.mark.slow
def test_every_variant_sees_the_product_of_luminances(red_floor):
    """Expected on both halves: Y(reflectance) Y(sky) = 0.5367, and not Y(reflectance sky) = 0.4425.

    Under a uniform sky a Lambertian floor sends the sky's radiance times its reflectance.
    """
    expected = (LUMINANCE @ RED) * (LUMINANCE @ BLUISH)
    assert expected == pytest.approx(0.5367, abs=1e-4)
    colored = LUMINANCE @ (RED * BLUISH)
    assert colored == pytest.approx(0.4425, abs=1e-4)
    code = (
        "import sys, json; from eres_render import *;"
        "s = load_scene(sys.argv[1]);"
        "f = Renderer(s, 8, 4096, integrator='path').frame(s.trajectory().pose(1.0));"
        "print(json.dumps(f.tolist()))"
    )
    run = run_python(code, red_floor, timeout_s=600, ERES_VARIANT="scalar_rgb")
    scalar = np.array(json.loads(run.stdout))
    scene = load_scene(red_floor)
    here = Renderer(scene, 8, 4096, integrator="path").frame(scene.trajectory().pose(1.0))
    np.testing.assert_allclose(scalar, expected, rtol=1e-3)
    np.testing.assert_allclose(here, expected, rtol=1e-3)


@pytest.mark.parametrize("suffix", [".png", ".exr"])
def test_baked_images_reflect_the_luminance_of_their_light(tmp_path, suffix):
    """Expected under an even sky: the luminance of the image's linear light, by either integrator.

    sRGB codes of 188, 128 and 64 are 0.503, 0.216 and 0.051 of white.
    """
    codes = np.array([188, 128, 64])
    light = ((codes / 255 + 0.055) / 1.055) ** 2.4
    coarse = ("cell_m = 0.078125", "cell_m = 2.0"), ("spp = 16384", "spp = 4096")
    folder = edit_scene(tmp_path / "floor", *coarse)
    drop_textures(folder)
    if suffix == ".png":
        cv2.imwrite(str(folder / "tile.png"), np.full((4, 4, 3), codes[::-1], np.uint8))
    else:
        image = np.full((4, 4, 3), light, dtype=np.float32)
        OpenEXR.File({}, {"RGB": image}).write(str(folder / "tile.exr"))
    (folder / "scene.xml").write_text(
        f"""<scene version="3.0.0"><emitter type="constant"/>
        <shape type="rectangle" id="floor">
          <transform name="to_world"><scale value="10"/></transform>
          <bsdf type="diffuse"><texture type="bitmap" name="reflectance">
            <string name="filename" value="tile{suffix}"/></texture></bsdf></shape></scene>"""
    )
    scene = load_scene(folder)
    for integrator in ("baked", "path"):
        frame = Renderer(scene, 8, 256, integrator=integrator).frame(scene.trajectory().pose(1.0))
        np.testing.assert_allclose(frame, LUMINANCE @ light, rtol=0.01, err_msg=integrator)
