"""Area integration: exact overlaps, and a conserved mean."""

import numpy as np
import pytest

import reference_sensor
from sensor import SensorError
from sensor.optics import area_weights, integrate


@pytest.mark.parametrize(("n_in", "n_out"), [(1280, 346), (1280, 240), (1280, 128), (7, 7), (5, 3)])
def test_weights_cover_every_sample_once(n_in, n_out):
    """Physics: each sample's light is divided completely, and each pixel is a mean."""
    first, count, weight = area_weights(n_in, n_out)
    received = np.zeros(n_in)
    for i in range(n_out):
        received[first[i] : first[i] + count[i]] += weight[i, : count[i]]
        assert np.all(weight[i, count[i] :] == 0)
    np.testing.assert_allclose(weight.sum(axis=1), 1, rtol=1e-14)
    np.testing.assert_allclose(received, n_out / n_in, rtol=1e-12)


@pytest.mark.parametrize("size", [(10, 7), (9, 13), (14, 1), (3, 20)])
def test_fractional_box_matches_brute_force(size):
    """Promise: fractional ratios are exact, each axis independently."""
    frame = np.random.default_rng(1).gamma(0.5, 2.0, (14, 20)).astype(np.float32)
    np.testing.assert_allclose(
        integrate(frame, *size), reference_sensor.area_mean(frame, *size), rtol=1e-13
    )


@pytest.mark.parametrize("size", [(0, 4), (3, -1), (2.5, 4)])
def test_a_sensor_without_pixels_is_refused(size):
    """Promise: by name, not by an error of NumPy's."""
    with pytest.raises(SensorError, match=r"(height|width): found .*, expected a positive integer"):
        integrate(np.ones((8, 8)), *size)


def test_mean_is_conserved_at_the_papers_ratio():
    """Physics: 1280 / 346 = 3.699...; the sensor receives the light of the frame."""
    frame = np.random.default_rng(2).gamma(0.3, 5.0, (1280, 1280)).astype(np.float32)
    mean = frame.mean(dtype=np.float64)
    assert abs(integrate(frame, 346, 346).mean() / mean - 1) < 1e-6


@pytest.mark.parametrize("dtype", [">f4", ">f8", np.float16, np.longdouble, ">u2", ">i4"])
def test_numbers_of_any_kind_are_light(dtype):
    """Promise: PFM and FITS have big-endian numbers."""
    frame = np.arange(24.0).reshape(4, 6)
    found = integrate(frame.astype(dtype), height=2, width=3)
    np.testing.assert_array_equal(found, integrate(frame, height=2, width=3))


@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_what_is_no_light_is_refused(value):
    """Promise: an error, not a picture without the pixel."""
    frame = np.ones((4, 4))
    frame[1, 2] = value
    with pytest.raises(SensorError, match="frame: radiance is negative or not finite"):
        integrate(frame, 2, 2)
