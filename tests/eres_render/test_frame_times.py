"""Adaptive frame times: never too far apart, never too close, with marks hit exactly."""

import math
from itertools import pairwise

import numpy as np
import pytest

from eres_render import RenderError, load_scene
from eres_render.trajectory.frame_times import (
    adaptive_times,
    earlier_times,
    paced_times,
    plane_image_motion,
)

MARKS_S = (0.2118, 0.25, 0.3)


@pytest.fixture(scope="module")
def motion():
    scene = load_scene("carpet")
    return plane_image_motion(scene.trajectory(), scene.camera(1280), scene.plane)


@pytest.mark.parametrize("limit_px", [0.5, 2.0])
def test_each_step_moves_the_image_by_the_limit_unless_a_mark_cuts_it_short(motion, limit_px):
    t_s = adaptive_times(motion, MARKS_S, limit_px)
    assert set(MARKS_S) <= set(t_s.tolist())
    assert (t_s[0], t_s[-1]) == (MARKS_S[0], MARKS_S[-1])
    assert np.all(np.diff(t_s) > 0)
    steps = np.array([motion(a, b) for a, b in pairwise(t_s)])
    assert steps.max() <= limit_px * (1 + 1e-5)
    cut_short = np.isin(t_s[1:], MARKS_S)
    np.testing.assert_allclose(steps[~cut_short], limit_px, rtol=1e-5)


def test_times_before_an_anchor_do_not_depend_on_how_many_there_are(motion):
    """Promise: an earlier start adds times and moves none; each step moves the image by the limit,
    and the last one back reaches the start or passes it."""
    longest = earlier_times(motion, 0.25, 0.02, 2.0)
    for start_s in (0.2499999, 0.2, float(longest[10]), 0.02):
        t_s = earlier_times(motion, 0.25, start_s, 2.0)
        np.testing.assert_array_equal(t_s, longest[-len(t_s) :])
        assert t_s[0] <= start_s
        assert np.all(t_s[1:] > start_s)
    steps = [motion(b, a) for a, b in pairwise([*longest.tolist(), 0.25])]
    np.testing.assert_allclose(steps, 2.0, rtol=1e-5)


def test_times_before_an_anchor_end_at_the_start_of_the_path():
    np.testing.assert_allclose(
        earlier_times(lambda a, b: 100 * abs(b - a), 0.025, 0.0, 1.0), [0.0, 0.005, 0.015]
    )
    np.testing.assert_array_equal(earlier_times(lambda a, b: 0.0, 0.3, 0.1, 1.0), [0.0])


def test_steady_motion_gives_even_steps():
    """At 100 px/s and 1 px per frame: a frame every 10 ms."""
    t_s = adaptive_times(lambda a, b: 100 * abs(b - a), (0.0, 0.05), 1.0)
    np.testing.assert_allclose(t_s, np.linspace(0, 0.05, 6), atol=1e-9)


def test_motion_that_turns_back_within_a_long_rest_is_not_missed():
    """A camera that rests, moves away fast and returns: frames show the excursion."""

    def place_px(t):
        return 3 * np.exp(-(((t - 0.6) / 0.05) ** 2))

    t_s = adaptive_times(lambda a, b: abs(place_px(b) - place_px(a)), (0.0, 1.0), 0.5)
    assert max(place_px(t_s)) > 2.5


def test_without_motion_only_the_marks_remain():
    np.testing.assert_array_equal(adaptive_times(lambda a, b: 0.0, MARKS_S, 0.5), MARKS_S)


def test_senseless_requests_are_refused(motion):
    with pytest.raises(RenderError, match=r"max_displacement_px: found .*, expected a positive"):
        adaptive_times(motion, MARKS_S, 0.0)
    with pytest.raises(RenderError, match="max_displacement_px: found inf, expected a positive"):
        adaptive_times(motion, MARKS_S, np.inf)
    with pytest.raises(RenderError, match="increasing"):
        adaptive_times(motion, (0.3, 0.2), 0.5)


@pytest.mark.parametrize("enters_s", [0.0162, 0.0263777, 0.0371])
def test_a_motion_that_jumps_stays_below_the_limit(enters_s):
    """Promise: where a fast object enters the view, a frame is taken just before."""

    def motion(a, b):
        return (90.0 if b >= enters_s else 50.0) * (b - a)

    t_s = adaptive_times(motion, (0.0, 0.05), 0.5)
    found = [motion(a, b) for a, b in pairwise(t_s.tolist())]
    assert max(found) <= 0.5 * (1 + 1e-6)
    assert len(t_s) <= 1 + math.ceil(100 * enters_s) + 1 + math.ceil(180 * (0.05 - enters_s))


@pytest.mark.parametrize("times", [adaptive_times, paced_times])
@pytest.mark.parametrize("px_per_s", [1e9, 1e12])
def test_an_image_that_is_too_fast_for_frames_is_refused(times, px_per_s):
    """Promise: an error, not frames too far apart nor an endless search; poses in nanoseconds."""
    with pytest.raises(RenderError, match="path: the image moves"):
        times(lambda a, b: px_per_s * (b - a), (0.0, 1e-3), 0.5)


def test_a_limit_below_rounding_is_refused():
    """Promise: an error of the path, not one of the search."""
    with pytest.raises(RenderError, match="path: the image moves 1e-14 px within 0 s"):
        adaptive_times(lambda a, b: 100 * (b - a) + 2e-14, (0.0, 1e-3), 1e-14)


def test_paced_times_keep_the_limit_too(motion):
    """A few more frames than `adaptive_times` makes, none farther apart."""
    t_s = paced_times(motion, MARKS_S, 0.5)
    assert set(MARKS_S) <= set(t_s.tolist())
    assert np.all(np.diff(t_s) > 0)
    steps = np.array([motion(a, b) for a, b in pairwise(t_s)])
    assert steps.max() <= 0.5 * (1 + 1e-4)
    assert 1 <= len(t_s) / len(adaptive_times(motion, MARKS_S, 0.5)) < 1.1


def test_paced_times_of_motion_that_turns_back():
    """A point that swings 5 times a second by 20 px: its way is 400 px a second."""

    def motion(a, b):
        return 20 * abs(np.sin(10 * np.pi * b) - np.sin(10 * np.pi * a))

    t_s = paced_times(motion, (0.0, 1.0), 0.5)
    assert 800 <= len(t_s) < 850
    assert max(motion(a, b) for a, b in pairwise(t_s)) <= 0.5


def test_paced_times_without_motion_or_sense():
    np.testing.assert_array_equal(paced_times(lambda a, b: 0.0, MARKS_S, 0.5), MARKS_S)
    with pytest.raises(RenderError, match="max_displacement_px: found 0"):
        paced_times(lambda a, b: 0.0, MARKS_S, 0)


def test_a_camera_at_rest_reaches_a_mark_that_rounding_puts_out_of_reach():
    """Promise: the search ends where t + (mark - t) is less than the mark in floating point."""
    assert 0.65 + (1.7 - 0.65) < 1.7
    assert adaptive_times(lambda start, end: 0.0, (0.65, 1.7), 0.5).tolist() == [0.65, 1.7]
