"""A plane at another distance: speeds in m/s and errors in mm are those of an enlarged scene."""

from __future__ import annotations

import json
import logging
from dataclasses import replace

import pytest

from eres_render import load_scene
from eres_render.progress import silent
from finished_runs import page_of
from light_scenes import light_evenly, small_carpet_folder
from small_study import only
from tasks.errors import StudyError
from tasks.study.config import Flow, Reconstruction, Render, Simulate, Study, Tracking, to_json
from tasks.study.run import run_study
from tasks.study.run.compute import compute_job
from tasks.study.run.jobs import QueuedJob, jobs_of
from tasks.study.study_file import read_study

OWN_M = {"carpet": 1.79, "rocks": 1.38}  # docs/scenes.md
SPEED_M_S = 1.5
DISTANCE_M = 5.0
SIGMA_MM = 60.0


def study_of(folder, speeds, sigma_mm=SIGMA_MM):
    """Return a study of three tasks on a scene, for one sensor."""
    return Study(
        name="small",
        scenes=(str(folder),),
        render=Render(resolution=160, spp=1, max_displacement_px=1.0, samples=1),
        simulate=Simulate(widths=(160,), cutoffs_hz=(float("inf"),), **speeds),
        evaluate=only(
            reconstruction=Reconstruction(),
            flow=Flow(methods=("contrast_maximization",), features=2),
            tracking=Tracking(sigmas_mm=(sigma_mm,)),
        ),
    )


def jobs_on(name, **simulate):
    """Return the jobs of a study of flow on a packaged scene."""
    evaluate = only(flow=Flow(methods=("contrast_maximization",)))
    study = Study(name="m", scenes=(name,), simulate=Simulate(**simulate), evaluate=evaluate)
    return jobs_of(study, load_scene(name))


@pytest.fixture(scope="module")
def carpet(tmp_path_factory):
    """Write a small carpet that needs no baking."""
    folder = small_carpet_folder(tmp_path_factory.mktemp("distance") / "carpet")
    return light_evenly(folder, "carpet", 3.0)


@pytest.fixture(scope="module")
def jobs(carpet):
    """Return a job at 5 m, and the one with the same factors and a start that is as far off."""
    scene = load_scene(carpet)
    speeds = {"speeds_m_s": (SPEED_M_S,), "distance_m": DISTANCE_M}
    (at_5_m,) = jobs_of(study_of(carpet, speeds), scene)
    factors = {"speeds": at_5_m.simulate.speeds}
    (plain,) = jobs_of(study_of(carpet, factors, SIGMA_MM / at_5_m.scale), scene)
    return at_5_m, plain


@pytest.fixture(scope="module")
def computed(jobs):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tasks.study.run.compute.warn_of_noise", lambda *_: None)
        return [compute_job(QueuedJob(job, job.key, False), silent) for job in jobs]


@pytest.mark.parametrize("name", OWN_M)
def test_a_speed_is_a_factor_on_that_of_the_enlarged_scene(name):
    """Analytic: v / (s * base), where s is the distance over the one that docs/scenes.md prints."""
    job, *_ = jobs_on(name, speeds_m_s=(0.8, 1.6), distance_m=DISTANCE_M)
    base_m_s = {"carpet": 0.9, "rocks": 0.7}[name]
    assert round(DISTANCE_M / job.scale, 2) == OWN_M[name]
    settings = job.settings(1.0)
    assert {one.speed_m_s for one in settings} == {0.8, 1.6}
    for one in settings:
        assert one.speed == pytest.approx(one.speed_m_s / (job.scale * base_m_s))


def test_the_frames_are_the_very_same(jobs, computed):
    """Promise: the distance is in the key of the scores alone, so nothing is rendered again."""
    at_5_m, plain = jobs
    assert at_5_m.scale == pytest.approx(2.8, rel=0.01)
    assert at_5_m.frames_decided_by == plain.frames_decided_by
    assert at_5_m.key != plain.key
    assert [one.timings.rendered_frames > 0 for one in computed] == [True, False]


def test_images_stay_and_positions_are_those_of_the_enlarged_scene(jobs, computed):
    """Promise: reconstruction and flow are equal to the bit, and position errors are s times those
    of a study whose start is s times nearer: that of the start, and that of a search that
    succeeds."""
    at_5_m, plain = ({(r.task, r.method, r.item): r for r in one.rows} for one in computed)
    assert {row.speed_m_s for row in at_5_m.values()} == {SPEED_M_S}
    assert at_5_m.keys() == plain.keys()
    for what, row in at_5_m.items():
        other = plain[what]
        assert (row.speed, row.event_rate_hz) == (other.speed, other.event_rate_hz)
        if row.task != "tracking":
            assert row.value == other.value
            continue
        assert row.failure == other.failure == ""
        assert row.value == pytest.approx(jobs[0].scale * other.value, rel=1e-5)
        assert row.variant == "sigma 60 mm"
    tracked, start = (at_5_m["tracking", n, 0] for n in ("photometric_tracking", "initial_path"))
    assert tracked.value < 0.5 * start.value


@pytest.mark.parametrize(
    ("simulate", "message"),
    [
        ({}, "needs simulate.speeds_m_s"),
        ({"speeds_m_s": (1.0,), "same_lens": True}, "cannot be combined with simulate.same_lens"),
        ({"speeds_m_s": (1.0,)}, "room is not planar"),
        ({"distance_m": float("inf")}, "found inf, expected a positive number"),
        ({"distance_m": -1.0}, "found -1.0, expected a positive number"),
    ],
)
def test_a_distance_that_means_nothing_is_refused_before_rendering(simulate, message):
    with pytest.raises(StudyError, match=f"simulate.distance_m: {message}"):
        jobs_on("room", **{"distance_m": DISTANCE_M} | simulate)


def test_an_option_replaces_the_distance_of_the_file(tmp_path, eres, monkeypatch):
    """Promise: `--distance-m` and the field are one; to_json has it only if it is given."""
    asked = []
    monkeypatch.setattr("tasks.study.run.run_study", lambda study, *_, **__: asked.append(study))
    file = tmp_path / "mine.toml"
    file.write_text('scenes = ["carpet"]\n[simulate]\nspeeds_m_s = [1]\ndistance_m = 3\n')
    eres("study", file, "--distance-m", 4.5, "--out", tmp_path / "run")
    given = read_study(file)
    assert given.simulate.distance_m == 3.0
    assert [one.simulate for one in asked] == [replace(given.simulate, distance_m=4.5)]
    file.write_text('scenes = ["carpet"]\n[simulate]\nspeeds_m_s = [1]\n')
    plain = read_study(file)
    for one in (plain, given):
        there = {"distance_m": 3.0} if one is given else {}
        assert to_json(one)["simulate"] == to_json(plain)["simulate"] | there


@pytest.mark.parametrize(("given", "scale"), [({}, 1.0), ({"distance_m": DISTANCE_M}, 2.8)])
def test_a_study_in_m_s_says_at_which_distance(carpet, tmp_path, caplog, given, scale):
    """Promise: the log before rendering says it if the study does not, and the page always; the
    speed at factor 1 in study.json is that of the enlarged scene."""
    study = study_of(carpet, {"speeds_m_s": (SPEED_M_S,)} | given)
    study = replace(study, evaluate=only(reconstruction=Reconstruction()))
    study = replace(study, simulate=replace(study.simulate, widths=(64,)))
    with pytest.MonkeyPatch.context() as patch, caplog.at_level(logging.INFO):
        patch.setattr("tasks.study.run.compute.warn_of_noise", lambda *_: None)
        run_study(study, tmp_path / "run")
    told = "speeds in m/s apply at each scene's distance: carpet 1.79 m"
    assert (told in caplog.messages) is (not given)
    stored = json.loads((tmp_path / "run" / "study.json").read_text())
    assert stored["base_m_per_s"]["carpet"] == pytest.approx(0.9 * scale, rel=0.01)
    label = f"carpet {given.get('distance_m', 1.79):g} m."
    page = page_of(tmp_path / "run")
    assert f"median distance of the camera from the plane: {label}" in page
    assert f", {SPEED_M_S:g} m/s" in page
