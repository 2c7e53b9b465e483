"""Random crops: textures, motion, views and events agree with each other and with the scorer."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from sensor.levels import DARK_SHARE
from sensor.representations import voxel_grid
from tasks.errors import TaskError
from tasks.methods.high_pass_filter import HighPassFilter
from tasks.methods.our_reconstruction import DECAYS, OurReconstruction
from tasks.random_crops.crop import flow_sample, random_crop, video_sample
from tasks.random_crops.motion import Motion
from tasks.random_crops.settings import Crops, FlowCrops
from tasks.random_crops.texture import (
    DARKEST,
    SUBPIXELS,
    fractal,
    paint_leaves,
    random_texture,
    view,
)
from tasks.video import ImageTaker, picture

SIDE = 24
CROPS = Crops(side_px=SIDE, motion_px=(1.0, 4.0))
WINDOWS = 3


@pytest.fixture(scope="module")
def crop():
    return random_crop(CROPS, WINDOWS, seed=3, index=1, light="ideal")


def sampled(texture, homography, side):
    """Return what `view` promises, slowly."""
    offsets = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS
    total = np.zeros((side, side))
    for dy in offsets:
        for dx in offsets:
            x, y = np.meshgrid(np.arange(side) + dx, np.arange(side) + dy)
            u, v, w = np.tensordot(homography, np.stack([x, y, np.ones_like(x)]), axes=1)
            at = [v / w - 0.5, u / w - 0.5]
            total += map_coordinates(texture.astype(np.float64), at, order=1, mode="grid-wrap")
    return total / SUBPIXELS**2


def test_a_view_is_the_mean_of_samples():
    """Promise: a pixel is the mean of 2 x 2 bilinear samples of a periodic texture."""
    texture = np.random.default_rng(0).random((64, 64)).astype(np.float32)
    for homography in Motion(np.random.default_rng(1), 12, 6.0, 1.5).homographies(np.arange(3.0)):
        found = view(texture, homography, 12)
        np.testing.assert_allclose(found, sampled(texture, homography, 12), atol=2e-6)


def test_a_view_of_two_texels_a_pixel_is_their_mean():
    """Promise: at 2 texels per pixel, shifted by whole texels, a pixel is the mean of 4 texels."""
    texture = np.random.default_rng(0).random((16, 16)).astype(np.float32)
    homography = np.array([[2.0, 0, 3], [0, 2, -1], [0, 0, 1]])
    rolled = np.roll(texture, (1, -3), axis=(0, 1))
    expected = rolled.reshape(8, 2, 8, 2).mean(axis=(1, 3))[:6, :6]
    np.testing.assert_allclose(view(texture, homography, 6), expected, atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_a_bright_dot_moves_with_the_flow(seed):
    """Promise: the flow at a dot, by the homographies, is how far the dot's image moves."""
    side = 64
    motion = Motion(np.random.default_rng(seed), side, 5.0, 1.2)
    before, after = motion.homographies(np.array([2.0, 3.0]))
    at = np.array([30.5, 33.5, 1.0])  # center of the pixel in column 30 and row 33
    u, v, w = before @ at
    columns, rows = np.meshgrid(np.arange(512) + 0.5, np.arange(512) + 0.5)
    dx, dy = ((d + 256) % 512 - 256 for d in (columns - u / w, rows - v / w))
    texture = np.exp(-(dx**2 + dy**2) / (2 * 3.0**2)).astype(np.float32)

    def center(homography):
        image = view(texture, homography, side)
        x, y = np.meshgrid(np.arange(side) + 0.5, np.arange(side) + 0.5)
        return np.array([(image * x).sum(), (image * y).sum()]) / image.sum()

    moved = center(after) - center(before)
    flow = motion.flow(2.0, 3.0)[:, 33, 30]
    assert np.linalg.norm(flow) > 0.5
    np.testing.assert_allclose(moved, flow, atol=0.05)
    corner = motion.flow(2.0, 3.0)[:, 0, 0]
    assert motion.fastest_px(2) > 0.95 * np.linalg.norm(corner), "the frames are close enough"


def test_leaves_cover_what_their_formula_says():
    """Promise: each leaf paints the texels within its outline, over those before it, and around the
    edges."""
    leaves = np.array(
        [
            [3.0, 60.0, 9.0, 5.0, 0.6, 0, 1.0],
            [40.0, 20.0, 12.0, 7.0, 2.0, 1, 2.0],
            [44.0, 22.0, 6.0, 6.0, 0.0, 0, 3.0],
        ]
    )
    image = np.zeros((64, 64), np.float32)
    paint_leaves(image, leaves)
    expected = np.zeros((64, 64))
    rows, columns = np.mgrid[:64, :64]
    for x, y, length, width, angle, is_rectangle, gray in leaves:
        dx, dy = ((d + 32) % 64 - 32 for d in (columns - x, rows - y))
        along = (np.cos(angle) * dx + np.sin(angle) * dy) / length
        across = (np.cos(angle) * dy - np.sin(angle) * dx) / width
        outline = np.maximum(abs(along), abs(across)) if is_rectangle else along**2 + across**2
        expected[outline <= 1] = gray
    np.testing.assert_array_equal(image, expected)
    assert np.sum(image == 3) == pytest.approx(math.pi * 36, rel=0.03)


def test_octaves_of_1_over_f_noise_have_equal_variance():
    """Promise: the slope is that of the amplitude: at 1, each octave has the same share."""
    power = np.abs(np.fft.fft2(fractal(np.random.default_rng(0), 1.0))) ** 2
    radius = np.hypot(np.fft.fftfreq(512)[:, None], np.fft.fftfreq(512)[None])
    octaves = [power[(radius >= low) & (radius < 2 * low)].sum() for low in (0.05, 0.1, 0.2)]
    np.testing.assert_allclose(octaves, np.mean(octaves), rtol=0.05)


def test_textures_are_seeded_and_can_be_lit():
    """Promise: the same seed gives the same texture, others differ, and all reflect 1 to 100 %."""
    found = [random_texture(np.random.default_rng(seed), 0.6) for seed in (0, 0, 1, 2, 3)]
    np.testing.assert_array_equal(found[0], found[1])
    for texture in found[1:]:
        assert DARKEST <= texture.min() < texture.max() <= 1
        assert 0.2 < np.log(texture).std() < 0.7
        assert sum(np.array_equal(texture, other) for other in found[1:]) == 1


def test_events_add_up_to_the_truth_at_every_windows_end(crop):
    """Promise: the truth is aligned with the windows: an ideal pixel's events up to a window's end
    give the true change of log intensity to within C."""
    C = crop.contrast_threshold
    total = np.zeros((SIDE, SIDE))
    for k, events in enumerate(crop.events):
        assert events.t_us[0] >= (0, *crop.ends_us)[k]
        assert events.t_us[-1] < crop.ends_us[k]
        np.add.at(total, (events.y, events.x), C * events.p)
        change = crop.log_image(k + 1, SIDE) - crop.log_image(0, SIDE)
        assert np.abs(change - total).max() < C + 1e-3
    assert np.abs(change).max() > 3 * C


def test_twins_see_the_same_crops(crop):
    """Promise: light changes the cutoff and the events, but neither truth nor threshold."""
    other = random_crop(CROPS, WINDOWS, seed=3, index=1, light=50.0)
    np.testing.assert_array_equal(other.log_image(2, SIDE), crop.log_image(2, SIDE))
    assert other.contrast_threshold == crop.contrast_threshold
    assert (other.cutoff_hz, crop.cutoff_hz) == (50.0, math.inf)
    assert sum(map(len, other.events)) < sum(map(len, crop.events))


def test_drawn_light_is_within_its_range():
    """Promise: some crops are ideal, the others have cutoffs within the range; a share of 1 makes
    all ideal."""
    tiny = replace(CROPS, side_px=16, motion_px=(0.1, 0.2))
    found = [random_crop(tiny, 1, 0, index).cutoff_hz for index in range(12)]
    finite = [hz for hz in found if hz < math.inf]
    assert 0 < len(finite) < 12
    assert all(25 <= hz <= 400 for hz in finite)
    assert random_crop(replace(tiny, ideal_share=1.0), 1, 0, 0).cutoff_hz == math.inf


def test_fewer_texels_on_a_pixel_are_a_smoother_image():
    """Promise: the range of texels per pixel decides how alike neighboring pixels are."""
    alike = []
    for texels in (0.25, 2.0):
        crops = replace(CROPS, texels_per_px=(texels, texels), motion_px=(0.1, 0.2))
        image = random_crop(crops, 1, seed=3, index=1, light="ideal").log_image(0, 64)
        alike.append(np.corrcoef(image[:, 1:].ravel(), image[:, :-1].ravel())[0, 1])
    assert 1 - alike[0] < 0.5 * (1 - alike[1])


def test_crops_depend_on_their_seed_alone(crop):
    """Promise: the same seed gives the same crop; another seed, or a held-out crop, differs."""
    again = random_crop(CROPS, WINDOWS, seed=3, index=1, light="ideal")
    np.testing.assert_array_equal(again.log_image(1, SIDE), crop.log_image(1, SIDE))
    for one, other in zip(again.events, crop.events, strict=True):
        for column, expected in zip(one.columns, other.columns, strict=True):
            np.testing.assert_array_equal(column, expected)
    for seed, index, held_out in ((4, 1, False), (3, 2, False), (3, 1, True)):
        other = random_crop(CROPS, 1, seed, index, light="ideal", held_out=held_out)
        assert not np.array_equal(other.log_image(0, SIDE), crop.log_image(0, SIDE))


class Recorder:
    """Stands for a network: keeps its inputs."""

    bins = 5

    def __init__(self):
        self.grids = []

    def image(self, grid, states):
        self.grids.append(grid)
        return np.full(grid.shape[1:], 0.5, np.float32), states


def test_a_sample_is_what_the_method_gets_and_what_is_scored(crop):
    """Promise: inputs of training equal those of evaluation bit by bit, and targets are the
    pictures with which the scorer compares the image at a window's end."""
    grids, pictures = video_sample(crop, 5, run_in=0, ranked_px=SIDE)
    network = Recorder()
    window_us = 1e3 * CROPS.window_ms
    method = OurReconstruction(
        SIDE, SIDE, crop.contrast_threshold, network=network, window_us=window_us
    )
    taker = ImageTaker(method, crop.ends_us)
    for events in crop.events:
        list(taker.take(events))
    list(taker.rest())
    np.testing.assert_array_equal(grids, network.grids)
    for k in range(WINDOWS):
        image = crop.log_image(k + 1, SIDE)
        expected = picture(image, image.shape, "global")
        np.testing.assert_allclose(pictures[k], expected, atol=1e-6)
    late_grids, late_pictures = video_sample(crop, 5, run_in=2, ranked_px=SIDE)
    np.testing.assert_array_equal(late_grids, grids[2:])
    np.testing.assert_array_equal(late_pictures, pictures[2:])


def test_pixels_are_ranked_in_a_larger_area(crop):
    """Promise: targets are the middle of a larger picture, so a crop within something bright is
    bright."""
    _, pictures = video_sample(crop, 5, run_in=0, ranked_px=2 * SIDE)
    for k, found in enumerate(pictures, start=1):
        image = crop.log_image(k, 2 * SIDE)
        middle = slice(SIDE // 2, SIDE // 2 + SIDE)
        np.testing.assert_allclose(image[middle, middle], crop.log_image(k, SIDE), atol=1e-5)
        expected = picture(image, image.shape, "global")[middle, middle]
        np.testing.assert_allclose(found, expected, atol=1e-6)


def test_inputs_are_in_log_units(crop):
    """Promise: bins add up to C times the polarities; each other channel is the high-pass filter
    without decay in time and with its own decay per event, the last one with the filter's."""
    grids, _ = video_sample(crop, 5, run_in=0, ranked_px=SIDE)
    size = SIDE, SIDE, crop.contrast_threshold
    filters = [HighPassFilter(*size, 0.0, decay) for decay in DECAYS[:-1]]
    filters.append(HighPassFilter(*size, cutoff_hz=0.0))
    for grid, events, end_us in zip(grids, crop.events, crop.ends_us, strict=True):
        total = np.zeros((SIDE, SIDE))
        np.add.at(total, (events.y, events.x), crop.contrast_threshold * events.p)
        np.testing.assert_allclose(grid[:5].sum(axis=0), total, atol=1e-4)
        for channel, one in zip(grid[5:], filters, strict=True):
            one.push(events)
            np.testing.assert_allclose(channel, one.image(end_us), atol=1e-6)


def test_a_flow_sample_pairs_windows_with_the_later_ones_flow(crop):
    """Promise: the flow is over the second window of a pair."""
    grids, flows = flow_sample(crop, 5)
    assert grids.shape == (WINDOWS, 5, SIDE, SIDE)
    for k in range(1, WINDOWS):
        np.testing.assert_array_equal(flows[k - 1], crop.motion.flow(k, k + 1))
        grid = voxel_grid(crop.events[k], 5, convention="eraft")
        np.testing.assert_array_equal(grids[k], grid)


def test_a_camera_gives_what_crops_do_not_draw(tmp_path):
    """Promise: noise, dark level and the ratio of the thresholds are the camera's, the threshold
    of ON events and the cutoff the crop's, and all else that of the same crop without it."""
    file = tmp_path / "mine.toml"
    file.write_text("threshold = 0.1\nthreshold_off = 0.15\ndark = 0.05\nshot_noise = 50")
    plain, mine = (
        random_crop(replace(CROPS, sensor=name), WINDOWS, seed=3, index=1, light="ideal")
        for name in ("", str(file))
    )
    np.testing.assert_array_equal(mine.texture, plain.texture)
    assert mine.contrast_threshold == plain.contrast_threshold
    image, darker = mine.log_image(0.0, SIDE), plain.log_image(0.0, SIDE)
    np.testing.assert_allclose(np.exp(image) - np.exp(darker), 0.049, rtol=1e-3)
    model = mine.events[0].model
    assert model.off_threshold == pytest.approx(1.5 * plain.contrast_threshold)
    assert (model.dark_level, model.shot_noise_hz) == (0.05, 50.0)
    other = random_crop(replace(CROPS, sensor=str(file)), WINDOWS, seed=3, index=2, light="ideal")
    assert not np.array_equal(other.events[0].t_us, mine.events[0].t_us)


def test_wrong_settings_are_refused_by_name():
    """Promise: a message says which field, what was found and what was expected."""
    for change, words in (
        ({"side_px": 8}, "side_px: found 8, expected 16 to 1024"),
        ({"motion_px": (2.0, 1.0)}, r"motion_px: found \[2.0, 1.0\], expected two positive"),
        ({"ideal_share": 1.5}, "ideal_share: found 1.5, expected 0 to 1"),
        ({"window_ms": 0.0}, "window_ms: found 0.0, expected a positive number"),
    ):
        with pytest.raises(TaskError, match=words):
            replace(CROPS, **change)
    assert FlowCrops().window_ms == 50
    assert DARK_SHARE < DARKEST
