"""`LiveCamera` answers each frame with the events of `simulate` and `read_out`, to the bit."""

import threading
import tracemalloc
from contextlib import closing

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from event_streams import assert_same, random_events
from moving_texture import texture_in_motion
from sensor import LiveCamera, Readout, SensorError, SensorModel, read_out, simulate, simulate_bank
from sensor.engine import group
from sensor.engine.devices import device_called
from sensor.engine.live import Live
from sensor.events import concatenate, no_events
from sensor.readout import Sender

SIZE = 24, 32
KINDS = {
    "ideal": {},
    "filtered": {"cutoff_hz": 200.0, "contrast_threshold": 0.1},
    "coarse": {"width": 16, "height": 12, "fill_factor": 0.5, "cutoff_reference": 2.0},
    "v2e": {"cutoff_hz": 300.0, "photoreceptor": "v2e", "latency_s": 3e-4},
    "noise": {"shot_noise_hz": 300.0, "hot_pixel_fraction": 0.05, "leak_hz": 20.0},
    "everything": {
        "cutoff_hz": 300.0,
        "threshold_mismatch": 0.03,
        "random_start": True,
        "leak_hz": 5.0,
        "shot_noise_hz": 200.0,
        "refractory_s": 5e-4,
        "latency_s": 1.3e-3,
    },
}
KINDS["coarse"]["cutoff_hz"] = 500.0
BUS = Readout(max_rate_hz=1e5, fifo_depth=3, row_overhead_s=1e-6)


def plain(**options):
    return SensorModel(**({"width": SIZE[1], "height": SIZE[0]} | options))


@pytest.mark.parametrize("bus", [None, BUS], ids=["at once", "bus"])
@pytest.mark.parametrize("kind", KINDS)
def test_pushed_frames_give_the_events_of_simulate(kind, bus):
    """Promise: the same events, model and report for 1, 7 and all frames a push and any threads;
    a push returns all events before the last frame; a frame's memory may be used again."""
    frames, t_s = texture_in_motion(3, 40, SIZE, 1.7e-3)
    model = plain(**KINDS[kind])
    expected = simulate(frames, t_s, model, seed=5, threads=1)
    latency_us = round(1e6 * model.latency_s)
    completed = expected.model
    if bus is not None:
        sent = read_out(expected, bus)
        expected = concatenate(list(sent))
        assert sent.report.dropped > 0
    assert len(expected) > 300
    for chunk, threads in ((1, 1), (7, 3), (40, 2)):
        parts, buffer = [], np.empty((chunk, *SIZE), np.float32)
        with LiveCamera(model, seed=5, readout=bus, threads=threads) as live:
            for k in range(0, len(frames), chunk):
                view = buffer[: len(frames[k : k + chunk])]
                view[:] = frames[k : k + chunk]
                one = (view[0], t_s[k]) if chunk == 1 else (view, t_s[k : k + chunk])
                parts.append(live.push(*one))
                view[:] = np.nan
                end_us = round(1e6 * t_s[: k + chunk][-1]) + latency_us
                assert sum(map(len, parts)) == np.searchsorted(expected.t_us, end_us)
            parts.append(live.finish())
        assert chunk > 1 or len(parts[0]) == 0
        assert_same(concatenate(parts), expected)
        assert live.model == completed == parts[-1].model
        assert live.report == (None if bus is None else sent.report)


@pytest.mark.parametrize("chunk", [1, 7, 40])
def test_the_engine_gives_the_events_of_a_bank_for_any_chunks(chunk):
    """Promise: models that start within a chunk, at any speed, fire as in `simulate_bank`."""
    frames, t_s = texture_in_motion(3, 40, SIZE, 1.7e-3)
    kinds = "ideal", "coarse", "noise", "everything", "filtered"
    models = [plain(dark_level=1e-3, **KINDS[kind]) for kind in kinds]
    speeds, starts = [1.0, 2.0, 0.5, 1.0, 3.0], [0, 5, 39, 5, 38]
    expected = simulate_bank(frames, t_s, models, speeds=speeds, starts=starts, seed=4)
    parts = [[no_events(m.width, m.height, m)] for m in models]
    live = Live(models, speeds, starts, 4, device_called("cpu", 2), frames[0].size)
    with closing(live):
        for k in range(0, len(t_s), chunk):
            for i, events in live.push(frames[k : k + chunk], t_s[k : k + chunk]):
                parts[i].append(events)
        for i, events in live.finish():
            parts[i].append(events)
    assert sum(map(len, expected)) > 10_000
    for one, other in zip(parts, expected, strict=True):
        assert_same(concatenate(one), other)


def test_a_frame_is_divided_among_threads_where_that_is_worth_it(monkeypatch):
    """Promise: on a machine of many cores a small frame costs what it does on one: the default is
    one thread for each core, and a part of 100 microseconds of work costs that much to start."""
    monkeypatch.setattr(group, "_BAND_WORK", 1 << 16)
    pixels, advance = [], group.advance.advance_pixels

    def counted(light, band, *rest):
        pixels.append(band.stop - band.start)
        return advance(light, band, *rest)

    monkeypatch.setattr(group.advance, "advance_pixels", counted)
    with LiveCamera(plain(width=320, height=240), threads=8) as live:
        live.push(np.ones((240, 320)), 0.0)
        live.push(np.ones((240, 320)), 1.0)
        assert pixels == [320 * 240]
        live.push(np.ones((3, 240, 320)), [2.0, 3.0, 4.0])
        assert sorted(pixels[1:]) == [320 * 240 / 3] * 3


@given(
    cuts=st.lists(st.integers(0, 400), max_size=6).map(sorted),
    wait_us=st.lists(st.integers(0, 40), min_size=7, max_size=7),
    depth=st.integers(1, 40),
)
@settings(deadline=None, max_examples=40)
def test_a_bus_sends_until_the_time_that_it_is_told(cuts, wait_us, depth):
    """Promise: with a time before which no event follows, all that left before it is returned, and
    the result is that of the whole stream."""
    events = random_events(400, width=8, height=8, mean_us=2.0)
    bus = Readout(max_rate_hz=4e5, fifo_depth=depth, row_overhead_s=1e-6)
    whole = read_out(events, bus)
    expected, sender, sent, until_us = concatenate(list(whole)), Sender(bus), [], 0
    for first, last, wait in zip([0, *cuts], [*cuts, 400], wait_us, strict=False):
        next_us = int(events.t_us[last]) if last < 400 else 1 << 40
        until_us = min(next_us, max(until_us, int(events.t_us[last - 1]) if last else 0) + wait)
        sent.append(sender.push(events[first:last], until_us))
        assert sum(map(len, sent)) == np.searchsorted(expected.t_us, until_us)
    assert_same(concatenate([*sent, sender.finish()]), expected)
    assert sender.report == whole.report


def test_white_gives_the_levels_that_the_first_frame_cannot():
    """Promise: with `white` the first frame may be black, and the levels are those of a first frame
    with that white."""
    model = plain(cutoff_hz=100.0, photoreceptor="v2e")
    with LiveCamera(model, white=5.0) as live:
        assert live.model == model
        live.push(np.zeros(SIZE), 0.0)
    assert (live.model.dark_level, live.model.cutoff_reference) == (0.005, 5.0)
    with (
        LiveCamera(plain()) as live,
        pytest.raises(SensorError, match=r"dark_level: .* is black.* `white`"),
    ):
        live.push(np.zeros(SIZE), 0.0)


ONES = np.ones(SIZE)
REFUSED = {
    "time again": ((ONES, 0.2), r"t_s\[3\]: found 0\.2 after 0\.2"),
    "time before": ((np.ones((2, *SIZE)), [0.3, 0.25]), r"t_s\[4\]: found 0\.25 after 0\.3"),
    "no time": ((ONES, np.nan), r"t_s\[3\]: found nan"),
    "a word": ((ONES, "soon"), "t_s: found .*, expected a 1-D array"),
    "times missing": ((np.ones((2, *SIZE)), 0.3), "t_s: 1 times for 2 frames"),
    "hours later": ((ONES, 1e4), r"t_s: two frames are 9999.* s apart"),
    "another size": (
        (np.ones((24, 30)), 0.3),
        r"frame 3: found shape \(24, 30\), expected ",
    ),
    "colors": ((np.ones((1, 1, *SIZE)), 0.3), r"frame 3: found shape \(1, 24, 32\)"),
    "an image": ((np.ones(SIZE, np.uint8), 0.3), "frame 3: found uint8, .* sensor.to_linear"),
}


@pytest.mark.parametrize(("pushed", "message"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_the_next_frame_is_refused_and_changes_nothing(pushed, message):
    """Promise: the error names the frame and the value, and the camera goes on."""
    frames, t_s = texture_in_motion(3, 6, SIZE, 0.1)
    t_s = np.round(t_s, 1)
    model = plain(contrast_threshold=0.05)
    with LiveCamera(model) as live:
        parts = [live.push(frames[:3], [0.0, 0.1, 0.2])]
        with pytest.raises(SensorError, match=message):
            live.push(*pushed)
        parts += [live.push(frames[3:], [0.3, 0.4, 0.5]), live.finish()]
    t_s = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    assert_same(concatenate(parts), simulate(frames, t_s, model))


@pytest.mark.parametrize("value", [np.nan, -1.0, np.inf])
@pytest.mark.parametrize("first", [True, False])
def test_bad_radiance_is_named_and_no_frame_follows(value, first):
    """Promise: the error has frame and pixel. Where some pixels have seen a bad frame, the camera
    ends; before the first frame it has seen nothing."""
    bad = np.ones((3, *SIZE))
    bad[2 - 2 * first, 7, 5] = value
    with LiveCamera(plain()) as live:
        if not first:
            live.push(ONES, 0.0)
        with pytest.raises(SensorError, match=rf"frame {0 if first else 3}, pixel x=5 y=7: found"):
            live.push(bad, [1.0, 2.0, 3.0])
        if first:
            assert len(live.push(ONES, 1.0)) == 0
        else:
            with pytest.raises(SensorError, match="push: this camera has ended, after 1 f"):
                live.push(ONES, 4.0)


def test_nothing_is_pushed_after_the_end():
    """Promise: `finish` and the end of `with` end the camera and its threads."""
    before = threading.active_count()
    with LiveCamera(plain(), threads=2) as live:
        live.push(np.ones((9, *SIZE)), np.arange(9.0))
        assert threading.active_count() > before
        assert len(live.finish()) == 0
        for again in (lambda: live.push(ONES, 9.0), live.finish):
            with pytest.raises(SensorError, match="has ended, after 9 frames"):
                again()
    assert threading.active_count() == before
    with LiveCamera(plain()) as live:
        pass
    with pytest.raises(SensorError, match="has ended, after 0 frames"):
        live.push(ONES, 0.0)
    with LiveCamera(plain()) as live:
        assert len(live.finish()) == 0  # of no frame


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"model": SIZE}, "model: found type tuple, expected a SensorModel"),
        ({"model": plain(width=64, height=48)}, "64x48 px is finer than the frames of 32x24"),
        ({"model": plain(height=16)}, "32x16 px differs in aspect ratio"),
        ({"readout": 12e6}, r"readout: found 12000000\.0, expected a sensor\.Readout"),
        ({"white": 0}, "white: found 0, expected a radiance"),
        ({"seed": -1}, "seed: found -1"),
        ({"threads": 0}, "threads: found 0"),
        ({"device": "tpu"}, "device: found 'tpu'"),
    ],
)
def test_cameras_that_cannot_be_are_refused(options, message):
    """Promise: arguments are refused at once, and what does not fit the frames with the first."""
    with pytest.raises(SensorError, match=message):
        LiveCamera(**({"model": plain()} | options)).push(ONES, 0.0)


def test_the_likely_mistakes_of_a_loop_are_warned_of_once(caplog):
    """Promise: times in ms and images of 8 bits are named, as by `simulate`, with their number."""
    image = np.arange(24.0 * 32).reshape(SIZE) % 256
    with LiveCamera(plain()) as live:
        for k in range(4):
            live.push(image, 33.0 * k)
    assert [record.getMessage()[:40] for record in caplog.records] == [
        "frames: the first frame looks like an 8-",
        "t_s: the median interval between frames ",
    ]


def test_memory_does_not_grow_with_the_frames():
    """Promise: however long the loop, what it keeps is the state of the pixels and of the bus.
    Python's lists of free objects grow to 200 kB; the frames have 0.6 MB."""
    frames, _ = texture_in_motion(3, 20, SIZE, 1e-3)
    model = plain(cutoff_hz=200.0, refractory_s=1e-3, shot_noise_hz=50.0)
    used = []
    with LiveCamera(model, readout=BUS, threads=1) as live:
        tracemalloc.start()
        try:
            for k in range(200):
                live.push(frames[k % 20], 1e-3 * k)
                used.append(tracemalloc.get_traced_memory()[0])
        finally:
            tracemalloc.stop()
    assert max(used[40:]) < max(used[:40]) + 300_000
