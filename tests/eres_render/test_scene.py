"""Scene folders: eres finds them, checks each field, and distinguishes them by digest."""

import dataclasses

import numpy as np
import pytest

from eres_render import (
    Camera,
    Renderer,
    RenderError,
    SceneError,
    Trajectory,
    TrajectoryError,
    clips,
    list_scenes,
    load_scene,
    path_through,
    render_scene,
)
from eres_render.sequence.clips import WARM_UP_S
from light_scenes import edit_scene, light_evenly, small_carpet_folder


def test_carpet_is_packaged_and_complete():
    assert "carpet" in list_scenes()
    scene = load_scene("carpet")
    assert scene.name == "carpet"
    assert scene.settings.license == "MIT"
    assert len(scene.digest) == 64


def test_unknown_scene_gets_the_nearest_name():
    with pytest.raises(SceneError, match=r"'carpte': did you mean 'carpet'\?"):
        load_scene("carpte")
    with pytest.raises(SceneError, match=r"'zzz': choose from: carpet"):
        load_scene("zzz")


def test_a_seed_after_the_name_changes_textures_and_path(tmp_path):
    """Promise: "carpet@1" differs from "carpet" in the seeds of textures and path alone; its path
    is the first that suits the scene, the same each time. A folder may have a seed too."""
    carpet, other = load_scene("carpet"), load_scene("carpet@1")
    assert (other.name, other.source) == ("carpet@1", "carpet@1")
    assert other.settings.textures["carpet_reflectance"].seed == 1007
    assert other.settings.path.seed == 1002  # the views of 1000 and 1001 leave the carpet
    assert load_scene(other.source).digest == other.digest != carpet.digest
    seeds = {"textures": carpet.settings.textures, "path": carpet.settings.path}
    assert dataclasses.replace(other.settings, **seeds) == carpet.settings
    mine = load_scene(f"{edit_scene(tmp_path / 'mine')}@2")
    assert (mine.name, load_scene(mine.source).digest) == ("mine@2", mine.digest)
    with pytest.raises(SceneError, match="'carpte': did you mean"):
        load_scene("carpte@1")
    camera = '<sensor type="perspective"><float name="fov" value="60"/></sensor>'
    (tmp_path / "plain.xml").write_text(f'<scene version="3.0.0">{camera}</scene>')
    with pytest.raises(SceneError, match="neither textures nor a path with a seed"):
        load_scene(f"{tmp_path / 'plain.xml'}@1")


def test_a_folder_is_a_scene_too(tmp_path):
    assert load_scene(edit_scene(tmp_path / "mine")).name == "mine"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fov_deg = 60.0", "", r"camera\.fov_deg: missing, expected a number"),
        ("fov_deg = 60.0", "fov_deg = '60'", r"camera\.fov_deg: found '60', expected a number"),
        ("fov_deg = 60.0", "fov_deg = true", r"camera\.fov_deg: found True, expected a number"),
        ("fov_deg = 60.0", "fov_deg = nan", r"camera\.fov_deg: found nan, expected a number"),
        (
            "fov_deg = 60.0",
            "fov_deg = 190",
            r"camera\.fov_deg: found 190\.0, expected between 0 and 180",
        ),
        (
            "fov_deg = 60.0",
            "fov_deg = 60\nfow = 1",
            r"camera\.fow: unknown; choose from: fov_deg",
        ),
        ("seed = 0", "seed = 1.5", r"path\.seed: found 1\.5, expected an integer"),
        ("seed = 0", "seed = -1", r"path\.seed: found -1, expected 0 or more"),
        ("seed = 7", "seed = -7", r"textures\.carpet_reflectance\.seed: found -7, expected 0"),
        ("[1.0, 1.0, 0.25]", "[1.0, 1.0]", r"path\.sway: found \[1\.0, 1\.0\], expected three"),
        ("[1.0, 1.0, 0.25]", "[1, 'a', 0]", r"path\.sway\[1\]: found 'a', expected a number"),
        ("[0.0, 0.0, 1.0]", "[0, 0, 2]", r"plane\.normal: .*expected a vector of length 1"),
        ("[textures.carpet_reflectance]", "[textures.config]", r"textures\.config: found 'config'"),
        ('kind = "carpet"', 'kind = "carpt"', r"textures\.carpet_reflectance: .*found 'carpt'"),
        (
            "duration_s = 10.0",
            "duration_s = 0",
            r"path\.duration_s: found 0\.0, expected a positive",
        ),
        (
            'kind = "facing_plane"',
            'kind = ["tum"]',
            r"path: kind: found \['tum'\], expected one of",
        ),
        (
            "min_clearance_m = 0.5",
            "min_clearance_m = 0.001",
            r"path\.min_clearance_m: found 0\.001, expected at least 0\.005 m",
        ),
        ("[bake]", "[bake", "could not be read as TOML"),
    ],
)
def test_each_wrong_field_is_named_with_what_was_found_and_expected(tmp_path, old, new, message):
    folder = edit_scene(tmp_path / "broken", (old, new))
    with pytest.raises(SceneError, match=message) as caught:
        load_scene(folder)
    assert str(folder / "scene.toml") in str(caught.value)


def test_a_folder_with_the_name_of_a_packaged_scene_is_not_taken_for_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rocks").mkdir()  # such as frames of the scene
    assert load_scene("rocks").folder != tmp_path / "rocks"
    edit_scene(tmp_path / "rocks")
    with pytest.raises(SceneError, match=r"rocks: found a packaged scene and a folder .* \./rocks"):
        load_scene("rocks")
    assert load_scene("./rocks").folder == tmp_path / "rocks"


def test_a_folder_without_scene_xml_is_refused(tmp_path):
    folder = edit_scene(tmp_path / "half")
    (folder / "scene.xml").unlink()
    with pytest.raises(SceneError, match=r"scene\.xml: missing"):
        load_scene(folder)


def test_a_path_that_would_look_past_the_carpet_is_refused(tmp_path):
    far = load_scene(edit_scene(tmp_path / "far", ("distance_m = 1.82", "distance_m = 3.0")))
    with pytest.raises(SceneError, match=r"path: the view reaches .* m .*half_width_m = 2\.5 m"):
        far.trajectory()


def test_the_view_that_counts_is_that_of_the_camera(tmp_path):
    """Promise: a camera of 30 degrees may be farther from the carpet than the scene's own of 60
    degrees, and one of 90 degrees not; the error says which it was."""
    far = load_scene(edit_scene(tmp_path / "far", ("distance_m = 1.82", "distance_m = 3.0")))
    for fov_deg in (30, 60, 90):
        camera = Camera(64, 64, np.deg2rad(fov_deg))
        if fov_deg == 30:
            assert far.trajectory(camera).duration_s >= far.duration_s == 10.0
            assert Renderer(far, 64, 1, integrator="path", camera=camera).trajectory
        else:
            with pytest.raises(SceneError, match=f"a field of view of {fov_deg} degrees, expected"):
                far.trajectory(camera)
    with pytest.raises(SceneError, match="a field of view of 60 degrees, expected at most plane"):
        far.trajectory()


def test_a_telephoto_camera_renders_given_poses_from_afar(tmp_path):
    """Promise: the length of a given path does not depend on what the scene's own camera sees."""
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, :3, :3] = np.diag([1.0, -1.0, -1.0])
    poses[:, :3, 3] = [(0.0, 0.0, 4.6), (0.1, 0.0, 4.6)]
    scene = load_scene(edit_scene(tmp_path / "mine"), path_through(np.array([0.0, 0.5]), poses))
    assert scene.trajectory(Camera(64, 64, np.deg2rad(30))).duration_s == scene.duration_s == 0.5
    assert len(clips(scene, every_s=0.2, warm_up_s=0.0)) == 2


def test_a_made_path_that_cannot_be_names_its_field(tmp_path):
    """Promise: scene.toml and the field in it, as for other fields."""
    still = ("sway = [1.0, 1.0, 0.25]", "sway = [0.0, 0.0, 0.0]")
    scene = load_scene(edit_scene(tmp_path / "still", still))
    with pytest.raises(TrajectoryError, match=r"scene\.toml: path\.sway: found \(0\.0, 0\.0, "):
        scene.trajectory()


def test_a_short_look_past_the_carpet_is_refused(tmp_path):
    """Promise: the view is checked between all poses of a path; one that leaves the square for 0.4
    ms of 10 s is refused."""
    knots_s = np.concatenate(
        [np.arange(-1.0, 5.0), 4.001 + 1e-4 * np.arange(9), np.arange(5.0, 12)]
    )
    controls = np.tile(np.eye(4), (len(knots_s), 1, 1))
    controls[:, :3, :3] = np.diag([1.0, -1.0, -1.0])
    controls[:, 2, 3] = 1.8
    controls[0, 0, 3] = 0.01  # it moves
    folder = edit_scene(tmp_path / "mine")
    load_scene(folder, Trajectory(knots_s, controls)).trajectory()
    controls[10, 0, 3] = 9.0
    with pytest.raises(SceneError, match="path: the view reaches"):
        load_scene(folder, Trajectory(knots_s, controls)).trajectory()


def test_the_view_may_leave_the_carpet_after_the_scene(tmp_path):
    """Promise: a made path is checked for as long as the scene lasts, here a tenth of a second;
    its knots go on to 1.25 s, where it looks past the carpet."""
    scene = load_scene(edit_scene(tmp_path / "mine", ("duration_s = 10.0", "duration_s = 0.1")))
    assert scene.trajectory().duration_s == 1.25
    assert scene.duration_s == 0.1


def test_the_digest_follows_the_files_and_the_light_digest_only_the_light(tmp_path):
    """A new camera path needs new frames, but the light in the scene does not change."""
    base = load_scene(edit_scene(tmp_path / "base"))
    other_path = load_scene(edit_scene(tmp_path / "path", ("seed = 0", "seed = 1")))
    other_yarn = load_scene(edit_scene(tmp_path / "yarn", ("seed = 7", "seed = 8")))
    assert base.light_digest == load_scene("carpet").light_digest
    assert base.digest != load_scene("carpet").digest  # which has its lightmap with it
    assert len({base.digest, other_path.digest, other_yarn.digest}) == 3
    assert base.light_digest == other_path.light_digest
    assert base.light_digest != other_yarn.light_digest


def test_clips_are_twenty_half_a_second_apart_each_warmed_up():
    made = clips(load_scene("carpet"))
    assert [clip.index for clip in made] == list(range(20))
    for k, clip in enumerate(made):
        assert clip.t_window_start_s == 0.25 + 0.5 * k
        assert clip.t_window_end_s - clip.t_window_start_s == pytest.approx(0.05)
        assert clip.t_start_s == clip.t_window_start_s - WARM_UP_S
    assert made[-1].t_window_end_s <= 10


@pytest.mark.parametrize(("every_s", "window_s"), [(0.1, 0.05), (0.05, 0.025), (0.5, 0.05)])
def test_no_clip_ends_after_the_path(every_s, window_s):
    """Promise: sums of times that are no binary fractions do not pass the end by a rounding."""
    scene = load_scene("carpet")
    made = clips(scene, every_s=every_s, window_s=window_s, warm_up_s=0.02)
    assert made[-1].t_window_end_s == pytest.approx(10.0, abs=every_s)
    assert max(clip.t_window_end_s for clip in made) <= scene.duration_s


def test_clips_that_do_not_fit_are_refused():
    scene = load_scene("carpet")
    assert len(clips(scene, 1.3)) == 3
    assert clips(scene, samples=2) == clips(scene)[:2]
    assert clips(scene, warm_up_s=0.19)[0].t_start_s > 0
    with pytest.raises(RenderError, match="duration_s: found 11, not within"):
        clips(scene, 11)
    with pytest.raises(RenderError, match="samples: found 4, expected 1 to 3"):
        clips(scene, 1.3, samples=4)
    with pytest.raises(RenderError, match="no clip fits"):
        clips(scene, 0.2)
    with pytest.raises(
        RenderError, match=r"path of 10 s .* are the times of the poses in seconds\?"
    ):
        clips(scene, every_s=1e-6, window_s=1e-7, warm_up_s=0.0)
    with pytest.raises(
        RenderError, match=r"found 0\.05 and 0\.3 s, expected each to fit into half"
    ):
        clips(scene, warm_up_s=0.3)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('length_unit = "m"', 'length_unit = "mm"'),
        ('radiance_unit = "W m^-2 sr^-1"', 'radiance_unit = "cd m^-2"'),
    ],
)
def test_other_units_than_ours_are_refused(tmp_path, old, new):
    """Promise: numbers in other units are not taken for meters or W m^-2 sr^-1."""
    with pytest.raises(SceneError, match="_unit"):
        load_scene(edit_scene(tmp_path / "other", (old, new)))


def test_a_plane_that_is_not_what_the_camera_sees_is_refused(tmp_path):
    """Promise: depth and flow of ground truth follow from `[plane]`; one half a meter above the
    carpet is an error before anything is rendered, not wrong truth."""
    folder = small_carpet_folder(tmp_path / "mine")
    text = (folder / "scene.toml").read_text()
    (folder / "scene.toml").write_text(
        text.replace("point_m = [0.0, 0.0, 0.0]", "point_m = [0.0, 0.0, 0.5]")
    )
    scene = load_scene(light_evenly(folder, "carpet", 3.0))
    with pytest.raises(
        SceneError, match=r"scene\.toml: plane: the visible surface is 1.3 times as far"
    ):
        render_scene(scene, tmp_path / "out", resolution=16, spp=1, samples=1)
    assert not list((tmp_path / "out").rglob("*.exr"))


def test_a_plane_where_the_camera_sees_nothing_is_refused(tmp_path):
    """Promise: a carpet that covers only the middle of the view is an error that counts the rays
    that meet nothing, not truth of a surface that is not there."""
    folder = small_carpet_folder(tmp_path / "mine")
    xml = (folder / "scene.xml").read_text()
    (folder / "scene.xml").write_text(xml.replace('<scale value="2.5"/>', '<scale value="0.7"/>'))
    scene = load_scene(light_evenly(folder, "carpet", 3.0))
    with pytest.raises(
        SceneError, match=r"scene\.toml: plane: \d+ of 81 rays of the camera meet no surface"
    ):
        _ = Renderer(scene, 16, 1).trajectory
