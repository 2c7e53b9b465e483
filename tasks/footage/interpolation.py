"""How far things move from frame to frame, and motion-compensated frames in between.

The simulation interpolates between frames. Where a texture moves by more than about a pixel, it
therefore misses variations of the light, and their events.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain, pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from eres_render.cores import cores
from tasks.footage.footage import Footage
from tasks.footage.warping import blend, coefficients, find_later

Float32 = NDArray[np.float32]

_MAX_PX = 0.5  # largest motion per step
_ROWS = 64  # that a thread computes at a time
_MEASURED_PX = 320  # longer side of the images in which motion is measured
_PERCENTILE = 95  # of the displacements, so that a few wrong vectors do not matter
_MIN_PX = 64  # DIS finds too little motion in images with a shorter side, or fails
_EDGE = 4.0  # gray levels per px: less is noise, and flow in a plain area means nothing


def steps_for(displacement_px: float) -> int:
    """Return how finely to divide an interval so that a step has at most half a pixel of motion."""
    return max(1, math.ceil(displacement_px / _MAX_PX))


def interpolated(footage: Footage, steps: Sequence[int]) -> Footage:
    """Return footage with motion-compensated frames; interval k becomes `steps[k]` intervals."""
    times = map(_times_s, pairwise(footage.t_s), steps)
    return replace(
        footage,
        t_s=np.append(np.concatenate(list(times)), footage.t_s[-1]),
        frames=lambda: (frame for _, frame in timed_frames(footage, steps)),
    )


def timed_frames(
    footage: Footage, steps: Sequence[int] | None, sensor_px: float = 1.0
) -> Iterator[tuple[float, Float32]]:
    """Yield the times and frames of `interpolated`.

    With None, an interval has as many steps as its motion needs on a sensor with `sensor_px` pixels
    for a pixel of the footage.
    """
    ends = (_End(light, footage.white_level) for light in footage)
    with ThreadPoolExecutor(cores(), thread_name_prefix="in between") as workers:
        for k, (before, after) in enumerate(pairwise(ends)):
            if steps is None:
                n = steps_for(sensor_px * _displacement_px(before, after))
            else:
                n = steps[k]
            times_s = _times_s(footage.t_s[k : k + 2], n)
            between = _between(before, after, n, workers) if n > 1 else ()
            yield from zip(times_s, chain([before.light], between), strict=True)
    yield footage.t_s[-1], after.light


def _times_s(ends_s: Iterable[float], steps: int) -> NDArray[np.float64]:
    start_s, end_s = ends_s
    return start_s + (end_s - start_s) * np.arange(steps) / steps


@dataclass(frozen=True, eq=False)
class _End:
    """A frame of the footage, with what is computed once for the intervals before and after it."""

    light: Float32
    white_level: float

    @cached_property
    def gray(self) -> NDArray[np.uint8]:
        return gray(self.light, self.white_level)

    @cached_property
    def small(self) -> NDArray[np.uint8]:
        scale = min(1.0, _MEASURED_PX / max(self.light.shape))
        height, width = (max(_MIN_PX, round(scale * side)) for side in self.light.shape)
        light = cv2.resize(self.light, (width, height), interpolation=cv2.INTER_AREA)
        return gray(light, self.white_level)

    @cached_property
    def spline(self) -> Float32:
        return coefficients(self.light)


def _between(before: _End, after: _End, steps: int, workers: Executor) -> Iterator[Float32]:
    flow = optical_flow(before.gray, after.gray)
    later = np.empty_like(flow)
    find_later(flow, later)
    starts = range(0, len(flow), _ROWS)
    for k in range(1, steps):
        frame = np.empty(flow.shape[:2], np.float32)
        bands = [frame[start : start + _ROWS] for start in starts]
        blended = partial(blend, before.spline, after.spline, flow, later, k / steps)
        list(workers.map(blended, starts, bands))
        yield frame


def displacements_px(footage: Footage) -> NDArray[np.float64]:
    """Measure the motion of edges from each frame to the next, by DIS optical flow on small images.

    It is the 95th percentile, (T - 1,) px of the footage; 0 without edges. Only motion across edges
    counts: along them the light does not change, nor in plain areas.
    """
    ends = (_End(light, footage.white_level) for light in footage)
    return np.array([_displacement_px(*both) for both in pairwise(ends)])


def _displacement_px(before: _End, after: _End) -> float:
    image, flow = before.small, optical_flow(before.small, after.small)
    scales = np.divide(image.shape, before.light.shape)[::-1]  # a narrow image is stretched
    sides = [cv2.Sobel(image, cv2.CV_64F, *d, scale=1 / 8) for d in ((1, 0), (0, 1))]
    gradient = np.stack(sides, axis=-1)
    edge = np.hypot(*np.moveaxis(gradient, 2, 0)) > _EDGE
    change = np.abs(np.sum(gradient * flow, axis=2)[edge])  # of the light; the scales cancel
    across = change / np.hypot(*np.moveaxis(gradient[edge] * scales, 1, 0))
    return float(np.percentile(across, _PERCENTILE)) if across.size else 0.0


def gray(light: NDArray[np.number], white_level: float) -> NDArray[np.uint8]:
    """Return an image for optical flow, in which dark and bright textures have similar contrast."""
    return np.clip(255 * np.sqrt(light / white_level), 0, 255).astype(np.uint8)


def optical_flow(before: NDArray[np.uint8], after: NDArray[np.uint8]) -> Float32:
    """Return dense optical flow between `gray` images (DIS; Kroeger et al., ECCV 2016).

    It has the displacements of the points of `before`, (H, W, 2) px: x, then y.
    """
    height, width = before.shape
    larger = max(width, _MIN_PX), max(height, _MIN_PX)
    first, second = (cv2.resize(image, larger) for image in (before, after))  # same size: a copy
    still = np.zeros((*larger[::-1], 2), np.float32)
    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    flow = cv2.resize(dis.calc(first, second, still), (width, height))
    return np.asarray(flow * np.array([width / larger[0], height / larger[1]], np.float32))


def followed(image: Float32, before: NDArray[np.uint8], after: NDArray[np.uint8]) -> Float32:
    """Return an image of the moment of `after`, moved back to `before` along their optical flow."""
    columns, rows = (np.arange(side, dtype=np.float32) for side in image.shape[::-1])
    at = optical_flow(before, after) + np.dstack(np.meshgrid(columns, rows))
    x, y = np.moveaxis(at, 2, 0).copy()
    return np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
