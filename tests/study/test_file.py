"""A study from a TOML file: read completely, or refused with file and field."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from eres_render import load_scene
from sensor import EventCamera, cutoff_in_light, find_camera, plain_camera
from tasks.errors import StudyError
from tasks.study.config import (
    Evaluate,
    Render,
    Simulate,
    Study,
    Tracking,
    to_json,
    with_resolution,
)
from tasks.study.run.jobs import jobs_of
from tasks.study.study_file import read_study


def written(tmp_path, text):
    file = tmp_path / "mine.toml"
    file.write_text(text)
    return file


def test_what_is_left_out_has_its_default(tmp_path):
    study = read_study(written(tmp_path, 'scenes = ["carpet"]'))
    assert study == Study(name="mine", scenes=("carpet",))


def test_every_field_of_a_study_can_be_said(tmp_path):
    text = """
    question = "Do rocks need more?"
    scenes = ["rocks", "./my_scene"]
    [render]
    resolution = 640
    samples = 2
    [simulate]
    widths = [160, 320]
    cutoffs_hz = [inf, 100]
    contrast_thresholds = [0.3]
    [evaluate.flow]
    methods = ["photometric_flow", "my_package.flow:estimate"]
    features = 7
    """
    study = read_study(written(tmp_path, text))
    assert study.scenes == ("rocks", f"{tmp_path}/my_scene")
    assert study.question == "Do rocks need more?"
    assert (study.render.resolution, study.render.samples) == (640, 2)
    assert study.simulate.cutoffs_hz == (math.inf, 100.0)
    assert study.evaluate["flow"].methods[1] == "my_package.flow:estimate"
    assert study.evaluate["tracking"] == Evaluate()["tracking"]


def test_light_stands_for_cutoffs(tmp_path):
    text = 'scenes = ["carpet"]\n[simulate]\nilluminance_lux = [67, 17]'
    cutoffs_hz = read_study(written(tmp_path, text)).simulate.cutoffs_hz
    assert cutoffs_hz == (cutoff_in_light(67), cutoff_in_light(17))


def test_settings_made_with_numpy_are_those_of_a_file(tmp_path):
    """Promise: they are checked, stored and named as Python's numbers are."""
    text = """
    scenes = ["carpet"]
    [render]
    resolution = 256
    seed = 3
    [simulate]
    widths = [64, 128]
    cutoffs_hz = [inf, 200]
    speeds = [1, 2]
    [evaluate.tracking]
    methods = ["photometric_tracking"]
    sigmas_mm = [5, 10]
    """
    made = Study(
        name="mine",
        scenes=("carpet",),
        render=Render(resolution=np.int64(256), seed=np.int32(3)),
        simulate=Simulate(
            widths=np.array([64, 128]),
            cutoffs_hz=(np.float64(np.inf), np.float32(200)),
            speeds=[np.float64(1), 2.0],
        ),
        evaluate=Evaluate(
            tracking=Tracking(methods=("photometric_tracking",), sigmas_mm=np.array([5.0, 10.0]))
        ),
    )
    read = read_study(written(tmp_path, text))
    assert made == read
    assert json.dumps(to_json(made)) == json.dumps(to_json(read))
    carpet = load_scene("carpet")
    assert [job.key for job in jobs_of(made, carpet)] == [job.key for job in jobs_of(read, carpet)]
    with pytest.raises(StudyError, match=r"render\.seed: found -1, expected 0 or more"):
        Study(name="mine", scenes=("carpet",), render=Render(seed=np.int64(-1)))


def test_old_words_are_read(tmp_path):
    text = 'scenes = ["carpet"]\n[evaluate.video]\n{} = "global"'
    old, new = (
        read_study(written(tmp_path, text.format(w))) for w in ("equalisation", "equalization")
    )
    assert old == new
    assert new.evaluate["video"].equalization == "global"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("scenes = 3", r"mine.toml: scenes: found 3, expected a list"),
        ("", r"mine.toml: scenes: missing"),
        ('scenes = ["carpet"]\n[render]\nsppp = 4', r"mine.toml: render.sppp: unknown"),
        ('scenes = ["carpet"]\n[render]\nspp = "4"', r"mine.toml: render.spp: found '4'"),
        (
            'scenes = ["carpet"]\n[simulate]\nwidths = [2560]',
            r"mine.toml: simulate.widths: found 2560x2560 px, finer than the 1280x1280 px",
        ),
        (
            'scenes = ["carpet"]\n[simulate]\ncontrast_thresholds = [0.2, 0.2]',
            r"simulate.contrast_thresholds: found \(0.2, 0.2\), expected each once",
        ),
        (
            'scenes = ["carpet"]\n[simulate]\ncutoffs_hz = [0]',
            r"simulate.cutoffs_hz: found 0.0, expected a positive number",
        ),
        (
            'scenes = ["carpet"]\n[simulate]\ncutoffs_hz = [nan]',
            r"simulate.cutoffs_hz\[0\]: found nan, expected a number or inf",
        ),
        (
            'scenes = ["carpet"]\n[simulate]\nilluminance_lux = [0]',
            r"simulate.illuminance_lux: found 0.0, expected a positive number",
        ),
        (
            'scenes = ["carpet"]\n[simulate]\ncutoffs_hz = [1]\nilluminance_lux = [1]',
            "give cutoffs_hz or illuminance_lux, not both",
        ),
        ("scenes = [", r"mine.toml: could not be read as TOML"),
        (
            'scenes = ["carpet"]\n[evaluate.reconstruction]\nupsampling = "cubic"',
            r"evaluate.reconstruction.upsampling: found 'cubic', expected 'nearest' or 'bilinear' "
            "or 'bicubic'",
        ),
        (
            'scenes = ["carpet"]\n[evaluate.video]\nequalization = 3',
            r"evaluate.video.equalization: found 3, expected 'none' or 'global' or",
        ),
        (
            'scenes = ["carpet"]\n[render]\nmax_displacement_px = 1e-300',
            r"render.max_displacement_px: found 1e-300, expected at least 0.001",
        ),
        (
            'scenes = ["carpet"]\n[evaluate.video]\ne2vid_window_s = 1\ne2vid_events_per_px = 1',
            "mine.toml: evaluate.video: give e2vid_window_s or e2vid_events_per_px, not both",
        ),
        (
            'scenes = ["carpet"]\n[evaluate.video]\nevery_s = 0.0',
            r"mine.toml: evaluate.video.every_s: found 0.0, expected a positive number",
        ),
        (
            'scenes = ["carpet"]\n[evaluate.tracking]\nsigmas_mm = [5, -1]',
            r"evaluate.tracking.sigmas_mm: found -1.0, expected a positive number",
        ),
        (
            'scenes = ["carpet"]\n[simulate]\ndark_fraction = -1e-3',
            r"simulate.dark_fraction: found -0.001, expected 0 or more",
        ),
        (
            'scenes = ["carpet"]\n[render]\nresolution = 61\n[simulate]\nwidths = [20]',
            r"render.resolution: found 61, expected at least 62",
        ),
        ('scenes = ["carpet"]\n[render]\nsamples = 0', r"render.samples: found 0, expected"),
        (
            'scenes = ["carpet"]\n[evaluate.tracking]\nsigmas_mm = [10, 10.0000001]',
            r"mine.toml: .*tracking.sigmas_mm: found \(10.0, 10.0000001\), expected no duplicates",
        ),
        (
            'scenes = ["carpet"]\n[evaluate.tracking]\nsigmas_mm = []',
            r"mine.toml: .*tracking.sigmas_mm: found none, expected one or more",
        ),
        (
            'scenes = ["carpet"]\n[evaluate.video]\nmethods = ["blank"]\nscenes = ["rocks"]',
            r"mine.toml: evaluate.video: has methods only for rocks, but the study's scenes "
            "are carpet",
        ),
        (
            'scenes = ["carpet"]\n[evaluate.flow]\nfast_methods = ["initial_flow"]\n'
            'fast_scenes = ["rocks", "room"]',
            r"mine.toml: evaluate.flow: has methods only for rocks, room, but the study",
        ),
        (
            'scenes = ["carpet"]\n[evaluate.flow]\nfast_speed = 4.0',
            r"mine.toml: evaluate.flow.fast_speed: needs evaluate.flow.fast_methods",
        ),
        (
            'scenes = ["carpet"]\n[evaluate.flow]\nfast_scenes = ["carpet"]',
            r"evaluate.flow.fast_scenes: needs evaluate.flow.fast_methods",
        ),
        (
            'scenes = ["carpet"]\n[evaluate.video]\nevery_s = 10.0',
            r"mine.toml: evaluate.video: every_s: found 10 s, .* duration_s = 2$",
        ),
        (
            'scenes = ["carpet"]\n[evaluate.flow]\nmethods = ["initial_flow", "initial_flow"]',
            r"mine.toml: evaluate.flow, methods: found \('initial_flow', 'initial_flow'\)",
        ),
        (
            'scenes = ["carpet"]\n[evaluate.flow]\nfast_speed = 2.0\n'
            'fast_methods = ["initial_flow"]',
            r"mine.toml: evaluate.flow: has methods only for speed 2, .* simulate.speeds",
        ),
        (
            'scenes = ["carpet"]\n[simulate]\nphotoreceptors = ["two_pole", "v2e"]\n'
            '[evaluate.video]\nmethods = ["late_truth"]',
            r"mine.toml: evaluate.video.methods: 'late_truth' .* the photoreceptor 'v2e'",
        ),
        (
            'scenes = ["carpet"]\n[simulate]\nwidths = []\nsensors = [\n'
            "{ width = 64, height = 64, cutoff_follows_light = true }]\n"
            '[evaluate.video]\nmethods = ["filtered_truth"]',
            r"mine.toml: evaluate.video.methods: 'filtered_truth' .* follows the light",
        ),
    ],
)
def test_a_bad_study_is_refused_by_file_and_field(tmp_path, text, message):
    """Promise: what cannot be, and what would silently do nothing, ends with file and field."""
    with pytest.raises(StudyError, match=message):
        read_study(written(tmp_path, text))


def test_methods_for_some_scenes_need_one_of_them(tmp_path):
    """Promise: a scene of the study may be a name, a folder or a Mitsuba file; settings of a task
    that is left out do not matter."""
    asked = '[evaluate.video]\nmethods = ["blank"]\nscenes = ["rocks"]'
    for scenes in ('"carpet", "rocks"', '"./my/rocks"', '"./rocks.xml"'):
        read_study(written(tmp_path, f"scenes = [{scenes}]\n{asked}"))
    read_study(written(tmp_path, 'scenes = ["carpet"]\n[evaluate.video]\nscenes = ["rocks"]'))


@pytest.mark.parametrize(
    ("given", "found"),
    [
        (
            'reconstruction.methods = ["no_events"]\nflow.methods = ["initial_flow"]\n'
            "tracking.methods = []",
            "no_events and initial_flow",
        ),
        ('reconstruction.methods = ["no_events"]\nflow.methods = []', "no_events"),
    ],
)
def test_a_study_of_nothing_to_compare_is_refused(given, found, tmp_path, eres):
    """Promise: do-nothing methods alone are refused before anything is rendered; tracking, which
    needs a plane, does not count in a room."""
    scene = "carpet" if "tracking" in given else "room"
    file = written(tmp_path, f'scenes = ["{scene}"]\n[evaluate]\n{given}')
    code, _, err = eres("study", file, "--out", tmp_path / "run")
    assert code == 1
    assert err.splitlines()[-1] == (
        f"error: evaluate: found only {found}; add a method that uses the events and suits the "
        "scenes"
    )
    assert [one.name for one in tmp_path.iterdir()] == ["mine.toml"]


def test_a_study_that_is_not_there(tmp_path):
    with pytest.raises(StudyError, match="no such file"):
        read_study(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        (plain_camera(64), "simulate.sensors: found a camera without a name"),
        (find_camera("imx636"), "simulate: imx636: needs width and height"),
    ],
    ids=["no name", "no grid"],
)
def test_a_camera_of_a_study_has_a_name_and_a_grid(camera, message):
    """Promise: rows of a camera without a name would be those of a plain sensor."""
    with pytest.raises(StudyError, match=message):
        Study(name="mine", scenes=("carpet",), simulate=Simulate(sensors=(camera,)))


def test_sensors_finer_than_smaller_frames_are_left_out():
    """Promise: --resolution keeps the sensors that see enough pixels of frames of any shape."""
    sensors = tuple(
        EventCamera(name=name, width=width, height=height)
        for name, width, height in (("square", 500, 500), ("flat", 200, 100), ("low", 600, 90))
    )
    study = Study(
        name="flat",
        scenes=("room",),
        render=Render(resolution=1280, height=640),
        simulate=Simulate(widths=(), cutoffs_hz=(math.inf,), sensors=sensors),
        evaluate=Evaluate(tracking=Tracking(methods=())),
    )
    kept = with_resolution(study, 640)
    assert (kept.render.resolution, kept.render.height) == (640, 320)
    assert [one.name for one in kept.simulate.sensors] == ["flat", "low"]
    square = replace(study, simulate=replace(study.simulate, sensors=sensors[:1]))
    with pytest.raises(StudyError, match="--resolution: found 640 px, expected at least 1000"):
        with_resolution(square, 640)
    with pytest.raises(StudyError, match="--resolution: found 0, expected a positive number"):
        with_resolution(study, 0)
    assert with_resolution(square, 1000).simulate.sensors == sensors[:1]
