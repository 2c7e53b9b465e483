"""Baked light: the same picture as path tracing, from reproducible lightmaps."""

import dataclasses

import cv2
import numpy as np
import pytest

from eres_render import BackendError, Renderer, SceneError, load_scene
from eres_render.errors import RenderError
from eres_render.interior.pieces import PIECES
from eres_render.rendering import backend
from eres_render.rendering import lightmaps as bake
from eres_render.rendering.irradiance import irradiance_maps, reason_not_to_wait
from eres_render.rendering.load import load_mi_scene
from eres_render.storage.exr import read_attributes, read_luminance, write_luminance
from light_scenes import drop_textures, edit_scene, small_carpet_folder


@pytest.fixture(autouse=True)
def vectorized():
    if backend.select_variant().startswith("scalar"):
        pytest.skip("baking needs a vectorized Mitsuba variant")


def test_irradiance_under_a_uniform_sky_is_pi_times_its_radiance(tmp_path):
    """A white sky of radiance 2 over an open floor: E = 2 pi, for any floor."""
    folder = edit_scene(tmp_path / "open")
    (folder / "scene.xml").write_text(
        """<scene version="3.0.0">
        <emitter type="constant"><rgb name="radiance" value="2"/></emitter>
        <shape type="rectangle" id="floor">
          <bsdf type="diffuse"><rgb name="reflectance" value="0.3"/></bsdf>
        </shape></scene>"""
    )
    drop_textures(folder)
    maps = irradiance_maps(load_scene(folder), cell_m=0.5, spp=4096)
    np.testing.assert_allclose(maps["floor"], 2 * np.pi, rtol=0.02)


def test_a_panel_lights_the_floor_as_the_double_integral_over_it_says(tmp_path):
    """Expected at each point: E = sum over both panels of L cos cos / r^2 dA, by quadrature."""
    scene = load_scene(small_carpet_folder(tmp_path / "panels"))
    n = 8
    baked = irradiance_maps(scene, cell_m=5 / n, spp=16384)["carpet"]
    nodes, weights = np.polynomial.legendre.leggauss(12)
    center = (np.arange(n) + 0.5) / n * 5 - 2.5
    inner = (nodes / 2) * 5 / n  # a lightmap's texel is a mean over its cell
    expected = np.zeros((n, n))
    for radiance, x0, y0 in ((16.0, -2.0, 0.2), (14.0, 2.1, -0.2)):
        px, py = x0 + 0.3 * nodes, y0 + 2.2 * nodes
        dx = (center[:, None] + inner)[:, :, None] - px
        dy = (center[:, None] + inner)[:, :, None] - py
        r2 = dx[None, :, None, :, None, :] ** 2 + dy[:, None, :, None, :, None] ** 2 + 3.4**2
        kernel = radiance * 3.4**2 / r2**2
        panel = np.einsum("yxabcd,a,b,c,d->yx", kernel, *[weights] * 4)
        expected += panel / 4 * (0.3 * 2.2)
    np.testing.assert_allclose(baked, expected, rtol=0.02)


@pytest.mark.slow
def test_light_goes_round_an_integrating_sphere(tmp_path):
    """A lamp in a sphere that reflects half: E = E_direct / (1 - 0.5 (1 - lamp's share))."""
    folder = edit_scene(tmp_path / "sphere")
    (folder / "scene.xml").write_text(
        """<scene version="3.0.0">
        <shape type="sphere" id="wall"><boolean name="flip_normals" value="true"/>
          <bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf>
        </shape>
        <shape type="sphere" id="lamp"><float name="radius" value="0.1"/>
          <emitter type="area"><rgb name="radiance" value="100"/></emitter>
        </shape></scene>"""
    )
    drop_textures(folder)
    wall = irradiance_maps(load_scene(folder), cell_m=0.4, spp=4096)["wall"]
    share = 0.1**2  # of the light that leaves a point of the wall, absorbed by the black lamp
    expected = np.pi * 100 * share / (1 - 0.5 * (1 - share))
    np.testing.assert_allclose(wall, expected, rtol=0.02)


@pytest.mark.slow
def test_cells_under_a_solid_take_their_neighbors_light(tmp_path):
    """A box without a bottom stands on half of the floor: no darkness leaks out under it."""
    folder = edit_scene(tmp_path / "box")
    sides = {
        "top": '<translate z="1"/>',
        "east": '<rotate y="1" angle="90"/><translate x="1"/>',
        "west": '<rotate y="1" angle="-90"/><translate x="-1"/>',
        "south": '<rotate x="1" angle="90"/><translate y="-1"/>',
        "north": '<rotate x="1" angle="-90"/><translate y="1"/>',
    }
    shapes = "".join(
        f"""<shape type="rectangle" id="{name}"><transform name="to_world">{place}
          <scale z="0.1"/><translate x="1"/></transform>
          <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>"""
        for name, place in sides.items()
    )
    (folder / "scene.xml").write_text(
        f"""<scene version="3.0.0">
        <emitter type="constant"><rgb name="radiance" value="1"/></emitter>
        <shape type="rectangle" id="floor">
          <bsdf type="diffuse"><rgb name="reflectance" value="0.3"/></bsdf>
        </shape>{shapes}</scene>"""
    )
    drop_textures(folder)
    floor = irradiance_maps(load_scene(folder), cell_m=0.25, spp=1024)["floor"]
    beside = floor[:, :4]
    assert beside.min() > 0.5 * np.pi
    np.testing.assert_array_equal(floor[:, 4:], np.repeat(floor[:, 3:4], 4, axis=1))


@pytest.mark.slow
def test_what_is_seen_through_an_open_side_is_black_and_hides_the_light_behind(tmp_path):
    """A box open below hangs 1 m over the floor, 2 m wide, under a sky of radiance 1.

    Expected in the middle below it, where only the opening shows the sky: E = pi (1 - F) = 1.40,
    with F = 0.554 the form factor of a square at half its width (Howell, B-4).
    """
    folder = edit_scene(tmp_path / "hood")
    sides = {
        "top": '<translate z="3"/>',
        "east": '<rotate y="1" angle="90"/><translate x="1" z="2"/>',
        "west": '<rotate y="1" angle="-90"/><translate x="-1" z="2"/>',
        "south": '<rotate x="1" angle="90"/><translate y="-1" z="2"/>',
        "north": '<rotate x="1" angle="-90"/><translate y="1" z="2"/>',
    }
    shapes = "".join(
        f"""<shape type="rectangle" id="{name}"><transform name="to_world">{place}</transform>
          <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>"""
        for name, place in sides.items()
    )
    (folder / "scene.xml").write_text(
        f"""<scene version="3.0.0">
        <emitter type="constant"><rgb name="radiance" value="1"/></emitter>
        <shape type="rectangle" id="floor">
          <transform name="to_world"><scale value="0.45"/></transform>
          <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
        </shape>{shapes}</scene>"""
    )
    drop_textures(folder)
    floor = irradiance_maps(load_scene(folder), cell_m=0.1, spp=4096)["floor"]
    form_factor = 4 / (2 * np.pi) * 2 * np.sqrt(0.5) * np.arctan(np.sqrt(0.5))
    np.testing.assert_allclose(floor[4, 4], np.pi * (1 - form_factor), rtol=0.03)


@pytest.mark.slow
def test_a_scene_of_meshes_is_found_bakeable(tmp_path, monkeypatch):
    """Mitsuba ends the process if a program asks a mesh for its UV after its scene is deleted."""
    monkeypatch.setenv("ERES_CACHE", str(tmp_path / "cache"))
    folder = small_carpet_folder(tmp_path / "mesh")
    (folder / "stool.ply").write_bytes(PIECES["stool"].atlas().ply())
    xml = (folder / "scene.xml").read_text()
    stool = """<shape type="ply" id="stool"><string name="filename" value="stool.ply"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.4"/></bsdf></shape></scene>"""
    (folder / "scene.xml").write_text(xml.replace("</scene>", stool))
    renderer = Renderer(load_scene(folder), 16, 4)
    assert renderer.integrator == "baked"
    assert renderer.frame(renderer.scene.trajectory().pose(0.0)).min() > 0


def test_cells_line_up_with_the_texels_of_an_atlas():
    """The room's textures store the size of their UV squares: 2 cm parts, 5 mm cells."""
    scene = load_scene("room")
    for name in ("plant", "floor_lamp", "chairs"):
        lightmap = read_luminance(scene.folder / f"lightmap_{name}.exr")
        atlas = PIECES[name].atlas()
        assert lightmap.shape == (4 * atlas.rows, 4 * atlas.columns)


@pytest.mark.parametrize("texel_m", [0.1, 0.01, 1e-3, 1.0])
def test_cells_have_their_size_on_the_surface(tmp_path, texel_m):
    """Promise: a floor of 6 m has 60 cells of 0.1 m, also if a texel of its texture has another
    size than on the floor, as on a print of something larger."""
    folder = edit_scene(
        tmp_path / "floor",
        ("size_px = 4096", "size_px = 64"),
        ("texel_m = 0.001220703125", f"texel_m = {texel_m}"),
        ("half_width_m = 2.5", "half_width_m = 3.0"),
    )
    (folder / "scene.xml").write_text(
        """<scene version="3.0.0">
        <emitter type="constant"/>
        <shape type="rectangle" id="carpet">
          <transform name="to_world"><scale value="3"/></transform>
          <bsdf type="diffuse"><texture type="bitmap" name="reflectance">
            <string name="filename" value="$carpet_reflectance"/><boolean name="raw" value="true"/>
          </texture></bsdf>
        </shape></scene>"""
    )
    (cells,) = irradiance_maps(load_scene(folder), cell_m=0.1, spp=1).values()
    assert cells.shape == ((64, 64) if texel_m == 0.1 else (60, 60))


def test_baked_and_path_traced_views_agree():
    """Packaged lightmap against 1024 paths per pixel: log radiance to 40 dB (peak 1, 1 % rms)."""
    scene = load_scene("carpet")
    pose = scene.trajectory().pose(3.3)
    baked = Renderer(scene, 24, 1024).frame(pose)
    traced = Renderer(scene, 24, 1024, integrator="path").frame(pose)
    error = np.log(baked) - np.log(traced)
    assert -10 * np.log10(np.mean(error**2)) >= 40
    assert abs(error.mean()) < 1e-3


@pytest.mark.parametrize("texels", [0, 4])
def test_light_varies_over_a_uniform_surface_and_under_a_coarse_image(tmp_path, texels):
    """Physics: the texture of radiance has the detail of the light, where the reflectance is one
    number, or an image coarser than the lightmap."""
    folder = small_carpet_folder(tmp_path / "plain")
    drop_textures(folder)
    text = (folder / "scene.xml").read_text()
    start, end = text.index("<texture"), text.index("</texture>") + len("</texture>")
    reflectance = '<rgb name="reflectance" value="0.5"/>'
    if texels:
        write_luminance(folder / "gray.exr", np.full((texels, texels), 0.5))
        reflectance = (
            '<texture type="bitmap" name="reflectance"><string name="filename" value="gray.exr"/>'
            '<boolean name="raw" value="true"/></texture>'
        )
    (folder / "scene.xml").write_text(text[:start] + reflectance + text[end:])
    scene = load_scene(folder)
    pose = scene.trajectory().pose(1.0)
    baked, traced = (
        Renderer(scene, 16, 1024, integrator=name).frame(pose) for name in ("baked", "path")
    )
    assert traced.max() > 1.2 * traced.min()
    np.testing.assert_allclose(baked, traced, rtol=0.03)


SKY = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'
GRAY = '<bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf>'


def open_scene(folder, shapes, cell_m=0.5):
    """Return a scene of some shapes under a white sky, which the carpet's camera sees."""
    edit_scene(folder, ("cell_m = 0.078125", f"cell_m = {cell_m}"), ("spp = 16384", "spp = 1024"))
    (folder / "scene.xml").write_text(f'<scene version="3.0.0">{SKY}{shapes}</scene>')
    drop_textures(folder)
    return load_scene(folder)


def image_floor(file):
    return (
        '<shape type="rectangle" id="floor"><transform name="to_world"><scale value="4"/>'
        '</transform><bsdf type="diffuse"><texture type="bitmap" name="reflectance">'
        f'<boolean name="raw" value="true"/><string name="filename" value="{file}"/>'
        "</texture></bsdf></shape>"
    )


def assert_baked_as_traced(scene, width=16, rtol=0.02):
    """Promise: the scene bakes by default, and looks as with paths."""
    pose = scene.trajectory().pose(1.0)
    renderer = Renderer(scene, width, 256)
    assert renderer.integrator == "baked"
    traced = Renderer(scene, width, 4096, integrator="path").frame(pose)
    np.testing.assert_allclose(renderer.frame(pose), traced, rtol=rtol, atol=1e-3)
    return traced


@pytest.mark.parametrize("color", [(0.9, 0.6, 0.3), (0.1, 0.5, 1.0)])
def test_a_colored_image_is_baked(tmp_path, color):
    """Promise: interpolation is recognized in images with different channels."""
    noise = np.random.default_rng(1).uniform(60, 250, (64, 64, 1))
    (tmp_path / "colored").mkdir()
    bgr = (noise * color[::-1]).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "colored" / "wood.png"), bgr)
    traced = assert_baked_as_traced(open_scene(tmp_path / "colored", image_floor("wood.png")))
    assert traced.std() > 0.01


@pytest.mark.parametrize("texels", [16, 13, pytest.param(32, marks=pytest.mark.slow)])
def test_an_image_coarser_than_its_lightmap_is_not_blurred(tmp_path, texels):
    """Promise: of 40 cells under 16, 32 or 13 texels; blurred, the light was up to 0.8 off."""
    codes = np.random.default_rng(2).integers(30, 220, (texels, texels), np.uint8)
    (tmp_path / "coarse").mkdir()
    cv2.imwrite(str(tmp_path / "coarse" / "noise.png"), codes)
    assert_baked_as_traced(open_scene(tmp_path / "coarse", image_floor("noise.png"), cell_m=0.2))


@pytest.mark.slow
def test_a_mirrored_mesh_has_its_front_where_its_normals_point(tmp_path):
    """Promise: a floor mirrored by a negative scale is lit from above, as it is with paths."""
    (tmp_path / "mirrored").mkdir()
    (tmp_path / "mirrored" / "floor.obj").write_text(
        "v -4 -4 0\nv 4 -4 0\nv 4 4 0\nv -4 4 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n"
        "f 1/1/1 2/2/1 3/3/1\nf 1/1/1 3/3/1 4/4/1\n"
    )
    shape = (
        '<shape type="obj" id="floor"><string name="filename" value="floor.obj"/>'
        f'<transform name="to_world"><scale x="-1" y="1" z="1"/></transform>{GRAY}</shape>'
    )
    traced = assert_baked_as_traced(open_scene(tmp_path / "mirrored", shape))
    np.testing.assert_allclose(traced, 0.5, rtol=0.02)


@pytest.mark.slow
def test_a_cylinder_is_baked(tmp_path):
    """Promise: a shape with the same stretch everywhere has a lightmap of its size."""
    shape = (
        '<shape type="cylinder" id="pipe"><transform name="to_world"><scale value="3"/></transform>'
        f"{GRAY}</shape>"
    )
    maps = irradiance_maps(open_scene(tmp_path / "pipe", shape), cell_m=0.5, spp=64)
    assert sorted(maps["pipe"].shape) == [6, 38]  # 3 m long, 6 pi m around


def test_a_name_that_another_shape_has_is_not_given(tmp_path):
    """Promise: shapes without an id do not get that of another, by which they would be confused."""
    one, other = (
        f'<shape type="rectangle"{name}><transform name="to_world"><scale value="4"/>'
        f'<translate x="{x}"/></transform>{GRAY}</shape>'
        for name, x in ((' id="rectangle_1"', -4), ("", 4))
    )
    scene = open_scene(tmp_path / "names", one + other)
    assert sorted(irradiance_maps(scene, 1.0, 4)) == ["rectangle_1", "rectangle_1_"]


def test_a_lamp_with_a_material_is_path_traced(tmp_path):
    """Promise: a glowing screen also reflects the light of other lamps; only lamps without a
    material are black."""
    folder = small_carpet_folder(tmp_path / "screen")
    text = (folder / "scene.xml").read_text()
    glow = '<emitter type="area"><rgb name="radiance" value="0.01"/></emitter>'
    at = text.index("</shape>", text.index('id="carpet"'))
    (folder / "scene.xml").write_text(text[:at] + glow + text[at:])
    scene = load_scene(folder)
    renderer = Renderer(scene, 8, 16)
    assert renderer.integrator == "path"
    assert renderer.frame(scene.trajectory().pose(1.0)).min() > 0.1
    with pytest.raises(SceneError, match="'carpet' emits light and reflects it, too"):
        irradiance_maps(scene, 1.0, 4)


def test_a_plane_that_takes_hours_to_bake_is_path_traced(tmp_path, caplog):
    """Promise: by default no lightmap is begun that takes more than about an hour; the log names
    the shape. A cell of 0.1 m has 2 x 1024 + 7 x 64 samples, so a plane of 262 m has 2^34."""

    def plane(side_m):
        scale = f'<transform name="to_world"><scale value="{side_m / 2}"/></transform>'
        shape = f'<shape type="rectangle" id="sea">{scale}{GRAY}</shape>'
        return open_scene(tmp_path / f"{side_m}", shape, cell_m=0.1)

    for side_m, waits in ((261, True), (264, False)):
        scene = plane(side_m)
        assert (reason_not_to_wait(load_mi_scene(scene), scene) == "") == waits
    with caplog.at_level("INFO"):
        assert Renderer(plane(2000), 8, 1).integrator == "path"
    assert "of shape 'sea', has 20000 x 20000 cells" in caplog.text


def test_other_lightmaps_in_the_folder_are_ignored(tmp_path, monkeypatch):
    """Promise: those of a shape that is gone do not make the scene's own ones useless."""
    monkeypatch.setenv("ERES_CACHE", str(tmp_path / "cache"))
    folder = small_carpet_folder(tmp_path / "mine")
    (file,) = bake.bake_scene(load_scene(folder))
    write_luminance(folder / "lightmap_gone.exr", np.ones((4, 4)), {"eresLightDigest": "old"})
    assert set(bake.lightmaps(load_scene(folder))) == {"carpet"}
    file.unlink()
    assert not bake.has_lightmaps(load_scene(folder))


def test_scenes_in_one_folder_do_not_take_each_others_lightmaps(tmp_path, monkeypatch):
    """Promise: a set of which another scene replaced a part is not used."""
    monkeypatch.setenv("ERES_CACHE", str(tmp_path / "cache"))
    shapes = "".join(
        f"""<shape type="rectangle" id="{name}"><transform name="to_world"><scale value="4"/>
        <translate x="{x}"/></transform>{GRAY}</shape>"""
        for name, x in (("floor", 0), ("stage", 8))
    )
    one = open_scene(tmp_path / "mine", shapes)
    assert {file.name for file in bake.bake_scene(one)} == {
        "lightmap_floor.exr",
        "lightmap_stage.exr",
    }
    state = {"eresLightDigest": "of another", "eresLightmaps": "1"}
    write_luminance(one.folder / "lightmap_floor.exr", np.ones((4, 4)), state)
    assert not bake.has_lightmaps(one)
    assert set(bake.lightmaps(one)) == {"floor", "stage"}


@pytest.mark.slow
def test_a_part_of_a_uv_square_that_no_probe_hits_is_baked(tmp_path):
    """Promise: a chart of four millionths of an atlas is baked with small cells; lightmaps with
    cells that are too large for it, or too many, are refused by name."""
    corners = "v -4 -4 0\nv 4 -4 0\nv 4 4 0\nv -4 4 0\n"
    chart = "vt 0.25 0.25\nvt 0.252 0.25\nvt 0.252 0.252\nvt 0.25 0.252\n"
    (tmp_path / "part.obj").write_text(f"{corners}{chart}f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n")
    file = '<string name="filename" value="part.obj"/>'
    scene = open_scene(tmp_path, f'<shape type="obj" id="part">{file}{GRAY}</shape>')
    sky = irradiance_maps(scene, 8.0, 16)["part"]
    assert sky[125, 125] == pytest.approx(np.pi, rel=0.1)
    with pytest.raises(SceneError, match=r"'part': fills less than 1/64 of each of the 2 x 2"):
        irradiance_maps(scene, 4000.0, 64)
    with pytest.raises(SceneError, match=r"shape 'part': found a lightmap of \d+ x \d+ cells"):
        irradiance_maps(scene, 0.4, 4)


@pytest.mark.parametrize("start", [1.0, 2.25, -0.9, 0.6])
def test_a_chart_beside_the_uv_square_is_not_baked(tmp_path, start):
    """Promise: it is path-traced, and the log names it; its lightmap would be black."""
    u0, u1 = start, start + 0.5
    corners = "v -4 -4 0\nv 4 -4 0\nv 4 4 0\nv -4 4 0\n"
    chart = f"vt {u0} 0\nvt {u1} 0\nvt {u1} 0.5\nvt {u0} 0.5\n"
    (tmp_path / "part.obj").write_text(f"{corners}{chart}f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n")
    file = '<string name="filename" value="part.obj"/>'
    scene = open_scene(tmp_path, f'<shape type="obj" id="part">{file}{GRAY}</shape>')
    with pytest.raises(SceneError, match="'part' has points that share a UV coordinate, or"):
        irradiance_maps(scene, 0.5, 4)


@pytest.mark.slow
def test_the_packaged_lightmap_belongs_to_the_scene_and_can_be_made_again():
    """With fewer samples, a new lightmap differs by rounding and noise only: 0.2 % at 1024 spp."""
    scene = load_scene("carpet")
    file = scene.folder / "lightmap_carpet.exr"
    assert read_attributes(file)["eresLightDigest"] == scene.light_digest
    again = irradiance_maps(scene, scene.settings.bake.cell_m, spp=1024)["carpet"]
    ratio = again / read_luminance(file)
    assert abs(ratio.mean() - 1) < 1e-3
    assert ratio.std() < 0.005


def test_lightmaps_of_another_state_of_the_scene_are_baked_again(tmp_path, monkeypatch):
    monkeypatch.setenv("ERES_CACHE", str(tmp_path / "cache"))
    scene = load_scene(small_carpet_folder(tmp_path / "mine"))
    packaged = load_scene("carpet").folder / "lightmap_carpet.exr"
    (scene.folder / packaged.name).write_bytes(packaged.read_bytes())
    assert bake.lightmaps(scene)["carpet"].shape == (16, 16)  # not the packaged 64 x 64
    assert len(list((tmp_path / "cache" / "lightmaps").glob("mine-*/lightmap_carpet.exr"))) == 1

    (bake.bake_scene(scene)[0]).rename(scene.folder / packaged.name)
    monkeypatch.setattr(bake, "bake_scene", None)  # from now on it would fail
    assert bake.lightmaps(scene)["carpet"].shape == (16, 16)
    assert [file.name for file in scene.folder.glob("*lightmap*")] == [packaged.name]
    monkeypatch.setattr(bake, "BAKE_VERSION", bake.BAKE_VERSION + 1)
    assert not bake.has_lightmaps(scene), "those of other code are ignored"


@pytest.mark.parametrize(
    ("shape", "reason"),
    [
        ('<shape type="sphere" id="it"><bsdf type="conductor"/></shape>', "is not Lambertian"),
        (
            '<shape type="disk" id="it">'
            '<bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>',
            "has two sides",
        ),
        ('<shape type="cube" id="it"/>', "has points that share a UV coordinate"),
        (
            '<shape type="rectangle" id="it"><boolean name="flip_normals" value="true"/></shape>',
            "has flipped normals",
        ),
        (
            '<shape type="disk" id="it"><bsdf type="bumpmap"><texture type="checkerboard"/>'
            '<bsdf type="diffuse"/></bsdf></shape>',
            "has a material of class BumpMap",
        ),
        (
            '<shape type="disk" id="it"><bsdf type="diffuse">'
            '<texture type="checkerboard" name="reflectance"/></bsdf></shape>',
            "neither uniform nor an image",
        ),
        *(
            (
                '<shape type="disk" id="it"><bsdf type="diffuse"><texture type="bitmap" '
                f'name="reflectance"><string name="filename" value="{name}.png"/>'
                '<string name="filter_type" value="nearest"/></texture></bsdf></shape>',
                "has an image that is not interpolated bilinearly",
            )
            for name in ("columns", "rows", "speck")
        ),
    ],
)
def test_what_cannot_be_baked_is_named(tmp_path, shape, reason):
    folder = small_carpet_folder(tmp_path / "mixed")
    cv2.imwrite(str(folder / "columns.png"), np.array([[0, 255], [0, 255]], np.uint8))
    cv2.imwrite(str(folder / "rows.png"), np.array([[0, 0], [255, 255]], np.uint8))
    speck = np.random.default_rng(0).integers(0, 2, (200, 300)).astype(np.uint8)
    speck[101, 203] = 255  # in none of the lines that are looked at first
    cv2.imwrite(str(folder / "speck.png"), speck)
    xml = (folder / "scene.xml").read_text()
    (folder / "scene.xml").write_text(xml.replace("</scene>", f"{shape}</scene>"))
    with pytest.raises(SceneError, match=f"cannot be baked: shape 'it' .*{reason}.*; path-trace"):
        irradiance_maps(load_scene(folder), 1.0, 4)


def test_shapes_without_an_id_are_baked_too(tmp_path):
    folder = small_carpet_folder(tmp_path / "nameless")
    xml = (folder / "scene.xml").read_text()
    (folder / "scene.xml").write_text(xml.replace(' id="carpet"', ""))
    (file,) = bake.bake_scene(load_scene(folder))
    assert file.name == "lightmap_rectangle_0.exr"
    assert (
        Renderer(load_scene(folder), 8, 1).frame(load_scene(folder).trajectory().pose(1.0)).min()
        > 0
    )


def test_an_id_with_a_slash_has_a_file_of_its_own(tmp_path):
    """Promise: Mitsuba takes any id, and each shape finds its lightmap again."""
    folder = small_carpet_folder(tmp_path / "slash")
    xml = (folder / "scene.xml").read_text()
    (folder / "scene.xml").write_text(xml.replace(' id="carpet"', ' id="floor/a b"'))
    (file,) = bake.bake_scene(load_scene(folder))
    assert file.parent == folder
    assert set(bake.lightmaps(load_scene(folder))) == {"floor/a b"}


def test_a_folder_that_cannot_be_written_to_is_refused_before_the_work(tmp_path, monkeypatch):
    """Promise: minutes of baking are not lost at their end."""
    monkeypatch.setattr(bake.light, "irradiance_maps", lambda *_: pytest.fail("baked first"))
    (tmp_path / "file").write_text("")
    scene = load_scene(small_carpet_folder(tmp_path / "mine"))
    with pytest.raises(RenderError, match="file: found a file, expected a folder"):
        bake.bake_scene(scene, tmp_path / "file" / "maps")


def test_a_broken_scene_xml_is_named(tmp_path):
    folder = small_carpet_folder(tmp_path / "broken")
    (folder / "scene.xml").write_text('<scene version="3.0.0"><shape type="rectangel"/></scene>')
    with pytest.raises(SceneError, match=r"scene\.xml: could not be read as a Mitsuba scene"):
        load_mi_scene(load_scene(folder))


def test_a_texture_has_the_texels_that_mitsuba_reads(small_carpet):
    """Promise: value for value, and as half precision, which takes half the memory."""
    import mitsuba as mi

    (file,) = small_carpet.texture_files().values()
    (mine,) = (s for s in load_mi_scene(small_carpet).shapes() if s.id() == "carpet")
    ours = mi.traverse(mine.bsdf())["reflectance.data"]
    theirs = mi.traverse(mi.load_dict({"type": "bitmap", "filename": file, "raw": True}))["data"]
    assert type(ours) is type(theirs) is mi.TensorXf16
    np.testing.assert_array_equal(np.asarray(ours), np.asarray(theirs))


def test_scalar_machines_are_told_that_they_cannot_bake(tmp_path, monkeypatch):
    import mitsuba as mi

    monkeypatch.setenv("ERES_CACHE", str(tmp_path))
    scene = load_scene("carpet")
    settings = dataclasses.replace(scene.settings.bake, spp=7)
    stale = dataclasses.replace(scene, settings=dataclasses.replace(scene.settings, bake=settings))
    before = mi.variant()
    try:
        mi.set_variant("scalar_rgb")
        with pytest.raises(BackendError, match=r"vectorized .* found scalar_rgb; .*libllvm19"):
            bake.lightmaps(stale)
    finally:
        mi.set_variant(before)
