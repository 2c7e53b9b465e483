"""Users' mistakes in arguments of the sensor: an error that names the argument, or a warning."""

import dataclasses
import logging
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from another_process import run_python
from sensor import (
    EventError,
    Events,
    Readout,
    SensorError,
    SensorModel,
    cutoff_in_light,
    read_out,
    simulate,
    simulate_bank,
    stream,
)
from sensor.engine import arguments, group
from sensor.formats.header import model_from_json, model_to_json
from sensor.optics import crop_to_aspect
from sensor.representations import voxel_grid

T_S = [0.0, 0.01]
MODEL = SensorModel(width=4, height=4)
NO_NUMBERS = [None, "200", math.nan, True, np.bool_(True), [1.0], 1j, np.ones((9, 9)), {}]


def frames(dtype=np.float32, size=(4, 4)):
    light = np.ones((2, *size), dtype)
    light[1] *= 3
    return light


def one_line(error, *texts):
    text = str(error.value)
    assert "\n" not in text
    assert len(text) < 250
    for part in texts:
        assert part in text


# Numbers


# Every field of a model that is a number, with a value that it may have.
FIELDS = {
    field.name: {"width": 3, "height": 3, "cutoff_hz": 200.0}.get(field.name, 0.5)
    for field in dataclasses.fields(SensorModel)
    if field.name not in ("random_start", "photoreceptor")
}


@pytest.mark.parametrize("value", NO_NUMBERS, ids=repr)
@pytest.mark.parametrize("name", FIELDS)
def test_a_model_of_no_numbers_is_refused(name, value):
    """Promise: every numeric field refuses other types by name."""
    given = {"width": 4, "height": 4, "cutoff_hz": 50.0, name: value}
    if value is None and name in ("dark_level", "cutoff_reference", "contrast_threshold_off"):
        assert getattr(SensorModel(**given), name) is None  # a valid value of this field
        return
    with pytest.raises(SensorError) as error:
        SensorModel(**given)
    one_line(error, f"SensorModel.{name}: found ", "expected ")


@pytest.mark.parametrize("value", [None, "no", 1, 0.0, math.nan])
def test_a_switch_is_on_or_off(value):
    """Promise: `random_start="no"` is an error, not True."""
    with pytest.raises(SensorError, match=r"SensorModel.random_start: found .*, expected True"):
        SensorModel(width=4, height=4, random_start=value)


def test_an_integer_beyond_all_floats_is_refused():
    with pytest.raises(SensorError) as error:
        SensorModel(width=4, height=4, contrast_threshold=10**400)
    one_line(error, "SensorModel.contrast_threshold: found a value of type int")


@pytest.mark.parametrize(("name", "value"), FIELDS.items())
def test_numbers_of_numpy_are_numbers(name, value):
    """Promise: NumPy scalars work, equal Python's own numbers, and can be stored."""
    rest = {"width": 3, "height": 3, "cutoff_hz": 200.0}
    plain = SensorModel(**{**rest, name: value})
    kinds = [np.int64, np.uint8, np.int32] if isinstance(value, int) else [np.float64, np.float32]
    for kind in kinds:
        model = SensorModel(**{**rest, name: kind(value)})
        assert model == plain
        assert hash(model) == hash(plain)
        assert type(getattr(model, name)) is type(value)
        assert model_from_json(model_to_json(model)) == plain
    assert SensorModel(width=3, height=3, random_start=np.bool_(True)).random_start is True


@pytest.mark.parametrize("value", NO_NUMBERS, ids=repr)
@pytest.mark.parametrize("name", ["max_rate_hz", "fifo_depth", "row_overhead_s"])
def test_a_bus_of_no_numbers_is_refused(name, value):
    """Promise: a bus refuses values that are not numbers, as a model does, and accepts NumPy's."""
    right = {"max_rate_hz": 1e6, "fifo_depth": 2, "row_overhead_s": 0.0}
    with pytest.raises(SensorError) as error:
        Readout(**{**right, name: value})
    one_line(error, f"Readout.{name}: found ", "expected ")
    assert Readout(**{**right, name: np.asarray(right[name])[()]}) == Readout(**right)


@pytest.mark.parametrize("depth", [0, 100_000_001, 10**20])
def test_a_fifo_that_no_memory_holds_is_refused(depth):
    with pytest.raises(SensorError) as error:
        Readout(max_rate_hz=1e6, fifo_depth=depth)
    one_line(error, f"Readout.fifo_depth: found {depth}", "an integer from 1 to 100,000,000")


@pytest.mark.parametrize("value", [*NO_NUMBERS, 0, -1.0, math.inf], ids=repr)
def test_light_in_lux_is_a_positive_number(value):
    with pytest.raises(SensorError, match=r"^illuminance_lux: found .*, expected a positive"):
        cutoff_in_light(value)


# How to run


@pytest.mark.parametrize("value", [-1, 1 << 63, 1 << 64, 0.0, 1.5, "7", None, True, math.nan])
def test_a_seed_that_is_none_is_refused(value):
    """Promise: the sensor uses a seed without change or refuses it."""
    for run in (simulate, lambda *a, **k: list(stream(*a, **k))):
        with pytest.raises(SensorError) as error:
            run(frames(), T_S, MODEL, seed=value)
        one_line(error, f"seed: found {value!r}, expected an integer in 0..2^63 - 1")


def test_any_seed_there_is_works():
    """Promise: the largest seed works too, Python's or NumPy's, and differs from its neighbor."""
    largest = (1 << 63) - 1
    drawn = SensorModel(width=40, height=40, random_start=True)
    light = frames(size=(40, 40))
    a, b, other = (
        simulate(light, T_S, drawn, seed=seed)
        for seed in (largest, np.int64(largest), np.uint32(largest & 0xFFFF_FFFF))
    )
    np.testing.assert_array_equal(a.t_us, b.t_us)
    assert not np.array_equal(a.t_us, other.t_us)
    assert not np.array_equal(a.t_us, simulate(light, T_S, drawn, seed=largest - 1).t_us)


@pytest.mark.parametrize("value", [0, -1, 10**6, 2.0, "2", True, math.nan])
def test_threads_that_cannot_be_are_refused(value):
    """Promise: the sensor never replaces a number of threads by another: 0 is not all cores."""
    with pytest.raises(SensorError) as error:
        simulate(frames(), T_S, MODEL, threads=value)
    one_line(error, f"threads: found {value!r}, expected an integer in 1..1024, or None")
    assert len(simulate(frames(), T_S, MODEL, threads=np.int32(2))) == 16 * 5  # log(3) / 0.2


@pytest.mark.parametrize(
    "model", [{"width": 4, "height": 4}, None, "davis346", (4, 4), SensorModel, np.ones(2)]
)
def test_what_is_no_model_is_refused(model):
    """Promise: a dict of settings is not a sensor, alone or among sensors."""
    name = type(model).__name__
    with pytest.raises(SensorError) as error:
        simulate(frames(), T_S, model)
    one_line(error, f"model: found type {name}, expected a SensorModel")
    with pytest.raises(SensorError) as error:
        simulate_bank(frames(), T_S, [MODEL, model])
    one_line(error, f"models[1]: found type {name}, expected a SensorModel")


@pytest.mark.parametrize("frames", [None, 3])
def test_what_is_no_frames_is_refused(frames):
    with pytest.raises(SensorError, match=f"^frames: found {frames}, expected an array"):
        simulate(frames, T_S, MODEL)


@pytest.mark.parametrize("models", [MODEL, None, 3])
def test_models_are_several(models):
    with pytest.raises(SensorError, match=r"^models: found .*, expected a list"):
        simulate_bank(frames(), T_S, models)


@pytest.mark.parametrize(
    "speeds", [2.0, [None, 1.0], ["2", 1.0], [math.nan, 1.0], [True, 1.0], [1.0], [0.0, 1.0]]
)
def test_speeds_are_positive_numbers(speeds):
    with pytest.raises(SensorError, match=r"^speeds: found .*, expected 2 positive factors"):
        simulate_bank(frames(), T_S, [MODEL, MODEL], speeds=speeds)
    fast, _ = simulate_bank(frames(), T_S, (MODEL, MODEL), speeds=np.array([2, 1]))
    assert fast.t_us[-1] <= 5000


# Shape

SIDE = st.integers(1, 400)


@given(height=SIDE, width=SIDE, sensor_height=SIDE, sensor_width=SIDE)
def test_a_sensor_of_another_shape_is_refused(height, width, sensor_height, sensor_width):
    """Physics: pixels are square. The remainder of whole pixels is allowed, less than one along one
    axis, and so is the crop that the error suggests."""
    sensor_height, sensor_width = min(height, sensor_height), min(width, sensor_width)
    model = SensorModel(width=sensor_width, height=sensor_height)
    off_px = min(
        abs(sensor_height - Fraction(sensor_width * height, width)),
        abs(sensor_width - Fraction(sensor_height * width, height)),
    )
    if off_px < 1:
        arguments.check_fit(model, height, width)
    else:
        rows, columns = crop_to_aspect(height, width, sensor_height, sensor_width)
        with pytest.raises(SensorError) as error:
            arguments.check_fit(model, height, width)
        cut = f"[{rows.start}:{rows.stop}, {columns.start}:{columns.stop}]"
        one_line(error, f"frames of {width}x{height} px; crop them to frame{cut}, or choose")
        cropped = np.empty((height, width))[rows, columns].shape
        assert sensor_height <= cropped[0]
        assert sensor_width <= cropped[1]
        arguments.check_fit(model, *cropped)
        said = str(error.value).rpartition("choose a sensor of ")[2].removesuffix(" px")
        alike = SensorModel(
            **dict(zip(("width", "height"), map(int, said.split("x")), strict=True))
        )
        arguments.check_fit(alike, height, width)


@given(height=SIDE, width=SIDE, data=st.data())
def test_a_sensor_of_the_frames_shape_is_accepted(height, width, data):
    """Promise: a width and its matching height, rounded up or down, and the reverse."""
    for long, short in ((width, height), (height, width)):
        side = data.draw(st.integers(1, long))
        exact = Fraction(side * short, long)
        for other in {max(1, math.floor(exact)), math.ceil(exact)}:
            w, h = (side, other) if (long, short) == (width, height) else (other, side)
            arguments.check_fit(SensorModel(width=w, height=h), height, width)


@pytest.mark.parametrize(
    ("sensor", "frame", "text"),
    [
        ((346, 260), (1280, 960), ""),
        ((346, 259), (1280, 960), ""),
        ((346, 346), (1280, 1280), ""),
        ((1280, 720), (1280, 1280), "frame[280:1000, 0:1280], or choose a sensor of 1280x1280 px"),
        ((346, 261), (1280, 960), "frame[0:960, 3:1276], or choose a sensor of 346x260 px"),
        ((64, 4), (64, 64), "frame[30:34, 0:64], or choose a sensor of 64x64 px"),
    ],
)
def test_light_is_not_stretched(sensor, frame, text):
    """Promise: `simulate` refuses frames that it would stretch, and gives advice, for any
    source."""
    model = SensorModel(width=sensor[0], height=sensor[1])
    light = np.broadcast_to(np.float32(1), (2, *frame[::-1]))
    for source in (light, iter(light)):
        if text:
            with pytest.raises(SensorError) as error:
                simulate(source, T_S, model)
            one_line(error, f"sensor of {sensor[0]}x{sensor[1]} px differs in aspect ratio", text)
        else:
            assert len(simulate(source, T_S, model)) == 0


# Times and light of another unit


@pytest.mark.parametrize(
    ("t_s", "median"),
    [
        (np.arange(5) * 33.3, "33.3 s"),  # milliseconds
        (np.arange(5) * 1000.0, "1000 s"),  # microseconds
        (np.array([0.0, 1.5]), "1.5 s"),
        (np.arange(5) * 1.0, None),
        (np.array([0.0, 0.1, 0.2, 50.0]), None),  # a pause
        (np.zeros(1), None),
    ],
)
def test_times_that_may_not_be_seconds_are_warned_of(t_s, median, caplog):
    """Promise: a warning names a median frame interval above 1 s, but not one long pause."""
    with caplog.at_level(logging.WARNING):
        simulate(np.ones((len(t_s), 2, 2)), t_s, SensorModel(width=2, height=2))
    if median is None:
        assert caplog.messages == []
    else:
        (message,) = caplog.messages
        assert f"t_s: the median interval between frames is {median}" in message


@pytest.mark.parametrize(
    "t_s", ["now", ["a", "b"], [0.0, [1.0]], None, iter([0.0, 1.0]), [True, False]]
)
def test_times_that_are_no_numbers_are_refused(t_s):
    """Promise: the error names the times; a clock's own type is not taken for seconds."""
    with pytest.raises(SensorError) as error:
        simulate(frames(), t_s, MODEL)
    one_line(error, "t_s: found ", "expected a 1-D array")
    for kind in ("datetime64[us]", "timedelta64[us]"):
        with pytest.raises(SensorError, match=r"t_s: found .*, expected a 1-D array"):
            simulate(frames(), np.arange(2).astype(kind), MODEL)


def gradient(levels, highest):
    """Return a frame (16, 32) with `levels` values from 0 to the highest."""
    return np.resize(np.linspace(0, highest, levels), (16, 32))


@pytest.mark.parametrize(
    ("light", "said"),
    [
        (gradient(256, 255), "whole numbers from 0 to 255, 256 different values"),
        (gradient(16, 15), "whole numbers from 0 to 15, 16 different values"),
        (gradient(15, 14), None),  # a step wedge
        (gradient(2, 1), None),  # a checkerboard
        (gradient(2, 255), None),
        (gradient(256, 1), None),  # an image divided by 255
        (gradient(256, 255) ** 2.2 / 255, None),
        (gradient(256, 255) + 0.25, None),
        (gradient(257, 256), None),  # more than 8 bits
        (np.ones((16, 32)), None),
        (np.zeros((16, 32)), None),
    ],
)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_frames_that_may_be_an_8_bit_image_are_warned_of(light, said, dtype, caplog):
    """Promise: an image read as floats causes a warning that it may not be light; synthetic light
    of a few levels, and light that is not whole, does not."""
    model = SensorModel(width=32, height=16, dark_level=0.1)
    with caplog.at_level(logging.WARNING):
        simulate(np.repeat(light.astype(dtype)[None], 2, axis=0), T_S, model)
    if said is None:
        assert caplog.messages == []
    else:
        (message,) = caplog.messages
        assert said in message
        assert "sensor.to_linear(frames.astype(np.uint8), 'srgb')" in message


# Events and the bus


@pytest.mark.parametrize("name", ["t_start_us", "t_end_us"])
@pytest.mark.parametrize("value", [0.005, 5000.0, np.float64(5000), np.float32(0), "0", None])
def test_a_window_in_seconds_is_refused(name, value):
    """Promise: windows are whole microseconds, so that 0.05 s is not an empty window."""
    events = simulate(frames(), T_S, MODEL)
    with pytest.raises(EventError) as error:
        events.between(**{"t_start_us": 0, "t_end_us": 10, name: value})
    one_line(error, f"Events.between: found {name} = {value!r}, expected whole microseconds")


@pytest.mark.parametrize("shift_us", [0.7, 1e6, np.float64(3), "1", None, np.arange(3)])
def test_a_shift_in_seconds_is_refused(shift_us):
    """Promise: times stay whole microseconds."""
    events = simulate(frames(), T_S, MODEL)
    assert events.later(np.int16(7)).t_us.tolist() == (events.t_us + 7).tolist()
    with pytest.raises(EventError, match=r"Events\.later: found shift_us = .*, expected whole"):
        events.later(shift_us)


@pytest.mark.parametrize("shift_us", [2**63 - 1, -(2**63), 2**70])
def test_a_shift_beyond_int64_is_refused(shift_us):
    """Promise: no time wraps around."""
    events = simulate(frames(), T_S, MODEL)
    there = events.later(shift_us // 2**8) if abs(shift_us) < 2**64 else events
    with pytest.raises(EventError, match=r"later: adding shift_us = .* overflows int64"):
        there.later(shift_us)
    assert len(events[:0].later(shift_us)) == 0


def test_windows_are_exact_up_to_the_ends_of_int64():
    """Promise: times and bounds are compared as integers, not as float64, which merges them."""
    t_us = np.array([-(2**63), -(2**60) - 1, 2**60 + 1, 2**60 + 3, 2**63 - 1])
    x = np.zeros(5, np.uint16)
    events = Events(t_us, x, x, np.ones(5, np.int8), width=1, height=1)
    bounds = [-(2**70), *(int(t) + k for t in t_us for k in (-1, 0, 1)), 2**70]
    for first in bounds:
        for last in bounds:
            expected = [t for t in t_us.tolist() if first <= t < last]
            assert events.between(first, last).t_us.tolist() == expected
    array = np.zeros(1, [("x", "u2"), ("y", "u2"), ("t", "u8"), ("p", "?")])
    array["t"] = 2**63 + 5
    with pytest.raises(EventError, match=r"t of uint64 .* 9223372036854775813"):
        Events.from_structured(array, 1, 1)
    with pytest.raises(EventError, match="voxel_grid: events span 18446744073709551615 us"):
        voxel_grid(events, 3)


def test_events_are_selected_by_a_mask_only():
    """Promise: indices are not taken for a mask."""
    events = simulate(frames(), T_S, MODEL)
    assert len(events.where(events.p > 0)) == len(events)
    with pytest.raises(EventError, match="where: found int64"):
        events.where(np.flatnonzero(events.p > 0))


@pytest.mark.parametrize("width", [-4, 4.0, "4", None])
def test_a_sensor_of_events_has_a_number_of_pixels(width):
    """Promise: the size of a sensor without events is checked too."""
    t_us, x, p = np.zeros(0, np.int64), np.zeros(0, np.uint16), np.zeros(0, np.int8)
    with pytest.raises(EventError, match=r"found .*, expected 0 or more whole px"):
        Events(t_us, x, x, p, width=width, height=4)


@pytest.mark.parametrize("kind", [int, np.int64, np.int32, np.uint32, np.uint64])
def test_a_window_of_any_integers_is_right(kind):
    """Promise: NumPy's integers are integers; the window is half-open."""
    events = simulate(frames(), T_S, MODEL)
    first_us, last_us = np.unique(events.t_us)[[1, 3]]
    window = events.between(kind(first_us), kind(last_us))
    np.testing.assert_array_equal(
        window.t_us, events.t_us[(events.t_us >= first_us) & (events.t_us < last_us)]
    )
    assert len(window) == 2 * 16


def test_a_bus_has_no_report_before_it_ran():
    """Promise: the report is an error before the parts are read, not zeros; then it counts as they
    come."""
    events = simulate(frames(), T_S, MODEL)
    parts = read_out([events[:30], events[30:]], Readout(max_rate_hz=1e6, fifo_depth=8))
    with pytest.raises(EventError) as error:
        _ = parts.report
    one_line(error, "ReadOut.report: ", "parts.report")
    next(iter(parts))
    assert parts.report.fired == 30
    for _ in parts:
        pass
    assert parts.report.fired == len(events) == 80
    none = read_out([], Readout(max_rate_hz=1e6, fifo_depth=8))
    assert list(none) == []
    assert none.report.fired == 0


# Memory

DEMANDING = {
    "ideal": {},
    "filtered": {"cutoff_hz": 50.0},
    "uneven": {"threshold_mismatch": 0.02},
    "hot": {"hot_pixel_fraction": 0.1},
    "tired": {"refractory_s": 1e-3},
    "everything": {
        "cutoff_hz": 50.0,
        "threshold_mismatch": 0.02,
        "hot_pixel_fraction": 0.1,
        "refractory_s": 1e-3,
    },
}


@pytest.mark.parametrize("options", DEMANDING.values(), ids=DEMANDING)
def test_sensors_larger_than_memory_are_refused(options, monkeypatch):
    """Promise: the limit is the memory of the pixels' state, to the byte; the error has both
    numbers, and comes before any allocation of that size."""
    model = SensorModel(width=50, height=40, dark_level=1.0, **options)
    light = np.ones((2, 40, 50))
    models = [
        model,
        dataclasses.replace(model, leak_hz=1.0),
        SensorModel(width=50, height=40, dark_level=1.0),
    ]
    started = group.SensorGroup.start([0, 1, 2], models, [1.0] * 3, light[0], 0, 0)
    arrays = [*started.state, started.settings.hot_hz, *started.ready_us]
    if model.threshold_mismatch:
        arrays += [started.settings.C_on, started.settings.C_off]
    needed = sum(array.nbytes for array in arrays if array is not None)
    monkeypatch.setattr(arguments, "memory_bytes", lambda: needed)
    simulate_bank(light, T_S, models)
    monkeypatch.setattr(arguments, "memory_bytes", lambda: needed - 1)
    monkeypatch.setattr(group.SensorGroup, "start", None)
    with pytest.raises(SensorError) as error:
        simulate_bank(light, T_S, models)
    one_line(error, "3 sensors of up to 50x40 px", f"{needed / 1e9:.1f} GB", "this machine has")


def test_a_sensor_of_sixteen_gigapixels_is_refused_here():
    """Promise: the limit is the machine's own memory. 65536 x 65536 filtered pixels need 137 GB of
    state, more than this machine has; a larger machine gets as many sensors as it takes."""
    model = SensorModel(width=1 << 16, height=1 << 16, cutoff_hz=50.0)
    there = arguments.memory_bytes()
    assert 1e8 < there < 1e15
    count = math.ceil((there + 1) / (24 * (1 << 32)))  # they share 8 bytes a pixel
    with pytest.raises(SensorError, match=rf"but this machine has {there / 1e9:.1f} GB of memory"):
        arguments.check_memory([model] * count, [0] * count)


@pytest.mark.parametrize("name", ["leak_hz", "shot_noise_hz", "hot_pixel_hz"])
def test_rates_above_one_event_a_microsecond_are_refused(name):
    """Promise: the sensor refuses a rate that event times cannot store; its events would fill
    memory."""
    SensorModel(width=1, height=1, **{name: 1e6})
    with pytest.raises(
        SensorError, match=rf"{name}: found 1e\+300, expected a rate from 0 to 1e\+06"
    ):
        SensorModel(width=1, height=1, **{name: 1e300})


@pytest.mark.parametrize("dark_level", [1e-310, 5e-324, 1e301])
def test_dark_levels_that_float64_does_not_add_are_refused(dark_level):
    """Promise: I + I_dark has all its digits and a logarithm, for any light."""
    with pytest.raises(SensorError, match="dark_level"):
        SensorModel(width=1, height=1, dark_level=dark_level)


def test_a_device_that_is_not_there_is_refused():
    """Promise: the error says what is missing."""
    with pytest.raises(SensorError) as error:
        simulate(frames(), T_S, MODEL, device="tpu")
    one_line(error, "device: found 'tpu', expected 'cpu' or 'cuda'")
    code = """
import numpy as np
from sensor import SensorError, SensorModel, simulate
try:
    simulate(np.ones((2, 4, 4)), [0.0, 1e-3], SensorModel(width=4, height=4), device="cuda")
except SensorError as error:
    print(error)
"""
    without = run_python(code, CUDA_VISIBLE_DEVICES="-1").stdout
    assert without.startswith("device: 'cuda' does not work here: it needs an NVIDIA GPU with")
    assert without.count("\n") == 1
