"""Methods with a network, without PyTorch: windows, weights, dense flow; and the oracles of video.

`test_learned_networks.py` tests the networks themselves.
"""

import hashlib
import math
import sys
import tracemalloc
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eres_render import Clip, Renderer, load_scene, render_clip, render_scene
from hashed_fill import hashed_events
from sensor import Events, SensorModel
from sensor.representations import voxel_grid
from tasks.dense_flow import DenseFlowSample, flow_at
from tasks.errors import TaskError, WeightsError
from tasks.evaluation.evaluate import method_timings
from tasks.evaluation.rendered_clip import RenderedClip
from tasks.evaluation.scorers.dense_flow import DenseFlowScorer
from tasks.evaluation.scorers.video import VideoScorer
from tasks.evaluation.sequence import evaluate_sequence
from tasks.evaluation.settings import DenseFlow, Flow, Video
from tasks.evaluation.source import Window, true_points
from tasks.flow import Features
from tasks.methods import code_of, load_method, task_of
from tasks.methods.baselines import initial_flow_everywhere
from tasks.methods.e2vid import E2vid
from tasks.methods.eraft import estimate as estimate_eraft
from tasks.methods.networks import named_weights, weights_of
from tasks.methods.true_video import FilteredTruth, LateTruth, TrueLight
from tasks.recording.video import network_options
from tasks.registry import TASKS
from tasks.study.config import preset, with_weights
from tasks.study.run import run_study
from tasks.study.run.jobs import jobs_of
from tasks.study.study_file import read_study
from tasks.video import ImageTaker

W, H, BINS = 12, 9, 5


class Recorder:
    """Stands for a network: keeps the grids, and numbers the images."""

    bins, normalized = BINS, True

    def __init__(self):
        self.grids = []

    def image(self, grid, states):
        assert (states or 0) == len(self.grids), "the state of the window before"
        self.grids.append(grid)
        return np.full(grid.shape[1:], 0.1 + 0.01 * len(self.grids), np.float32), len(self.grids)

    def flow(self, old, new):
        self.grids += [old, new]
        return np.zeros((2, *old.shape[1:]), np.float32)


def stream(count=600, duration_us=100_000):
    return hashed_events("windows", count, W, H, duration_us)[0]


def run(events, times=(), cuts=(), **options):
    """Return the grids that a network got, and the images at given times."""
    network = Recorder()
    taker = ImageTaker(E2vid(W, H, 0.2, network=network, **options), sorted(times))
    edges, taken = [0, *sorted(cuts), len(events)], []
    for first, last in pairwise(edges):
        taken += taker.take(events[first:last])
    taken += taker.rest()
    return network.grids, taken


def assert_windows(grids, events, edges_us):
    assert len(grids) == len(edges_us) - 1
    for grid, (start, end) in zip(grids, pairwise(edges_us), strict=True):
        np.testing.assert_array_equal(grid, voxel_grid(events.between(start, end), BINS))


def test_windows_of_e2vid_divide_the_time_between_images():
    """Promise: windows of 25 ms end at images 50 ms apart; each grid has its window's events."""
    events = stream()
    grids, taken = run(events, [50_000, 100_000])
    assert_windows(grids, events, [0, 25_000, 50_000, 75_000, 100_000])
    values = [math.exp(image[0, 0]) for _, image in taken]
    np.testing.assert_allclose(values, [0.12, 0.14], rtol=1e-6)


def test_windows_of_a_faster_sequence_have_fractions_of_a_microsecond():
    """Promise: at three times the speed, windows end where the images do, without extra ones."""
    events = stream()
    times = [round(1e6 * k * 0.05 / 3) for k in range(1, 6)]
    grids, _ = run(events, times, window_us=25_000 / 3)
    edges = [round(25_000 / 3 * k) for k in range(12)]  # the last before the last event
    assert_windows(grids, events, edges)


def test_windows_of_a_recording_are_equal_whatever_the_rate_of_images():
    """Promise: at 30 images a second each has one window, not one of 25 ms and the rest."""
    events = stream()
    times = [round(1e6 * k / 30) for k in range(1, 4)]
    grids, _ = run(events, times, **network_options("e2vid", times))
    assert_windows(grids, events, [0, *times])
    assert network_options("blank", times) == network_options("e2vid", times[:1]) == {}


def test_an_image_between_windows_ends_one():
    """Promise: an image sees all events before it, and the next window begins there."""
    events = stream()
    grids, _ = run(events, [40_000, 70_000])
    assert_windows(grids[:4], events, [0, 25_000, 40_000, 65_000, 70_000])


def test_events_of_ended_windows_are_forgotten():
    """Promise: at the end of a window a network keeps no events, which each sensor would have."""
    events = stream(count=100_000)
    run(events, [100_000])  # compiles
    method = E2vid(W, H, 0.2, network=Recorder())
    tracemalloc.start()
    method.push(events.copy())
    method.image(100_000)
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept < 13 * 5000  # bytes of 5,000 events; a window has 25,000


def test_windows_begin_with_the_first_event_and_may_be_empty():
    """Promise: a stretch without events before the first is skipped; later ones count."""
    late = stream(10, 5000)
    late = Events(late.t_us + 10**12, late.x, late.y, late.p, W, H)
    grids, taken = run(late, [10**12 - 1, 10**12 + 75_000])
    assert not taken[0][1].any()
    assert [bool(grid.any()) for grid in grids] == [True, False, False]


def test_windows_may_hold_a_number_of_events():
    """Promise: windows of N = floor(share * pixels) events follow one another without overlap."""
    events = stream()
    count = math.floor(0.35 * W * H)
    grids, taken = run(events, [0, 10**6], events_per_px=0.35)
    assert len(grids) == len(events) // count
    for k, grid in enumerate(grids):
        expected = voxel_grid(events[k * count : (k + 1) * count], BINS)
        np.testing.assert_array_equal(grid, expected)
    assert not taken[0][1].any()


@settings(max_examples=15)
@given(
    st.lists(st.integers(0, 600), max_size=5),
    st.lists(st.integers(0, 120_000), max_size=3),
    st.sampled_from([{}, {"window_us": 9000.0}, {"events_per_px": 0.3}]),
)
def test_any_division_of_the_stream_gives_the_same_windows(cuts, times, options):
    """Promise: the division of the stream changes neither grids nor images."""
    events = stream()
    whole, images = run(events, times, **options)
    parts, others = run(events, times, cuts, **options)
    assert len(whole) == len(parts)
    np.testing.assert_array_equal(whole, parts)
    np.testing.assert_array_equal([i for _, i in images], [i for _, i in others])


def test_eraft_gets_the_grids_of_both_windows():
    """Promise: the previous window comes first, both in the convention of E-RAFT."""
    events, network = stream(), Recorder()
    parts = events.between(0, 50_000), events.between(50_000, 100_000)
    flow = estimate_eraft(
        DenseFlowSample(*parts, np.zeros((1, 2)), np.zeros((1, 2))), network=network
    )
    assert flow.shape == (2, H, W)
    for grid, part in zip(network.grids, parts, strict=True):
        np.testing.assert_array_equal(grid, voxel_grid(part, BINS, convention="eraft"))


# Weights


def test_weights_are_named_or_for_the_only_network(tmp_path):
    """Promise: NAME=FILE for each, or a bare FILE if one method needs it; others are refused."""
    found = named_weights(["e2vid=a=b.pth", "eraft=c.tar"], ["e2vid", "eraft"])
    assert found["e2vid"].endswith("/a=b.pth")
    assert found["eraft"].endswith("/c.tar")
    assert list(named_weights(["a.pth"], ["blank", "e2vid"])) == ["e2vid"]
    found = named_weights(["runs/seed=3/a.pth"], ["e2vid"])
    assert found["e2vid"].endswith("/runs/seed=3/a.pth")
    for files, methods, words in (
        (["a.pth"], ["blank"], "found 'a.pth', expected e2vid=a.pth or firenet=a.pth or"),
        (["a.pth"], ["e2vid", "eraft"], "expected e2vid=a.pth or eraft=a.pth"),
        (["e2vid=a.pth"], ["high_pass_filter"], "'e2vid': is not among the methods"),
        (["e2vd=a.pth"], ["e2vid"], "'e2vd': did you mean 'e2vid'"),
        (["e2vid=a", "e2vid=b"], ["e2vid"], "'e2vid': has two files"),
    ):
        with pytest.raises(WeightsError, match=words):
            named_weights(files, methods)


def test_our_weights_come_with_eres(tmp_path):
    """Promise: our networks need no file; a given one is used in their place, and rows of other
    weights have other names."""
    name = "our_reconstruction_all_light"
    ours = Path(weights_of(name))
    assert ours.name == f"{name}.pt"
    assert sum(file.stat().st_size for file in ours.parent.glob("*.pt")) < 14e6
    assert weights_of("e2vid") is None
    other = tmp_path / "mine.pt"
    other.write_bytes(b"mine")
    assert weights_of(name, {name: str(other)}) == str(other)
    assert named_weights([str(other)], [name]) == {name: str(other)}
    assert named_weights([str(other)], [name, "e2vid"]) == {"e2vid": str(other)}
    assert code_of([name]) == {name: f"2 {hashlib.sha256(ours.read_bytes()).hexdigest()}"}
    assert code_of([name], {name: str(other)}) == {name: f"2 {hashlib.sha256(b'mine').hexdigest()}"}


def test_a_network_needs_weights_and_torch(tmp_path, monkeypatch):
    """Promise: one line says which is missing, and how to get it."""
    with pytest.raises(WeightsError, match=r"needs weights; give --weights e2vid=FILE"):
        load_method("video", "e2vid")
    with pytest.raises(WeightsError, match=r"none.pth: cannot be read: No such file"):
        load_method("video", "e2vid", {"e2vid": str(tmp_path / "none.pth")})
    file = tmp_path / "weights.pth"
    file.write_bytes(b"weights")
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "tasks.learned.e2vid", raising=False)
    with pytest.raises(ModuleNotFoundError, match="torch"):
        load_method("video", "e2vid", {"e2vid": str(file)})


def test_methods_are_listed_without_torch(eres):
    """Promise: `eres methods` says which methods need weights and which are diagnostics."""
    code, out, _ = eres("methods")
    assert code == 0
    lines = {line.split()[1]: line for line in out.splitlines()}
    assert "PyTorch, --weights" in lines["e2vid"]
    assert "PyTorch, --weights" in lines["eraft"]
    assert lines["our_reconstruction_all_light"].endswith("PyTorch")
    assert "diagnostic" in lines["late_truth"]
    assert TASKS["video"].usual() == (
        *("high_pass_filter", "high_pass_filter_no_event_decay", "blank"),
    )
    assert "e2vid" in TASKS["video"].usual(["e2vid"])
    assert task_of("e2vid") == "video"
    with pytest.raises(TaskError, match=r"^no method 'erafd'; did you mean 'eraft'"):
        task_of("erafd")
    with pytest.raises(
        TaskError, match="'initial_flow' belongs to several tasks: flow, dense_flow"
    ):
        task_of("initial_flow")


STUDY = """
scenes = ["carpet"]
[evaluate.video]
methods = ["e2vid", "blank"]
[weights]
e2vid = "weights/a.pth"
"""


def test_the_weights_of_a_study_are_in_its_keys(tmp_path):
    """Promise: a job's key depends on the content of its weights, but not on their path."""
    (tmp_path / "weights").mkdir()
    (tmp_path / "study.toml").write_text(STUDY)
    for name, content in (("a", b"one"), ("b", b"one"), ("c", b"two")):
        (tmp_path / "weights" / f"{name}.pth").write_bytes(content)
    scene = load_scene("carpet")

    def keys(study):
        return [
            [job.key for job in jobs_of(study, scene) if task in job.evaluate]
            for task in ("video", "flow")
        ]

    study = read_study(tmp_path / "study.toml")
    assert study.evaluate["video"].weights == {"e2vid": f"{tmp_path}/weights/a.pth"}
    found = [keys(with_weights(study, {"e2vid": f"{tmp_path}/weights/{n}.pth"})) for n in "abc"]
    assert keys(study) == found[0] == found[1]
    assert found[1][0] != found[2][0]
    assert found[1][1] == found[2][1]
    (tmp_path / "study.toml").write_text(STUDY.replace("e2vid =", "eraft ="))
    with pytest.raises(WeightsError, match="eraft is not among the study's"):
        read_study(tmp_path / "study.toml")


def test_a_study_without_weights_is_refused_before_it_starts(tmp_path):
    """Promise: nothing is written or rendered."""
    quick = preset("quick")
    video = replace(quick.evaluate["video"], methods=("e2vid",))
    evaluate = type(quick.evaluate)(**{**quick.evaluate, "video": video})
    with pytest.raises(WeightsError, match=r"e2vid under \[weights\] in the study's file"):
        run_study(replace(quick, evaluate=evaluate), tmp_path / "run")
    assert not (tmp_path / "run").exists()


# Dense flow


def test_the_initial_flow_is_that_of_the_nearest_feature():
    """Promise: at the features, the baseline is exactly their initial flow."""
    rng = np.random.default_rng(0)
    centers = np.array([[2.2, 3.1], [9.4, 2.6], [6.0, 7.7]])
    initial = rng.normal(size=(3, 2))
    events = stream(0)
    flow = initial_flow_everywhere(DenseFlowSample(events, events, centers, initial))
    np.testing.assert_allclose(flow_at(flow, centers), initial, rtol=1e-14)


def test_flow_is_read_between_the_centers_of_pixels():
    """Analytic: a linear flow is read exactly, also at whole pixels and at the edge's centers."""
    y, x = np.mgrid[:H, :W] + 0.5
    flow = np.stack([2 * x - y, 0.5 * x + 3 * y])
    points = np.array([[0.5, 0.5], [W - 0.5, H - 0.5], [3.3, 4.8], [7.0, 2.0]])
    px, py = points.T
    expected = np.stack([2 * px - py, 0.5 * px + 3 * py], axis=1)
    np.testing.assert_allclose(flow_at(flow, points), expected, rtol=1e-14)
    np.testing.assert_array_equal(flow_at(flow, np.array([[-3.0, H + 3.0]]))[0], flow[:, -1, 0])


def test_dense_flow_on_a_clip(small_carpet, tmp_path):
    """Promise: the error of zero flow is the motion; a clip that begins too late is refused."""
    options = {"resolution": 64, "spp": 4, "samples": 1, "max_displacement_px": 1.0}
    (clip,) = render_scene(small_carpet, tmp_path / "long", warm_up_s=0.06, **options)
    rows = evaluate_sequence(clip, "dense_flow", camera=64)
    by_method = {
        name: [r.value for r in rows if r.method == name] for name in TASKS["dense_flow"].methods
    }
    assert not by_method["eraft"]
    assert len(by_method["zero_flow"]) == len(by_method["initial_flow"]) == 20
    assert np.median(by_method["zero_flow"]) > 3 * np.median(by_method["initial_flow"]) > 1
    (short,) = render_scene(small_carpet, tmp_path / "short", **options)
    with pytest.raises(TaskError, match=r"one window before .* a longer --warm-up"):
        evaluate_sequence(short, "dense_flow", camera=64)
    # Frames that end before the path of tracking, or before events that are late, are refused too.
    with pytest.raises(TaskError, match=r"frames last 12\.5 ms .* the path needs 14 ms"):
        evaluate_sequence(short, "tracking", camera=64, speed=4.0, methods=["initial_path"])
    with pytest.raises(TaskError, match=r"plus 10 ms for delays"):
        evaluate_sequence(short, "tracking", camera=64, speed=2.5)
    with pytest.raises(TaskError, match=r"speed: found 0"):
        evaluate_sequence(short, "tracking", camera=64, speed=0.0)


@pytest.mark.parametrize(
    ("task", "said"),
    [
        ("tracking", "tracking: the scene's path .* speed 2 needs -0.004 to 0.032 s"),
        ("dense_flow", "dense_flow: the frames begin at 0 s, expected -0.02 s or earlier"),
    ],
)
def test_tasks_of_clips_refuse_a_continuous_sequence(small_carpet, tmp_path, task, said):
    """Promise: what the path before the window is needed for is refused with what to render."""
    options = {"resolution": 16, "spp": 1, "max_displacement_px": 2.0, "duration_s": 0.02}
    (whole,) = render_scene(small_carpet, tmp_path, continuous=True, **options)
    with pytest.raises(TaskError, match=said + ".* without --continuous"):
        evaluate_sequence(whole, task, camera=16, speed=2.0)


def test_tracking_refuses_a_window_at_the_end_of_the_path(small_carpet, tmp_path):
    """Promise: the spline that is tracked needs a pose 16 ms after its start, not only frames."""
    renderer = Renderer(small_carpet, width=16, spp=1)
    last = Clip(0, t_start_s=9.9, t_window_start_s=9.95, t_window_end_s=10.0)
    clip = render_clip(renderer, last, tmp_path, max_displacement_px=2.0)
    options = {"camera": 16, "methods": ["initial_path"]}
    with pytest.raises(TaskError, match=r"covers 0 to 10 s, but .* to 10\.006 s"):
        evaluate_sequence(clip, "tracking", speed=3.5, **options)
    assert len(evaluate_sequence(clip, "tracking", speed=3.0, **options)) == 1


def test_dense_flow_keeps_the_events_of_two_windows_only():
    """Promise: those of the warm-up do not stay in memory."""
    size = 1 << 14
    source = SimpleNamespace(
        window=Window(10**9, 10**9 + 9), before_us=lambda: 10**9 - 9, points=repr
    )
    scorer = DenseFlowScorer(source, DenseFlow())
    tracemalloc.start()
    for k in range(40):
        x = np.zeros(size, np.uint16)
        t_us = np.arange(size) + k * size
        scorer.push(Events(t_us, x, x.copy(), np.ones(size, np.int8), 1, 1))
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept < 5 * 13 * size  # bytes of five parts


def test_one_flow_of_a_sensor_is_one_estimate():
    """Promise: its time and its events count once, not once for each feature."""
    centers_px = np.array([[2.2, 3.1], [9.4, 2.6], [6.0, 7.7]])
    task = DenseFlow(methods=("zero_flow", "initial_flow"))
    features = Features(W, H, centers_px, np.ones((3, 2)), np.zeros((3, 2)))
    points = true_points(features, task, range(3))
    source = SimpleNamespace(window=Window(0, 9), before_us=lambda: -9, points=lambda task: points)
    scorer = DenseFlowScorer(source, task)
    scorer._parts = [stream(0)], [stream(1)]
    setting = SimpleNamespace(model=SimpleNamespace(width=W, height=H), name="")
    timings = method_timings((setting, "dense_flow", score) for score in scorer.scores())
    events = len(stream(0)) + len(stream(1))
    assert [(one.estimates, one.events) for one in timings] == [(1, events)] * 2


# Oracles


def test_the_estimate_of_dense_flow_is_that_of_its_networks():
    """Promise: baselines cost nothing, our network a fraction of E-RAFT."""

    def seconds(*methods):
        return DenseFlow(methods=methods).score_s(1280, 1280)

    assert seconds("zero_flow", "initial_flow") == 0
    assert seconds("eraft", "zero_flow") == seconds("eraft") > 2 * seconds("our_flow_all_light") > 0


def test_the_estimate_follows_the_pixels_of_a_wide_sensor():
    """Promise: half as high takes half the time; patches are square and follow the width."""
    dense = DenseFlow(methods=("our_flow_all_light",))
    assert dense.score_s(640, 320) == pytest.approx(dense.score_s(640, 640) / 2)
    assert Flow().score_s(640, 320) == Flow().score_s(640, 640) > 0


def sequence_of(log_light, t_s):
    """Return a sequence of 2 x 3 px frames whose log light is a function of time."""
    ones = np.ones((2, 3))
    return SimpleNamespace(t_s=t_s, frame=lambda k: np.exp(log_light(t_s[k])) * ones)


def light_of(log_light, t_s, cutoff_hz=50.0, speed=1.0):
    return TrueLight(sequence_of(log_light, t_s), 0.0, cutoff_hz, speed)


@pytest.mark.parametrize("speed", [1.0, 2.0])
@pytest.mark.parametrize("oracle", [LateTruth, FilteredTruth])
def test_a_steady_rise_is_two_time_constants_late(oracle, speed):
    """Physics: both poles delay a ramp by 1 / (pi f); speed acts before them."""
    t_s = np.linspace(0, 0.4, 37) ** 1.1
    method = oracle(3, 2, 0.2, light=light_of(lambda t: 5 * t, t_s, 50.0, speed))
    for t_us in (100_000, 123_456, 170_000):
        expected = 5 * speed * (1e-6 * t_us - 1 / (math.pi * 50))
        np.testing.assert_allclose(method.image(t_us), expected, atol=1e-8)


@pytest.mark.parametrize("oracle", [LateTruth, FilteredTruth])
def test_without_a_filter_the_oracles_are_the_truth(oracle):
    """Promise: an ideal photoreceptor is neither late nor slow."""
    t_s = np.linspace(0, 0.1, 11)
    method = oracle(3, 2, 0.2, light=light_of(lambda t: math.sin(60 * t), t_s, math.inf))
    for t_us in (0, 10_000, 55_000, 100_000):
        expected = np.interp(1e-6 * t_us, t_s, np.sin(60 * t_s))
        np.testing.assert_allclose(method.image(t_us), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "cutoff_hz", "found"),
    [
        ("one_pole", 50.0, "the photoreceptor 'one_pole'"),
        ("v2e", 200.0, "the photoreceptor 'v2e'"),
        ("two_pole", 50.0, "a cutoff that follows the light"),
    ],
)
def test_the_oracles_are_about_two_poles(kind, cutoff_hz, found):
    """Promise: no oracle bounds the score of a photoreceptor that it does not know."""
    model = SensorModel(
        width=3, height=2, cutoff_hz=cutoff_hz, photoreceptor=kind, cutoff_reference=1.0
    )
    setting = SimpleNamespace(model=model, speed=1.0, start_us=0, end_us=100_000)
    sequence = SimpleNamespace(window_s=(0.0, 0.1))
    reference = SimpleNamespace(sequence=sequence, dark_level=0.0)
    with pytest.raises(TaskError, match=f"found {found}, but the method needs .*'two_pole'"):
        VideoScorer(RenderedClip(reference, setting), Video(methods=("late_truth",)))


def test_the_filtered_truth_is_that_of_small_steps():
    """Promise: both poles, started settled, integrated in steps of 1 us as the slow reference."""
    t_s, f = np.linspace(0, 0.03, 13), 50.0
    light = np.cos(200 * t_s)
    method = FilteredTruth(3, 2, 0.2, light=light_of(lambda t: math.cos(200 * t), t_s, f))
    first = second = light[0]
    for k, u in enumerate(np.interp((np.arange(30_000) + 0.5) * 1e-6, t_s, light)):
        first, before = first + 2e-6 * math.pi * f * (u - first), first
        second += 2e-6 * math.pi * f * (0.5 * (first + before) - second)
        if k + 1 in (8_000, 21_300, 30_000):
            np.testing.assert_allclose(method.image(k + 1), second, atol=2e-4)
