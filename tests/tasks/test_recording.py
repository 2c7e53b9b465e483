"""Methods on recordings: flow from zero, images against frames, and input that does not fit."""

import json
import re
import tracemalloc

import cv2
import numpy as np
import pytest

from event_streams import make_events
from moving_texture import texture_in_motion
from recordings import SIZE, STEP, C, make_recording
from sensor import Events, SensorModel, simulate
from sensor.formats import write_events
from tasks.errors import TaskError
from tasks.flow import FlowEstimate, FlowSample, flow_sample
from tasks.methods.contrast_maximization import AT_BOUND, Contrast, off_grid
from tasks.methods.contrast_maximization.contrast import _EXPOSURES
from tasks.recording import video
from tasks.recording.clock import estimate_shift, on_one_clock
from tasks.recording.evaluate import _thresholds, evaluate_recording
from tasks.recording.flow_windows import spread, track
from tasks.recording.frames import open_frames, sums
from tasks.recording.levels import busiest
from tasks.recording.options import FlowOptions
from tasks.recording.recording import cut, open_recording
from tasks.recording.threshold import fit_recording
from tasks.recording.worth import worth_of_events
from tasks.registry import TASKS


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return make_recording(tmp_path_factory.mktemp("recording"))


@pytest.fixture(scope="module")
def recording(made):
    return open_recording(made.events_file)


@pytest.fixture(scope="module")
def frames(made):
    return open_frames(made.frames, encoding="linear")


@pytest.fixture
def coarse_clock(monkeypatch):
    """Try 5 shifts of the clock in place of 41, in tests of what does not depend on them."""
    monkeypatch.setattr("tasks.recording.clock.STEP_US", 10_000)


def medians(found):
    """Return the median score of each method."""
    names = dict.fromkeys(score.method for score in found.rows)
    return {n: np.median([s.value for s in found.rows if s.method == n]) for n in names}


def moving_right(sample: FlowSample) -> FlowEstimate:
    return FlowEstimate(np.array([31.0, 0.0]))


def far_off(sample: FlowSample) -> FlowEstimate:
    return FlowEstimate(np.array([60.0, 0.0]))


def moving_dots(folder):
    """Open a recording of dots that move 31 px to the right in 31 ms."""
    rng = np.random.default_rng(0)
    start, step = rng.uniform(0, 346 - 31, (600, 1)), np.arange(31)
    x, y = np.floor(start + step).ravel(), np.repeat(rng.integers(0, 260, 600), 31)
    t_us = (1000 * (step + rng.random((600, 1)))).astype(np.int64).ravel()
    order = np.argsort(t_us, kind="stable")
    dots = make_events(*(one[order] for one in (t_us, x, y, np.ones(x.size))), 346, 260)
    write_events(folder / "dots.h5", dots)
    return open_recording(folder / "dots.h5")


def test_answers_beyond_the_search_are_scored_as_they_are(tmp_path):
    """Promise: without frames, the gain is that of the flow that a method returns, also beyond
    `search_px`, 21.6 px by default here: dots that move 31 px in the window are sharpest there.

    Expected: the gain does not depend on `search_px`.
    """
    recording = moving_dots(tmp_path)
    names = [f"{__name__}:{name}" for name in ("moving_right", "far_off")]
    gains = []
    for search_px in (None, 40.0):
        options = FlowOptions(search_px=search_px, window_ms=30.9, features=20)
        gains.append(medians(evaluate_recording(recording, "flow", methods=names, flow=options)))
    right, wrong = (np.array([one[name] for one in gains]) for name in names)
    assert right[0] > 1.5 * wrong[0]
    np.testing.assert_allclose(right, right[0], rtol=0.02)
    np.testing.assert_allclose(wrong, wrong[0], rtol=0.02)


def standing_still(sample: FlowSample) -> FlowEstimate:
    return FlowEstimate(np.zeros(2))


def test_what_most_answers_have_in_common_is_a_note(tmp_path):
    """Promise: where most searches end at their bound, the note on them says what helps."""
    options = FlowOptions(search_px=8.0, window_ms=30.9, features=20)
    methods = ["contrast_maximization", "initial_flow"]
    found = evaluate_recording(moving_dots(tmp_path), "flow", methods=methods, flow=options)
    failed = [one.failure for one in found.rows if one.method == methods[0] and one.failure]
    assert set(failed) == {AT_BOUND}
    assert found.notes == [
        f"contrast_maximization: {len(failed)} of 20 answers failed, mostly with 'search ended at "
        "its bound'; a larger --search-px or a shorter --window-ms helps",
    ]


@pytest.mark.parametrize("part", [1, 7, 1000, 10**6])
def test_windows_are_those_of_all_events(made, part):
    """Promise: overlapping, empty and adjacent windows, whatever the parts of the stream are."""
    events = made.events[:1200]
    last = int(events.t_us[-1])
    windows = [(-9, 0), (0, 400), (300, 900), (300, 901), (last // 2, last), (last, last + 9)]
    starts = range(0, len(events), part)
    parts = (one for k in starts for one in (events[k : k + part], events[:0]))
    for found, (start, end) in zip(cut(parts, windows), windows, strict=True):
        expected = events.between(start, end)
        np.testing.assert_array_equal(found.t_us, expected.t_us)
        np.testing.assert_array_equal(found.x, expected.x)


def test_a_window_late_in_a_file_does_not_keep_what_comes_before():
    """Promise: at most a window and a part are in memory."""
    size = 1 << 14

    def parts():
        for k in range(60):
            x = np.zeros(size, np.uint16)
            yield Events(np.arange(size) + k * size, x, x.copy(), np.ones(size, np.int8), 1, 1)

    tracemalloc.start()
    (found,) = cut(parts(), [(60 * size - 10, 60 * size)])
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(found) == 10
    assert peak < 10 * 13 * size  # bytes of ten parts


def test_the_thresholds_of_a_file_are_both_used(tmp_path):
    """Promise: event integration counts OFF events with the OFF threshold of the file's sensor."""
    model = SensorModel(width=4, height=4, contrast_threshold=0.2, contrast_threshold_off=0.4)
    frames = np.exp(np.sin(np.arange(20.0)))[:, None, None] * np.ones((4, 4))
    write_events(tmp_path / "own.h5", simulate(frames, np.arange(20) * 1e-2, model))
    notes = []
    found = _thresholds(open_recording(tmp_path / "own.h5"), None, None, "reconstruction", notes)
    assert (found.on, found.off) == (0.2, 0.4)
    assert notes == ["thresholds: ON 0.2, OFF 0.4, from the file"]


@pytest.mark.parametrize("task", ["video", "reconstruction"])
def test_frames_of_mixed_sizes_are_refused(made, recording, tmp_path, task):
    """Promise: the error names the image that differs, wherever it is."""
    folder = made.write_frames(tmp_path / "mixed")
    cv2.imwrite(str(folder / "030.png"), np.full((20, 30), 9000, np.uint16))
    with pytest.raises(TaskError, match=r"030\.png: found 30x20 px, expected 96x72 px"):
        evaluate_recording(recording, task, frames=open_frames(folder, encoding="linear"))


def test_weights_are_means_over_the_exposures(made, tmp_path):
    """Promise: events between two exposed frames count as in the mean of the integral of events
    over each exposure, sampled at many times."""
    folder = made.write_frames(tmp_path / "exposed", exposure=6)
    exposed = open_frames(folder, encoding="linear")
    found = sums(made.events, exposed, 1)
    after = []  # share of each exposure that sees the light after an event
    for k in (1, 2):
        times = np.linspace(exposed.start_us[k], exposed.end_us[k], 6001)
        after.append(1 - np.searchsorted(times, made.events.t_us) / len(times))
    weight = after[1] - after[0]
    on = np.zeros(SIZE[::-1])
    kept = made.events.p > 0
    np.add.at(on, (made.events.y[kept], made.events.x[kept]), weight[kept])
    np.testing.assert_allclose(found[0], on, atol=0.02)


def test_the_worth_of_events_that_explain_the_frames(recording, made, tmp_path):
    """Promise: frames whose logarithm changes by exactly 0.03 for an ON event and 0.02 for an OFF
    event give these."""
    width, height = SIZE
    folder = tmp_path / "exact"
    folder.mkdir()
    times = np.linspace(int(made.t_us[1]), int(made.t_us[-2]), 4).astype(int)
    rows = ["t_us_start,t_us_end,file"]
    log = np.full((height, width), np.log(0.1))
    for k, t_us in enumerate(times):
        if k:
            window = made.events.between(int(times[k - 1]), int(t_us))
            for p, worth in ((1, 0.03), (-1, -0.02)):
                log += worth * np.abs(window.where(window.p == p).polarity_sum())
        light = np.exp(log) - 1 / 64
        cv2.imwrite(str(folder / f"{k}.png"), np.round(65535 * light).astype(np.uint16))
        rows.append(f"{t_us},{t_us},{k}.png")
    (folder / "frames.csv").write_text("\n".join(rows))
    worth, left = worth_of_events(recording, open_frames(folder, encoding="linear"))
    assert worth == (pytest.approx(0.03, rel=0.01), pytest.approx(0.02, rel=0.01))
    assert left < 1e-3


def test_thresholds_from_frames_that_miss_changes(tmp_path):
    """Promise: with 4 px of motion between frames the thresholds come out too low, and the interval
    still contains the sensor's."""
    light, t_s = texture_in_motion(7, 161, SIZE[::-1], 1e-3, travel_px=32.0)
    light /= light.max()
    width, height = SIZE
    model = SensorModel(width=width, height=height, contrast_threshold=C, dark_level=1 / 64)
    write_events(tmp_path / "events.h5", simulate(light, t_s, model))
    rows = ["t_us_start,t_us_end,file"]
    for k in range(0, 161, 20):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.round(65535 * light[k]).astype(np.uint16))
        t_us = round(1e6 * t_s[k])
        rows.append(f"{t_us},{t_us},{k}.png")
    (tmp_path / "frames.csv").write_text("\n".join(rows))
    camera = open_recording(tmp_path / "events.h5")
    found = fit_recording(camera, open_frames(tmp_path, encoding="linear"))
    for one in (found.on, found.off):
        assert one.value < 0.19 < C < one.high < 0.22


def test_thresholds_of_a_simulated_camera(recording, frames):
    """Promise: the sensor's thresholds lie in the intervals, though the image moves by 2 px between
    frames: the light between them follows from the motion."""
    found = fit_recording(recording, frames)
    for one in (found.on, found.off):
        assert one.low < C < one.high
        assert one.high - one.low < 0.2
    assert found.values.on == found.on.value
    assert found.unexplained < 0.2


def test_the_stretch_with_most_events_is_used(made, frames, monkeypatch):
    """Promise: as many successive frames as allowed, around the events; frames before and after
    the recording do not count."""
    monkeypatch.setattr("tasks.recording.levels._MAX_FRAMES", 3)
    t_us = frames.middle_us
    some = [made.events.between(int(t_us[2]) - 50, int(t_us[4]) + 50)]
    np.testing.assert_array_equal(busiest(some, frames).middle_us, t_us[2:5])
    with pytest.raises(TaskError, match="found 2 frames within the time of the events"):
        busiest([made.events.between(int(t_us[2]) - 50, int(t_us[3]) + 50)], frames)


def test_a_clock_that_is_off_is_found(recording, made, tmp_path, monkeypatch):
    """Promise: frames with stamps 1.6 ms early fit best 1.6 ms later, those on the clock of the
    events as they are, though events fire after the change of light."""
    monkeypatch.setattr("tasks.recording.clock.REACH_US", 4000)
    early = open_frames(made.write_frames(tmp_path / "early", shift_us=-1600), encoding="linear")
    found = estimate_shift(recording, early)
    right = estimate_shift(recording, open_frames(made.frames, encoding="linear"))
    assert found.shift_us == pytest.approx(1600, abs=100)
    assert right.shift_us == pytest.approx(0, abs=100)
    assert (found.matters, right.matters) == (True, False)
    notes = []
    on_one_clock(recording, early, 0, notes)
    assert notes[-1].endswith("; --estimate-shift applies this shift")
    on_one_clock(recording, early, -400, notes)  # what the note names replaces what was given
    option, shift_us = notes[-1].split("); ")[1].split()[:2]
    assert option == "--frames-shift-us"
    assert int(shift_us) == pytest.approx(1600, abs=100)


def test_a_clock_is_found_where_the_light_between_frames_is_not(tmp_path):
    """Promise: where the image moves by half its height from frame to frame, so that no light
    between them is known, the shift is still right to a millisecond."""
    light, t_s = texture_in_motion(2, 501, (48, 60), 1e-3, travel_px=112.0)
    t_us = np.round(1e6 * t_s).astype(int) - 8000
    light /= np.percentile(light[0], 99.9)
    model = SensorModel(width=60, height=48, contrast_threshold=0.2, dark_level=1 / 64)
    write_events(tmp_path / "fast.h5", simulate(light, t_s, model))
    lines = ["t_us_start,t_us_end,file"]
    for k in range(0, 501, 100):
        cv2.imwrite(str(tmp_path / f"{k}.tiff"), light[k].astype(np.float32))
        lines.append(f"{t_us[k]},{t_us[k]},{k}.tiff")
    (tmp_path / "frames.csv").write_text("\n".join(lines))
    found = estimate_shift(open_recording(tmp_path / "fast.h5"), open_frames(tmp_path))
    assert found.shift_us == pytest.approx(8000, abs=1000)
    assert found.matters


def test_tracks_follow_the_texture(made, frames):
    """Promise: tracks have the displacement of the texture, and no track that went astray."""
    found = track(frames.light(1), frames.light(2), 20)
    way_px = 12.0 * STEP / (len(made.t_us) - 1)
    assert len(found.centers_px) >= 8
    lengths = np.linalg.norm(found.flow_px, axis=1)
    np.testing.assert_allclose(lengths, way_px, atol=0.15)
    assert np.abs(found.flow_px - found.flow_px.mean(0)).max() < 0.15


@pytest.mark.usefixtures("coarse_clock")
def test_flow_with_frames_beats_doing_nothing(recording, frames):
    """Promise: from zero, both kinds of methods come near the tracks, and zero flow is as far off
    as the texture moves."""
    options = FlowOptions(patch_px=21, windows=3, features=6, search_px=6.0)
    found = evaluate_recording(recording, "flow", frames=frames, flow=options)
    median = medians(found)
    assert median["initial_flow"] == pytest.approx(2.0, abs=0.1)
    assert median["contrast_maximization"] < 0.4
    assert median["contrast_maximization_by_gradient"] < 0.4
    assert median["photometric_flow"] < 0.4
    assert {score.metric for score in found.rows} == {"epe_px"}
    assert any(note.startswith("thresholds: ON 0.") for note in found.notes)


def test_frames_that_show_no_thresholds_say_what_to_give(recording, frames):
    """Promise: the error names the option that makes the fit unnecessary."""
    with pytest.raises(TaskError, match=r"found 2 frames within .*; or give --threshold"):
        evaluate_recording(recording, "flow", frames=frames.some(np.arange(1, 3)))


def test_thresholds_are_fitted_for_methods_that_use_them(made, frames, tmp_path):
    """Promise: ON events alone, from which no thresholds follow, stop no evaluation whose methods
    do not use them; an own method may use them."""
    write_events(tmp_path / "on.h5", made.events.where(made.events.p > 0))
    on = open_recording(tmp_path / "on.h5")
    options = FlowOptions(patch_px=21, windows=3, features=6, search_px=6.0)
    methods = ["contrast_maximization", "initial_flow"]
    found = evaluate_recording(on, "flow", frames=frames, methods=methods, flow=options)
    assert set(medians(found)) == set(methods)
    assert not any("threshold" in note for note in found.notes)
    own = [f"{__name__}:standing_still", "initial_flow"]
    with pytest.raises(TaskError, match="or give --threshold"):
        evaluate_recording(on, "flow", frames=frames, methods=own, flow=options)


@pytest.mark.usefixtures("coarse_clock")
def test_methods_without_a_threshold_answer_the_same_with_any(recording, frames):
    """Promise: the methods of flow that are listed as such do not use the threshold."""
    options = FlowOptions(patch_px=21, windows=1, features=4, search_px=6.0)
    listed = TASKS["flow"].methods.items()
    without = [name for name, method in listed if "threshold" not in method.needs]
    scores = []
    for threshold in (0.2, 0.5):
        given = {"methods": without, "contrast_threshold": threshold}
        found = evaluate_recording(recording, "flow", frames=frames, flow=options, **given)
        scores.append([(row.method, row.value, row.failure) for row in found.rows])
    assert scores[0] == scores[1]


def test_flow_without_frames_sharpens_the_events(recording):
    """Promise: zero flow gains nothing, exactly, and contrast maximization does; methods that need
    an image are left out."""
    options = FlowOptions(window_ms=20.0, windows=3, features=5, patch_px=21, search_px=8.0)
    found = evaluate_recording(recording, "flow", flow=options)
    median = medians(found)
    assert median["initial_flow"] == 1.0
    assert median["contrast_maximization"] > 1.1
    assert set(median) == {
        *("contrast_maximization", "contrast_maximization_by_gradient"),
        *("contrast_maximization_by_plain_variance", "initial_flow"),
    }


def moves_along(flow_px):
    """Return a dense method with the same flow everywhere, and the list of its samples."""
    seen = []

    def method(sample):
        seen.append(sample)
        return np.broadcast_to(np.reshape(flow_px, (2, 1, 1)), sample.shape)

    return method, seen


def dense(recording, monkeypatch, flow_px, **more):
    method, seen = moves_along(flow_px)
    monkeypatch.setattr("tasks.evaluation.scorers.dense_flow.load_method", lambda *_: method)
    options = FlowOptions(window_ms=10.0, windows=3, features=5, patch_px=21, search_px=8.0)
    given = {"methods": ["tasks.methods.baselines:zero_flow"], "flow": options, **more}
    return evaluate_recording(recording, "dense_flow", **given), seen


@pytest.mark.usefixtures("coarse_clock")
def test_dense_flow_with_frames_is_compared_with_tracks(recording, frames, made, monkeypatch):
    """Promise: the true flow is as near to the tracks as these are to the texture; a window and the
    one before it are of equal length and follow one another."""
    tracks = track(frames.light(2), frames.light(3), 20)
    true_px = tracks.flow_px.mean(0)
    found, seen = dense(recording, monkeypatch, true_px, frames=frames)
    assert {score.metric for score in found.rows} == {"epe_px"}
    assert max(score.value for score in found.rows) < 0.3
    still, _ = dense(recording, monkeypatch, [0.0, 0.0], frames=frames)
    assert np.median([score.value for score in still.rows]) == pytest.approx(2.0, abs=0.1)
    for sample in seen:
        assert sample.before.t_us[-1] < sample.during.t_us[0]
        spans = [float(np.ptp(one.t_us)) for one in (sample.before, sample.during)]
        assert spans == pytest.approx([frames.middle_us[1]] * 2, rel=0.02)


def test_dense_flow_without_frames_is_how_much_sharper_events_become(
    recording, frames, monkeypatch
):
    """Promise: zero flow gains nothing, exactly, and the true one does; the first window has none
    before it."""
    of_frames_px = track(frames.light(2), frames.light(3), 20).flow_px.mean(0)
    true_px = 10_000 / frames.middle_us[1] * of_frames_px
    found, seen = dense(recording, monkeypatch, true_px)
    still, _ = dense(recording, monkeypatch, [0.0, 0.0])
    back, _ = dense(recording, monkeypatch, -true_px)
    assert {score.value for score in still.rows} == {1.0}
    assert np.median([score.value for score in found.rows]) > 1.02
    assert np.median([score.value for score in back.rows]) < 1
    assert len(seen) == 3
    assert all(len(sample.before) for sample in seen)


@pytest.mark.usefixtures("coarse_clock")
def test_frames_predicted_from_the_one_before(recording, frames, made, tmp_path):
    """Promise: event integration is far better than the frame before; and with long exposures
    better if they are known than if frames are taken as instants."""
    found = evaluate_recording(recording, "reconstruction", frames=frames)
    median = medians(found)
    assert median["event_integration"] > median["no_events"] + 6
    exposed = open_frames(made.write_frames(tmp_path / "b", exposure=8), encoding="linear")
    given = {"methods": ["event_integration"], "contrast_threshold": C}
    known = evaluate_recording(recording, "reconstruction", frames=exposed, **given).rows
    instants = open_frames(
        made.write_frames(tmp_path / "c", exposure=8, table=False), encoding="linear"
    )
    taken = evaluate_recording(recording, "reconstruction", frames=instants, **given).rows
    gain = np.mean([s.value for s in known]) - np.mean([s.value for s in taken])
    assert gain > 2


@pytest.mark.usefixtures("coarse_clock")
def test_images_from_events_alone_are_scored_at_each_frame(recording, frames):
    """Promise: one score for each frame within the events and each method."""
    found = evaluate_recording(recording, "video", frames=frames)
    times = sorted({score.t_us for score in found.rows})
    assert times == [t for t in frames.middle_us if recording.start_us < t <= recording.end_us]
    median = medians(found)
    assert set(median) == {"high_pass_filter", "high_pass_filter_no_event_decay", "blank"}
    assert all(np.isfinite(score.value) for score in found.rows)


def test_the_command_prints_scores_and_what_it_assumed(made, eres):
    """Promise: the table of a recording is that of a sequence, with the notes after it."""
    code, out, _ = eres(
        *("evaluate", made.events_file, "--frames", made.frames, "--encoding", "linear"),
        *("--task", "reconstruction"),
    )
    assert code == 0
    assert re.search(r"method +median +metric +scores +failed", out)
    assert re.search(r"event_integration +\d+\.\d+ +psnr_db +[45] +0", out)
    assert "decoded as linear" in out
    assert "M events/s in the recording" in out


@pytest.mark.parametrize(("name", "value"), [("resolution", 128), ("cutoff", 50.0), ("speed", 2.0)])
def test_options_of_a_simulated_sensor_are_refused(name, value, made, eres):
    """Promise: what a recording fixes cannot be chosen."""
    code, _, err = eres("evaluate", made.events_file, "--task", "flow", f"--{name}", value)
    assert code == 1
    assert f"is a recording; --{name} {value}" in err


def test_options_of_flow_are_refused_for_images(made, tmp_path, eres):
    """Promise: no option is without effect in silence."""
    frames = made.write_frames(tmp_path / "frames")
    args = "--task", "reconstruction", "--frames", frames, "--patch-px", 21
    code, _, err = eres("evaluate", made.events_file, *args)
    assert code == 1
    assert f"{made.events_file}: reconstruction uses no windows or patches" in err


@pytest.mark.usefixtures("coarse_clock")
def test_the_truth_itself_is_refused_by_name(made, tmp_path, eres):
    """Promise: a diagnostic needs the light of a rendered sequence; the error names the file."""
    frames = made.write_frames(tmp_path / "frames")
    args = "--task", "video", "--frames", frames, "--method", "late_truth"
    code, _, err = eres("evaluate", made.events_file, *args)
    assert code == 1
    assert f"{made.events_file}: method 'late_truth' needs a rendered sequence" in err


def wrong_size(made, folder):
    frames = made.write_frames(folder / "frames")
    for file in frames.glob("*.png"):
        cv2.imwrite(str(file), np.zeros((260, 346), np.uint8))
    return ["--frames", frames], "frame has 346x260 px, but the sensor has 96x72 px"


def other_clock(made, folder):
    frames = made.write_frames(folder / "frames", shift_us=1_700_000_000_000_000)
    return ["--frames", frames], "--frames-shift-us shifts the frames"


def no_times(made, folder):
    frames = made.write_frames(folder / "frames")
    (frames / "frames.csv").unlink()
    return ["--frames", frames], "needs one of frames.csv"


def no_unit(made, folder):
    frames = made.write_frames(folder / "frames", table=False)
    times = (frames / "timestamps.txt").read_text().splitlines()[1:]
    (frames / "timestamps.txt").write_text("\n".join(times))
    return ["--frames", frames], "unit: found none, expected --frames-time-unit s, ms, us or ns"


def ends_before_it_starts(made, folder):
    frames = made.write_frames(folder / "frames")
    lines = (frames / "frames.csv").read_text().splitlines()
    lines[2] = "9000,8000,010.png"
    (frames / "frames.csv").write_text("\n".join(lines))
    return ["--frames", frames], "expected the start and the end of an exposure"


def exposure_in_an_exposure(made, folder):
    frames = made.write_frames(folder / "frames")
    lines = (frames / "frames.csv").read_text().splitlines()
    start = int(lines[2].split(",")[0])
    lines[1] = f"{start - 1},{start + 9_000_000},{lines[1].split(',')[2]}"
    (frames / "frames.csv").write_text("\n".join(lines))
    return ["--frames", frames], "expected a middle after"


def time_beyond_any_clock(made, folder):
    frames = made.write_frames(folder / "frames")
    lines = (frames / "frames.csv").read_text().splitlines()
    lines[2] = f"{10**30},{10**30},010.png"
    (frames / "frames.csv").write_text("\n".join(lines))
    return ["--frames", frames], "frames.csv:3: found '1000000000000"


def missing_file(made, folder):
    frames = made.write_frames(folder / "frames")
    (frames / "020.png").unlink()
    return ["--frames", frames], "lists 020.png, but there is no file"


def both_shifts(made, folder):
    options = ["--frames", made.frames, "--frames-shift-us", 5, "--estimate-shift"]
    return options, "--frames-shift-us or --estimate-shift, not both"


def unknown_images(made, folder):
    frames = made.write_frames(folder / "frames")
    table = frames / "frames.csv"
    table.write_text(table.read_text().replace("000.png", "000.bmp"))
    (frames / "000.png").rename(frames / "000.bmp")
    return ["--frames", frames], "000.bmp: expected an extension of .png"


def frames_out_of_int64(made, tmp_path):
    options = ["--frames", made.frames, "--frames-shift-us", 2**62]
    return options, "frames-shift-us: found 4611686018427387904, expected between -2^62"


def frames_forgotten(made, folder):
    return ["--exposure-us", 5000], "--exposure-us 5000 needs --frames"


def short(made, folder):
    return ["--window-ms", 500], "expected at least 1 x 500 ms"


def endless(made, folder):
    return ["--window-ms", "inf"], "window-ms: found inf, expected at least 0.001"


def coded_floats(made, folder):
    frames = made.write_frames(folder / "frames")
    for file in frames.glob("*.png"):
        light = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE).astype(np.float32) / 255
        cv2.imwrite(str(file.with_suffix(".tiff")), light)
    table = frames / "frames.csv"
    table.write_text(table.read_text().replace(".png", ".tiff"))
    assert open_frames(frames).encoding == "linear"
    return ["--frames", frames, "--encoding", "rec709"], "leave out --encoding rec709"


@pytest.mark.parametrize("unit", [10.0, 1e-3])
def test_floats_have_no_unit(made, tmp_path, unit):
    """Promise: white of float frames is the 99.9th percentile of the first one, as of footage, so
    the unit of their light changes nothing. As footage, to which thresholds are fitted, white is
    1."""
    frames = made.write_frames(tmp_path / "frames")
    table = frames / "frames.csv"
    table.write_text(table.read_text().replace(".png", ".tiff"))
    found = []
    for times in (1.0, unit):
        for file in frames.glob("*.png"):
            light = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE).astype(np.float32)
            cv2.imwrite(str(file.with_suffix(".tiff")), times * light)
        of_unit = open_frames(frames)
        footage = of_unit.footage()
        assert footage.white_level == 1.0
        found.append((of_unit.white_level, of_unit.light(0), of_unit.light(3), next(iter(footage))))
    one, other = found
    assert other[0] == pytest.approx(unit * one[0])
    for light, expected in zip(other[1:], (one[1], one[2], one[1]), strict=True):
        np.testing.assert_allclose(light, expected, rtol=1e-6)
    assert np.percentile(one[1], 99.9) == pytest.approx(1.0, rel=1e-3)


def test_a_black_first_frame_of_floats_is_refused(made, tmp_path):
    frames = made.write_frames(tmp_path / "frames")
    table = frames / "frames.csv"
    table.write_text(table.read_text().replace(".png", ".tiff"))
    for file in frames.glob("*.png"):
        light = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        cv2.imwrite(str(file.with_suffix(".tiff")), np.zeros(light.shape, np.float32))
    with pytest.raises(TaskError, match="first frame defines white, but is black"):
        open_frames(frames)


def needs_an_image(made, folder):
    return ["--method", "photometric_flow"], "needs the image at the start of each window"


BAD = (wrong_size, other_clock, no_times, no_unit, ends_before_it_starts, missing_file)
BAD += (time_beyond_any_clock, exposure_in_an_exposure)
BAD += (
    both_shifts,
    frames_out_of_int64,
    unknown_images,
    frames_forgotten,
    short,
    endless,
    coded_floats,
    needs_an_image,
)


@pytest.mark.parametrize("bad", BAD, ids=lambda one: one.__name__)
def test_input_that_does_not_fit_is_one_line(bad, made, tmp_path, eres):
    """Promise: an error names what was found and what was expected, with exit code 1."""
    options, said = bad(made, tmp_path)
    code, out, err = eres("evaluate", made.events_file, "--task", "flow", *options)
    assert (code, out) == (1, "")
    assert said in err
    assert len(err.strip().splitlines()) == 1


def test_tasks_that_need_more_say_it(made, eres):
    """Promise: pose tracking, and images without frames, are refused with what is missing."""
    for task, said in (
        ("tracking", "needs poses and a plane, which a recording does not have"),
        ("video", "needs frames, which a recording without --frames does not have"),
        ("dense_flow", "needs a network; give --method our_flow_all_light, --weights"),
    ):
        code, _, err = eres("evaluate", made.events_file, "--task", task)
        assert (code, said in err) == (1, True)


def test_files_that_cannot_be_opened(tmp_path, eres):
    """Promise: the error names the file, for a file without a size and for none."""
    (tmp_path / "a.txt").write_text("0.001 3 4 1\n")
    for name, said in (("a.txt", "does not store the sensor's size"), ("b.txt", "no such file")):
        code, _, err = eres("evaluate", tmp_path / name, "--task", "flow")
        assert code == 1
        assert f"{tmp_path / name}: " in err
        assert said in err


def test_a_recording_without_events(tmp_path, eres):
    """Promise: an empty file is an error."""
    none = np.empty(0, np.int64), *np.empty((2, 0), np.uint16), np.empty(0, np.int8)
    write_events(tmp_path / "a.h5", Events(*none, 64, 48))
    code, _, err = eres("evaluate", tmp_path / "a.h5", "--task", "flow")
    assert (code, "has no events" in err) == (1, True)


def test_frames_without_exposures_are_a_warning(made, tmp_path, caplog):
    """Promise: the reader says that it takes frames as instants, unless their exposure is given."""
    folder = made.write_frames(tmp_path / "frames", table=False)
    assert len(open_frames(folder)) == 7
    assert "states no exposures; frames count as instants" in caplog.text
    caplog.clear()
    found = open_frames(folder, exposure_us=900)
    assert set((found.end_us - found.start_us).tolist()) == {900}
    assert not caplog.text


def test_lists_of_images_as_in_the_rpg_dataset(made, tmp_path):
    """Promise: images.txt has a time and a file in each line, in the unit that is given."""
    folder = made.write_frames(tmp_path / "frames")
    (folder / "frames.csv").unlink()
    (folder / "images.txt").write_text("0.001500000 000.png\n0.0025 010.png\n")
    found = open_frames(folder, time_unit="s", exposure_us=0)
    assert found.start_us.tolist() == [1500, 2500]
    assert [file.name for file in found.files] == ["000.png", "010.png"]
    with pytest.raises(TaskError, match="unit: found none, expected --frames-time-unit"):
        open_frames(folder, exposure_us=0)
    with pytest.raises(
        TaskError, match=r"000.png: found an exposure .*, expected times between -2\^61"
    ):
        open_frames(folder, time_unit="s", exposure_us=1 << 61)
    (folder / "images.txt").write_text("0.001 000.png\n1e999999 010.png\n")
    with pytest.raises(TaskError, match=r"images.txt:2: found '1e999999 010.png', expected a time"):
        open_frames(folder, time_unit="s", exposure_us=0)


def test_lists_of_images_with_tabs_and_names_with_spaces(made, tmp_path):
    """Promise: any white space separates the time from the file, whose name may have spaces."""
    folder = made.write_frames(tmp_path / "frames")
    (folder / "frames.csv").unlink()
    (folder / "010.png").rename(folder / "no 10.png")
    (folder / "images.txt").write_text("0.0015\t000.png\n0.0025 \t no 10.png\n")
    found = open_frames(folder, time_unit="s", exposure_us=0)
    assert found.start_us.tolist() == [1500, 2500]
    assert [file.name for file in found.files] == ["000.png", "no 10.png"]
    (folder / "images.txt").write_text("0.0015 000.png\n0.0025\n")
    with pytest.raises(TaskError, match=r"images.txt:2: found '0.0025', expected a time and a f"):
        open_frames(folder, time_unit="s", exposure_us=0)


def test_images_of_events_with_their_times(made, tmp_path, eres):
    """Promise: PNG images at a rate, times in microseconds; the folder is one that
    `eres simulate` reads, and is made with the folders above it."""
    out = tmp_path / "new" / "images"
    code, said, _ = eres("video", made.events_file, "--out", out, "--fps", 100)
    times = (out / "timestamps.txt").read_text().splitlines()
    files = sorted(out.glob("*.png"))
    assert (code, times[0], len(files)) == (0, "# unit: us", len(times) - 1)
    assert f"{len(files)} images of 96x72 px" in said
    assert np.diff(np.array(times[1:], int)).tolist() == [10_000] * (len(files) - 1)
    image = cv2.imread(str(files[-1]), cv2.IMREAD_UNCHANGED)
    assert (image.shape, image.dtype) == ((72, 96), np.uint8)
    assert image.std() > 20
    assert sorted(out.parent.iterdir()) == [out]
    code, _, err = eres("video", made.events_file, "--out", out)
    assert (code, "add --overwrite" in err) == (1, True)
    code, _, _ = eres("video", made.events_file, "--out", out, "--fps", 50, "--overwrite")
    assert (code, len(list(out.glob("*.png"))) < len(files)) == (0, True)


def test_images_that_appear_meanwhile_are_kept(made, tmp_path, eres, monkeypatch):
    """Promise: without --overwrite, a folder of images that another process wrote stays."""
    out, drawn = tmp_path / "images", video.picture

    def meanwhile(*arguments):
        out.mkdir(exist_ok=True)
        (out / "000000.png").write_bytes(b"of others")
        return drawn(*arguments)

    monkeypatch.setattr(video, "picture", meanwhile)
    code, _, err = eres("video", made.events_file, "--out", out, "--fps", 50)
    assert (code, f"{out}: already exists" in err) == (1, True)
    assert [file.name for file in tmp_path.iterdir()] == ["images"]
    assert [file.read_bytes() for file in out.iterdir()] == [b"of others"]


def test_images_go_into_the_folder_that_is_there(made, tmp_path, eres, monkeypatch):
    """Promise: the folder may be the working directory, or a link, and stays the same folder."""
    real = tmp_path / "real"
    real.mkdir()
    (tmp_path / "link").symlink_to(real)
    monkeypatch.chdir(real)
    folder = real.stat().st_ino
    for out, options in ((".", ["--fps", 50]), (tmp_path / "link", ["--fps", 100, "--overwrite"])):
        code, said, err = eres("video", made.events_file, "--out", out, *options)
        assert (code, err) == (0, ""), err
        count = int(re.search(r"(\d+) images", said)[1])
        assert len(list(real.glob("*.png"))) == count
        assert len((real / "timestamps.txt").read_text().splitlines()) == count + 1
    assert real.stat().st_ino == folder
    assert {one.name for one in tmp_path.iterdir()} == {"real", "link"}


def test_images_are_those_of_the_filter(made, recording, tmp_path, eres):
    """Promise: an image has the events before its time, and no later one."""
    from tasks.methods.high_pass_filter import HighPassFilter
    from tasks.video import picture

    eres("video", made.events_file, "--out", tmp_path / "a", "--fps", 100, "--start", 0.03)
    filter = HighPassFilter(*SIZE, 0.2)
    filter.push(made.events.between(0, 30_000))
    expected = np.round(255 * picture(filter.image(30_000), SIZE[::-1], "none"))
    found = cv2.imread(str(tmp_path / "a" / "000000.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(found, expected)


def test_images_have_the_threshold_of_the_file(tmp_path, eres):
    """Promise: a method scales log intensity by the sensor's C, the mean of ON and OFF."""
    from tasks.methods.high_pass_filter import HighPassFilter
    from tasks.video import picture

    model = SensorModel(width=16, height=12, contrast_threshold=0.4, contrast_threshold_off=0.6)
    t_s = np.arange(60) * 1e-3
    phase = np.linspace(0, 3, 16)[None, :] + np.linspace(0, 2, 12)[:, None]
    events = simulate(np.exp(2 * np.sin(60 * t_s[:, None, None] + phase)), t_s, model)
    write_events(tmp_path / "own.h5", events)
    eres("video", tmp_path / "own.h5", "--out", tmp_path / "a", "--fps", 100, "--start", 0.04)
    filter = HighPassFilter(16, 12, 0.5)
    filter.push(events.between(0, 40_000))
    expected = np.round(255 * picture(filter.image(40_000), (12, 16), "none"))
    found = cv2.imread(str(tmp_path / "a" / "000000.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--fps", 0], "fps: found 0, expected above 0"),
        (["--fps", 1], "no image at 1 Hz"),
        (["--fps", 1000001, "--end", 2e-3], "fps: found 1000001, expected above 0 and at most 1e6"),
        (["--start", "nan"], "--start, --end: found nan to 0."),
        (["--start", "inf"], "--start, --end: found inf to 0."),
        (["--start", 0.5, "--end", 0.1], "--start, --end: found 0.5 to 0.1 s"),
        (["--start", 1e6 + 0.5, "--end", 1e6], "--start, --end: found 1000000.5 to 1000000 s"),
        (["--end", "nan"], "to nan s, expected finite times"),
        (["--method", "blnk"], "no method 'blnk'"),
        (["--equalization", "some"], "equalization: found 'some', expected one of none"),
    ],
)
def test_images_that_cannot_be_made(options, said, made, tmp_path, eres):
    """Promise: an error in one line, and no folder."""
    code, _, err = eres("video", made.events_file, "--out", tmp_path / "images", *options)
    assert (code, said in err) == (1, True)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_of_other_files_is_never_replaced(made, tmp_path, eres):
    """Promise: --overwrite replaces images, nothing else."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("keep")
    code, _, err = eres("video", made.events_file, "--out", tmp_path / "mine", "--overwrite")
    assert (code, "contains notes.txt" in err) == (1, True)
    assert (tmp_path / "mine" / "notes.txt").read_text() == "keep"


def test_a_calibration_takes_the_distortion_out(made, tmp_path, eres):
    """Promise: images are as OpenCV undistorts them; a calibration of another camera is refused."""
    out = tmp_path / "images"
    (tmp_path / "calib.txt").write_text("90 90 47.5 35.5 -0.3 0.1 0 0 0\n")
    eres("video", made.events_file, "--out", out, "--fps", 50)
    plain = cv2.imread(str(out / "000001.png"), cv2.IMREAD_UNCHANGED)
    code, _, _ = eres(
        *("video", made.events_file, "--out", out, "--fps", 50, "--overwrite"),
        *("--calibration", tmp_path / "calib.txt"),
    )
    found = cv2.imread(str(out / "000001.png"), cv2.IMREAD_UNCHANGED)
    K = np.array([[90, 0, 47.5], [0, 90, 35.5], [0, 0, 1.0]])
    assert code == 0
    np.testing.assert_array_equal(found, cv2.undistort(plain, K, np.array([-0.3, 0.1, 0, 0, 0])))
    for text, said in (
        ("335 335 130 99 -0.1 0.1 0 0 0", "cx: found 130 px, expected about 47.5 px"),
        ("90 90 47.5", "found 3 words, expected the finite numbers fx fy cx cy"),
        (json.dumps({"fx": 90}), "expected the finite numbers"),
    ):
        (tmp_path / "calib.txt").write_text(text)
        code, _, err = eres(
            *("video", made.events_file, "--out", tmp_path / "b"),
            *("--calibration", tmp_path / "calib.txt"),
        )
        assert (code, said in err) == (1, True)


def test_windows_are_spread_evenly():
    """Promise: a long recording is sampled from its start to its end, without repetition."""
    assert spread(range(3), 5) == [0, 1, 2]
    found = spread(range(1000), 20)
    assert len(set(found)) == 20
    assert set(np.diff(found)) == {50}


def whole_sensor(events, end_us):
    """The events of a square sensor as the patch of a flow, from 0 on, started without motion."""
    side = events.width
    return flow_sample(
        events,
        *(0, end_us),
        log_image=np.zeros((side, side)),
        contrast_threshold=0.2,
        center_px=np.full(2, 0.5 * side),
        side_px=side,
        initial=np.zeros(2),
        initial_sigma_px=1.0,
    )


@pytest.mark.parametrize("flow", [(0.0, 0.0), (2.3, -1.1)])
def test_evenly_spread_events_have_no_contrast(flow):
    """Promise: the image that is subtracted is theirs at every flow."""
    side, count = 9, _EXPOSURES
    t_us, row, column = (one.ravel() for one in np.mgrid[500 : 1000 * count : 1000, :side, :side])
    events = make_events(t_us, column, row, np.ones(t_us.size), side, side)
    sample = whole_sensor(events, 1000 * count)
    contrast = Contrast(sample, 4.0)
    assert len(contrast.patch.exposure_t) == count
    assert contrast(np.array(flow)) < 1e-20


def test_off_the_grid_zero_flow_is_not_sharper():
    """Promise: events without any motion are sharper at zero flow than at flows around it only
    because they lie on whole pixels: spread over their pixels they are not, near or far."""
    rng = np.random.default_rng(3)
    count, side = 20_000, 61
    t_us = np.sort(rng.integers(0, 10_000, count))
    x, y = rng.integers(0, side, (2, count)).astype(np.uint16)
    sample = whole_sensor(Events(t_us, x, y, np.ones(count, np.int8), side, side), 10_000)
    around = np.stack([np.cos(a := np.linspace(0.2, 6.2, 12)), np.sin(a)], axis=1)
    for radius_px, sharper in ((0.45, 1.01), (3.0, 1.1)):
        gains = []
        for given in (sample, off_grid(sample)):
            contrast = Contrast(given, 4.0)
            other = np.mean([contrast(radius_px * flow) for flow in around])
            gains.append(contrast(np.zeros(2)) / other)
        assert gains[0] > sharper
        assert abs(gains[1] - 1) < 0.02
