"""The error of event integration at each width, from the spectrum of one image."""

import cv2
import numpy as np
import pytest
from PIL import Image

from sensor import to_linear
from sensor.optics import integrate
from tasks.advice.spectrum import MovingImage, read_picture
from tasks.errors import TaskError

SIDE, PATH_PX = 240, 30.0
LAGS_PX = 0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 5.0, 9.0


def texture(power_x=1.0, power_y=1.0, seed=0):
    """Return periodic log light of a power of k^-2.2, with frequencies along an axis stretched."""
    k = np.fft.fftfreq(SIDE)
    radius = np.hypot(power_x * k, power_y * k[:, None])
    radius[radius < 1 / 60] = np.inf
    noise = np.fft.fft2(np.random.default_rng(seed).standard_normal((SIDE, SIDE)))
    log_light = np.fft.ifft2(noise * radius**-1.1).real
    return 0.45 * log_light / log_light.std()


def picture(log_light):
    light = np.exp(log_light)
    return np.minimum(light / np.percentile(light, 99.9), 1)


def margins(image, threshold=0.2, poles=2, direction=0.0):
    """Return by how much the finest width leads the next coarser one at each lag, dB."""
    moving = MovingImage(image, PATH_PX, direction)
    fine, coarse = (moving.psnr_db(w, LAGS_PX, threshold, poles) for w in (SIDE, SIDE // 2))
    return np.subtract(fine, coarse)


def crossing(image, **options):
    lost = np.flatnonzero(margins(image, **options) < 0)
    return LAGS_PX[lost[0]] if len(lost) else np.inf


EVEN = picture(texture())
STRIPES = picture(np.broadcast_to(2 * texture(0.6, 60).mean(axis=0), (SIDE, SIDE)))
COURSES = picture(texture(4.0, 1.0))


@pytest.mark.parametrize("image", [EVEN, STRIPES, COURSES])
def test_without_lag_a_finer_sensor_is_better(image):
    """Physics: of pixels without delay, and with fine thresholds, each finer width is better."""
    moving = MovingImage(image, PATH_PX, 0.0)
    found = [moving.psnr_db(width, [0.0], 1e-3)[0] for width in (30, 60, 80, 120, 240)]
    assert (np.diff(found) > 0).all()


def test_the_crossing_follows_the_detail_along_the_motion():
    """Physics: stripes across the motion cross before a texture with detail in all directions, and
    that before courses along it."""
    assert crossing(STRIPES) < crossing(EVEN) < crossing(COURSES)
    assert crossing(STRIPES) >= 0.5
    assert 0.7 <= crossing(EVEN) <= 1.4


def test_motion_along_stripes_changes_nothing():
    """Physics: stripes that move along themselves are not seen to move; what is left is that the
    image ends somewhere."""
    along, across = (MovingImage(STRIPES, PATH_PX, one).psnr_db(SIDE, LAGS_PX) for one in (90, 0))
    assert (np.subtract(along, across) > 15).all()


def test_larger_thresholds_favor_the_coarser_sensor():
    """Physics: at small lags the finer sensor's lead falls with the threshold, and at last ends."""
    found = [margins(EVEN, threshold=C)[0] for C in (0.01, 0.1, 0.2, 0.4, 0.8)]
    assert (np.diff(found) < 0).all()
    assert found[0] > 2
    assert found[-1] < 0.5


def test_one_pole_lets_the_finer_sensor_win():
    """Physics: one pole never turns a detail against the image, so that only the threshold does."""
    assert crossing(EVEN, poles=1, threshold=1e-3) == np.inf
    assert crossing(EVEN, poles=1) > crossing(EVEN)


@pytest.mark.parametrize("width", [120, 80, 104, 60])
def test_aliases_and_enlargement_are_exact(width):
    """Promise: without delay and threshold, the error is that of averaging an image over pixels,
    and enlarging it as event integration does, also for widths that divide no other."""
    light = EVEN
    errors = []
    for shift in range(1, 25):
        change = np.roll(light, shift, 1) - np.roll(light, shift - round(PATH_PX), 1)
        seen = integrate(np.maximum(change + 1, 0), width, width) - 1
        up = cv2.resize(seen, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC)
        errors.append(np.mean((up - change) ** 2))
    (psnr,) = MovingImage(light, PATH_PX, 0.0).psnr_db(width, [0.0], 1e-4)
    assert psnr == pytest.approx(-10 * np.log10(np.mean(errors)), abs=0.3)


def test_pixels_that_never_fire_have_no_noise():
    """Promise: a flat half, however bright, halves the error and adds none."""
    half = np.vstack([EVEN, np.ones_like(EVEN)])
    both, whole = (MovingImage(one, PATH_PX, 0.0).psnr_db(SIDE, [0.5])[0] for one in (half, EVEN))
    assert both == pytest.approx(whole + 10 * np.log10(2), abs=0.5)


def test_directions_are_averaged():
    """Promise: without a direction, the mean squared error over four."""
    each = [MovingImage(COURSES, PATH_PX, one).psnr_db(60, [1.0])[0] for one in (0, 45, 90, 135)]
    mean = np.mean([10 ** (-one / 10) for one in each])
    assert MovingImage(COURSES, PATH_PX).psnr_db(60, [1.0])[0] == pytest.approx(
        -10 * np.log10(mean)
    )


def test_a_picture_is_linear_light(tmp_path):
    """Promise: codes are linear before they are averaged, and white is 1."""
    codes = np.tile(np.array([0, 255], np.uint8), (30, 300))
    Image.fromarray(codes).save(tmp_path / "bars.png")
    np.testing.assert_allclose(read_picture(tmp_path / "bars.png", 300), 1.0)
    codes[:15] //= 2
    Image.fromarray(codes).save(tmp_path / "bars.png")
    found = read_picture(tmp_path / "bars.png", 200)  # pixels of three samples
    assert found.shape == (10, 200)
    light = to_linear(np.array([127, 255], np.uint8), "srgb")
    dark = float(light[0])
    np.testing.assert_allclose(found[0, ::2] / found[-1, ::2], dark, rtol=1e-5)
    np.testing.assert_allclose(found[-1, :2], [0.5, 1.0], rtol=1e-5)


def test_a_narrow_picture_is_refused(tmp_path):
    """Promise: an image that lacks the finest detail is an error."""
    Image.fromarray(np.zeros((9, 99), np.uint8)).save(tmp_path / "small.png")
    with pytest.raises(TaskError, match="99 px wide"):
        read_picture(tmp_path / "small.png", 100)
