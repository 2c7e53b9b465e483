"""Video from events: the high-pass filter against its equation, and the comparison of images."""

import math
from itertools import pairwise
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensor import Events, SensorModel, simulate
from tasks.errors import TaskError
from tasks.evaluation.rendered_clip import RenderedClip
from tasks.evaluation.scorers.video import VideoScorer
from tasks.evaluation.sensor_setting import Setting
from tasks.evaluation.settings import Video
from tasks.methods.baselines import BlankVideo
from tasks.methods.high_pass_filter import HighPassFilter, without_event_decay
from tasks.psnr import psnr_db
from tasks.video import EQUALIZATIONS, ImageTaker, equalize, log_light, picture

C = 0.2
SIZE = 8


def random_events(count=2000, seed=0, size=SIZE):
    rng = np.random.default_rng(seed)
    return Events(
        np.sort(rng.integers(0, 3_000_000, count)),
        rng.integers(0, size, count).astype(np.uint16),
        rng.integers(0, size, count).astype(np.uint16),
        rng.choice([-1, 1], count).astype(np.int8),
        size,
        size,
    )


def train(period_us, count, polarity=1):
    """Return events of one pixel at even times."""
    nothing = np.zeros(count, np.uint16)
    t_us = np.arange(count) * period_us
    return Events(t_us, nothing, nothing, np.full(count, polarity, np.int8), 1, 1)


def slow_filter(events, t_us, cutoff_hz, per_event_decay):
    """Return the filter's state from its definition: each event, decayed by all later ones."""
    omega = 2 * math.pi * cutoff_hz
    image = np.zeros((events.height, events.width))
    for y, x in np.ndindex(image.shape):
        here = (events.x == x) & (events.y == y) & (events.t_us < t_us)
        for k, (t, p) in enumerate(zip(events.t_us[here], events.p[here], strict=True)):
            later = np.count_nonzero(here) - 1 - k
            age_s = (t_us - t) * 1e-6
            image[y, x] += p * C * math.exp(-omega * age_s - per_event_decay * later)
    return image


@pytest.mark.parametrize(("cutoff_hz", "decay"), [(0.06, 0.06), (0.06, 0.0), (2.0, 0.3)])
def test_filter_is_that_of_a_slow_reference(cutoff_hz, decay):
    """Promise: image(t) is the sum of all events before t, each decayed by its age and rank."""
    events = random_events()
    taker = ImageTaker(
        HighPassFilter(SIZE, SIZE, C, cutoff_hz, decay), [1_000_000, 2_500_000, 4_000_000]
    )
    for t_us, image in [*taker.take(events), *taker.rest()]:
        expected = slow_filter(events, t_us, cutoff_hz, decay)
        np.testing.assert_allclose(image, expected, rtol=1e-12, atol=1e-15)


def test_one_event_fades_by_the_time_constant():
    """Physics: exp(-2 pi f t) remains after t; 2.65 s leave 1 / e at 0.06 Hz."""
    tau_us = 1e6 / (2 * math.pi * 0.06)
    method = HighPassFilter(1, 1, C)
    method.push(train(1, 1))
    assert method.image(0)[0, 0] == C
    assert method.image(round(tau_us))[0, 0] == pytest.approx(C / math.e, rel=1e-6)


def test_a_steady_rise_saturates():
    """Physics: events every T settle at C / (1 - exp(-(omega T + d))), a geometric series."""
    method = HighPassFilter(1, 1, C, cutoff_hz=0.5, per_event_decay=0.1)
    method.push(train(10_000, 1000))
    left = math.exp(-(2 * math.pi * 0.5 * 0.01 + 0.1))
    assert method.image(999 * 10_000)[0, 0] == pytest.approx(C / (1 - left), rel=1e-9)


def test_without_forgetting_it_is_event_integration():
    """Physics: at cutoff 0 and without decay per event, the filter adds up p C."""
    events = random_events()
    method = HighPassFilter(SIZE, SIZE, C, cutoff_hz=0.0, per_event_decay=0.0)
    method.push(events)
    np.testing.assert_allclose(method.image(10**9), events.polarity_sum() * C, atol=1e-12)


def test_it_passes_what_is_fast_and_stops_what_is_slow():
    """Physics: a sine at the cutoff is 3 dB down and 45 degrees ahead, as for one pole."""
    cutoff_hz, contrast, amplitude = 2.0, 0.002, 1.0
    t_s = np.arange(4001) / 1000  # 8 periods
    signal = amplitude * np.sin(2 * math.pi * cutoff_hz * t_s)
    model = SensorModel(width=1, height=1, contrast_threshold=contrast, dark_level=0.0)
    events = simulate(np.exp(signal)[:, None, None], t_s, model)
    method = HighPassFilter(1, 1, contrast, cutoff_hz, 0.0)
    taker = ImageTaker(method, range(3_000_000, 4_000_000, 10_000))
    taken = [*taker.take(events), *taker.rest()]
    phase = 2 * math.pi * cutoff_hz * 1e-6 * np.array([t_us for t_us, _ in taken])
    value = np.array([image[0, 0] for _, image in taken])
    in_phase, ahead = 2 * np.mean(value * np.sin(phase)), 2 * np.mean(value * np.cos(phase))
    assert math.hypot(in_phase, ahead) == pytest.approx(amplitude / math.sqrt(2), rel=0.01)
    assert math.degrees(math.atan2(ahead, in_phase)) == pytest.approx(45, abs=0.5)


def test_event_decay_bounds_the_state():
    """Promise: every pixel is within C / (1 - exp(-d)) of 0, for any events."""
    method = HighPassFilter(1, 1, C, cutoff_hz=0.0)
    bound = C / (1 - math.exp(-0.06))
    method.push(train(1, 100_000, polarity=-1))
    assert -bound * (1 + 1e-12) <= method.image(10**6)[0, 0] < -0.999 * bound
    free = without_event_decay(1, 1, C)
    free.push(train(1, 100_000))
    assert free.image(10**5)[0, 0] > 1000 * bound


@settings(max_examples=30)
@given(st.lists(st.integers(0, 2000), max_size=6), st.lists(st.integers(0, 3_500_000), max_size=5))
def test_any_division_of_the_stream_gives_the_same_images(cuts, times):
    """Promise: parts, and images between them, change nothing, not even rounding."""
    events = random_events()
    whole = ImageTaker(HighPassFilter(SIZE, SIZE, C), sorted(times))
    expected = [*whole.take(events), *whole.rest()]
    taker, taken = ImageTaker(HighPassFilter(SIZE, SIZE, C), sorted(times)), []
    edges = [0, *sorted(cuts), len(events)]
    for first, last in pairwise(edges):
        taken += taker.take(events[first:last])
    taken += taker.rest()
    assert [t_us for t_us, _ in taken] == [t_us for t_us, _ in expected] == sorted(times)
    for (_, image), (_, other) in zip(taken, expected, strict=True):
        np.testing.assert_array_equal(image, other)


def test_an_image_may_be_the_state_of_the_method():
    """Promise: an image shows the events before its time, not those of its batch, and one image is
    in memory at a time."""

    class Sum:
        def __init__(self):
            self.state, self.made = np.zeros((1, 1)), 0

        def push(self, events):
            self.state += events.p.sum()

        def image(self, t_us):
            self.made += 1
            return self.state

    method = Sum()
    taker = ImageTaker(method, [10, 20, 30, 40])
    found = []
    for images in (taker.take(train(10, 3)), taker.rest()):
        for t_us, image in images:
            found.append((t_us, image[0, 0]))
            assert method.made == len(found)
    assert found == [(10, 1), (20, 2), (30, 3), (40, 3)]


def test_an_image_sees_the_events_before_its_time():
    """Promise: windows are half-open, so an event at t counts from then on."""
    taker = ImageTaker(without_event_decay(1, 1, 1.0), [0, 10, 11])
    ((t_us, image),) = taker.take(train(10, 1))
    assert (t_us, image[0, 0]) == (0, 0.0)
    events = train(10, 2)
    taken = taker.take(events[1:])
    assert [(t_us, round(image[0, 0], 3)) for t_us, image in taken] == [(10, 1.0)]
    assert [(t_us, round(image[0, 0], 3)) for t_us, image in taker.rest()] == [(11, 2.0)]


def test_the_filter_refuses_what_it_cannot_use():
    """Promise: another sensor's events, a step back in time and a negative decay are errors."""
    method = HighPassFilter(SIZE, SIZE, C)
    with pytest.raises(TaskError, match="found events of 1x1 px, expected 8x8"):
        method.push(train(1, 1))
    method.push(random_events())
    with pytest.raises(TaskError, match="us, the time of the last event"):
        method.push(random_events(10))
    with pytest.raises(TaskError, match="us, the time of the last event"):
        method.image(0)
    with pytest.raises(TaskError, match="per_event_decay: found -1"):
        HighPassFilter(SIZE, SIZE, C, per_event_decay=-1)


def smooth_noise(seed, size=160, blur_px=3.0):
    noise = np.random.default_rng(seed).standard_normal((size, size))
    image = cv2.GaussianBlur(noise, (0, 0), blur_px)
    return image / image.std()


def test_the_filter_makes_a_better_image_than_nothing():
    """Physics: a texture that moves by many of its details appears in the image; blank is blank."""
    t_s = np.linspace(0, 0.3, 150)
    wide = smooth_noise(1, 260)
    frames = np.exp([cv2.warpAffine(wide, _shift(300 * t), (160, 160)) for t in t_s])
    model = SensorModel(width=160, height=160, contrast_threshold=C, dark_level=0.0)
    events = simulate(frames, t_s, model)
    truth = picture(np.log(frames[-1]), (160, 160))
    scores = {}
    for start in (HighPassFilter, without_event_decay, BlankVideo):
        method = start(160, 160, C)
        method.push(events)
        scores[start] = psnr_db(picture(method.image(300_000), (160, 160)), truth)
    assert scores[BlankVideo] == pytest.approx(10 * math.log10(12), abs=0.5)
    assert scores[HighPassFilter] > scores[BlankVideo] + 2
    assert scores[without_event_decay] > scores[BlankVideo] + 1


def _shift(x_px):
    return np.array([[1.0, 0.0, -x_px], [0.0, 1.0, -5.0]])


@pytest.mark.parametrize("side", [2, 3, 8, 15])
def test_small_images_are_not_all_alike(side):
    """Promise: an image and its negative differ, though tiles of one pixel would be the same."""
    rng = np.random.default_rng(side)
    image = rng.uniform(-1.0, 0.0, (side, side))
    both = [picture(sign * image, image.shape) for sign in (1, -1)]
    assert psnr_db(*both) < 15


def test_yardsticks_of_equalized_images():
    """Physics: even histograms differ by 1/6 in the mean square, and by 1/12 from mid-gray."""
    truth, other = (picture(smooth_noise(k), (160, 160), "global") for k in (1, 2))
    assert np.std(truth) == pytest.approx(1 / math.sqrt(12), rel=0.01)
    blank = picture(np.zeros((20, 20)), (160, 160), "global")
    np.testing.assert_allclose(blank, 0.5)
    assert psnr_db(blank, truth) == pytest.approx(10 * math.log10(12), abs=0.05)
    assert psnr_db(other, truth) == pytest.approx(10 * math.log10(6), abs=0.5)


@pytest.mark.parametrize("equalization", ["global", "local"])
def test_equalized_images_know_no_level_and_no_contrast(equalization):
    """Promise: log intensity at another level and of another contrast is the same picture."""
    log_image = smooth_noise(3)
    truth = picture(log_image, log_image.shape, equalization)
    scaled = picture(0.6 * log_image - 20, log_image.shape, equalization)
    assert psnr_db(scaled, truth) > 45
    assert psnr_db(picture(-log_image, log_image.shape, equalization), truth) < 7


def test_local_equalization_knows_no_slow_shading():
    """Promise: variation over many tiles is removed, variation within one stays."""
    log_image = smooth_noise(4)
    y, _ = np.mgrid[:160, :160] / 160
    shaded = log_image + 8 * y
    scores = {
        name: psnr_db(picture(shaded, (160, 160), name), picture(log_image, (160, 160), name))
        for name in ("none", "global", "local")
    }
    assert scores["local"] > max(scores["none"], scores["global"]) + 3


def test_clahe_is_opencvs():
    """Promise: tiles, clip limit and interpolation as in OpenCV, which gives a level its last rank.

    We give it the mean of its ranks; its share is at most 3 / 256, the limit and the spread excess.
    """
    image = picture(smooth_noise(5, 1024, 20.0), (1024, 1024), "none")
    ours = equalize(image, *EQUALIZATIONS["clahe"])
    theirs = cv2.createCLAHE(2.0, (8, 8)).apply(np.minimum(image * 256, 255).astype(np.uint8))
    assert np.abs(ours - theirs / 255.0).max() < 3 / 256
    assert np.abs(ours - image).max() > 0.1


def test_predictions_are_enlarged_about_their_middle():
    """Promise: any sensor's image is compared at the truth's resolution, with aligned centers."""
    truth = smooth_noise(6, blur_px=16.0)
    small = cv2.resize(truth, (40, 40), interpolation=cv2.INTER_AREA)
    aligned = psnr_db(picture(small, (160, 160)), picture(truth, (160, 160)))
    shifted = psnr_db(picture(small, (160, 160))[:, 4:], picture(truth, (160, 160))[:, :-4])
    assert aligned > 35 > shifted + 5


@pytest.mark.parametrize("brighter", [3.0, 19.0, 23.0, 700.0, 1e5])
def test_a_hot_pixel_takes_no_levels_from_the_others(brighter):
    """Promise: black and white are percentiles, so all that is brighter than white looks the same,
    however far above, also where the others would be 0 next to it."""
    image = smooth_noise(6, blur_px=4.0)
    hot, white = image.copy(), image.copy()
    white[10, 20] = image.max() + 1e-3
    hot[10, 20] = image.max() + brighter
    found = picture(hot, hot.shape, "none")
    np.testing.assert_allclose(found, picture(white, white.shape, "none"), atol=1e-9)
    assert len(np.unique(found)) > 0.9 * found.size


def test_bad_pictures_are_refused():
    """Promise: NaN, an unknown equalization and images of two sizes are errors."""
    with pytest.raises(TaskError, match="not finite"):
        picture(np.full((4, 4), np.nan), (4, 4))
    with pytest.raises(TaskError, match="found 'lokal', expected one of none, global, local"):
        picture(np.zeros((4, 4)), (4, 4), "lokal")
    with pytest.raises(TaskError, match=r"found shape \(3, 4\), expected \(4, 4\)"):
        psnr_db(np.zeros((3, 4)), np.zeros((4, 4)))


class TwoFrames:
    """Stand-in for a sequence: radiance 1 at 0 s, 4 at 1 s."""

    t_s = np.array([0.0, 1.0])

    def frame(self, i):
        return np.full((2, 2), (1.0, 4.0)[i], np.float32)


def test_light_between_frames_is_a_line_in_log_intensity():
    """Promise: the truth is the light that the sensor received, at any time."""
    for t_s, expected in ((0.0, 1.0), (0.5, 2.0), (1.0, 4.0)):
        np.testing.assert_allclose(log_light(TwoFrames(), t_s, 0.0), math.log(expected))
    assert log_light(TwoFrames(), 0.0, 1.0)[0, 0] == pytest.approx(math.log(2))
    with pytest.raises(TaskError, match=r"the frames cover 0 to 1 s, but not 1.5 s"):
        log_light(TwoFrames(), 1.5, 0.0)


def test_other_equalizations_score_the_same_images():
    """Promise: each is a variant with the scores of a run with that equalization, and the method
    runs once."""
    events = random_events(size=32)
    setting = Setting(SensorModel(width=32, height=32), 1.0, 0, 2_000_000)
    truth = smooth_noise(1, 32)
    reference = SimpleNamespace(
        sequence=SimpleNamespace(window_s=(0.0, 2.0)),
        picture=lambda model, t_s, equalization: picture(truth, truth.shape, equalization),
    )

    def scores(**options):
        task = Video(methods=("high_pass_filter", "blank"), every_s=1.0, **options)
        scorer = VideoScorer(RenderedClip(reference, setting), task)
        scorer.push(events)
        return list(scorer.scores())

    together = scores(equalization="local", other_equalizations=("none", "clahe"))
    assert len(together) == 2 * 2 * 3
    for name, variant in (
        *(("local", ""), ("none", "equalization none")),
        ("clahe", "equalization clahe"),
    ):
        here = [score for score in together if score.variant == variant]
        alone = scores(equalization=name)
        assert [(s.method, s.sample, s.value) for s in here] == [
            (s.method, s.sample, s.value) for s in alone
        ]
        assert all(score.copied == (variant != "") for score in here)
    assert len({score.value for score in together if score.method == "high_pass_filter"}) == 6
