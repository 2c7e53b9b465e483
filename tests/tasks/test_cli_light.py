"""Commands for light: any scene, truth, convergence; an error for bad input."""

import json
import logging
import re

import h5py
import numpy as np
import pytest

from eres_render import load_scene, open_sequence, render_scene
from eres_render.rendering import backend
from eres_render.sequence import render_clips
from eres_render.storage.exr import read_luminance
from light_scenes import (
    CAMERA,
    edit_scene,
    room_folder,
    small_carpet_folder,
    write_poses,
    write_scene,
)
from tasks.datasets import EventDataset

SCENE = """<emitter type="constant"/>
<shape type="sphere" id="ball"><float name="radius" value="0.5"/></shape>
<shape type="sphere" id="mirror">
  <point name="center" value="0 0 1"/><float name="radius" value="0.3"/><bsdf type="conductor"/>
</shape>"""
POSITIONS_M = ((3, 0, 0), (2.8, 1, 0.1), (2.5, 1.5, 0))
T_S = (0.0, 0.2, 0.4)


def missing_texture(folder):
    """Make a scene folder's scene.xml name an image that does not exist."""
    xml = (folder / "scene.xml").read_text()
    wall = """<shape type="rectangle"><bsdf type="diffuse">
        <texture type="bitmap" name="reflectance">
        <string name="filename" value="wallpaper.png"/></texture></bsdf></shape></scene>"""
    (folder / "scene.xml").write_text(xml.replace("</scene>", wall))
    return folder


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """A room in light that is set by hand."""
    return room_folder(tmp_path_factory.mktemp("light") / "room")


@pytest.fixture(scope="module")
def room_clip(room, tmp_path_factory):
    """The folder of a clip of the room, of few frames and pixels."""
    options = {"resolution": 24, "spp": 1, "samples": 1, "max_displacement_px": 4.0}
    (clip,) = render_scene(load_scene(room), tmp_path_factory.mktemp("clips"), **options)
    return clip.folder


@pytest.mark.slow
@pytest.mark.usefixtures("unmeasured_noise")
def test_a_users_own_scene_from_xml_to_truth(eres, tmp_path):
    """Promise: any Mitsuba file with poses renders; info and truth describe the result."""
    xml, poses = write_scene(tmp_path, CAMERA, SCENE), write_poses(tmp_path, POSITIONS_M, T_S)
    options = ["--resolution", "24", "--spp", "4", "--max-displacement", "4", "--continuous"]
    code, out, _ = eres("render", xml, "--trajectory", poses, "--out", tmp_path / "out", *options)
    assert code == 0
    assert f"{tmp_path / 'out' / 'continuous'}: " in out
    sequence = open_sequence(tmp_path / "out" / "continuous")
    assert sequence.is_continuous
    assert sequence.manifest.integrator == "path"  # for the mirror

    code, out, _ = eres("info", sequence.folder)
    assert code == 0
    assert "mine, continuous" in out
    assert "0.0000 to 0.4000 s" in out
    assert "m/s on average" in out
    said = f"{sequence.folder}: is a folder; --format and read options"
    refused(eres, tmp_path, said, "info", sequence.folder, "--format", "npz")

    code, out, _ = eres(
        "truth", sequence.folder, "--out", tmp_path / "truth", "--width", "20", "--step", "0.15",
        "--flow-png",
    )  # fmt: skip
    assert code == 0
    assert "4 times" in out  # 0, 0.15, 0.3, 0.4
    assert len(list((tmp_path / "truth" / "depth").glob("*.exr"))) == 4
    assert len(list((tmp_path / "truth" / "flow").glob("*.png"))) == 3

    wide = ["--out", tmp_path / "wide", "--width", 20, "--height", 12]
    assert eres("truth", sequence.folder, *wide)[0] == 0
    camera = json.loads((tmp_path / "wide" / "camera.json").read_text())
    assert (camera["width"], camera["height"]) == (20, 12)


FILMED = """<sensor type="perspective"><float name="fov" value="50"/>
<film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="18"/></film>
<sampler type="independent"><integer name="sample_count" value="5"/></sampler></sensor>"""


@pytest.mark.slow
@pytest.mark.usefixtures("unmeasured_noise")
def test_a_mitsuba_file_has_its_own_size_and_samples(eres, tmp_path, monkeypatch, caplog):
    """Promise: film and sampler decide unless told otherwise, with samples rounded up to a square;
    a dry run tells frames and cost and writes nothing; other settings are refused at once."""
    xml, poses = write_scene(tmp_path, FILMED, SCENE), write_poses(tmp_path, POSITIONS_M, T_S)
    out = tmp_path / "out"
    given = [xml, "--trajectory", poses, "--out", out, "--max-displacement", 8, "--continuous"]
    with caplog.at_level(logging.INFO):
        assert eres("render", *given, "--dry-run")[0] == 0
    assert not out.exists()
    said = r"1 sequence to render: about (\d+) frames of 24x18 px, 1 MB on disk, \d+ s"
    counted = re.search(said, caplog.text)
    assert eres("render", *given)[0] == 0
    frames = open_sequence(out / "continuous")
    assert (frames.manifest.width, frames.manifest.height, frames.manifest.spp) == (24, 18, 9)
    assert len(frames) == int(counted[1])
    monkeypatch.setattr(render_clips, "Renderer", None)
    for options, said in (
        (["--resolution", 24], "height 18, not 24"),
        (["--width", 36, "--height", 18], "width 24, not 36"),
        (["--spp", 16], "spp 9, not 16"),
        (["--seed", 3], "seed 0, not 3"),
    ):
        code, _, err = eres("render", *given, *options)
        assert (code, f"continuous: found a sequence with {said}" in err) == (1, True)


@pytest.mark.slow
def test_frames_of_any_shape_from_render_to_scores(eres, small_carpet, tmp_path):
    """Promise: events, truth and scores of wide frames, at a width that does not divide theirs; an
    error of a sensor that is too fine tells the frames from what it sees of them."""
    out, sensor = tmp_path / "wide", ["--resolution", 173]
    render = ["render", small_carpet.folder, "--out", out, "--width", 320]
    options = ["--spp", 1, "--samples", 1, "--max-displacement", 1]
    code, _, err = eres(*render, *options)
    assert (code, "found --width, expected" in err) == (1, True)
    assert eres(*render, "--height", 180, *options)[0] == 0
    clip = out / "clip_000"
    assert "of 320x180 px" in eres("info", clip)[1]
    events = tmp_path / "events.h5"
    code, said, _ = eres("simulate", clip, "--out", events, *sensor, "--truth", 0.05)
    assert (code, "of 173x97 px" in said) == (0, True)
    fine = ["--out", tmp_path / "fine.h5", "--sensor", "davis346"]
    refused(
        eres,
        tmp_path,
        f"{clip}: the sensor has 346x260 px, but sees 240x180",
        "simulate",
        clip,
        *fine,
    )
    assert eres("truth", clip, "--out", tmp_path / "truth", "--width", 173)[0] == 0
    camera = json.loads((tmp_path / "truth" / "camera.json").read_text())
    assert (camera["width"], camera["height"]) == (173, 97)
    np.testing.assert_allclose(camera["K"][1], [0, 277.128 * 97 / 180, 48.5], rtol=1e-5)
    for method, nothing, task in (
        ("event_integration", "no_events", "reconstruction"),
        ("photometric_flow", "initial_flow", "flow"),
        ("photometric_tracking", "initial_path", "tracking"),
    ):
        asked = ["--task", task, "--method", method, nothing, *sensor]
        code, said, _ = eres("evaluate", clip, *asked)
        assert code == 0
        rows = {line.split()[0]: line for line in said.splitlines()}
        mine, theirs = (float(re.search(r"\d+\.\d+", rows[m])[0]) for m in (method, nothing))
        assert mine > theirs + 2 if task == "reconstruction" else mine < 0.5 * theirs


KALIBR = """cam0:
  camera_model: pinhole
  intrinsics: [90.0, 88.0, 46.5, 31.5]
  distortion_model: radtan
  distortion_coeffs: [-0.25, 0.06, 0.001, -0.002]
  resolution: [96, 64]
"""


@pytest.mark.slow
def test_a_calibrated_lens_from_its_file_to_events_and_truth(eres, small_carpet, tmp_path):
    """Promise: size, focal lengths and lens come from the file; sequence, info, truth and events
    have them, half a pixel from Kalibr's; tracking, which needs a pinhole, refuses the lens."""
    file = tmp_path / "camera.yaml"
    file.write_text(KALIBR)
    render = ["render", small_carpet.folder, "--out", tmp_path / "out", "--camera", file]
    options = ["--spp", 1, "--samples", 1, "--max-displacement", 1]
    assert eres(*render, *options)[0] == 0
    clip = tmp_path / "out" / "clip_000"
    said = " ".join(eres("info", clip)[1].split())
    assert "of 96x64 px" in said
    assert "camera fx 90, fy 88, cx 47, cy 32 px lens k1 -0.25, k2 0.06, p1 0.001, p2 -0.0" in said

    assert eres("truth", clip, "--out", tmp_path / "truth", "--width", 48)[0] == 0
    camera = json.loads((tmp_path / "truth" / "camera.json").read_text())
    lens = {"k1": -0.25, "k2": 0.06, "p1": 0.001, "p2": -0.002, "k3": 0.0}
    assert (camera["width"], camera["K"][0][2], camera["distortion"]) == (48, 23.5, lens)
    events = tmp_path / "out" / "events.h5"
    sensor = ["--resolution", 48]
    assert eres("simulate", clip, "--out", events, *sensor, "--truth", 0.05)[0] == 0
    with h5py.File(events) as stored:
        assert stored["truth/distortion"][:].tolist() == list(lens.values())
    assert EventDataset(tmp_path / "out")[0]["distortion"].tolist() == list(lens.values())
    for task, method in (("reconstruction", "event_integration"), ("flow", "initial_flow")):
        assert eres("evaluate", clip, "--task", task, "--method", method, *sensor)[0] == 0
    code, _, err = eres("evaluate", clip, "--task", "tracking", *sensor)
    assert (code, "needs a pinhole camera; found Distortion(k1=-0.25" in err) == (1, True)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--width", 9, "--height", 8], "found --width and --height and --camera, expected"),
        (["--resolution", 9], "found --resolution and --camera, expected"),
        (["--camera-name", "cam1"], "camera.yaml: found cam0, expected 'cam1'"),
    ],
)
def test_a_calibrated_camera_has_its_own_size(eres, tmp_path, options, text):
    (tmp_path / "camera.yaml").write_text(KALIBR)
    camera = ["--camera", tmp_path / "camera.yaml", *options]
    code, _, err = eres("render", "carpet", "--out", tmp_path / "out", *camera)
    assert (code, len(err.splitlines()), text in err) == (1, 1, True), err
    assert not (tmp_path / "out").exists()
    code, _, err = eres("render", "carpet", "--out", tmp_path / "out", "--camera-name", "cam0")
    assert (code, "--camera-name cam0 needs --camera" in err) == (1, True)


def test_a_scene_is_baked_into_its_folder(eres, tmp_path):
    """Promise: the lightmaps lie beside scene.xml, and are printed."""
    if backend.select_variant().startswith("scalar"):
        pytest.skip("baking needs a vectorized variant")
    folder = small_carpet_folder(tmp_path / "carpet")
    code, out, _ = eres("bake", folder)
    assert (code, out.split()) == (0, [str(folder / "lightmap_carpet.exr")])
    assert np.all(read_luminance(folder / "lightmap_carpet.exr") > 0)


def test_truth_replaces_truth_only_when_told(eres, room_clip, tmp_path):
    """Promise: a folder never has truth of two steps; --overwrite removes the old truth
    and nothing else."""
    clip, out = room_clip, tmp_path / "truth"
    truth = ["truth", clip, "--out", out, "--width", 20, "--step"]
    assert eres(*truth, 0.01, "--flow-png")[0] == 0
    fine = sorted(out.rglob("*"))
    (out / "notes.txt").write_text("mine")
    (out / "depth" / "mine.exr").write_text("mine")
    code, _, err = eres(*truth, 0.025)
    assert (code, len(err.splitlines())) == (1, 1)
    assert f"{out}: has ground truth already" in err
    assert "--overwrite" in err
    assert set(out.rglob("*")) - set(fine) == {out / "notes.txt", out / "depth" / "mine.exr"}

    assert eres(*truth, 0.025, "--overwrite")[0] == 0
    files = {str(p.relative_to(out)) for p in out.rglob("*") if p.is_file()}
    assert files == {
        *("camera.json", "poses.txt", "notes.txt", "depth/mine.exr"),
        *("depth/000000.exr", "depth/000001.exr", "depth/000002.exr"),
        *("flow/000000.exr", "flow/000001.exr"),
    }
    poses = (clip / "poses.txt").read_bytes()
    code, _, err = eres("truth", clip, "--out", clip, "--overwrite")
    assert (code, "holds a sequence" in err) == (1, True)
    assert (clip / "poses.txt").read_bytes() == poses


@pytest.mark.slow
def test_convergence_prints_each_setting(eres, room):
    code, out, _ = eres("convergence", room, "--resolution", "12", "--duration", "0.005")
    assert code == 0
    lines = out.splitlines()
    assert len(lines) == 1 + 1 + 2 * 8
    assert "64 spp" in lines[1]
    assert "+0.0 %" in lines[1]
    assert sum("fresh" in line for line in lines) == 8


BAD_SCENES = [
    ([SCENE], "found 0 cameras"),
    ([CAMERA, CAMERA, SCENE], "found 2 cameras"),
    (
        [CAMERA, '<shape type="obj"><string name="filename" value="gone.obj"/></shape>'],
        "gone.obj is missing",
    ),
    (
        [CAMERA, '<texture type="bitmap"><string name="filename" value="gone.png"/></texture>'],
        "gone.png is missing",
    ),
    ([CAMERA, '<shape type="sphre"/>'], "could not be read as a Mitsuba scene"),
    ([CAMERA, SCENE.partition("\n")[2]], "mine.xml: found no light (white, the 99.9th percentile"),
]
BAD_POSES = [
    ("0 0 0 3 0 0 0 1\n1 0 0 4 0 0 0 1\n0.5 0 0 5 0 0 0 1\n", "line 3: found time 0.5 after 1.0"),
    ("0 0 0 3 0 0 0 1.01\n1 0 0 4 0 0 0 1\n", "line 1: found a quaternion of length 1.01"),
    ("0 0 0 3 0 0 0 1\n1 0 0 3 0 0 0 1\n", "the path has length 0"),
    ("0 0 0 0.2 0 0 0 1\n1 0 0 0.1 0 0 0 1\n", "is inside a solid or behind a wall, shape 'ball'"),
    ("0 3 0 0 0 0 0 1\n1 -3 0 0 0 0 0 1\n", "of shape 'ball'"),
    ("hello\n", "line 1: found 'hello', expected 8 numbers"),
    ("0 3 0 0 0 0 0 1\n", "expected at least two poses"),
    ("", "found no pose"),
    (b"\x92\xff\x00", "poses.txt: could not be read as text"),
]
BAD_NUMBERS = [
    (("--spp", "0"), "spp: found 0, expected a square"),
    (("--spp", "7"), "spp: found 7, expected a square"),
    (("--seed", "-1"), "seed: found -1"),
    (("--resolution", "0"), "Camera: found 0x0 pixels"),
    (("--width", "9"), "found --resolution and --width, expected"),
    (("--height", "9"), "found --resolution and --height, expected"),
    (("--width", "9", "--height", "8"), "found --resolution and --width and --height, expected"),
    (("--duration", "9"), "--duration: found 9.0, not within the 0.4 s"),
    (("--max-displacement", "0"), "--max-displacement: found 0.0, expected a positive number"),
    (("--integrator", "baked"), "shape 'mirror' is not Lambertian"),
]


@pytest.mark.parametrize(("parts", "text"), BAD_SCENES)
def test_bad_scenes_are_refused_and_leave_nothing(eres, tmp_path, parts, text):
    """Promise: exit code 1, one line that names the file and the mistake."""
    xml, poses = write_scene(tmp_path, *parts), write_poses(tmp_path, POSITIONS_M, T_S)
    options = ("--trajectory", poses, "--resolution", 8, "--out", tmp_path / "out")
    refused(eres, tmp_path, text, "render", xml, *options)


@pytest.mark.parametrize(("poses", "text"), BAD_POSES)
def test_bad_poses_are_refused_and_leave_nothing(eres, tmp_path, poses, text):
    xml = write_scene(tmp_path, CAMERA, SCENE)
    data = poses if isinstance(poses, bytes) else poses.encode()
    (tmp_path / "poses.txt").write_bytes(data)
    refused(
        eres, tmp_path, text, "render", xml, "--trajectory", tmp_path / "poses.txt", "--out",
        tmp_path / "out",
    )  # fmt: skip


@pytest.mark.parametrize(("options", "text"), BAD_NUMBERS)
def test_bad_numbers_are_refused_and_leave_nothing(eres, tmp_path, options, text):
    xml, poses = write_scene(tmp_path, CAMERA, SCENE), write_poses(tmp_path, POSITIONS_M, T_S)
    usual = ("--out", tmp_path / "out", "--resolution", "8", "--spp", "1", "--continuous")
    refused(eres, tmp_path, text, "render", xml, "--trajectory", poses, *usual, *options)


@pytest.mark.parametrize(
    ("path_s", "instead"),
    [(0.4, "give --duration 0.3 or more, or --continuous"), (0.25, "give --continuous")],
)
def test_a_path_without_room_for_a_clip_says_what_to_do(eres, tmp_path, path_s, instead):
    xml = write_scene(tmp_path, CAMERA, SCENE)
    poses = write_poses(tmp_path, POSITIONS_M, (0.0, 0.2, path_s))
    text = f"no clip fits into 0.22 s of path, expected at least 0.3 s; {instead} for one sequence"
    options = ("--out", tmp_path / "out", "--duration", 0.22)
    refused(eres, tmp_path, text, "render", xml, "--trajectory", poses, *options)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (
            lambda folder: room_folder(folder, ("[1.0, 0.0, 1.5]", "[2.5, 0.0, 1.5]")),
            "the camera is inside a solid or behind a wall",
        ),
        (
            lambda folder: room_folder(folder, ("[1.0, 0.0, 1.5]", "[0.1, 0.0, 1.5]")),
            "inside a solid or behind a wall, shape 'ball'",
        ),
        (
            lambda folder: missing_texture(room_folder(folder)),
            "names 'wallpaper.png', but",
        ),
        (
            lambda folder: edit_scene(folder, ("distance_m = 1.82", "distance_m = 3.0")),
            "expected at most plane.half_width_m = 2.5 m",
        ),
    ],
)
def test_paths_that_leave_their_scene_are_refused_and_leave_nothing(eres, tmp_path, make, text):
    folder = make(tmp_path / "scene")
    refused(eres, tmp_path, text, "render", folder, "--out", tmp_path / "out", "--spp", "1")


PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
property float quality
element face 2
property list uchar int vertex_indices
end_header
-1 -1 0 200 100 50 1
1 -1 0 200 100 50 1
1 1 0 200 100 50 1
-1 1 0 200 100 50 1
3 0 1 2
3 0 2 3
"""


def write_mesh(folder, material=""):
    """Write a mesh with vertex colors, and the poses of a camera above it."""
    (folder / "mesh.ply").write_text(PLY)
    mesh = f'<shape type="ply"><string name="filename" value="mesh.ply"/>{material}</shape>'
    xml = write_scene(folder, CAMERA, '<emitter type="constant"/>', mesh)
    return xml, write_poses(folder, ((0, 0.1, 3), (0.1, 0.1, 3), (0.1, 0, 3)), T_S)


@pytest.mark.usefixtures("unmeasured_noise")
def test_colors_of_a_mesh_that_nothing_uses_are_no_matter(tmp_path, capfd, caplog):
    """Promise: a mesh with colors, as scanners write it, renders without a message of Mitsuba; one
    without UV coordinates is path-traced, with no traceback."""
    scene = load_scene(*write_mesh(tmp_path))
    (sequence,) = render_scene(scene, tmp_path / "r", resolution=8, spp=1, continuous=True)
    assert "".join(capfd.readouterr()) == ""
    assert not any("Mitsuba" in message or "quality" in message for message in caplog.messages)
    assert sequence.manifest.integrator == "path"


@pytest.mark.usefixtures("unmeasured_noise")
def test_colors_of_a_mesh_that_a_material_uses_are_said_once(tmp_path, capfd, caplog):
    """Promise: relevant warnings of Mitsuba appear once, with the scene's name."""
    material = """<bsdf type="diffuse"><texture type="mesh_attribute" name="reflectance">
        <string name="name" value="vertex_color"/></texture></bsdf>"""
    xml, poses = write_mesh(tmp_path, material)
    comment = "<?xml version='1.0' encoding='ISO-8859-1'?><!-- ä -->"  # is not UTF-8
    xml.write_bytes(comment.encode("latin-1") + xml.read_bytes())
    render_scene(load_scene(xml, poses), tmp_path / "r", resolution=8, spp=1, continuous=True)
    assert "WARN" not in "".join(capfd.readouterr())
    (said,) = (message for message in caplog.messages if "Mitsuba" in message)
    assert said.startswith(f"{xml}: Mitsuba warns: ")
    assert "[0, 1] range" in said


def test_a_scene_without_a_lamp_is_not_baked_for_minutes(eres, tmp_path):
    """Promise: a scene without light causes one clear line before any computation of the light."""
    plane = '<shape type="rectangle" id="floor"/>'
    xml = write_scene(tmp_path, CAMERA, plane)
    poses = write_poses(tmp_path, ((0, 0.1, 3), (0.1, 0.1, 3), (0.1, 0, 3)), T_S)
    options = ("--resolution", 8, "--continuous", "--out", tmp_path / "out")
    refused(
        eres, tmp_path, f"{xml}: found no light", "render", xml, "--trajectory", poses, *options
    )


def test_the_folder_above_clips_is_not_a_sequence(eres, tmp_path):
    """Promise: for the same argument as `eres render` got, the error names the folder to give."""
    for k in range(2):
        (tmp_path / "r" / f"clip_00{k}").mkdir(parents=True)
        (tmp_path / "r" / f"clip_00{k}" / "manifest.json").write_text("{}")
    instead = f"a folder of 2 sequences; give one sequence, such as {tmp_path / 'r' / 'clip_000'}"
    folder, out = tmp_path / "r", tmp_path / "o"
    refused(eres, tmp_path, instead, "info", folder)
    refused(eres, tmp_path, instead, "truth", folder, "--out", out)
    refused(eres, tmp_path, instead, "simulate", folder, "--out", out, "--resolution", 8)
    refused(eres, tmp_path, instead, "evaluate", folder, "--task", "flow")


def test_truth_beyond_memory_is_one_line(eres, room_clip, tmp_path):
    """Promise: truth images that are too large for any machine are an error, and leave no files."""
    out = tmp_path / "out"
    code, _, err = eres("truth", room_clip, "--out", out, "--width", 2_000_000)
    assert code == 1
    assert err.splitlines()[-1].startswith("error: out of memory: ")
    assert not out.exists()


def test_a_file_is_not_a_sequence(eres, tmp_path):
    """Promise: a file of events in place of a folder causes a clear error."""
    recording = tmp_path / "a.h5"
    recording.touch()
    said = f"{recording}: found a file, expected the folder of a rendered sequence"
    refused(eres, tmp_path, said, "truth", recording, "--out", tmp_path / "out")


def test_frames_far_apart_are_said(eres, room, tmp_path, caplog):
    """Promise: rendering, simulating or evaluating frames more than 1 px apart causes a warning
    with the distance; at 1 px there is none."""
    usual = ["--resolution", 16, "--spp", 1, "--samples", 1]
    for motion in (1, 3.5):
        out, clip = tmp_path / str(motion), tmp_path / str(motion) / "clip_000"
        asked = ["--max-displacement", motion, "--out", out]
        assert eres("render", room, *usual, *asked)[0] == 0
        events = clip.with_suffix(".h5")
        assert eres("simulate", clip, "--out", events, "--resolution", 8)[0] == 0
        task = ["--task", "reconstruction", "--resolution", 16]
        assert eres("evaluate", clip, *task)[0] == 0
    said = [message for message in caplog.messages if "from frame to frame" in message]
    assert [message.split(":")[0] for message in said] == ["room", str(clip), str(clip)]
    assert all(
        "the image moves up to 3.5 px from frame to frame, above 1 px:" in line for line in said
    )


def test_a_sensor_without_width_is_refused(eres, room_clip, tmp_path):
    """Promise: one line that names the option, whatever the task."""
    asked = ("evaluate", room_clip, "--task", "reconstruction")
    for width in (0, -5):
        said = f"width: found {width}, expected an integer from 1"
        refused(eres, tmp_path, said, *asked, "--resolution", width)


def test_truth_of_no_sequence_and_senseless_steps_are_refused(eres, tmp_path):
    refused(
        eres, tmp_path, "none/manifest.json", "truth", tmp_path / "none", "--out", tmp_path / "o"
    )
    refused(
        eres, tmp_path, "duration: found 9.0 s", "convergence", "carpet", "--duration", "9",
    )  # fmt: skip


def refused(eres, folder, text, *args):
    before = sorted(folder.rglob("*"))
    code, _, err = eres(*args)
    assert code == 1
    assert text in err
    assert err.startswith("error: ")
    assert len(err.strip().splitlines()) == 1, err
    assert sorted(folder.rglob("*")) == before
