"""All steps on a small virtual rig: render, simulate, detect, solve, crop, evaluate."""

import importlib
import json
import math
import shutil
import sys
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from docs_page import BLOCK, DOCS
from eres_render import Camera, Distortion, open_sequence
from eres_render.calibration import write_camera
from eres_render.trajectory.tum import read_tum
from sensor import Events, SensorModel, read_camera
from sensor.formats import load_events, write_events
from tasks.cli import main
from tasks.errors import RigError, TaskError
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.settings import TaskSettings
from tasks.events.frame_camera_options import FrameCameraOptions
from tasks.events.simulation import simulate_sequence
from tasks.recording.frames import open_frames
from tasks.registry import TASKS
from tasks.rig import virtual
from tasks.rig.bundle import CORNER_BIAS, LATENCY, RigPose
from tasks.rig.calibration import (
    RigCalibration,
    compare,
    read_rig_calibration,
    read_truth,
    solve_recording,
)
from tasks.rig.crop import common_boxes, crop, homography, light_of_crop, read_crop
from tasks.rig.evaluate import (
    RigEvaluation,
    _load,
    evaluate_rig,
    rows_of,
)
from tasks.rig.markers import Detections, _Integration, detect
from tasks.rig.page import json_text
from tasks.rig.prints import Window, prints_of
from tasks.rig.recording import RigRecording
from tasks.rig.settings import read_rig
from tasks.rig.slider import Slider, read_slider, slider_text
from tasks.rig.virtual import render_rig
from tasks.row import read_rows

pytestmark = pytest.mark.slow
RIG = """
camera = {width = 200, height = 150, fx = 260.0, cx = 104.0, cy = 71.0}

[page]
width_m = 0.16
height_m = 0.12
picture = "pebbles"
picture_width_m = 0.04
picture_height_m = 0.025
marker_m = 0.012
marker_pitch_m = 0.018
dictionary = "DICT_4X4_100"

[slider]
travel_m = 0.03
speeds_mps = [0.06]
direction = [1.0, 0.02, -0.01]

[mount]
turn_deg = [1.0, -0.8, 0.5]
"""
DEPTH_M = 0.14
CUTOFF_HZ = 100.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A rendered recording with events of a sensor that is 3.2 ms late."""
    out = tmp_path_factory.mktemp("rig")
    (out / "rig.toml").write_text(RIG)
    light = render_rig(
        *(out / "rig.toml", out / "near", DEPTH_M),
        images=10,
        frame_camera=FrameCameraOptions(exposure=0.001, full_well=math.inf, read_noise=0.0),
        spp=4,
        max_displacement_px=1.0,
    )
    model = SensorModel(
        width=200, height=150, cutoff_hz=CUTOFF_HZ, dark_level=1e-3 * light.white_level
    )
    simulate_sequence(light, model, out / "near" / "events.h5")
    return out / "near"


@pytest.fixture(scope="module")
def recording(folder):
    return RigRecording(folder)


@pytest.fixture(scope="module")
def frames_solved(recording):
    found = detect(recording, "frame", images=10)
    return solve_recording(recording, found, (CORNER_BIAS,), 2.0)


@pytest.fixture(scope="module")
def calibration(frames_solved, tmp_path_factory):
    file = tmp_path_factory.mktemp("calibration") / "calibration.json"
    file.write_text(json_text(RigCalibration(recordings=(frames_solved,))))
    return read_rig_calibration(file)


@pytest.fixture(scope="module")
def made(recording, calibration, tmp_path_factory):
    """A folder with the recording's crop, which tests leave as it is."""
    out = tmp_path_factory.mktemp("crops")
    crop([recording], calibration, out)
    return out


@pytest.fixture
def crops(made, tmp_path):
    """A folder with a crop of its own."""
    return Path(shutil.copytree(made, tmp_path / "crops"))


def error(solved, recording):
    return compare(solved.pose.on(recording.camera), read_truth(recording), solved.x_m)


def test_frames_give_the_rig(recording, frames_solved):
    """Promise: from frames, image truth to 0.02 px and flow to 0.01 px."""
    found = error(frames_solved, recording)
    assert found.image_px < 0.02
    assert found.flow_px < 0.01
    assert found.position_mm < 0.2
    assert frames_solved.inliers > 0.8 * frames_solved.markers


def test_events_alone_give_it_too(recording):
    """Promise: markers are found in images of the high-pass filter, and the rig to 0.2 px (here a
    marker has only 15 px)."""
    found = detect(recording, "hf", images=10)
    solved = solve_recording(recording, found, (LATENCY, CORNER_BIAS), 2.0)
    assert error(solved, recording).image_px < 0.2
    assert 0 < solved.latency_ms < 1e3 / (math.pi * CUTOFF_HZ)  # the filter itself is early


def test_integrated_events_measure_the_cutoff(recording):
    """Promise: the latency of images by event integration is 2 / (2 pi f), to 10 %."""
    found = detect(recording, "ei", images=10)
    solved = solve_recording(recording, found, (LATENCY, CORNER_BIAS), 2.0)
    assert solved.latency_ms == pytest.approx(1e3 / (math.pi * CUTOFF_HZ), rel=0.1)


def test_images_of_events_begin_with_their_first_frame(recording):
    """Promise: where the first frame comes late, as many markers are found, at times after it:
    before it, its corners would be those of another time."""
    late = RigRecording(recording.folder)
    vars(late)["frames"] = recording.frames[4:]
    found = detect(late, "ei", images=4)
    assert len(np.unique(found.t_us)) == 4
    assert found.t_us.min() > late.frames[0].t_us
    vars(late)["frames"] = [recording.frames[-1]._replace(start_us=10**9, end_us=10**9)]
    with pytest.raises(RigError, match="no motion from 1000000000"):
        detect(late, "ei", images=4)


def test_frames_outside_the_readings_of_the_slider_are_left_out(recording):
    """Promise: no marker has a time at which the slider's position is unknown."""
    short = RigRecording(recording.folder)
    inside = recording.slider.t_us > recording.frames[4].t_us
    vars(short)["slider"] = Slider(recording.slider.t_us[inside], recording.slider.x_m[inside])
    found = detect(short, "frame", images=10)
    assert found.t_us.min() >= recording.frames[5].t_us
    vars(short)["frames"] = recording.frames[:4]
    with pytest.raises(RigError, match=r"frames.csv: has no frame"):
        detect(short, "frame", images=10)


def test_blur_makes_the_latency_that_of_the_photoreceptor(folder, tmp_path):
    """Promise: where an edge crosses a pixel in less than the delay, the latency of event
    integration is more than 10 % short of it, and within 10 % with blurred images."""
    copied, cutoff_hz = tmp_path / "near", 30.0
    unwanted = shutil.ignore_patterns("light", "scene", "events.h5", "*.parquet")
    shutil.copytree(folder, copied, ignore=unwanted)
    light = open_sequence(folder / "light" / "continuous")
    model = SensorModel(
        width=200, height=150, cutoff_hz=cutoff_hz, dark_level=1e-3 * light.white_level
    )
    simulate_sequence(light, model, copied / "events.h5")
    slow = RigRecording(copied)
    delay_ms = 1e3 / (math.pi * cutoff_hz)
    unknowns = (LATENCY, CORNER_BIAS)
    sharp, blurred = (
        solve_recording(slow, detect(slow, "ei", images=10, blur_px=px), unknowns, 2.0).latency_ms
        for px in (0.0, 1.5)
    )
    assert 0.7 * delay_ms < sharp < 0.9 * delay_ms
    assert blurred == pytest.approx(delay_ms, rel=0.1)


def test_blurred_frames_give_the_rig_too(recording):
    """Promise: a blur of half a pixel leaves image truth from frames at three hundredths."""
    found = detect(recording, "frame", images=10, blur_px=0.5)
    solved = solve_recording(recording, found, (CORNER_BIAS,), 2.0)
    assert error(solved, recording).image_px < 0.03


def test_the_truth_is_not_read(folder, recording, frames_solved, tmp_path):
    """Promise: without truth.json the calibration is the same, to the bit."""
    copied = tmp_path / "near"
    shutil.copytree(folder, copied, ignore=shutil.ignore_patterns("light", "scene", "truth.json"))
    real = RigRecording(copied)
    assert read_truth(real) is None
    found = detect(real, "frame", images=10)
    solved = solve_recording(real, found, (CORNER_BIAS,), 2.0)
    assert solved.pose == frames_solved.pose
    assert solved.covariance == frames_solved.covariance


def test_a_crop_tells_cutoff_and_latency(made, tmp_path, eres):
    """Promise: views of the page from the solved poses are light in known motion: the sensor's
    cutoff and its latency of 0 are within the camera's bounds, which are no more than bounds as
    12 % of the change of the light stays unexplained."""
    out = made / "near"
    fitted = tmp_path / "fitted.toml"
    command = "fit", out / "events.h5", "--crop", out, "--motion", "--out", fitted
    code, _, err = eres(*command)
    assert (code, err) == (0, "")
    camera = read_camera(fitted)
    low, high = camera.sources["cutoff"].interval
    assert CUTOFF_HZ / 3 < low < CUTOFF_HZ < high
    low, high = camera.sources["latency"].interval
    assert low == 0
    assert high < 2 / (math.pi * CUTOFF_HZ)
    assert camera.contrast_threshold == pytest.approx(0.2, rel=0.15)
    assert camera.contrast_threshold_off == pytest.approx(0.2, rel=0.15)


def test_a_recording_is_a_folder_of_frames_too(folder, recording, tmp_path):
    """Promise: `--frames` of other commands reads the table of a rig's recording; the rig also
    reads tables that leave out the folder of the images."""
    frames = open_frames(folder)
    assert list(frames.files) == [folder / one.file for one in recording.frames]
    bare = tmp_path / "bare"
    shutil.copytree(folder, bare)
    table = bare / "frames.csv"
    table.write_text(table.read_text().replace("frames/", ""))
    again = RigRecording(bare)
    assert [f"frames/{one.file}" for one in again.frames] == [one.file for one in recording.frames]
    for one, other in zip(again.frames, recording.frames, strict=True):
        assert np.array_equal(again.codes(one), recording.codes(other))


def test_a_calibration_is_of_its_camera(recording, frames_solved):
    """Promise: poses of other intrinsics or another lens are refused; files of earlier versions,
    which do not have them, are read."""
    camera = recording.camera
    frames_solved.check_camera(camera)
    replace(frames_solved, intrinsics=()).check_camera(camera)
    other = Camera(camera.width, camera.height, fx=1.01 * camera.fx)
    with pytest.raises(RigError, match=r"calibration: .*fx = 260,.* 262.6;"):
        frames_solved.check_camera(other)
    given = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy")}
    bent = Camera(camera.width, camera.height, **given, distortion=Distortion(k1=0.1))
    with pytest.raises(RigError, match=r"calibration: .*k1 = 0,.* 0.1;"):
        frames_solved.check_camera(bent)


def test_crops_and_scores(folder, recording, frames_solved, calibration, made):
    """Promise: a crop's events, poses and homographies belong together, and methods beat doing
    nothing on it."""
    assert calibration.of(recording) == frames_solved
    out = made / "near"
    cropped = read_crop(out)
    events, whole = load_events(out / "events.h5"), load_events(folder / "events.h5")
    box = cropped.box
    assert (events.width, events.height) == (box.width, box.height)
    counts = abs(whole.polarity_sum())[box.top : box.bottom, box.left : box.right]
    assert np.array_equal(abs(events.polarity_sum()), counts)
    # A point of the page, by the pose, and by the homography: the same pixel.
    t_s, poses = read_tum(out / "poses.txt")
    table = np.loadtxt(out / "homographies.csv", delimiter=",", skiprows=1)
    assert np.allclose(table[:, 0], 1e6 * t_s)
    for k in (0, len(t_s) // 3, len(t_s) - 1):
        point = np.array([0.07, 0.05, 0.0])
        by_pose = cropped.view().camera.project((point - poses[k][:3, 3]) @ poses[k][:3, :3])
        h = table[k, 1:].reshape(3, 3) @ [0.07, 0.05, 1.0]
        assert by_pose == pytest.approx(h[:2] / h[2], abs=1e-6)
    settings = RigEvaluation(
        places=2, features=4, flow=("contrast_maximization", "initial_flow"), tracking=()
    )
    rows = evaluate_rig([made], settings)
    assert {row.task for row in rows} == {"flow", "video"}
    assert {round(row.speed, 3) for row in rows} == {0.06}
    median = {
        method: np.median([row.value for row in rows if row.method == method])
        for method in {row.method for row in rows}
    }
    assert median["contrast_maximization"] < median["initial_flow"]
    assert median["high_pass_filter"] > median["blank"]


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("lens", [0.0] * 6, "lens"),
        ("width", 0, "Camera"),
        ("pose", {"R_world_cam": [[0.0] * 3] * 3}, "R_world_cam"),
    ],
)
def test_a_wrong_crop_is_refused(field, value, said, tmp_path):
    """Promise: an error names the file and the field, before anything is computed from it."""
    pose = {"R_world_cam": np.eye(3).tolist(), "origin_m": [0, 0, 0], "direction": [1, 0, 0]}
    stored = {
        **{"scene": "rocks", "width": 8, "height": 6, "fx": 9.0, "fy": 9.0, "cx": 4.0, "cy": 3.0},
        **{"lens": [0.0] * 5, "box": {"left": 0, "top": 0, "right": 8, "bottom": 6}},
        **{"pose": {**pose, "scale": 1.0}, "latency_ms": 0.0},
    }
    (tmp_path / "crop.json").write_text(json.dumps(stored))
    assert read_crop(tmp_path).view().camera.width == 8
    stored[field] = {**stored[field], **value} if field == "pose" else value
    (tmp_path / "crop.json").write_text(json.dumps(stored))
    with pytest.raises(RigError, match=rf"crop\.json: .*{said}"):
        read_crop(tmp_path)


@pytest.mark.parametrize("lens", [(0.0,) * 5, (-0.35, 0.1, 0.0, 0.0, 0.0)])
def test_the_light_of_a_crop_is_in_steps_of_half_a_pixel(crops, lens):
    """Promise: from frame to frame no point that is in view moves farther, nor much less, through
    a lens too."""
    out = crops / "near"
    facts = json.loads((out / "crop.json").read_text())
    (out / "crop.json").write_text(json.dumps(facts | {"lens": lens}))
    cropped, footage = read_crop(out), light_of_crop(out)
    pose = cropped.view()
    x_m = read_slider(out / "slider.csv").position_m(footage.t_offset_us + 1e6 * footage.t_s)
    steps_px = []
    for k in np.linspace(0, len(x_m) - 2, 20).astype(int).tolist():
        at_m = pose.on_page(pose.camera.grid(5), float(x_m[k]))
        ends_px = pose.project(at_m, x_m[k : k + 2])
        steps_px.append(np.linalg.norm(ends_px[1] - ends_px[0], axis=1).max())
    assert max(steps_px) < 0.51
    assert min(steps_px) > 0.45


def test_a_crop_needs_events_while_the_slider_is_read(crops):
    """Promise: clocks that overlap for less than 100 us, or not at all, are an error in one
    line."""
    out = crops / "near"
    first_us = load_events(out / "events.h5").t_us[0]
    for until_us in (40.0, -300.0):
        readings = Slider(first_us + np.array([-500.0, until_us]), np.array([0.0, 0.01]))
        (out / "slider.csv").write_text(slider_text(readings))
        with pytest.raises(RigError, match=r"near: the events .* do not overlap"):
            light_of_crop(out)


def test_a_crop_is_there_when_its_last_file_is(recording, calibration, crops):
    """Promise: a stopped crop is made again without --overwrite, and is not scored; a finished one
    is refused before anything is written."""
    with pytest.raises(TaskError, match=r"crop.json: already exists"):
        crop([recording], calibration, crops)
    (crops / "near" / "crop.json").unlink()
    with pytest.raises(RigError, match="crops: has no crops"):
        evaluate_rig([crops], RigEvaluation())
    crop([recording], calibration, crops)
    assert (crops / "near" / "crop.json").exists()


def test_crops_of_one_folder_show_one_field(recording, calibration, crops):
    """Promise: crops of another call, which show another field, do not stay beside new ones."""
    shutil.copytree(crops / "near", crops / "far")
    with pytest.raises(RigError, match=r"far: is a crop of another recording"):
        crop([recording], calibration, crops, overwrite=True)
    assert (crops / "near" / "crop.json").exists()


def test_every_distance_has_the_same_places_and_corners(crops):
    """Promise: patches of flow are at the same points of the print from near and far, with the same
    numbers, there and back; a recording that begins elsewhere shares the part that both pass."""
    made = crops / "near"
    far = made.with_name("far")
    shutil.copytree(made, far)
    near = read_crop(made)
    readings = read_slider(far / "slider.csv")  # the far one's begin at 1 cm
    (far / "slider.csv").write_text(slider_text(Slider(readings.t_us, readings.x_m + 0.01)))
    back_m = np.array([0.0, 0.0, 0.1]) + 0.01 * np.array(near.pose.direction)
    pose = replace(near.pose, origin_m=(np.array(near.pose.origin_m) - back_m).tolist())
    size = {"width": near.width // 2, "height": near.height // 2}
    middle = {"cx": 0.25 * near.width, "cy": 0.25 * near.height}
    zoom = 0.5 * pose.origin_m[2] / near.pose.origin_m[2]  # the field is the same
    lens = {"fx": zoom * near.fx, "fy": zoom * near.fy}
    farther = replace(near, pose=pose, **size, **middle, **lens)
    (far / "crop.json").write_text(json.dumps(asdict(farther)))
    cropped = {folder: read_crop(folder) for folder in (far, made)}
    settings = RigEvaluation()
    (printed,) = prints_of(cropped, 3, settings.travel_m).values()
    assert printed.nearest.pose.camera.width == near.width
    points = {}
    for folder in cropped:
        one = _load(folder, cropped[folder], printed, settings)
        found = one.windows
        assert {(w.place, w.visit) for w in found} == {(k, v) for k in range(3) for v in (0, 1)}
        pose, middle_px = one.way.pose, 0.5 * np.array([one.size])
        along = np.array(near.pose.direction[:2]) / np.linalg.norm(near.pose.direction[:2])
        for window in found:
            at_m = pose.on_page(middle_px, np.mean(window.x_m))[0] @ along
            assert at_m == pytest.approx(printed.places_m[window.place], abs=1e-5)
            numbers, centers_px, _ = replace(one, windows=[window]).corners(12)
            seen_m = pose.on_page(centers_px, window.x_m[0])
            assert len(numbers) > 3
            for number, at_m in zip(numbers.tolist(), seen_m, strict=True):
                points.setdefault((window.place, number), []).append(at_m)
    assert max(map(len, points.values())) == 4
    for at_m in points.values():
        assert np.ptp(at_m, axis=0).max() < 1e-9
    # Whatever the strokes before, both begin with the same errors: pairs are of methods alone.
    late = [replace(one, visit=one.visit + 4) for one in found]
    options = {"flow": ("initial_flow",), "tracking": ("initial_path",), "features": 4}
    settings = replace(settings, **options)
    for task in ("flow", "tracking"):
        tasks = {task: settings.tasks()[task]}
        first, second = (
            [
                row.value
                for window in windows[::3]  # there and back
                for row in rows_of(replace(one, windows=[window]), tasks)
            ]
            for windows in (found, late)
        )
        assert first == second != []
    # Where the encoder counts 2 mm as 1 mm, speeds and travels are still those of the carriage.
    crop_near = _load(made, near, printed, settings)
    way = crop_near.way
    scaled = replace(crop_near, way=replace(way, pose=replace(way.pose, scale=2.0)))
    window = Window(0, 0, 0, 10_000, (0.0, 0.002))
    one, two = (replace(crop, windows=[window]) for crop in (crop_near, scaled))
    score = Score("m", 0.0)
    assert (one.columns(score)["speed"], two.columns(score)["speed"]) == (0.2, 0.4)


def test_recordings_of_one_picture_are_of_one_print(crops, tmp_path):
    """Promise: places on different pages are not compared; the text names both folders. Nor are
    there more places than the print has room for."""
    made = crops / "near"
    with pytest.raises(RigError, match=r"pebbles: .* 4 windows of 6 mm on the 30 mm .*for 9;"):
        evaluate_rig([crops], RigEvaluation(places=9))
    (printed,) = prints_of({made: read_crop(made)}, 2, 0.006).values()
    off_m = replace(printed, places_m=printed.places_m + 1.0)  # never passed
    with pytest.raises(RigError, match=r"events.h5: .* 2 places .* 6 mm"):
        _load(made, read_crop(made), off_m, RigEvaluation())
    with pytest.raises(RigError, match=r"0 windows of 40 mm"):
        evaluate_rig([crops], RigEvaluation(travel_m=0.04))
    shutil.copytree(made, tmp_path / "others" / "near")
    image = tmp_path / "others" / "near" / "page.png"
    codes = cv2.imread(str(image), cv2.IMREAD_UNCHANGED)
    codes[codes.shape[0] // 2, codes.shape[1] // 2] ^= 255
    cv2.imwrite(str(image), codes)
    with pytest.raises(RigError, match=r"others/near: its page is not"):
        evaluate_rig([crops, tmp_path / "others"], RigEvaluation(places=2))
    facts = asdict(read_crop(made))
    shutil.copytree(made, made.with_name("wide"))
    wide = json.dumps(facts | {"width": 2 * facts["width"]})
    (made.with_name("wide") / "crop.json").write_text(wide)
    with pytest.raises(RigError, match=r"near: its field is .* mm wide"):
        evaluate_rig([crops], RigEvaluation(places=2))
    shutil.rmtree(made.with_name("wide"))
    settings = RigEvaluation(places=2, tracking=(), flow=(), video=("blank",))
    once = evaluate_rig([crops], settings)
    link = tmp_path / "link"
    link.symlink_to(crops)
    assert evaluate_rig([crops, link], settings) == once != []
    still = Slider(np.array([0.0, 1e9]), np.array([0.01, 0.01]))
    (made / "slider.csv").write_text(slider_text(still))
    with pytest.raises(RigError, match=r"slider.csv: slider: the carriage stays at 0.01 m"):
        evaluate_rig([crops], RigEvaluation())


def test_tracking_with_a_delay_has_the_events_that_it_needs(made):
    """Promise: a method that estimates the delay runs on a crop, too."""
    options = {"places": 1, "travel_m": 0.0005, "initial_sigma_mm": 0.1, "flow": (), "video": ()}
    method = "photometric_tracking_with_delay"
    rows = evaluate_rig([made], RigEvaluation(tracking=(method,), **options))
    assert {row.method for row in rows} == {method}


def test_your_own_task_is_scored_on_crops(made, tmp_path, monkeypatch):
    """Promise: the task of docs/methods.md runs on crops, next to the others: the rate of a window
    is that of the crop's events in it. One that needs what a crop lacks is refused."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "my_rate", raising=False)
    blocks = {name: text for _, name, text in BLOCK.findall((DOCS / "methods.md").read_text())}
    (tmp_path / "my_rate.py").write_text(blocks["my_rate.py"])
    try:
        importlib.import_module("my_rate")
        options = {"places": 3, "travel_m": 0.002, "video": (), "tracking": ()}
        settings = RigEvaluation(flow=("initial_flow",), **options)
        tasks = {"rate": TaskSettings(methods=("exact",))}
        rows = evaluate_rig([made], settings, tasks=tasks)
        rates = [row for row in rows if row.task == "rate"]
        assert {row.task for row in rows} == {"flow", "rate"}
        assert [row.sample for row in rates] == [0, 0, 1, 1, 2, 2]  # there and back
        events = load_events(made / "near" / "events.h5")
        for row in rates:
            assert row.value == pytest.approx(1e-6 * row.event_rate_hz)
            start_us = row.t_us - round(1e6 * 0.002 / 0.06)
            count = len(events.between(start_us, row.t_us))
            assert count / (row.t_us - start_us) == pytest.approx(row.value, rel=0.02)
        TASKS["rate"] = replace(TASKS["rate"], needs=("poses", "sound"))
        with pytest.raises(TaskError, match="event rate needs sound, which a crop does not have"):
            evaluate_rig([made], settings, tasks=tasks)
    finally:
        TASKS.pop("rate", None)
        sys.modules.pop("my_rate", None)


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_crop_never_replaces_a_recording(recording, calibration, overwrite):
    """Promise: --out may not be the folder of the recordings."""
    before = {one: one.read_bytes() for one in recording.folder.iterdir() if one.is_file()}
    with pytest.raises(RigError, match=r"near: contains a recording"):
        crop([recording], calibration, recording.folder.parent, overwrite=overwrite)
    assert {one: one.read_bytes() for one in recording.folder.iterdir() if one.is_file()} == before


def test_integration_knows_both_thresholds():
    """Promise: where ON and OFF differ, light that comes back leaves the image as it was."""
    frame, pixel = np.zeros((1, 1)), np.zeros(7, np.uint16)
    p = np.array([1, 1, 1, -1, -1, 1, -1], np.int8)
    events = Events(np.arange(7), pixel, pixel, p, 1, 1)
    method = _Integration(frame, 0, 0.2, 0.3)
    method.push(events.between(0, 5))
    assert method.image(5) == pytest.approx(3 * 0.2 - 2 * 0.3 - 0.15)
    method.push(events.between(5, 7))
    assert method.image(7) == pytest.approx(4 * 0.2 - 3 * 0.3 - 0.15)


def test_the_rig_s_own_camera_file_stays(tmp_path, monkeypatch):
    """Promise: `eres rig render --out .` does not write over the camera file of rig.toml; another
    folder gets a copy of it, and of the picture."""
    text = RIG[RIG.index("[page]") :]
    text = text.replace('picture = "pebbles"', 'picture = "photo.png"')
    (tmp_path / "rig.toml").write_text(f'camera_file = "lens.yaml"\n{text}')
    cv2.imwrite(str(tmp_path / "photo.png"), np.full((30, 50), 128, np.uint8))
    file = tmp_path / "lens.yaml"
    write_camera(file, Camera(200, 150, fx=260.0, fy=260.0, cx=104.0, cy=71.0))
    file.write_text(file.read_text() + "# measured on Tuesday\n")

    def stop(*args, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(virtual, "render_scene", stop)
    for out in (tmp_path, tmp_path / "far"):
        with pytest.raises(KeyboardInterrupt):
            render_rig(tmp_path / "rig.toml", out, DEPTH_M, frame_camera=FrameCameraOptions())
        assert (out / "lens.yaml").exists()
        assert (out / "photo.png").read_bytes() == (tmp_path / "photo.png").read_bytes()
    assert "# measured on Tuesday" in file.read_text()


def test_rows_are_asked_for(made):
    """Promise: an evaluation of nothing is an error, not an empty table."""
    with pytest.raises(RigError, match="crops: nothing to score"):
        evaluate_rig([made], RigEvaluation(places=2, flow=(), video=(), tracking=()))


def test_seeds_of_evaluations_share_no_initial_paths(made):
    """Promise: evaluations with seeds 0 and 1 are independent; the second began with the path of
    the first one's next window."""
    options = {"places": 2, "flow": (), "video": (), "tracking": ("initial_path",)}
    first, second = (evaluate_rig([made], RigEvaluation(seed=k, **options)) for k in (0, 1))
    errors_mm = {round(row.value, 6) for row in (*first, *second)}
    assert len(errors_mm) == len(first) + len(second) >= 4


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"seed": -1}, "seed: found -1"),
        ({"contrast_threshold": 0.0}, "contrast_threshold: found 0"),
        ({"initial_sigma_px": 0.0}, "initial_sigma_px: found 0"),
    ],
)
def test_senseless_evaluations_are_refused(options, said):
    with pytest.raises(RigError, match=said):
        RigEvaluation(**options)


def test_another_depth_does_not_change_the_truth_of_a_recording(folder, tmp_path):
    """Promise: truth, readings and page beside the light are those that it was rendered with."""
    (tmp_path / "near").mkdir()
    for name in ("truth.json", "page.json", "slider.csv"):
        shutil.copy(folder / name, tmp_path / "near")
    before = (folder / "truth.json").read_bytes()
    with pytest.raises(RigError, match=r"truth.json: was made for another rig or depth"):
        render_rig(
            *(folder.parent / "rig.toml", tmp_path / "near", DEPTH_M + 0.1),
            frame_camera=FrameCameraOptions(),
        )
    assert (tmp_path / "near" / "truth.json").read_bytes() == before


@pytest.mark.parametrize("name", ["slider.csv", "frames.csv", "events.raw"])
def test_a_real_recording_is_not_rendered_over(tmp_path, name):
    """Promise: readings, frames and events without truth.json stay as they are."""
    (tmp_path / "rig.toml").write_text(RIG)
    (tmp_path / "near").mkdir()
    (tmp_path / "near" / name).write_text("t_us,x_m\n0,0\n1000000,0.1\n")
    before = (tmp_path / "near" / name).read_bytes()
    with pytest.raises(RigError, match=rf"{name}: .* another --out"):
        render_rig(
            tmp_path / "rig.toml", tmp_path / "near", DEPTH_M, frame_camera=FrameCameraOptions()
        )
    assert [*(tmp_path / "near").iterdir()] == [tmp_path / "near" / name]
    assert (tmp_path / "near" / name).read_bytes() == before


@pytest.mark.parametrize(
    ("old", "new"),
    [("fx = 260.0", "fx = 270.0"), ('picture = "pebbles"', 'picture = "forest"')],
)
def test_another_rig_changes_nothing_in_a_recording(folder, tmp_path, old, new):
    """Promise: what is refused has written nothing: the recording keeps its camera and picture."""
    (tmp_path / "rig.toml").write_text(RIG.replace(old, new))
    before = {one: one.read_bytes() for one in folder.rglob("*") if one.is_file()}
    with pytest.raises(RigError, match=r"manifest.json: is from another camera or picture"):
        render_rig(tmp_path / "rig.toml", folder, DEPTH_M, frame_camera=FrameCameraOptions())
    assert {one: one.read_bytes() for one in folder.rglob("*") if one.is_file()} == before


@pytest.mark.parametrize(
    ("exposure", "said"),
    [(1e-6, "found 1e-06, expected 2e-06"), (5.0, r"found 5.0, .* 0.02")],
)
def test_an_exposure_that_does_not_fit_is_refused_before_the_render(tmp_path, exposure, said):
    """Promise: nothing is written for an exposure of a microsecond, which has no middle, or for one
    longer than the rest in which the first image is taken."""
    (tmp_path / "rig.toml").write_text(RIG)
    with pytest.raises(RigError, match=f"exposure: {said}"):
        render_rig(
            *(tmp_path / "rig.toml", tmp_path / "near", DEPTH_M),
            frame_camera=FrameCameraOptions(exposure=exposure),
            spp=1,
            max_displacement_px=50.0,
        )
    assert not (tmp_path / "near").exists()


def test_a_negative_number_of_images_is_refused(tmp_path):
    """Promise: before the render, and nothing is written."""
    (tmp_path / "rig.toml").write_text(RIG)
    with pytest.raises(RigError, match="images: found -3, expected at least 0"):
        render_rig(
            *(tmp_path / "rig.toml", tmp_path / "near", DEPTH_M),
            images=-3,
            frame_camera=FrameCameraOptions(),
        )
    assert not (tmp_path / "near").exists()


def test_images_of_an_earlier_render_are_not_left_among_new_ones(tmp_path):
    """Promise: fewer images than the folder has are refused before the render."""
    (tmp_path / "rig.toml").write_text(RIG)
    images = tmp_path / "near" / "frames"
    images.mkdir(parents=True)
    for k in range(6):
        (images / f"{k:06d}.png").write_bytes(b"as before")
    with pytest.raises(RigError, match=r"000005.png: .*earlier"):
        render_rig(
            *(tmp_path / "rig.toml", tmp_path / "near", DEPTH_M),
            images=4,
            frame_camera=FrameCameraOptions(),
        )
    assert {one.read_bytes() for one in images.iterdir()} == {b"as before"}
    assert [one.name for one in (tmp_path / "near").iterdir()] == ["frames"]


def test_the_file_of_a_lens_is_beside_the_rig(tmp_path):
    """Promise: `eres rig render` copies it, and never over the user's own."""
    text = RIG[RIG.index("[page]") :]
    (tmp_path / "rig.toml").write_text(f'camera_file = "{tmp_path}/lens.yaml"\n{text}')
    with pytest.raises(RigError, match=r"camera_file: found .*expected the name of your own file"):
        read_rig(tmp_path / "rig.toml")


def rolled(near, roll_deg):
    """Return the pose of a camera 0.1 m farther away, rolled around its axis."""
    roll = Rotation.from_euler("z", roll_deg, degrees=True).as_matrix()
    return RigPose(
        near.camera, near.R_world_cam @ roll, near.origin_m - [0, 0, 0.1], near.direction
    )


@pytest.mark.parametrize("roll_deg", [-135, -45, 90])
def test_cameras_on_their_sides_are_refused(recording, frames_solved, roll_deg):
    """Promise: widths of crops are sides of the same field; the text says how far it is rolled."""
    near = frames_solved.pose.on(recording.camera)
    poses = [near, rolled(near, roll_deg)]
    with pytest.raises(RigError, match=f"rolled by {roll_deg} degrees"):
        common_boxes(poses, frames_solved.x_m)


@pytest.mark.parametrize("roll_deg", [0, 180])
def test_common_field_of_two_distances(recording, frames_solved, roll_deg):
    """Promise: the far camera's box shows no more of the page than the near camera's, and at most
    two pixels less on each side, also if it is mounted upside down."""
    near = frames_solved.pose.on(recording.camera)
    far = rolled(near, roll_deg)
    camera = recording.camera
    boxes = common_boxes([near, far], frames_solved.x_m)
    for x in frames_solved.x_m:
        inner, outer = (
            np.linalg.inv(homography(pose, x)) @ np.c_[box.sides()[:, 0], np.ones(4)].T
            for pose, box in zip((far, near), reversed(boxes), strict=True)
        )
        (low, high), (left, right) = (
            ((h[:2] / h[2]).min(axis=1), (h[:2] / h[2]).max(axis=1)) for h in (inner, outer)
        )
        pixel_m = 0.24 / camera.fx
        assert np.all(low > left - 0.01 * pixel_m - 3 * pixel_m * 0.02)
        assert np.all(low < left + 3 * pixel_m)
        assert np.all(high < right + 0.01 * pixel_m + 3 * pixel_m * 0.02)
        assert np.all(high > right - 3 * pixel_m)


@pytest.mark.parametrize("k1", [0.0, -0.1, -0.3])
def test_a_lens_that_bends_the_sides_does_not_widen_the_field(k1):
    """Promise: at all positions, the box of the far camera shows nothing that is outside that of
    the near one, and leaves out less than two pixels on a side: a lens bends its sides outward."""
    camera = Camera(200, 150, fx=260.0, cx=104.0, cy=71.0, distortion=Distortion(k1))
    near = RigPose(camera, np.eye(3), np.array([0.07, 0.06, -0.14]), np.array([1.0, 0.0, 0.0]))
    far = rolled(near, 0)
    x_m = 0.0, 0.03
    inner, outer = common_boxes([near, far], x_m)
    seen = [near.project(far.on_page(outer.sides(), x), x) for x in x_m]
    low, high = np.min(seen, axis=(0, 1, 2)), np.max(seen, axis=(0, 1, 2))
    for found in (low - (inner.left, inner.top), (inner.right, inner.bottom) - high):
        assert np.all((found > -0.01) & (found < 2 * 0.24 / 0.14)), found


def run(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["eres", *map(str, arguments)])
    try:
        main()
    except SystemExit as end:
        return end.code or 0
    return 0


def test_commands(folder, tmp_path, monkeypatch, capsys):
    """Promise: detect, solve and crop by commands; errors are one line, with exit code 1."""
    corners = folder / "corners.parquet"
    corners.unlink(missing_ok=True)
    calibration = tmp_path / "calibration.json"
    detected = ("rig", "detect", folder, "--out", corners, "--source", "frame", "--images", 10)
    assert run(monkeypatch, *detected) == 0
    assert run(monkeypatch, *detected) == 1
    assert "already exists" in capsys.readouterr().err
    for blur in ("-1", "nan", "200"):
        assert run(monkeypatch, *detected, "--overwrite", "--blur", blur) == 1
        message = " ".join(capsys.readouterr().err.split())
        assert f"blur: found {blur} px, expected 0 to the width, 200" in message
    assert run(monkeypatch, "rig", "solve", folder, "--out", calibration) == 0
    assert "against the truth" in capsys.readouterr().out
    crops = tmp_path / "crops"
    assert (
        run(monkeypatch, "rig", "crop", folder, "--calibration", calibration, "--out", crops) == 0
    )
    assert (crops / "near" / "crop.json").exists()
    out = tmp_path / "scores"
    scored = ("rig", "evaluate", crops, "--out", out, "--tasks", "video", "--places", 2)
    assert run(monkeypatch, *scored, "--cutoff", 90) == 0
    assert {row.cutoff_hz for row in read_rows(out / "rows.parquet")} == {90.0}
    assert run(monkeypatch, *scored) == 1
    assert "already exists" in capsys.readouterr().err
    nothing = {"solve": (), "crop": ("--calibration", calibration), "evaluate": ()}
    for name, options in nothing.items():
        assert run(monkeypatch, "rig", name, "--out", tmp_path / "none", *options) == 2
        assert "at least one" in capsys.readouterr().err
        assert not (tmp_path / "none").exists()
    other = tmp_path / "other"
    other.mkdir()
    assert run(monkeypatch, "rig", "crop", other, "--calibration", calibration, "--out", crops) == 1
    assert "rig.toml: no such file" in capsys.readouterr().err


def test_bad_recordings_are_refused(folder, tmp_path):
    """Promise: clocks that disagree, frames without exposure, another camera, a missing file: each
    error names the file."""

    def copy(name):
        out = tmp_path / name
        shutil.copytree(folder, out, ignore=shutil.ignore_patterns("light", "scene", "*.parquet"))
        return out

    late = copy("late")
    table = (late / "slider.csv").read_text().splitlines()
    moved = [f"{int(line.split(',')[0]) + 10**7},{line.split(',')[1]}" for line in table[1:]]
    (late / "slider.csv").write_text("\n".join([table[0], *moved]) + "\n")
    with pytest.raises(RigError, match="check the clocks"):
        detect(RigRecording(late), "hf", images=4)

    unexposed = copy("unexposed")
    text = (unexposed / "frames.csv").read_text().replace("t_us_start,t_us_end", "t_us,other")
    (unexposed / "frames.csv").write_text(text)
    with pytest.raises(TaskError, match="each frame needs the start and the end"):
        detect(RigRecording(unexposed), "frame", images=4)

    another = copy("another")
    (another / "rig.toml").write_text(RIG.replace("width = 200", "width = 220"))
    with pytest.raises(RigError, match=r"events.h5, camera of rig.toml: .*200x150 px, .*220x150"):
        detect(RigRecording(another), "hf", images=4)
    with pytest.raises(RigError, match="found 200x150 px, expected 220x150"):
        detect(RigRecording(another), "frame", images=4)

    loud = copy("loud")
    (loud / "events.h5").rename(loud / "events.H5")
    assert RigRecording(loud).events_file.name == "events.H5"

    eventless = copy("eventless")
    (eventless / "events.h5").unlink()
    with pytest.raises(RigError, match=r"expected one file events\.\*, found none"):
        detect(RigRecording(eventless), "hf", images=4)

    blind = copy("blind")
    empty = load_events(blind / "events.h5")
    kept = empty.where(np.arange(len(empty)) % 9973 == 0)
    (blind / "events.h5").unlink()
    write_events(blind / "events.h5", kept)
    with pytest.raises(RigError, match=r"blind: none of 4 images .* marker"):
        detect(RigRecording(blind), "hf", images=4)

    with pytest.raises(RigError, match=r"rig.toml: no such file"):
        RigRecording(Path(tmp_path / "nowhere"))


def test_recordings_that_cannot_be_scored_are_refused(recording, crops):
    """Promise: tracking with lens distortion, a recording shorter than a window or without events,
    and a latency from motion in one direction: one line that names the recording."""
    out = crops / "near"
    cropped = read_crop(out)
    (out / "crop.json").write_text(json.dumps(asdict(replace(cropped, lens=(-0.1, 0, 0, 0, 0)))))
    with pytest.raises(RigError, match=r"crop.json: lens: .*tracking"):
        evaluate_rig([crops], RigEvaluation(places=2))
    events = load_events(out / "events.h5")
    settings = RigEvaluation(places=2, tracking=(), flow=(), video=("blank",))
    begins_us = int(events.t_us[len(events) // 4])
    for last_us, said in (
        (begins_us + 50_000, r"on the 3 mm that all recordings pass \(.*near passes 3 mm\)"),
        (begins_us, "near.events.h5: has no events"),
    ):
        (out / "events.h5").unlink()
        chosen = (events.t_us >= begins_us) & (events.t_us < last_us)
        write_events(out / "events.h5", events.where(chosen))
        with pytest.raises(RigError, match=said) as refused:
            evaluate_rig([crops], settings)
        assert "\n" not in str(refused.value)

    found = detect(recording, "frame", images=10)
    one_way = found.t_us < np.median(found.t_us)
    columns = (found.t_us, found.number, found.corners_px, found.score)
    there = Detections(*(column[one_way] for column in columns), found.source)
    with pytest.raises(RigError, match=r"near: .*on the way there and 0 on the way back"):
        solve_recording(recording, there, (LATENCY,), 2.0)


def test_a_calibration_of_another_camera_is_refused(folder, recording, frames_solved, tmp_path):
    file = tmp_path / "calibration.json"
    file.write_text(json_text(RigCalibration(recordings=(frames_solved,))))
    text = file.read_text().replace('"width": 200', '"width": 346')
    file.write_text(text)
    with pytest.raises(RigError, match=r"calibration: .*width = 346,.* 200;"):
        read_rig_calibration(file).of(recording)
    file.write_text(text.replace(str(folder), "/elsewhere"))
    with pytest.raises(RigError, match=r"calibration: does not include"):
        read_rig_calibration(file).of(recording)
