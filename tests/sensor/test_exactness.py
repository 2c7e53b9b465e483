"""The sensor on moving textures against the slow reference, and on light with exact answers."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import reference_sensor
from benchmark_files import benchmark
from event_streams import COLUMNS
from moving_texture import texture_in_motion
from sensor import SensorModel, simulate_bank
from sensor.engine import devices, group

CUTOFFS_HZ = (math.inf, 200.0, 50.0)
DARK = 0.01


@settings(max_examples=10)
@given(
    seed=st.integers(0, 10_000),
    interval_s=st.sampled_from([5e-5, 5e-4, 5e-3]),
    cutoff_hz=st.sampled_from(CUTOFFS_HZ),
    C=st.sampled_from([0.05, 0.2]),
)
def test_every_event_of_a_moving_texture_matches_the_reference(seed, interval_s, cutoff_hz, C):
    """Promise: at the base speed and at ten times it, at any frame interval, each event has the
    reference's pixel, polarity and order, and its time within 1 us."""
    frames, t_s = texture_in_motion(seed, 6, (11, 13), interval_s)
    model = SensorModel(
        width=5, height=4, contrast_threshold=C, cutoff_hz=cutoff_hz, dark_level=DARK
    )
    speeds = [1.0, 10.0]
    for speed, events in zip(
        speeds, simulate_bank(frames, t_s, [model] * 2, speeds=speeds), strict=True
    ):
        t_us, x, y, p = reference_sensor.simulate(frames, t_s / speed, model, DARK)
        ours = np.lexsort((np.arange(len(events)), events.x, events.y))
        theirs = np.lexsort((np.arange(len(t_us)), x, y))
        for got, want in ((events.x, x), (events.y, y), (events.p, p)):
            np.testing.assert_array_equal(got[ours], want[theirs])
        assert np.all(np.abs(events.t_us[ours] - t_us[theirs]) <= 1)


@pytest.mark.parametrize("interval_s", [5e-5, 5e-4, 5e-3])
def test_the_moving_textures_do_make_events(interval_s):
    """The comparison above does not compare empty streams."""
    frames, t_s = texture_in_motion(0, 6, (11, 13), interval_s)
    model = SensorModel(width=5, height=4, contrast_threshold=0.05, dark_level=DARK)
    (events,) = simulate_bank(frames, t_s, [model])
    assert len(events) > 20


@settings(max_examples=12)
@given(
    seed=st.integers(0, 1000),
    interval_s=st.sampled_from([5e-5, 5e-4, 5e-3]),
    order=st.permutations(range(10)),
    threads=st.integers(1, 5),
    chunk=st.integers(1, 12),
    block=st.integers(1, 700),
)
def test_the_bank_is_the_same_to_the_bit(seed, interval_s, order, threads, chunk, block):
    """Promise: no event depends on threads, chunks, blocks, or the order of the sensors."""
    frames, t_s = texture_in_motion(seed, 13, (24, 30), interval_s)
    members = [
        (SensorModel(width=w, height=h, cutoff_hz=c, dark_level=DARK, random_start=w == 30), speed)
        for w, h in ((30, 24), (13, 11))
        for c, speed in (
            (math.inf, 1.0),
            (math.inf, 10.0),
            (200.0, 10.0),
            (50.0, 1.0),
            (50.0, 10.0),
        )
    ]
    models, speeds = zip(*members, strict=True)
    plain = simulate_bank(frames, t_s, models, speeds=speeds, seed=seed, threads=1)
    assert sum(map(len, plain)) > 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(devices, "_CHUNK_FRAMES", chunk)
        patch.setattr(group, "_BLOCK_PX", block)
        other = simulate_bank(
            iter(frames),
            t_s,
            [models[i] for i in order],
            speeds=[speeds[i] for i in order],
            seed=seed,
            threads=threads,
        )
    for i, events in zip(order, other, strict=True):
        for column in COLUMNS:
            np.testing.assert_array_equal(getattr(events, column), getattr(plain[i], column))


@pytest.fixture(scope="module")
def conformance():
    module = benchmark("conformance")
    signals = module.all_signals()
    return module, signals, [module.run(signal) for signal in signals]


def test_light_that_is_straight_between_frames_has_exact_events(conformance):
    """Physics: for ramps and steps of log intensity, the only error is the rounding of the
    times."""
    _, signals, outcomes = conformance
    exact = [
        (signal, outcome)
        for signal, outcome in zip(signals, outcomes, strict=True)
        if "ramp" in signal.name or "step" in signal.name or "0 → 0.5" in signal.name
    ]
    assert len(exact) == 7
    for signal, outcome in exact:
        assert outcome.fired == len(signal.events), signal.name
        assert outcome.right_pixels == outcome.pixels
        assert outcome.worst_error_us <= 0.501


def test_curved_light_is_missed_by_the_frames_straight_lines_only(conformance):
    """Physics: sines and a moving edge with fine frames fire the right events within 4 us; at ten
    times the interval the edge's error is a hundred times as large."""
    _, signals, outcomes = conformance
    fine = [
        (signal, outcome)
        for signal, outcome in zip(signals, outcomes, strict=True)
        if "0.05 ms" in signal.source or "0.1 ms" in signal.source
    ]
    assert len(fine) == 4
    for signal, outcome in fine:
        assert outcome.fired == len(signal.events), signal.name
        assert outcome.right_pixels == outcome.pixels
        assert outcome.worst_error_us < 4
    edges = [o for s, o in zip(signals, outcomes, strict=True) if "edge" in s.name]
    assert edges[1].mean_error_us / edges[0].mean_error_us == pytest.approx(100, rel=0.15)


def test_the_conformance_page_is_what_its_script_makes(conformance):
    """Promise: docs/conformance.md has the numbers of this code."""
    module, signals, outcomes = conformance
    assert module.table(signals, outcomes) in module.TABLE.read_text()


def test_the_signals_can_be_loaded_by_others(conformance, tmp_path):
    """Promise: the .npz alone is enough to compare another simulator with the exact events."""
    module, signals, _ = conformance
    module.write_signals(tmp_path / "signals.npz", signals)
    with np.load(tmp_path / "signals.npz") as file:
        for k, signal in enumerate(signals):
            np.testing.assert_array_equal(file[f"frames_{k}"], signal.frames)
            assert len(file[f"t_s_{k}"]) == len(signal.frames)
            assert len(file[f"event_t_s_{k}"]) == len(signal.events)
            assert set(np.unique(file[f"event_p_{k}"])) <= {-1, 1}
            assert file[f"event_x_{k}"].max() < signal.frames.shape[2]
