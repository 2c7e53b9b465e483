"""Frames agree with the camera model, renders are reproducible, and clips survive interruptions."""

import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from another_process import run_python
from eres_render import (
    Camera,
    Clip,
    Renderer,
    RenderError,
    SequenceError,
    clip_in_progress,
    load_scene,
    open_sequence,
    render_clip,
    render_scene,
)
from eres_render.rendering.backend import select_variant
from eres_render.rendering.raycast import RayCaster
from light_scenes import DOTS_M, dots_folder, light_evenly, small_carpet_folder, tilted_pose

ROOT = Path(__file__).parents[2]
CLIP = Clip(0, 0.24, 0.25, 0.29)


@pytest.fixture(scope="module")
def dots(tmp_path_factory):
    folder = dots_folder(tmp_path_factory.mktemp("scenes") / "dots")
    return load_scene(light_evenly(folder, "floor", 0.0))


@pytest.fixture(scope="module")
def renderer(small_carpet):
    return Renderer(small_carpet, 64, 9)


@pytest.fixture(scope="module")
def pose(small_carpet):
    return small_carpet.trajectory().pose(1.0)


@pytest.fixture(scope="module")
def uninterrupted(renderer, tmp_path_factory):
    return render_clip(renderer, CLIP, tmp_path_factory.mktemp("whole") / "clip", 0.25)


@pytest.mark.parametrize("integrator", ["path", "baked"])
def test_code_is_compiled_once_for_views_of_all_sizes(small_carpet, integrator):
    """Promise: Dr.Jit compiles the same code for square views of any number of rays and pixels."""
    import drjit as dr

    def code_for(width):
        dr.kernel_history_clear()
        renderer = Renderer(small_carpet, width, 4, integrator=integrator)
        renderer.frame(renderer.trajectory.pose(1.0))
        RayCaster(renderer._mi_scene).cast(np.ones((width, 3)), np.ones((width, 3)))
        return {kernel["hash"] for kernel in dr.kernel_history() if "hash" in kernel}

    if select_variant().startswith("scalar"):
        pytest.skip("scalar variants compile nothing")
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        small, small_again, large, large_again = map(code_for, (16, 16, 24, 24))
    assert len(small & small_again) > 4
    # Code of one run alone depends on where its arrays are, not on the size of the view.
    assert large & large_again <= small | small_again


def test_a_sequence_is_one_line(uninterrupted):
    """Promise: a notebook shows what it is, not all its times and checksums."""
    shown = repr(uninterrupted)
    assert re.fullmatch(r"RadianceSequence\(\d+ frames of \d+x\d+ px, \w+, [\d.]+ s, '.*'\)", shown)


def frames_equal(a, b):
    return len(a) == len(b) and all(map(np.array_equal, a, b))


def test_no_frame_is_rendered_from_what_is_no_pose(dots):
    """Promise: a pose that is not finite, or several, are refused, and not black or a page of C++
    types; an unknown integrator has a hint."""
    renderer, T = Renderer(dots, 16, 1), tilted_pose()
    for bad in (T * np.nan, T[:3], np.stack([T, T])):
        with pytest.raises(RenderError, match=r"T_world_cam: found .*, expected one finite"):
            renderer.frame(bad)
    with pytest.raises(RenderError, match="integrator: found 'pathh'; did you mean 'path'"):
        Renderer(dots, 16, 1, integrator="pathh")


@pytest.mark.parametrize("integrator", ["baked", pytest.param("path", marks=pytest.mark.slow)])
@pytest.mark.parametrize("size", [(256, 256), (320, 180)])
def test_bright_dots_land_where_the_camera_model_projects_them(dots, size, integrator):
    """Centroids agree with `Camera.project` to 0.1 px, so that no axis is flipped."""
    camera = dots.camera(*size)
    renderer, T = Renderer(dots, spp=64, integrator=integrator, camera=camera), tilted_pose()
    frame = renderer.frame(T)
    expected = renderer.camera.project((DOTS_M - T[:3, 3]) @ T[:3, :3])
    y, x = np.mgrid[: size[1], : size[0]] + 0.5
    expected = expected[np.all((expected > 9) & (expected < np.array(size) - 9), axis=1)]
    assert len(expected) > 2
    for u, v in expected:
        near = np.where((abs(x - u) < 9) & (abs(y - v) < 9), frame, 0)
        assert near.sum() > 5
        centroid = np.array([(near * x).sum(), (near * y).sum()]) / near.sum()
        np.testing.assert_allclose(centroid, (u, v), atol=0.1)


def test_the_same_pose_gives_the_identical_frame(renderer, pose):
    """Common random numbers: nothing flickers while the camera rests, so no false events."""
    np.testing.assert_array_equal(renderer.frame(pose), renderer.frame(pose))


def test_a_frame_does_not_depend_on_the_frames_before(small_carpet, renderer, pose):
    """The sample positions do not change between frames, but change with the seed and `spp`."""
    fresh = Renderer(small_carpet, 64, 9).frame(pose)
    _ = renderer.frame(pose, seed=1), renderer.at(spp=4).frame(pose)
    assert np.array_equal(renderer.frame(pose), fresh)
    assert np.array_equal(renderer.at(spp=9).frame(pose), fresh)
    assert not np.array_equal(renderer.frame(pose, seed=1), fresh)


def test_radiance_changes_continuously_with_the_pose(renderer, pose):
    """A hundredfold smaller motion causes a far smaller change; new noise would not shrink."""

    def change(distance_m):
        moved = pose.copy()
        moved[0, 3] += distance_m
        return np.abs(np.log(renderer.frame(moved)) - np.log(renderer.frame(pose))).mean()

    small, tiny = change(1e-3), change(1e-5)
    assert 0 < tiny < small / 30


def test_seeds_differ_only_by_noise(small_carpet, renderer, pose):
    other = Renderer(small_carpet, 64, 9, seed=1).frame(pose)
    frame = renderer.frame(pose)
    assert not np.array_equal(other, frame)
    assert other.mean() == pytest.approx(frame.mean(), rel=0.01)


@pytest.mark.parametrize("spp", [-4, 0, 7])
def test_samples_that_cannot_be_laid_out_are_refused(small_carpet, spp):
    """Mitsuba would end the process, raise its own error, or use another number."""
    with pytest.raises(RenderError, match=f"spp: found {spp}, expected a square"):
        Renderer(small_carpet, 16, spp)


def test_the_sampler_lays_out_what_is_let_through(small_carpet):
    for spp in (1, 2, 4, 6, 8, 12, 16, 20):
        assert Renderer(small_carpet, 4, spp)._sensor.sampler().sample_count() == spp


@pytest.mark.parametrize("seed", [-1, 1 << 32])
def test_seeds_that_the_sampler_does_not_take_are_refused(small_carpet, seed):
    with pytest.raises(RenderError, match=f"seed: found {seed}, expected 0 to"):
        Renderer(small_carpet, 16, 4, seed=seed)
    with pytest.raises(RenderError, match=f"seed: found {seed}, expected 0 to"):
        Renderer(small_carpet, 4, 1).frame(small_carpet.trajectory().pose(0.1), seed=seed)


def test_white_is_a_property_of_the_scene_not_of_the_clip(renderer, small_carpet):
    """The value depends neither on the samples nor on the first use."""
    assert renderer.white_level == Renderer(small_carpet, 64, 9).white_level
    assert renderer.white_level == Renderer(small_carpet, 64, 1).white_level
    assert renderer.white_level == Renderer(small_carpet, 64, 9).at(spp=4).white_level
    frame = renderer.frame(small_carpet.trajectory().pose(0.0))
    assert 0.5 < renderer.white_level / frame.max() < 2


@pytest.mark.slow
def test_a_scalar_machine_does_the_whole_job(tmp_path):
    """Without LLVM: scalar rendering with the packaged lightmap agrees with this machine."""
    code = (
        "import sys; from pathlib import Path; from eres_render import *;"
        "r = Renderer(load_scene('carpet'), 24, 64); assert r.variant == 'scalar_rgb';"
        "render_clip(r, Clip(0, 0.24, 0.25, 0.26), Path(sys.argv[1]), 1.0)"
    )
    clip = tmp_path / "clip"
    run_python(code, clip, timeout_s=600, DRJIT_LIBLLVM_PATH="/nonexistent")
    scalar = open_sequence(clip)
    assert scalar.manifest.variant == "scalar_rgb"
    here = Renderer(load_scene("carpet"), 24, 64).frame(scalar.T_world_cam[0])
    # A pixel averages some thousand contrasty texels by 64 samples: 5 % of noise each.
    error = np.log(scalar.frame(0)) - np.log(here)
    assert abs(error.mean()) < 0.01
    assert error.std() < 0.12


@pytest.fixture(scope="module")
def killed(small_carpet, tmp_path_factory):
    """Kill a process on a single core after the fourth frame of a clip; return what it printed
    before, and the clip's folder."""
    code = (
        "import os, sys; from pathlib import Path\n"
        "if hasattr(os, 'sched_setaffinity'):\n"
        "    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\n"
        "from eres_render import *\n"
        "def told(stage, done, total):\n"
        "    print(done, flush=True)\n"
        "    if done == 4: sys.stdin.readline()\n"
        "r = Renderer(load_scene(sys.argv[1]), 64, 9)\n"
        "print(r.white_level.hex(), r.frame(r.trajectory.pose(1.0)).tobytes().hex())\n"
        "render_clip(r, Clip(0, 0.24, 0.25, 0.29), Path(sys.argv[2]), 0.25, told)\n"
    )
    clip = tmp_path_factory.mktemp("killed") / "clip"
    victim = subprocess.Popen(
        [sys.executable, "-c", code, str(small_carpet.folder), str(clip)],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert victim.stdout is not None
    try:
        printed = victim.stdout.readline()
        assert [victim.stdout.readline() for _ in range(4)] == ["1\n", "2\n", "3\n", "4\n"]
    finally:
        victim.send_signal(signal.SIGKILL)
        victim.communicate()
    return printed, clip


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="cannot ask for one core")
def test_one_core_renders_the_same_frame_and_white(killed, renderer, pose):
    """Another process on a single core gets the same bits, and Mitsuba does not lock up."""
    white, frame = killed[0].split()
    assert white == renderer.white_level.hex()
    assert frame == renderer.frame(pose).tobytes().hex()


def test_a_clip_holds_what_was_asked_for(uninterrupted, renderer):
    sequence = uninterrupted
    assert len(sequence) > 5
    assert {0.24, 0.25, 0.29} <= set(sequence.t_s.tolist())
    assert sequence.window_s == (0.25, 0.29)
    assert sequence.camera == renderer.camera
    assert sequence.white_level == renderer.white_level
    expected = renderer.frame(renderer.scene.trajectory().pose(sequence.t_s[3]))
    np.testing.assert_array_equal(sequence.frame(3), expected.astype(np.float16))
    assert sorted(p.name for p in sequence.folder.iterdir()) == [
        "SHA256SUMS",
        "frames",
        "manifest.json",
        "path.txt",
        "poses.txt",
    ]


@pytest.mark.slow
def test_a_render_killed_in_the_middle_goes_on_and_ends_up_the_same(
    killed, renderer, uninterrupted
):
    """kill -9 after the fourth frame; then eres renders only the missing ones."""
    clip = killed[1]
    with pytest.raises(SequenceError, match=r"frames/.*exr: missing .* render the sequence"):
        open_sequence(clip)
    # As a kill in mid-write would leave them: a half-written temporary, a damaged last frame.
    (clip / "frames" / ".000004.exr.123.unfinished").write_bytes(b"half")
    (clip / "frames" / "000001.exr").write_bytes(b"")
    progress = []
    resumed = render_clip(renderer, CLIP, clip, 0.25, lambda *at: progress.append(at))
    assert progress[0] == ("rendering", 2, len(resumed))
    assert progress[1][1] in (4, 5)
    assert progress[-1] == ("rendering", len(resumed), len(resumed))
    assert frames_equal(resumed, uninterrupted)
    assert not list((clip / "frames").glob(".*"))


def test_frames_are_the_same_from_the_renderer_and_from_the_disk(
    tmp_path, renderer, uninterrupted, monkeypatch
):
    """Those in memory are rounded as the files are, which are not compressed; nothing is rendered
    twice, and nothing is lost if the reader stops early."""
    whole = list(uninterrupted)
    with clip_in_progress(renderer, CLIP, tmp_path, 0.25) as clip:
        assert np.array_equal(clip.frame(5), whole[5])  # before its turn
        frames = iter(clip)
        first = [next(frames) for _ in range(3)]
        assert np.array_equal(first, whole[:3])
        assert clip.rendered.frames == 4
        assert clip.rendered.seconds > 0
    with pytest.raises(SequenceError, match=r"000003\.exr: missing"):
        open_sequence(tmp_path)
    with clip_in_progress(renderer, CLIP, tmp_path, 0.25) as clip:
        assert np.array_equal(list(clip), whole)
        assert clip.rendered.frames == len(whole) - 4
    assert frames_equal(open_sequence(tmp_path), uninterrupted)
    with OpenEXR.File(str(tmp_path / "frames" / "000000.exr")) as file:
        assert file.header()["compression"] == OpenEXR.NO_COMPRESSION
    monkeypatch.setattr(renderer, "frame", None)
    with clip_in_progress(renderer, CLIP, tmp_path, 0.25) as clip:
        assert np.array_equal(list(clip), whole)
        assert clip.rendered.frames == 0


@pytest.mark.parametrize("i", [-1, 10_000])
def test_frames_that_a_clip_does_not_have_are_neither_rendered_nor_written(renderer, tmp_path, i):
    """Promise: an index off the clip is an IndexError, as for a sequence on disk."""
    with (
        clip_in_progress(renderer, CLIP, tmp_path, 0.25) as clip,
        pytest.raises(IndexError, match=rf"frame: found {i}, expected 0 to \d+"),
    ):
        clip.frame(i)
    assert not list(tmp_path.rglob("*.exr"))


def test_a_finished_clip_is_not_rendered_again(renderer, uninterrupted, monkeypatch):
    monkeypatch.setattr(renderer, "frame", None)  # any rendering would fail
    again = render_clip(renderer, CLIP, uninterrupted.folder, 0.25)
    assert frames_equal(again, uninterrupted)


def test_a_finished_clip_stays_readable_while_it_is_asked_for_again(renderer, uninterrupted):
    """Promise: other processes may read it meanwhile, and a kill leaves it complete."""
    with clip_in_progress(renderer, CLIP, uninterrupted.folder, 0.25):
        assert frames_equal(open_sequence(uninterrupted.folder), uninterrupted)
    assert frames_equal(open_sequence(uninterrupted.folder), uninterrupted)


@pytest.mark.usefixtures("unmeasured_noise")
def test_a_path_whose_knots_round_to_just_before_its_end_is_rendered(tmp_path):
    """Promise: 3 knots of 0.3 s are a path of 0.9 s, though 0.3 * 3 < 0.9 in floating point."""
    folder = small_carpet_folder(
        tmp_path / "short",
        ("duration_s = 10.0", "duration_s = 0.9"),
        ("knot_interval_s = 1.25", "knot_interval_s = 0.3"),
    )
    scene = load_scene(folder)
    assert scene.trajectory().duration_s < scene.duration_s
    options = {"resolution": 16, "spp": 1, "continuous": True, "max_displacement_px": 1.0}
    (sequence,) = render_scene(scene, tmp_path / "out", integrator="path", **options)
    assert sequence.t_s[-1] == scene.duration_s


def test_a_folder_with_other_settings_is_left_alone(
    small_carpet, renderer, uninterrupted, monkeypatch, tmp_path
):
    """Promise: frames of other settings, or of code that renders others, are never mixed in."""
    before = (uninterrupted.folder / "manifest.json").read_bytes()
    with pytest.raises(RenderError, match="found a sequence with spp 9, not 4; remove the f"):
        render_clip(Renderer(small_carpet, 64, 4), CLIP, uninterrupted.folder, 0.25)
    with pytest.raises(RenderError, match="found a sequence with other frame times"):
        render_clip(renderer, CLIP, uninterrupted.folder, 0.125)
    monkeypatch.setattr("eres_render.sequence.render_clips.RENDER_VERSION", 99)
    with pytest.raises(RenderError, match=r"found a sequence with render_version \d+, not 99; rem"):
        render_clip(renderer, CLIP, uninterrupted.folder, 0.25)
    older = tmp_path / "older"
    shutil.copytree(uninterrupted.folder, older)
    manifest = json.loads(before)
    del manifest["render_version"]
    (older / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(RenderError, match="found a sequence with render_version 6, not 99; rem"):
        render_clip(renderer, CLIP, older, 0.25)
    assert (uninterrupted.folder / "manifest.json").read_bytes() == before


def test_frames_without_a_manifest_are_not_taken_for_others(small_carpet, uninterrupted, tmp_path):
    """Promise: of a folder whose manifest was removed, no frame is kept: it may have other
    settings."""
    folder = tmp_path / "clip"
    shutil.copytree(uninterrupted.folder, folder)
    (folder / "manifest.json").unlink()
    fewer = Renderer(small_carpet, 64, 4)
    again = render_clip(fewer, CLIP, folder, 0.25)
    fresh = render_clip(fewer, CLIP, tmp_path / "fresh", 0.25)
    assert frames_equal(again, fresh)
    assert not frames_equal(again, uninterrupted)


def test_a_place_that_is_no_folder_is_refused(tmp_path, renderer):
    (tmp_path / "file").write_text("")
    with pytest.raises(RenderError, match=r"file: found a file, expected a folder"):
        render_clip(renderer, CLIP, tmp_path / "file" / "clip", 0.25)


def test_a_full_disk_ends_the_render_and_leaves_nothing_half_written(
    tmp_path, renderer, uninterrupted, monkeypatch
):
    """A limit on file size acts as the full disk; afterwards the render continues."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # or a module's would be cut off
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    clip = tmp_path / "clip"
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, hard))
    try:
        with pytest.raises(RenderError, match=r"frames/000000\.exr: cannot be written"):
            render_clip(renderer, CLIP, clip, 0.25)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list((clip / "frames").iterdir()) == []
    assert json.loads((clip / "manifest.json").read_text())["complete"] is False
    assert frames_equal(render_clip(renderer, CLIP, clip, 0.25), uninterrupted)


def test_numbers_of_numpy_are_numbers(tmp_path, small_carpet):
    """Promise: sizes, seeds and times that were computed give the same frames, and files that are
    read again."""
    whole, real = np.int64, np.float64
    shape = {"resolution": whole(16), "spp": whole(4), "seed": whole(3), "samples": whole(1)}
    (made,) = render_scene(small_carpet, tmp_path / "clips", max_displacement_px=real(2.0), **shape)
    renderer = Renderer(small_carpet, 16, 4, seed=3)
    poses = renderer.trajectory.pose(made.t_s)
    np.testing.assert_allclose(made.frame(0), renderer.frame(poses[0]), rtol=1e-3)
    np.testing.assert_array_equal(
        renderer.frame(poses[0], seed=whole(5)), renderer.frame(poses[0], seed=5)
    )
    clip = Clip(whole(2), real(0.24), np.float32(0.25), real(0.26))
    sequence = render_clip(renderer, clip, str(tmp_path / "clip"), np.float32(2.0))
    assert sequence.window_s == (0.25, 0.26)
    camera = Camera(whole(16), whole(12), fx=np.float32(20.0), cy=whole(5))
    tilted = Renderer(small_carpet, spp=1, camera=camera)
    assert render_clip(tilted, clip, tmp_path / "tilted", 2.0).camera == Camera(16, 12, fx=20, cy=5)


def test_render_scene_makes_one_folder_per_clip(tmp_path, small_carpet):
    made = render_scene(
        small_carpet,
        tmp_path,
        resolution=16,
        spp=4,
        duration_s=2.0,
        max_displacement_px=1.0,
        samples=2,
    )
    assert [sequence.folder.name for sequence in made] == ["clip_000", "clip_001"]
    assert made[0].white_level == made[1].white_level
    assert made[1].window_s == (0.75, 0.8)
