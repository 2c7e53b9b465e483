"""A row depends on its own setting alone: not on what the study has beside it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from eres_render import render_scene
from eres_render.progress import silent
from sensor import EventCamera
from sensor.emulators import v2e
from sensor.optics import integrate
from small_study import only
from tasks.evaluation.sequence import evaluate_sequence
from tasks.events.simulation import SimulationOptions, simulate_sequence
from tasks.study.config import DenseFlow, Flow, Reconstruction, Render, Simulate, Study, Tracking
from tasks.study.run.compute import compute_job
from tasks.study.run.jobs import QueuedJob, jobs_of

RENDER = Render(resolution=64, spp=1, max_displacement_px=1.0, samples=1)
EVALUATE = only(
    reconstruction=Reconstruction(),
    flow=Flow(methods=("photometric_flow", "contrast_maximization", "initial_flow"), features=3),
    dense_flow=DenseFlow(methods=("zero_flow",), features=2),
    tracking=Tracking(sigmas_mm=(5.0,), max_events=2000),
)
ROWS = 2 + 3 * 3 + 2 + 2  # of a setting
ALONE = Simulate(widths=(32,), cutoffs_hz=(math.inf,), speeds=(1.0,))
# Each shares one setting with every other one, or nothing but that setting: 32 px, C = 0.2,
# speed 1, two poles, in ideal light or at 200 Hz, at the first sample.
STUDIES = {
    "ideal alone": ALONE,
    "day alone": replace(ALONE, cutoffs_hz=(200.0,)),
    "slow and fast": replace(
        ALONE,
        widths=(16, 32),
        cutoffs_hz=(10.0, 200.0, math.inf),
        speeds=(2.0, 1.0, 0.5),
        photoreceptors=("two_pole", "v2e", "one_pole"),
    ),
    "other thresholds": replace(
        ALONE, cutoffs_hz=(math.inf, 200.0, 1000.0), contrast_thresholds=(0.4, 0.1, 0.2)
    ),
}
# Two cameras as wide as a plain sensor: one differs in dark level, and one in fill factor.
PLAIN = replace(ALONE, widths=(43,))
CAMERAS = (
    EventCamera(name="dark", width=43, height=43, contrast_threshold=0.1, dark_share=0.02),
    EventCamera(name="small", width=43, height=43, contrast_threshold=0.15, fill_factor=0.2),
)
STUDIES |= {
    "plain alone": PLAIN,
    "dark alone": replace(PLAIN, widths=(), sensors=CAMERAS[:1]),
    "small alone": replace(PLAIN, widths=(), sensors=CAMERAS[1:]),
    "one width": replace(PLAIN, sensors=CAMERAS),
}
# v2e's program beside exact pixels, at two frame steps, and alone.
PROGRAMS = {"simulators": ("exact", "v2e-A", "v2e"), "frame_steps_px": (2.0, 1.0)}
ONE_PROGRAM = {"simulators": ("v2e",), "frame_steps_px": (2.0,)}
STUDIES |= {
    "programs": replace(ALONE, cutoffs_hz=(10.0, 200.0), **PROGRAMS),
    "program alone": replace(ALONE, cutoffs_hz=(10.0,), **ONE_PROGRAM),
}
# They share the pixels of "small": one by another name, one on a bus.
SHARING = (
    replace(CAMERAS[1], name="twin"),
    replace(CAMERAS[1], name="late", bus_hz=5e4, fifo=50),
)
STUDIES |= {
    "late alone": replace(PLAIN, widths=(), sensors=SHARING[1:]),
    "one kind of pixel": replace(PLAIN, widths=(), sensors=(CAMERAS[1], *SHARING)),
}


def rows_of(scene, simulate, samples=1):
    """Return the rows of the first sample of a study on the carpet, by what names them."""
    study = Study(
        name="siblings",
        scenes=("carpet",),
        render=replace(RENDER, samples=samples),
        simulate=simulate,
        evaluate=EVALUATE,
    )
    jobs = [job for job in jobs_of(study, scene) if job.clip.index == 0]
    rows = [r for job in jobs for r in compute_job(QueuedJob(job, job.key, False), silent).rows]
    return {replace(row, value=0.0, event_rate_hz=0.0): row for row in rows}


@pytest.fixture(scope="module")
def studies(small_carpet):
    samples = {"other thresholds": 3}
    return {name: rows_of(small_carpet, one, samples.get(name, 1)) for name, one in STUDIES.items()}


def rendered(scene, folder, warm_up_s):
    """Return the clip of the studies, by the function of `eres render`."""
    options = {"resolution": 64, "spp": 1, "max_displacement_px": 1.0, "samples": 1}
    (clip,) = render_scene(scene, folder, warm_up_s=warm_up_s, **options)
    return clip


@pytest.fixture(scope="module")
def clip(small_carpet, tmp_path_factory):
    return rendered(small_carpet, tmp_path_factory.mktemp("clip"), warm_up_s=0.2)


def test_a_row_alone_equals_the_row_beside_others(studies):
    """Promise: to the bit, beside slower, faster and ideal light, other widths, speeds,
    thresholds, photoreceptors and samples. The warm-up of 10 Hz at speed 2 is five times that of
    the others, and ideal light alone needs none for its filter."""
    shared = 0
    for name in ("ideal alone", "day alone"):
        for other in ("slow and fast", "other thresholds"):
            for key, row in studies[name].items():
                assert studies[other][key] == row, (name, other, row.task, row.method)
                shared += 1
    assert shared == 2 * 2 * ROWS
    assert len(studies["slow and fast"]) > 12 * len(studies["ideal alone"])


def test_sensors_of_one_width_are_scored_with_their_own_frames(studies):
    """Promise: beside two others of its width each has the rows that it has alone, to the bit: the
    truth has its own dark level, and the image for photometric flow its own fill factor too."""
    beside = studies["one width"]
    for name in ("plain", "dark", "small"):
        alone = studies[f"{name} alone"]
        assert len(alone) == ROWS
        assert {key: beside.get(key) for key in alone} == alone
    assert len(beside) == 3 * ROWS
    nothing = {row.sensor: row.value for row in beside.values() if row.method == "no_events"}
    assert nothing["dark"] != nothing["small"] == nothing[""]
    flow = [row for row in beside.values() if row.method == "photometric_flow"]
    assert len({row.value for row in flow if not row.failure}) >= 6


def test_sensors_that_share_their_pixels_have_their_own_rows(studies):
    """Promise: a sensor beside its equal, or beside one that differs in its bus alone, has the rows
    that it has alone, to the bit; its equal has them too, under its own name."""
    beside = studies["one kind of pixel"]
    for name in ("small", "late"):
        alone = studies[f"{name} alone"]
        assert {key: beside.get(key) for key in alone} == alone
    twins = [replace(row, sensor="small") for row in beside.values() if row.sensor == "twin"]
    assert twins == [row for row in beside.values() if row.sensor == "small"]
    assert len(beside) == 3 * ROWS
    assert {row.dropped > 0.1 for row in studies["late alone"].values()} == {True}


def test_a_program_has_its_own_rows_and_leaves_those_of_exact_pixels(studies):
    """Promise: to the bit, beside exact pixels, another version and another frame step."""
    beside = studies["programs"]
    for name in ("day alone", "program alone"):
        alone = studies[name]
        assert {key: beside.get(key) for key in alone} == alone
    assert len(beside) == 2 * 5 * ROWS
    assert {row.reading for row in studies["program alone"].values()} == {"v2e-C-2px"}
    rates = {r.reading: r.event_rate_hz for r in beside.values() if r.cutoff_hz == 10.0}
    assert len({*rates.values()}) == len(rates) == 5


def test_a_study_counts_the_events_of_the_program(studies, clip):
    """Promise: those of `sensor.emulators.v2e` on every second frame, on a scale of 255 for white,
    with the time of a frame in the interval before it."""
    start, end = np.searchsorted(clip.t_s, clip.window_s)
    before_s = 6 / (2 * math.pi * 10)
    first = np.searchsorted(clip.t_s, clip.window_s[0] - before_s, side="right") - 1
    seen = [*reversed(range(start, first - 1, -2)), *range(start + 2, end, 2), end]
    light = [255 / clip.white_level * integrate(clip.frame(k), 32, 32) for k in seen]
    t_s = clip.t_s[seen] - clip.t_s[seen[0]]
    events = v2e(light, t_s, contrast_threshold=0.2, cutoff_hz=10.0)
    after, last = (round(1e6 * (clip.t_s[k] - clip.t_s[seen[0]])) for k in (start, end))
    count = np.sum((events.t_us > after) & (events.t_us <= last))
    rows = studies["program alone"].values()
    (rate,) = {row.event_rate_hz for row in rows if row.task == "reconstruction"}
    assert count > 100
    assert rate == pytest.approx(count / RENDER.window_s)


def test_evaluate_gives_the_numbers_of_a_study(studies, clip):
    """Promise: on the frames of `eres render`, whose warm-up may be longer than a setting needs."""
    methods = "event_integration", "no_events"
    asked = [
        row
        for row in studies["slow and fast"].values()
        if (row.task, row.width, row.photoreceptor) == ("reconstruction", 32, "two_pole")
    ]
    found = [
        row.value
        for cutoff_hz, speed in dict.fromkeys((row.cutoff_hz, row.speed) for row in asked)
        for row in evaluate_sequence(
            *(clip, "reconstruction"), methods=methods, camera=32, cutoff_hz=cutoff_hz, speed=speed
        )
    ]
    assert found == [row.value for row in asked]
    assert len(found) == 2 * 3 * 3


def test_a_camera_loses_the_share_that_its_bus_reports(small_carpet, tmp_path):
    """Promise: in a study, in `evaluate_sequence` and in `eres simulate` a camera has its own bus,
    not that of the study. Without a warm-up all events are in the window."""
    camera = EventCamera(name="late", width=43, height=43, bus_hz=1e4, fifo=50)
    simulate = replace(ALONE, widths=(), sensors=(camera,), warm_up_s=0.0, bus_mev_s=12.0)
    rows = [row for row in rows_of(small_carpet, simulate).values() if row.task == "reconstruction"]
    clip = rendered(small_carpet, tmp_path, warm_up_s=0.0)
    model = camera.model(white=clip.white_level)
    options = SimulationOptions(readout=camera.bus)
    _, report = simulate_sequence(clip, model, tmp_path / "events.npz", options)
    evaluated = evaluate_sequence(clip, "reconstruction", camera=camera)
    assert {row.dropped for row in (*rows, *evaluated)} == {report.dropped_share}
    assert {row.bus_mev_s for row in rows} == {0.01}
    assert 0.1 < report.dropped_share < 0.9
