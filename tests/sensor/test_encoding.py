"""`to_linear` against the formulas of the standards, applied in reverse."""

import math

import numpy as np
import pytest

from sensor import SensorError, SensorModel, simulate, to_linear
from sensor.encoding import to_srgb

LIGHT = np.concatenate([[0.0, 1.0], np.geomspace(1e-6, 1.0, 20_000)])


def srgb_of(light):
    """IEC 61966-2-1: 12.92 L up to 0.0031308, then 1.055 L^(1/2.4) - 0.055."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def to_rec709(light):
    """ITU-R BT.709: 4.5 L below 0.018, then 1.099 L^0.45 - 0.099."""
    return np.where(light < 0.018, 4.5 * light, 1.099 * light**0.45 - 0.099)


ENCODERS = {
    "srgb": srgb_of,
    "rec709": to_rec709,
    "gamma:2.2": lambda light: light ** (1 / 2.2),
    "gamma:0.5": lambda light: light**2,
    "linear": lambda light: light,
}


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("encoding", ENCODERS)
def test_light_that_is_encoded_comes_back(encoding, dtype):
    """Physics: it inverts the standard's formula from light to signal, in both branches."""
    signal = ENCODERS[encoding](LIGHT).clip(0, 1).astype(dtype)
    light = to_linear(signal, encoding)
    assert light.dtype == np.float32
    np.testing.assert_allclose(light, LIGHT, rtol=3e-6, atol=1e-9)
    assert (light[0], light[1]) == (0.0, 1.0)


def test_srgb_is_encoded_by_the_standards_formula_and_decoded_to_the_same_light():
    """Physics: the straight part and the power meet at 0.0031308; both directions are inverse."""
    np.testing.assert_array_equal(to_srgb(LIGHT), srgb_of(LIGHT))
    np.testing.assert_allclose(to_linear(to_srgb(LIGHT), "srgb"), LIGHT, rtol=3e-6, atol=1e-9)
    edge = np.array([0.0031308, np.nextafter(0.0031308, 1)])
    assert np.diff(to_srgb(edge)) == pytest.approx(0, abs=1e-6)
    assert 255 * to_srgb(np.array(0.1845)) == pytest.approx(119, abs=0.1)  # middle gray


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, ">u2"])
@pytest.mark.parametrize("encoding", ENCODERS)
def test_integers_are_shares_of_their_types_white(encoding, dtype):
    """Physics: every number of the type is the same after decoding, encoding and rounding."""
    codes = np.arange(np.iinfo(dtype).max + 1).astype(dtype)
    light = to_linear(codes.reshape(16, -1), encoding)
    assert light.shape == (16, len(codes) // 16)
    assert light.dtype == np.float32
    assert np.all(np.diff(light.ravel()) > (0 if dtype == np.uint8 else -1e-4))
    again = ENCODERS[encoding](light.ravel().astype(np.float64)) * np.iinfo(dtype).max
    lost = np.round(again) != codes
    # BT.709's two branches miss each other by 0.00025, so no light has the few codes in between.
    assert np.all(np.abs(codes[lost] / np.iinfo(dtype).max - 0.0811) < 0.0002)
    assert encoding == "rec709" or not lost.any()


def test_published_values():
    """Known: sRGB's middle gray of 119 is 18.4 % of white; 10 is in its straight part."""
    levels = to_linear(np.array([0, 10, 119, 255], np.uint8), "srgb")
    np.testing.assert_allclose(levels, [0, 10 / 255 / 12.92, 0.1845, 1], rtol=2e-4)
    assert to_linear(np.uint8(51), "gamma:2") == pytest.approx(0.04)
    assert to_linear(np.float32(0.04045), "srgb") == pytest.approx(0.04045 / 12.92, rel=1e-6)
    assert to_linear([0.0405], "rec709")[0] == pytest.approx(0.009)


@pytest.mark.parametrize(
    ("encoding", "found"),
    [
        ("sRGB", "'sRGB'"),
        ("", "''"),
        ("gamma", "'gamma'"),
        ("gamma:0", "'gamma:0'"),
        ("gamma:-2.2", "'gamma:-2.2'"),
        ("gamma:nan", "'gamma:nan'"),
        ("gamma:inf", "'gamma:inf'"),
        ("gamma:two", "'gamma:two'"),
        ("power:2.2", "'power:2.2'"),
        (2.2, "2.2"),
        (None, "None"),
    ],
)
def test_an_unknown_encoding_is_refused(encoding, found):
    """Promise: the code guesses no encoding; the text lists all of them."""
    with pytest.raises(SensorError) as error:
        to_linear(np.zeros((2, 2), np.uint8), encoding)
    assert f"encoding: found {found}, expected 'srgb', 'rec709', 'gamma:2.2'" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("frames", "text"),
    [
        (np.zeros((2, 2), np.int64), "found int64, expected uint8, uint16, or floats from 0 to 1"),
        (np.zeros((2, 2), np.uint32), "found uint32"),
        (np.zeros((2, 2), np.bool_), "found bool"),
        (np.zeros((2, 2), np.complex64), "found complex64"),
        (None, "found object"),
        (np.array([0.0, 255.0]), "found 255, expected float64 values from 0 to 1"),
        (np.array([0.0, -1e-3], np.float32), "found -0.001, expected float32 values"),
        (np.array([0.0, math.nan]), "found nan"),
    ],
)
def test_frames_of_another_type_or_range_are_refused(frames, text):
    """Promise: without a known white there is no result."""
    with pytest.raises(SensorError, match=r"^frames: ") as error:
        to_linear(frames, "srgb")
    assert text in str(error.value)


def test_half_floats_keep_their_precision():
    """Promise: float16 is decoded in float32, so it loses no further digits."""
    half = np.linspace(0, 1, 1000).astype(np.float16)
    np.testing.assert_array_equal(to_linear(half, "srgb"), to_linear(half.astype("f4"), "srgb"))


def test_a_video_fires_as_its_light_does():
    """Physics: light that doubles fires log(2) / C events from an sRGB video, after decoding."""
    light = np.array([0.2, 0.4])
    video = np.round(255 * srgb_of(light)).astype(np.uint8)[:, None, None] * np.ones((1, 3, 3), "B")
    model = SensorModel(width=3, height=3, contrast_threshold=0.1, dark_level=0.0)
    assert len(simulate(to_linear(video, "srgb"), [0.0, 0.04], model)) == 9 * 6  # log(2) = 0.69
    assert len(simulate(video.astype(float), [0.0, 0.04], model)) == 9 * 3  # of the codes


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int16, np.int64])
@pytest.mark.parametrize("source", [np.asarray, list, iter])
def test_integer_frames_are_refused_and_the_way_out_is_named(dtype, source):
    """Promise: numbers encoded for a screen are never used as light."""
    frames = np.ones((2, 4, 4), dtype)
    with pytest.raises(SensorError) as error:
        simulate(source(frames), [0.0, 0.1], SensorModel(width=4, height=4))
    assert f"frame 0: found {np.dtype(dtype)}, expected linear radiance" in str(error.value)
    assert "sensor.to_linear(frames, 'srgb')" in str(error.value)
    assert "\n" not in str(error.value)


def test_frames_of_other_types_are_refused_without_that_advice():
    """Promise: the error recommends `to_linear` only where it can help."""
    for dtype in (np.bool_, np.complex64):
        with pytest.raises(SensorError, match=r"expected linear radiance as float32 or float64$"):
            simulate(np.ones((2, 4, 4), dtype), [0.0, 0.1], SensorModel(width=4, height=4))
