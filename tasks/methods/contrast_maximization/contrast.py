"""The contrast of the image of warped events."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tasks.flow import EVENT_COLUMNS, FlowSample
from tasks.numerics.compiling import inlined, jit_contract_in_place

REFERENCE_TIME = 0.5  # mid-window, so that events move as little as possible
_EVEN = np.array([0.7548776662466927, 0.5698402909980532])
"""The fractional parts of their multiples fill the unit square evenly: Roberts, "The Unreasonable
Effectiveness of Quasirandom Sequences" (2018)."""
_OBJECTIVES = {  # the fields by_gradient and around_even of `Patch`
    "variance": (False, True),
    "gradient": (True, True),
    "plain variance": (False, False),
}
_EXPOSURES = 16  # times, at least, at which the patch's own motion is sampled
_TOGETHER = 256  # events whose positions are computed at once
_SMOOTHING_PX = 1.0
_REACH_PX = 4  # of the Gaussian: four sigma
_TAPS = np.exp(-0.5 * (np.arange(_REACH_PX + 1) / _SMOOTHING_PX) ** 2)
_TAPS /= 2 * _TAPS.sum() - _TAPS[0]
_G0, _G1, _G2, _G3, _G4 = (float(tap) for tap in _TAPS)


class Patch(NamedTuple):
    """The events of a patch, in pixels of an image with a margin that fits every flow."""

    column: NDArray[np.float64]  # (N,) position of each event in the image
    row: NDArray[np.float64]
    t: NDArray[np.float64]  # (N,) time of each event from mid-window
    exposure_t: NDArray[np.float64]  # (E,) times from mid-window at which the patch is sampled
    width: int  # of the patch, px
    height: int
    left: float  # position of the patch in the image at mid-window
    top: float
    by_gradient: bool  # whether the objective is "gradient"
    around_even: bool  # whether the image without texture is subtracted


class Work(NamedTuple):
    """Memory of a search. Images include the margins."""

    pixels: NDArray[np.float64]  # the votes, row by row
    votes: NDArray[np.float64]  # the same memory as an image
    across: NDArray[np.float64]  # the votes blurred along x
    blurred: NDArray[np.float64]
    first: NDArray[np.uint64]  # (_TOGETHER,) pixel at the top left of each event
    f: NDArray[np.float64]  # (2, _TOGETHER) x and y from the center of that pixel to the event
    corner: NDArray[np.int64]  # (2, E) x and y of the pixel at the top left of the moving patch
    part: NDArray[np.float64]  # (2, E) x and y from that pixel to the patch's first pixel


class Contrast:
    """Contrast of the image of warped events: its variance around the image without texture.

    A static patch sees a point near its edge only for a part of the window. So the image of warped
    events fades out at its edges, and the plain variance depends on the flow even without texture.
    Therefore the image of events spread evenly over patch and window is subtracted before the
    squares are summed. The edges of the patch then add nothing to the sum at any flow, and the
    scatter of single events adds the same at every flow.

    Parameters
    ----------
    sample
        Events of one patch.
    reach_px
        Largest distance of any flow from the initial flow, per component; it sets the size of the
        images.
    objective
        "variance", "gradient", or "plain variance", which subtracts nothing: as no vote is lost, it
        is the variance of the image of warped events up to a constant.
    """

    def __init__(self, sample: FlowSample, reach_px: float, objective: str = "variance") -> None:
        farthest = 0.5 * (np.abs(sample.initial) + reach_px)
        # Blurred votes end within _REACH_PX of a vote, and none is made so near the image's edge.
        far = np.ceil(farthest + 2 * _REACH_PX).astype(np.int64) + 1
        far_x, far_y = far.tolist()
        width, height = (sample.patch[1] - sample.patch[0]).tolist()
        column, row = far - sample.patch[0]
        exposures = max(_EXPOSURES, math.ceil(2 * farthest.max()))  # at most a pixel apart
        self.patch = Patch(
            sample.x_px - 0.5 + column,
            sample.y_px - 0.5 + row,
            sample.t - REFERENCE_TIME,
            (np.arange(exposures) + 0.5) / exposures - REFERENCE_TIME,
            width,
            height,
            float(far_x),
            float(far_y),
            *_OBJECTIVES[objective],
        )
        votes, across, blurred = np.zeros((3, height + 2 * far_y, width + 2 * far_x))
        self.work = Work(
            votes.ravel(),
            votes,
            across,
            blurred,
            np.empty(_TOGETHER, np.uint64),
            np.empty((2, _TOGETHER)),
            np.empty((2, exposures), np.int64),
            np.empty((2, exposures)),
        )

    def __call__(self, flow: NDArray[np.float64]) -> float:
        """Return the contrast at a flow, (2,) px per window, as `contrast_at`."""
        return contrast_at(self.patch, self.work, flow[0], flow[1])


def off_grid(sample: FlowSample) -> FlowSample:
    """Spread events evenly over the areas of their pixels, so that zero flow is not the sharpest.

    Bilinear votes blur by f (1 - f) px^2, where f is the distance from the previous pixel center:
    not at all at zero flow, where all events are at pixel centers, but by 1/6 px^2 on average where
    they move. This outweighs the sharpness of a motion of up to about 2 px per window.

    Parameters
    ----------
    sample
        Events of one patch.

    Returns
    -------
    The sample with two events for each, on opposite sides of the center of its pixel.
    """
    aside_px = (np.arange(1, len(sample.t) + 1)[:, None] * _EVEN) % 1 - 0.5
    x_px, y_px = np.stack([aside_px, -aside_px], axis=1).reshape(-1, 2).T
    twice: dict[str, Any] = {name: np.repeat(getattr(sample, name), 2) for name in EVENT_COLUMNS}
    twice["x_px"] += x_px
    twice["y_px"] += y_px
    return replace(sample, **twice)


@jit_contract_in_place
def contrast_at(patch, work, vx, vy):
    """Compute the contrast at the flow (vx, vy), px per window."""
    work.pixels[:] = 0.0
    _vote(patch, vx, vy, work)
    if patch.around_even:
        _subtract_even_events(patch, vx, vy, work)
    _blur(work)
    image = work.blurred
    rows, columns = image.shape
    total = 0.0
    if patch.by_gradient:
        for y in range(1, rows - 1):
            for x in range(1, columns - 1):
                dx = 0.5 * (image[y, x + 1] - image[y, x - 1])
                dy = 0.5 * (image[y + 1, x] - image[y - 1, x])
                total += dx * dx + dy * dy
    else:
        for y in range(rows):
            for x in range(columns):
                total += image[y, x] * image[y, x]
    area = patch.width * patch.height
    mean = patch.t.size / area
    return total / (area * mean * mean)


@inlined
def _vote(patch, vx, vy, work):
    """Add the bilinear votes of the warped events; their positions first, in a vectorized loop."""
    pixels, first, fx, fy = work.pixels, work.first, work.f[0], work.f[1]
    columns = work.votes.shape[1]
    right, below = np.uint64(1), np.uint64(columns)
    for start in range(0, patch.t.size, _TOGETHER):
        group = slice(start, min(start + _TOGETHER, patch.t.size))
        column, row, t = patch.column[group], patch.row[group], patch.t[group]
        for k in range(t.size):
            x, y = column[k] - vx * t[k], row[k] - vy * t[k]
            x0, y0 = np.floor(x), np.floor(y)
            fx[k], fy[k] = x - x0, y - y0
            first[k] = np.int64(y0 * columns + x0)
        for k in range(t.size):
            at = first[k]
            pixels[at] += (1.0 - fx[k]) * (1.0 - fy[k])
            pixels[at + right] += fx[k] * (1.0 - fy[k])
            pixels[at + below] += (1.0 - fx[k]) * fy[k]
            pixels[at + below + right] += fx[k] * fy[k]


@inlined
def _subtract_even_events(patch, vx, vy, work):
    """Subtract the votes of the same number of events, spread evenly over the patch and the window.

    The votes of a moving patch are the product of a moving interval in x and one in y: 1 - f at the
    interval's first pixel, then 1, and f after its last.
    """
    width, height, exposures = patch.width, patch.height, patch.exposure_t.size
    x0, y0, fx, fy = work.corner[0], work.corner[1], work.part[0], work.part[1]
    for k in range(exposures):
        left = patch.left - vx * patch.exposure_t[k]
        top = patch.top - vy * patch.exposure_t[k]
        x0[k], y0[k] = int(left), int(top)
        fx[k], fy[k] = left - x0[k], top - y0[k]
    share = patch.t.size / (width * height) / exposures
    for y in range(work.votes.shape[0]):
        for k in range(exposures):
            below = y - y0[k]
            if below < 0 or below > height:
                continue
            expected = share
            if below == 0:
                expected = share * (1.0 - fy[k])
            elif below == height:
                expected = share * fy[k]
            line = work.votes[y, x0[k] : x0[k] + width + 1]
            line[0] -= expected * (1.0 - fx[k])
            for x in range(1, width):
                line[x] -= expected
            line[width] -= expected * fx[k]


@inlined
def _blur(work):
    """Blur by a Gaussian of 1 px; the votes are 0 within its reach of the edge."""
    across, blurred = work.across, work.blurred
    rows, columns = across.shape
    for y in range(rows):
        line, out = work.votes[y], across[y, 4:]
        for x in range(columns - 8):
            out[x] = (
                _G0 * line[x + 4]
                + _G1 * (line[x + 3] + line[x + 5])
                + _G2 * (line[x + 2] + line[x + 6])
                + _G3 * (line[x + 1] + line[x + 7])
                + _G4 * (line[x] + line[x + 8])
            )
    for y in range(rows - 8):
        lines, out = across[y : y + 9], blurred[y + 4]
        for x in range(columns):
            out[x] = (
                _G0 * lines[4, x]
                + _G1 * (lines[3, x] + lines[5, x])
                + _G2 * (lines[2, x] + lines[6, x])
                + _G3 * (lines[1, x] + lines[7, x])
                + _G4 * (lines[0, x] + lines[8, x])
            )
