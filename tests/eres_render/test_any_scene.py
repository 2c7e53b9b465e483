"""Any Mitsuba file as a scene: its camera, its files, and a path from a file of poses."""

import math
from dataclasses import replace

import numpy as np
import pytest

from eres_render import (
    Clip,
    Renderer,
    SceneError,
    TrajectoryError,
    continuous_stretch,
    ground_truth,
    load_scene,
    path_through,
    render_clip,
    render_scene,
)
from eres_render.errors import RenderError
from eres_render.rendering.backend import select_variant
from eres_render.rendering.load import load_mi_scene
from eres_render.scene.xml import read_scene_xml
from eres_render.storage.exr import write_channels
from eres_render.trajectory.generators import look_at
from light_scenes import CAMERA, write_poses, write_scene

BALL = '<shape type="sphere" id="ball"><float name="radius" value="0.5"/></shape>'
SKY = '<emitter type="constant"/>'
UP = (0.0, 0.0, 1.0)
POSITIONS_M = ((3, 0, 0), (2, 2, 0.1), (0, 3, 0))
T_S = (10.0, 10.7, 11.1)


def test_the_camera_passes_through_the_given_poses_at_their_times(tmp_path):
    file = write_poses(tmp_path, POSITIONS_M, T_S)
    t_s, poses = np.array(T_S) - T_S[0], [look_at(p, (0, 0, 0), UP) for p in POSITIONS_M]
    scene = load_scene(write_scene(tmp_path, CAMERA, BALL, SKY), file)
    assert scene.duration_s == pytest.approx(1.1)
    np.testing.assert_allclose(scene.trajectory().pose(t_s), poses, atol=1e-11)
    frame = Renderer(scene, 32, 4).frame(scene.trajectory().pose(0.3))
    assert frame[0, 0] == 1  # the sky
    assert 0.2 < frame[16, 16] < 0.9  # the ball, gray by default


def test_a_scene_far_from_the_origin_is_told(tmp_path, caplog):
    """Promise: coordinates whose rounding moves the image cause a warning, usual ones do not."""
    for far_m, told in ((0.0, False), (1e5, True)):
        ball = BALL.replace(
            'value="0.5"/>', f'value="0.5"/><point name="center" x="{far_m}" y="0" z="0"/>'
        )
        (folder := tmp_path / f"{far_m:g}").mkdir()
        poses = write_poses(folder, [(x + far_m, y, z) for x, y, z in POSITIONS_M], T_S)
        scene = load_scene(write_scene(folder, CAMERA, ball, SKY), poses)
        caplog.clear()
        _ = Renderer(scene, 640, 1).trajectory
        said = [m for m in caplog.messages if "from the origin, where single precision" in m]
        assert len(said) == told


@pytest.mark.usefixtures("unmeasured_noise")
def test_a_path_that_was_made_in_python_is_rendered(tmp_path):
    """Promise: it gives the frames and the ground truth of the same path from a file; another path
    is another scene; one that comes too near a surface is refused."""
    xml = write_scene(tmp_path, CAMERA, BALL, SKY)
    from_file = load_scene(xml, write_poses(tmp_path, POSITIONS_M, T_S))
    path = from_file.trajectory()
    given = load_scene(xml, replace(path, t_offset_us=np.int64(path.t_offset_us)))
    assert (given.duration_s, given.light_digest) == (path.duration_s, from_file.light_digest)
    assert given.digest != load_scene(xml).digest
    slower = path_through(2 * path.knots_s[1:-1], path.pose(path.knots_s[1:-1]))
    assert load_scene(xml, slower).digest != given.digest == load_scene(xml, path).digest

    found, expected = (
        render_scene(scene, tmp_path / name, resolution=16, spp=1, samples=1)[0]
        for name, scene in (("given", given), ("file", from_file))
    )
    assert found.t_offset_us == 10_000_000
    np.testing.assert_array_equal(found.t_s, expected.t_s)
    np.testing.assert_array_equal(found.frame(5), expected.frame(5))
    depths = [ground_truth(one).depth(one.t_s[-1], 16) for one in (found, expected)]
    np.testing.assert_array_equal(*depths)

    poses = np.array([look_at(p, (0, 0, 0), UP) for p in ((3, 0, 0), (0, 0.1, 0), (0, 3, 0))])
    through = load_scene(xml, path_through([0.0, 0.7, 1.1], poses))
    with pytest.raises(TrajectoryError, match=r"mine: the given path: at t = .* shape 'ball'"):
        _ = Renderer(through, 8, 1).trajectory


@pytest.mark.parametrize(
    "inner",
    [
        '<float name="fov" value="50"/>',
        '<float name="fov" value="50"/><string name="fov_axis" value="y"/>',
        '<float name="fov" value="50"/><string name="fov_axis" value="diagonal"/>',
        '<float name="fov" value="50"/><string name="fov_axis" value="smaller"/>',
        '<float name="fov" value="50"/><string name="fov_axis" value="larger"/>',
        '<string name="focal_length" value="35mm"/>',
        '<float name="fov" value="$wide"/>',
        "",
    ],
)
@pytest.mark.parametrize("size", [(400, 300), (300, 400), None])
def test_the_field_of_view_is_the_one_that_mitsuba_makes_of_it(tmp_path, inner, size):
    select_variant()
    import mitsuba as mi

    sides = "" if size is None else "".join(
        f'<integer name="{n}" value="{v}"/>' for n, v in zip(("width", "height"), size, strict=True)
    )  # fmt: skip
    film = f'<film type="hdrfilm">{sides}</film>'
    xml = write_scene(
        tmp_path,
        '<default name="wide" value="77"/>',
        f'<sensor type="perspective">{inner}{film}</sensor>',
    )
    expected = float(np.asarray(mi.traverse(mi.load_file(str(xml)).sensors()[0])["x_fov"])[0])
    assert math.degrees(read_scene_xml(xml).camera()[0]) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([BALL], r"mine\.xml: found 0 cameras \(<sensor>\), expected exactly one"),
        ([CAMERA, CAMERA], r"mine\.xml: found 2 cameras \(<sensor>\), expected exactly one"),
        (['<sensor type="thinlens"/>'], r"mine\.xml: camera: found type 'thinlens'"),
        (
            ['<sensor type="perspective"><float name="fov" value="wide"/></sensor>'],
            r"mine\.xml: camera: fov: found 'wide', expected between 0 and 180 degrees",
        ),
        (
            [CAMERA, '<shape type="ply"><string name="filename" value="ship.ply"/></shape>'],
            r"mine\.xml: names 'ship\.ply', but .*/ship\.ply is missing",
        ),
        (
            [
                CAMERA,
                '<default name="skin" value="a/skin.png"/>',
                '<texture type="bitmap"><string name="filename" value="$skin"/></texture>',
            ],
            r"names 'a/skin\.png', but .*/a/skin\.png is missing",
        ),
        ([CAMERA, '<include filename="rest.xml"/>'], r"names 'rest\.xml', but .* is missing"),
        (
            [CAMERA, '<include filename="$rest"/>'],
            r"includes '\$rest', whose parameter",
        ),
        ([CAMERA, '<include filename="mine.xml"/>'], r"includes .*mine\.xml, which includes it"),
        ([CAMERA, "<shape"], r"mine\.xml: could not be read as XML"),
    ],
)
def test_scene_files_that_cannot_do_are_refused(tmp_path, parts, message):
    with pytest.raises(SceneError, match=message):
        load_scene(write_scene(tmp_path, *parts))


@pytest.mark.parametrize(
    ("inner", "message"),
    [
        (
            '<float name="fov" value="200"/>',
            r"fov: found '200', expected between 0 and 180 degrees",
        ),
        (
            '<float name="fov" value="nan"/>',
            r"fov: found 'nan', expected between 0 and 180 degrees",
        ),
        (
            '<string name="focal_length" value="0mm"/>',
            "focal_length: found '0', expected a positive number of mm",
        ),
        (
            '<film type="hdrfilm"><integer name="height" value="0"/></film>',
            "film height: found '0', expected a positive whole number",
        ),
    ],
)
def test_cameras_that_cannot_be_are_refused(tmp_path, inner, message):
    """Promise: one line names the file, the field and the user's own number."""
    camera = f'<sensor type="perspective">{inner}</sensor>'
    with pytest.raises(SceneError, match=rf"mine\.xml: camera: {message}$"):
        load_scene(write_scene(tmp_path, camera, BALL, SKY))


def test_files_are_found_where_mitsuba_finds_them_and_change_the_digest(tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "a.spd").write_text("400 1\n700 1\n")
    (tmp_path / "rest.xml").write_text(
        '<scene version="3.0.0"><path value="meshes"/><emitter type="constant">'
        '<spectrum name="radiance" filename="a.spd"/></emitter></scene>'
    )
    xml = write_scene(tmp_path, CAMERA, BALL, '<include filename="rest.xml"/>')
    scene = load_scene(xml)
    assert scene.files == (tmp_path / "rest.xml", tmp_path / "meshes" / "a.spd")
    load_mi_scene(scene)
    before = scene.light_digest
    (tmp_path / "meshes" / "a.spd").write_text("400 2\n700 2\n")
    assert load_scene(xml).light_digest != before


def test_a_scene_file_without_a_path_and_bad_paths_are_refused(tmp_path):
    xml = write_scene(tmp_path, CAMERA, BALL, SKY)
    with pytest.raises(SceneError, match=r"mine\.xml: has no camera path; give poses in TUM"):
        load_scene(xml).trajectory()
    with pytest.raises(SceneError, match=r"nowhere\.txt: no such file, expected a camera path"):
        load_scene(xml, tmp_path / "nowhere.txt")
    file = write_poses(tmp_path, [(3, 0, 0)] * 3, T_S)
    with pytest.raises(TrajectoryError, match=r"poses\.txt: the path has length 0"):
        load_scene(xml, file).trajectory()
    file = write_poses(tmp_path, [(3, 0.1, 2.7)] * 9, np.arange(9.0))  # rounded by the spline
    with pytest.raises(TrajectoryError, match=r"poses\.txt: the path has length 0"):
        load_scene(xml, file).trajectory()
    file.write_text(file.read_text().splitlines()[1])
    with pytest.raises(TrajectoryError, match=r"poses\.txt: found 1 times and poses"):
        load_scene(xml, file).trajectory()
    file = write_poses(tmp_path, ((3, 0, 0), (0, 0.1, 0), (0, 3, 0)), T_S)
    with pytest.raises(TrajectoryError, match=r"poses\.txt: at t = .* shape 'ball'"):
        _ = Renderer(load_scene(xml, file), 8, 1).trajectory
    with pytest.raises(SceneError, match=r"folder or \.xml file named 'other\.xml'"):
        load_scene("other.xml")


@pytest.mark.usefixtures("unmeasured_noise")
def test_a_scene_folder_whose_path_a_generator_made(tmp_path):
    """Promise: the public API alone renders a scene and a path from outside."""
    folder = tmp_path / "spiral"
    folder.mkdir()
    turn = np.linspace(0, 1, 9)
    spiral = np.column_stack([3 * np.cos(turn), 3 * np.sin(turn), 0.3 * turn])
    write_poses(folder, spiral, turn)
    write_scene(folder, BALL, SKY).rename(folder / "scene.xml")
    (folder / "scene.toml").write_text("""title = "Around a ball"
licence = "MIT"
length_unit = "m"
radiance_unit = "W m^-2 sr^-1"
camera = { fov_deg = 50.0 }
path = { kind = "tum", file = "poses.txt", min_clearance_m = 1.0 }
""")
    options = {"spp": 4, "max_displacement_px": 1.0, "duration_s": 0.1, "continuous": True}
    (sequence,) = render_scene(load_scene(folder), tmp_path, resolution=16, **options)
    np.testing.assert_allclose(sequence.T_world_cam[0, :3, 3], spiral[0], atol=1e-12)
    assert sequence.frame(0)[0, 0] == 1  # the sky


def test_folders_of_a_path_element_come_before_the_scene_and_start_at_its_file(tmp_path):
    """Promise: as in Mitsuba, so that the digest is of the files that it reads."""
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "near").mkdir()
    for folder in (tmp_path, tmp_path / "b", tmp_path / "b" / "near"):
        (folder / "skin.exr").write_bytes(b"")
    (tmp_path / "b" / "rest.xml").write_text('<scene version="3.0.0"><path value="near"/></scene>')
    skin = '<texture type="bitmap"><string name="filename" value="skin.exr"/></texture>'
    xml = write_scene(tmp_path, CAMERA, '<path value="b"/>', skin)
    assert read_scene_xml(xml).files == (tmp_path / "b" / "skin.exr",)
    xml = write_scene(tmp_path, CAMERA, '<include filename="b/rest.xml"/>', skin)
    assert read_scene_xml(xml).files[-1] == tmp_path / "b" / "near" / "skin.exr"


def test_a_parameter_is_the_longest_name_that_fits(tmp_path):
    """Promise: as in Mitsuba, `$dir_color.png` is the parameter `dir` and then `_color.png`."""
    for name in ("wood_color.png", "oak.png"):
        (tmp_path / name).write_bytes(b"")
    values = '<default name="dir" value="wood"/><default name="dir_other" value="oak"/>'
    for name, file in (("$dir_color.png", "wood_color.png"), ("$dir_other.png", "oak.png")):
        skin = f'<texture type="bitmap"><string name="filename" value="{name}"/></texture>'
        xml = write_scene(tmp_path, CAMERA, values, skin)
        assert read_scene_xml(xml).files == (tmp_path / file,)


@pytest.mark.parametrize("encoding", ["gb2312", "utf-32", "none-such"])
def test_encodings_that_xml_readers_do_not_know_are_refused(tmp_path, encoding):
    xml = write_scene(tmp_path, CAMERA)
    xml.write_text(f'<?xml version="1.0" encoding="{encoding}"?>{xml.read_text()}')
    with pytest.raises(SceneError, match=r"mine\.xml: could not be read as XML: "):
        load_scene(xml)


def test_a_principal_point_that_is_left_out_is_said(tmp_path, caplog):
    inner = '<float name="fov" value="50"/><float name="principal_point_offset_x" value="{}"/>'
    camera = f'<sensor type="perspective">{inner}</sensor>'
    load_scene(write_scene(tmp_path, camera.format("0.0"), BALL, SKY))
    assert not caplog.text
    load_scene(write_scene(tmp_path, camera.format("0.2"), BALL, SKY))
    assert "principal_point_offset_x is ignored" in caplog.text


def lit_floor(radiance):
    """Return a floor that emits an image with one texel of another value in its middle."""
    return (
        '<shape type="rectangle"><transform name="to_world"><scale value="9"/></transform>'
        '<emitter type="area"><texture type="bitmap" name="radiance">'
        f'<string name="filename" value="{radiance}"/><boolean name="raw" value="true"/>'
        '<string name="filter_type" value="nearest"/></texture></emitter></shape>'
    )


def test_negative_light_is_refused_when_it_is_rendered(tmp_path):
    """Promise: no complete sequence that nothing can read; the error says what to look at."""
    image = np.ones((9, 9), np.float32)
    image[4, 4] = -0.5
    write_channels(tmp_path / "floor.exr", {"Y": image}, compression="none")
    poses = write_poses(tmp_path, [(0, -1, 3), (0, -0.9, 3), (0, -0.8, 3), (0, -0.7, 3)], range(4))
    scene = load_scene(write_scene(tmp_path, CAMERA, lit_floor("floor.exr")), poses)
    renderer = Renderer(scene, 16, 4, integrator="emission")
    message = r"000000\.exr: pixel x=\d+ y=\d+: found -0\.\d+, expected a radiance of 0 or more"
    with pytest.raises(RenderError, match=message):
        render_clip(renderer, Clip(0, 0.0, 0.0, 0.02), tmp_path / "out", 0.5)


def test_paths_of_days_are_refused_before_their_frame_times_are_sought(tmp_path):
    """Promise: times in microseconds do not start a search of hours."""
    poses = write_poses(tmp_path, [(3, 0, 0), (2, 2, 0.1), (0, 3, 0)], (0, 100_000, 200_000))
    scene = load_scene(write_scene(tmp_path, CAMERA, BALL, SKY), poses)
    with pytest.raises(RenderError, match=r"path of 200000 s .* poses in seconds\?"):
        continuous_stretch(scene)


def test_light_that_half_floats_round_visibly_is_said(tmp_path, caplog):
    """Promise: a dim scene renders, with a warning that says how dim it is."""
    lamp = '<emitter type="constant"><rgb name="radiance" value="0.001"/></emitter>'
    floor = (
        '<shape type="rectangle"><transform name="to_world"><scale value="9"/></transform></shape>'
    )
    xml = write_scene(tmp_path, CAMERA, lamp, floor)
    poses = write_poses(tmp_path, [(0, -1, 3), (0, -0.9, 3), (0, -0.8, 3), (0, -0.7, 3)], range(4))
    assert Renderer(load_scene(xml, poses), 8, 4, integrator="path").white_level < 0.002
    assert "scale all emitters up" in caplog.text
