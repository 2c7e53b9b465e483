"""The stretches of a path that a study renders."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from eres_render import Scene, SceneError, load_scene, path_through
from eres_render.progress import silent
from sensor import EventCamera
from sensor.cameras.camera import Source
from small_study import only
from tasks.errors import StudyError
from tasks.study.config import (
    DenseFlow,
    Flow,
    Reconstruction,
    Render,
    Simulate,
    Study,
    Tracking,
    Video,
    preset,
)
from tasks.study.run.compute import compute_job
from tasks.study.run.estimate import work_text
from tasks.study.run.jobs import QueuedJob, jobs_of


def test_only_what_is_scored_is_rendered() -> None:
    """Promise: a study of videos alone has one stretch, and no clips around samples."""
    video = Video(methods=("blank",))
    study = Study(name="video", scenes=("carpet",), evaluate=only(video=video))
    (stretch,) = jobs_of(study, load_scene("carpet"))
    assert stretch.evaluate == {"video": video}
    assert stretch.clip.t_window_end_s == Video().duration_s


def test_a_video_longer_than_the_path_is_refused() -> None:
    """Promise: the error names the field, the scene and its length, which is still possible."""
    video = Video(methods=("blank",), duration_s=10.5)
    study = Study(name="video", scenes=("carpet",), evaluate=only(video=video))
    said = re.escape("evaluate.video.duration_s: found 10.5 s, expected at most 10 s, the duration")
    with pytest.raises(StudyError, match=f"{said} .* carpet"):
        jobs_of(study, load_scene("carpet"))
    longest = replace(study, evaluate=only(video=replace(video, duration_s=10.0)))
    assert jobs_of(longest, load_scene("carpet"))


def test_a_scene_with_nothing_to_do_is_named() -> None:
    """Promise: a study with only pose tracking in a room, which has no plane, is an error."""
    study = Study(name="pose", scenes=("room",), evaluate=only(tracking=Tracking()))
    with pytest.raises(StudyError, match="no method suits room"):
        jobs_of(study, load_scene("room"))


def test_the_paper_preset_has_its_jobs() -> None:
    """20 clips on each scene, 20 with a longer warm-up for speed 10, one video on the carpet."""
    paper = preset("paper")
    counts = [len(jobs_of(paper, load_scene(name))) for name in paper.scenes]
    assert counts == [41, 20, 20]


def test_a_view_that_leaves_the_plane_is_refused_before_rendering() -> None:
    """Promise: that of the study's own camera, higher than the scene's square one."""
    evaluate = only(reconstruction=Reconstruction())
    tall = Study(name="tall", scenes=("carpet",), evaluate=evaluate)
    render, simulate = Render(resolution=640, height=1920), Simulate(widths=(64,))
    tall = replace(tall, render=render, simulate=simulate)
    with pytest.raises(SceneError, match=r"the view reaches 4\.346 m from plane.point_m"):
        jobs_of(tall, load_scene("carpet"))


def test_a_wide_view_may_be_farther_from_the_plane() -> None:
    """Promise: that of the study's camera counts, not the scene's square one, whose upper
    corners are past the edge of the carpet."""
    evaluate = only(reconstruction=Reconstruction())
    wide = Study(name="wide", scenes=("carpet",), evaluate=evaluate)
    wide = replace(wide, render=Render(resolution=640, height=64), simulate=Simulate(widths=(640,)))
    T = np.tile(np.eye(4), (2, 1, 1))
    T[:, :3, :3] = np.diag([1.0, -1.0, -1.0])
    T[:, :3, 3] = [(0.0, 2.2, 1.8), (0.1, 2.2, 1.8)]
    scene = load_scene("carpet", path_through(np.array([0.0, 0.9]), T))
    with pytest.raises(SceneError, match="the view reaches"):
        scene.trajectory()
    assert work_text(jobs_of(wide, scene), 2)


def test_a_threshold_with_a_source_is_the_camera_s_own() -> None:
    """Promise: it replaces the study's two thresholds, also where an equal camera has no source."""
    plain = EventCamera(name="a", width=64, height=64, contrast_threshold=0.2)
    measured = replace(plain, sources={"threshold": Source("a page", "measured")})
    study = Simulate(widths=(), cutoffs_hz=(50.0,), contrast_thresholds=(0.1, 0.4))
    counts = [len(replace(study, sensors=(one,)).models()) for one in (plain, measured, plain)]
    assert counts == [2, 1, 2]


@given(resolution=st.integers(2, 2000), height=st.integers(2, 2000), data=st.data())
@example(resolution=1190, height=669, data=None)
def test_widths_see_all_of_the_frames(resolution, height, data) -> None:
    """Promise: also where rounding makes a sensor flatter, as 442x248 px on 1190x669 px, so that
    all of a study's widths look at the same points."""
    render = Render(resolution=resolution, height=height)
    width = data.draw(st.integers(1, resolution)) if data else 442
    assume(render.height_at(width) > 0)
    assert render.seen_px(width, render.height_at(width)) == (resolution, height)


def test_flat_frames_are_the_same_points_for_each_width(small_carpet) -> None:
    """Promise: features are found once, although 197x111 px at square pixels would see 319 columns.

    The true flows are those of the frames, as its pixels are 0.2 % from square.
    """
    dense = DenseFlow(methods=("zero_flow",), features=8)
    study = Study(
        name="flat",
        scenes=("carpet",),
        render=Render(resolution=320, height=180, spp=1, max_displacement_px=2.0, samples=1),
        simulate=Simulate(widths=(197, 320), cutoffs_hz=(math.inf,), speeds=(1.0,)),
        evaluate=only(dense_flow=dense),
    )
    (job,) = jobs_of(study, small_carpet)
    computed = compute_job(QueuedJob(job, job.key, False), silent)
    coarse, fine = (
        [row.value for row in computed.rows if row.width == width] for width in (197, 320)
    )
    assert len(coarse) == 8
    np.testing.assert_allclose(coarse, fine, rtol=2e-3)
    timings = computed.timings
    assert timings.frames == timings.rendered_frames > 0  # read once, for one shape


@pytest.fixture(scope="module")
def carpet() -> Scene:
    return load_scene("carpet")


def refusal(study: Study, scene: Scene) -> str:
    """Return the error of a study, "" for none."""
    try:
        jobs_of(study, scene)
    except StudyError as error:
        return str(error)
    return ""


@given(
    cutoff_hz=st.floats(0.2, 30.0),
    speed=st.floats(0.5, 3.0),
    every_s=st.floats(0.15, 2.0),
    fast=st.booleans(),
    dense=st.booleans(),
)
@example(cutoff_hz=9.0, speed=2.0, every_s=0.5, fast=False, dense=True)
@example(cutoff_hz=7.11, speed=2.0, every_s=0.5, fast=False, dense=False)
@example(cutoff_hz=7.3, speed=2.0, every_s=0.5, fast=False, dense=False)
def test_the_nearest_values_work(carpet, cutoff_hz, speed, every_s, fast, dense) -> None:
    """Promise: a study that is refused for its warm-up is accepted with each of the values that
    the error names, as printed, and the lowest cutoff is the lowest, to 2 %."""
    tasks = {
        "reconstruction": Reconstruction(),
        "flow": Flow(methods=(), fast_methods=("initial_flow",) if fast else (), fast_speed=4.0),
        "dense_flow": DenseFlow(methods=("zero_flow",) if dense else ()),
    }
    sensors = Simulate(widths=(64,), cutoffs_hz=(math.inf, cutoff_hz), speeds=(speed,))
    study = Study(
        name="slow",
        scenes=("carpet",),
        render=Render(every_s=every_s),
        simulate=sensors,
        evaluate=only(**tasks),
    )
    said = refusal(study, carpet)
    if not said:
        return

    def refused(**fields: object) -> str:
        return refusal(replace(study, simulate=replace(sensors, **fields)), carpet)

    limits = re.findall(r"at least (\S+) Hz \((\S+) lux\)", said)
    assert bool(limits) == (refused(cutoffs_hz=(math.inf,)) == "")  # without: no light is enough
    for hz, lux in limits:
        assert refused(cutoffs_hz=(float(hz),)) == ""
        assert "of path before each window" in refused(cutoffs_hz=(0.98 * float(hz),))
        usual_hz = Simulate().cutoffs_hz
        assert refused(cutoffs_hz=usual_hz, illuminance_lux=(float(lux),)) == ""
    for longer_s in re.findall(r"every_s = (\S+)", said):
        assert refusal(replace(study, render=Render(every_s=float(longer_s))), carpet) == ""


def test_other_limits_are_rounded_to_the_side_that_works(carpet) -> None:
    """Promise: the highest speed for tracking, 1.786, or 3.125 where a window of 50 ms ends with
    the path, and the longest time between samples, 19.966 s, are rounded down."""
    tracking = only(tracking=Tracking())
    render = Render(window_s=0.025)
    study = Study(name="fast", scenes=("carpet",), render=render, evaluate=tracking)
    (most,) = re.findall(r"expected at most (\S+),", refusal(study, carpet))
    assert most == "1.78"
    assert refusal(replace(study, simulate=Simulate(speeds=(float(most),))), carpet) == ""
    ideal, faster = (Simulate(cutoffs_hz=(math.inf,), speeds=(speed,)) for speed in (3.12, 3.2))
    at_the_end = replace(study, render=Render(every_s=0.1), simulate=faster)
    assert "16 ms of pose tracking after the start" in refusal(at_the_end, carpet)
    assert refusal(replace(at_the_end, simulate=ideal), carpet) == ""
    study = replace(
        study,
        render=Render(every_s=30.0, window_s=0.017),
        evaluate=only(reconstruction=Reconstruction()),
    )
    (most,) = re.findall(r"at most (\S+)$", refusal(study, carpet))
    assert most == "19.9"
    assert refusal(replace(study, render=replace(study.render, every_s=19.9)), carpet) == ""
