"""`sensor.emulators.v2e`: the events of v2e's program, step by step."""

import json
import logging
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensor import SensorError
from sensor.emulators import V2E_DEFAULTS, v2e

DATA = json.loads((Path(__file__).parents[1] / "data/v2e_examples.json").read_text())


def rows(events):
    return [
        (int(t), int(x), int(y), int(p))
        for t, x, y, p in zip(events.t_us, events.x, events.y, events.p, strict=True)
    ]


@pytest.mark.parametrize("example", DATA["examples"], ids=lambda one: one["name"])
def test_the_programs_own_events(example):
    """Promise: the events that the program itself made, in three versions: the linear part, clamped
    steps, light above white, shared slots, a forgotten start, floor division."""
    frames = [
        np.array(frame, example["dtype_in"]).reshape(example["shape"])
        for frame in example["frames"]
    ]
    events = v2e(
        frames,
        example["times_s"],
        contrast_threshold=example["contrast_threshold"],
        cutoff_hz=example["cutoff_hz"] or math.inf,
        version=example["version"],
    )
    expected = [(round(1e6 * t), x, y, p) for t, x, y, p in example["events_txyp"]]
    assert sorted(rows(events)) == sorted(expected)


def reference(frames, t_s, C, C_off, cutoff_hz, version, refractory_s=0.0):
    """The events of version A, B or C, pixel by pixel and slot by slot, in NumPy's scalars."""
    single = version == "C" and math.isinf(cutoff_hz)
    real, step = (np.float32 if one else np.float64 for one in (single, version == "C"))
    height, width = frames[0].shape
    made, before_s, state = [], 0.0, {}
    for now_s, frame in zip(t_s, frames, strict=True):
        counts = {}
        for y, x in np.ndindex(height, width):
            light = float(frame[y, x])
            log = light * math.log(20) / 20 if light <= 20 else math.log(light)
            log = (np.float32 if version == "C" else np.float64)(round(log, 8))
            if (y, x) not in state:
                state[y, x] = [real(log), real(log), real(log), -np.inf]
                continue
            first, second, memory, _ = state[y, x]
            share = min(1.0, (light + 20) / 275 * 2 * math.pi * cutoff_hz * (now_s - before_s))
            first = real((1 - share) * first + share * log)
            second = real((1 - share) * second + share * first)
            level = second if version == "A" else first
            state[y, x][:2] = first, second
            change = level - memory
            counts[y, x] = int(change // real(C)) if change >= 0 else -int(-change // real(C_off))
        most = max(map(abs, counts.values()), default=0)
        told = dict.fromkeys(counts, 0)
        dead = refractory_s > (now_s - before_s) / max(most, 1)
        for slot in range(1, most + 1):
            part = slot / most if version == "C" else slot / (most + 1)
            time_s = np.float32(before_s + part * (now_s - before_s))
            for (y, x), count in counts.items():
                if abs(count) < slot:
                    continue
                if dead and not time_s - state[y, x][3] > np.float32(refractory_s):
                    continue
                told[y, x] += int(np.sign(count))
                state[y, x][3] = time_s if dead else state[y, x][3]
                made.append((1e6 * float(time_s), x, y, int(np.sign(count))))
        for place, count in told.items():
            change = step(count) * step(C if count > 0 else C_off)
            state[place][2] = real(state[place][2] + change)
        if counts or version != "C":
            before_s = now_s
    return made


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_the_kernels_are_the_plain_steps(data):
    """Promise: any frames, thresholds, cutoff, version and refractory period, as a slow reference
    has it: the same pixels, polarities and order of slots, and times within a microsecond."""
    shape = data.draw(st.tuples(*[st.integers(1, 4)] * 2))
    seed, count = data.draw(st.integers(0, 10**6)), data.draw(st.integers(1, 8))
    rng = np.random.default_rng(seed)
    frames = 255 * rng.random((count, *shape)) ** 2 * data.draw(st.sampled_from([0.1, 1.0, 4.0]))
    if data.draw(st.booleans()):
        frames = np.clip(np.round(frames), 0, 255).astype(np.uint8)
    t_s = np.cumsum(rng.uniform(2e-4, 2e-2, count)) - data.draw(st.sampled_from([0.0, 2e-4]))
    C, C_off = data.draw(st.tuples(*[st.sampled_from([0.07, 0.2, 0.3])] * 2))
    cutoff_hz = data.draw(st.sampled_from([13.0, 200.0, 1000.0, math.inf]))
    version = data.draw(st.sampled_from("ABC"))
    refractory_s = data.draw(st.sampled_from([0.0, 5e-4, 5e-3]))
    events = v2e(
        frames, t_s, contrast_threshold=C, contrast_threshold_off=C_off, cutoff_hz=cutoff_hz,
        version=version, refractory_s=refractory_s,
    )  # fmt: skip
    expected = sorted(reference(frames, t_s, C, C_off, cutoff_hz, version, refractory_s))
    found = sorted(rows(events))
    assert sorted(one[1:] for one in found) == sorted(one[1:] for one in expected)
    np.testing.assert_allclose([one[0] for one in found], [one[0] for one in expected], atol=1)


def test_noise_has_the_rates_that_are_asked_for():
    """Promise: in constant light leaks are ON at their rate; in the dark shot noise is of both
    polarities at its rate, and at white at a quarter; thresholds scatter by the mismatch."""
    shape, t_s = (200, 200), np.linspace(0, 1, 101)
    dark, white = np.zeros(shape), np.full(shape, 255.0)
    leaks = v2e([white] * 101, t_s, leak_hz=10.0)
    assert np.all(leaks.p == 1)
    assert len(leaks) == pytest.approx(
        10 * math.exp(0.5 * (0.1 * math.log(10)) ** 2) * 4e4, rel=0.06
    )
    for light, rate_hz in ((dark, 1 - 0.75 * 20 / 275), (white, 0.25)):
        noise = v2e([light] * 101, t_s, shot_noise_hz=2.0)
        assert len(noise) == pytest.approx(2 * rate_hz * 4e4, rel=0.03)
        assert np.mean(noise.p > 0) == pytest.approx(0.5, abs=0.02)
    rise = [np.full(shape, light) for light in (100.0, 100 * math.exp(0.2))]
    once = v2e(rise, [0, 1], contrast_threshold=0.2001, threshold_mismatch=0.03)
    assert len(once) == pytest.approx(0.5 * 4e4, rel=0.03)
    assert len(
        v2e(rise, [0, 1], contrast_threshold=0.23, threshold_mismatch=0.03)
    ) == pytest.approx(0.159 * 4e4, rel=0.05)


def test_the_programs_defaults_are_options():
    """Promise: what the program does unless told otherwise is one name away, and repeatable."""
    frames = np.random.default_rng(0).uniform(0, 255, (5, 20, 30))
    for options in V2E_DEFAULTS.values():
        one, same = (v2e(frames, np.arange(5) * 1e-2, seed=3, **options) for _ in range(2))
        assert rows(one) == rows(same)
        assert rows(one) != rows(v2e(frames, np.arange(5) * 1e-2, seed=4, **options))


def test_steps_that_are_clamped_everywhere_are_said(caplog):
    """Promise: a warning names the interval at which the filter has no effect at all."""
    frames = np.full((3, 2, 2), 200.0) + np.arange(3)[:, None, None]
    with caplog.at_level(logging.WARNING):
        v2e(frames, [0, 0.001, 0.002], cutoff_hz=50)
        assert not caplog.messages
        v2e(frames, [0, 0.1, 0.2], cutoff_hz=50)
    assert "clamped at 1" in caplog.text
    assert "less than 0.0032 s apart" in caplog.text


@pytest.mark.parametrize(
    ("frames", "t_s", "options", "said"),
    [
        ([[[1.0]]], [0, 1], {}, "t_s: found 2 times for 1 frames"),
        ([[[1.0]]] * 3, [0, 1], {}, "t_s: found 2 times for 3 frames"),
        ([[[1.0]]] * 2, [1, 1], {}, "t_s: found times that do not increase"),
        ([[[1.0]]] * 2, [-0.5, 1], {}, "t_s: found -0.5 to 1 s, expected 0 s"),
        ([[1.0]], [0], {}, "frame 0: found shape"),
        ([[[1.0]], [[1.0, 2.0]]], [0, 1], {}, r"frame 1: found shape \(1, 2\), expected \(1, 1\)"),
        ([[[-1.0]]], [0], {}, "frame 0: found a pixel that is not a finite number"),
        ([[[math.nan]]], [0], {}, "frame 0: found a pixel that is not a finite number"),
        ([[["a"]]], [0], {}, "frame 0: found <U1, expected real numbers"),
        ([[[1.0]]], [0], {"cutoff_hz": 0.0}, "cutoff_hz: found 0.0"),
        ([[[1.0]]], [0], {"leak_hz": math.nan}, "leak_hz: found nan"),
        ([[[1.0]]], [0], {"version": "D"}, "version: found 'D', expected 'A', 'B' or 'C'"),
        ([[[1.0]]], [0], {"contrast_threshold": 0.0}, "contrast_threshold: found 0.0"),
    ],
)
def test_what_it_cannot_take_is_refused(frames, t_s, options, said):
    with pytest.raises(SensorError, match=said):
        v2e(frames, t_s, **options)
