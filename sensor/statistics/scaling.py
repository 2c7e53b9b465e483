"""Slopes of log intensity in time, Eq. (5), and how they scale with the size of pixels, Eq. (6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from sensor.errors import SensorError

_DRAWS = 2000


def log_slope(
    radiance_0: NDArray[np.floating],
    radiance_1: NDArray[np.floating],
    dt_s: float,
    dark_level: float,
) -> NDArray[np.float64]:
    """Return L_t of Eq. (5), the mean slope of log(I + I_dark) between two frames.

    Parameters
    ----------
    radiance_0, radiance_1
        (H, W) linear radiance of the frames.
    dt_s
        Time between them, s.
    dark_level
        I_dark, in the unit of radiance.

    Returns
    -------
    (H, W) float64, 1/s

    Examples
    --------
    >>> import numpy as np
    >>> from sensor.statistics import log_slope
    >>> log_slope(np.array([[1.0, 2.0]]), np.array([[np.e, 2.0]]), dt_s=0.01, dark_level=0.0)
    array([[100.,   0.]])
    """
    after, before = (f.astype(np.float64) + dark_level for f in (radiance_1, radiance_0))
    return np.log(after / before) / dt_s


@dataclass(frozen=True, eq=False, slots=True)
class SlopesBySize:
    """|L_t| of square pixels of increasing size, in blocks of the image.

    Attributes
    ----------
    sizes_px : (P,) int64
        Widths of the pixels, in pixels of the frames.
    everywhere, edges : (N, P) float64
        Mean |L_t| of each block, 1/s: over all its pixels, and over its edge pixels. `edges` omits
        blocks without an edge.
    edge_weights : (len(edges),) int64
        Number of edge pixels of each block in `edges`.
    """

    sizes_px: NDArray[np.int64]
    everywhere: NDArray[np.float64]
    edges: NDArray[np.float64]
    edge_weights: NDArray[np.int64]


def slopes_by_pixel_size(
    radiance_0: NDArray[np.floating],
    radiance_1: NDArray[np.floating],
    dt_s: float,
    dark_level: float,
    *,
    sizes_px: Sequence[int] = (1, 3, 5, 7, 9, 13, 19, 27, 39, 55),
    edge_share: float = 0.05,
    blocks_a_side: int = 8,
) -> SlopesBySize:
    """Return |L_t| for pixels of increasing size at the same points: Fig. 2 (b).

    Radiance is averaged over the square of each pixel, Eq. (3), before the logarithm. Motion
    between the two frames blurs finer structure.

    Parameters
    ----------
    radiance_0, radiance_1, dt_s, dark_level
        As in `log_slope`.
    sizes_px
        Odd widths; the first determines the edges.
    edge_share
        Share of pixels that count as edges: those with the largest |L_t| at the first size. Because
        of this selection, their slopes fall more steeply from that size on than the mean does.
    blocks_a_side
        Blocks along each side of the image. The bootstrap draws blocks, since neighboring pixels
        are correlated.

    Returns
    -------
    SlopesBySize

    Raises
    ------
    SensorError
        A size is even, or the frames are too small for the largest size.

    Examples
    --------
    Stripes that move: coarse pixels see them as gray.

    >>> import numpy as np
    >>> from sensor.statistics import slopes_by_pixel_size
    >>> x = np.arange(64)
    >>> before, after = (np.tile(2 + np.sin(x + shift), (64, 1)) for shift in (0.0, 0.1))
    >>> slopes = slopes_by_pixel_size(
    ...     before, after, 0.01, 0.0, sizes_px=(1, 3, 7), blocks_a_side=2
    ... )
    >>> slopes.everywhere.mean(axis=0).round(1)
    array([3.5, 2.3, 0.3])
    """
    if any(size % 2 == 0 for size in sizes_px):
        raise SensorError(f"sizes_px: found {tuple(sizes_px)}, expected odd numbers")
    margin = max(sizes_px) // 2
    if min(radiance_0.shape) - 2 * margin < blocks_a_side:
        raise SensorError(
            f"frames of {radiance_0.shape[1]}x{radiance_0.shape[0]} px have no room for "
            f"{blocks_a_side} blocks per side inside a margin of {margin} px"
        )
    inside = tuple(slice(margin, side - margin) for side in radiance_0.shape)
    slopes = []
    for size in sizes_px:
        before, after = (
            uniform_filter(f, size, np.float64)[inside] for f in (radiance_0, radiance_1)
        )
        slopes.append(np.abs(log_slope(before, after, dt_s, dark_level)))
    edge = slopes[0] >= np.quantile(slopes[0], 1 - edge_share)

    rows, cols = (np.arange(side) * blocks_a_side // side for side in edge.shape)
    block = rows[:, None] * blocks_a_side + cols

    def means(where: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        many = np.bincount(block[where], minlength=blocks_a_side**2)
        totals = [np.bincount(block[where], s[where], minlength=many.size) for s in slopes]
        some = many > 0
        return np.stack(totals, axis=1)[some] / many[some, None], many[some]

    everywhere, _ = means(np.ones_like(edge))
    return SlopesBySize(np.array(sizes_px), everywhere, *means(edge))


@dataclass(frozen=True, slots=True)
class PowerLaw:
    """value = factor * size ** -exponent, with the 95 % interval of the exponent."""

    exponent: float
    low: float
    high: float
    factor: float


def fit_power_law(
    sizes: NDArray[np.number],
    blocks: NDArray[np.float64],
    weights: NDArray[np.number] | None = None,
) -> PowerLaw:
    """Fit gamma of value ~ size^-gamma, Eq. (6), to the weighted mean over blocks.

    Fits a line to the logarithms by least squares. The interval is a percentile bootstrap over
    blocks; draws without positive means are left out.

    Parameters
    ----------
    sizes
        (P,) sizes.
    blocks
        (N, P) values, 0 or more; their means are positive.
    weights
        (N,) weights of the blocks; None is 1 for all.

    Returns
    -------
    PowerLaw

    Raises
    ------
    SensorError
        There are fewer than two sizes or blocks, the sizes are not positive or are all equal, the
        numbers of weights and blocks differ, a value is not finite, or the mean at a size is not
        positive.

    Examples
    --------
    >>> import numpy as np
    >>> from sensor.statistics import fit_power_law
    >>> sizes = np.array([1, 3, 9])
    >>> law = fit_power_law(sizes, np.array([8.0, 12.0])[:, None] * sizes**-0.5)
    >>> round(law.exponent, 3), round(law.factor, 3)
    (0.5, 10.0)
    """
    sizes = np.asarray(sizes)
    weights = np.ones(len(blocks)) if weights is None else np.asarray(weights)
    if len(sizes) < 2 or not np.all(sizes > 0) or np.ptp(sizes) == 0:
        raise SensorError(f"sizes: found {sizes}, expected at least 2 positive numbers that differ")
    if len(blocks) < 2 or weights.shape != (len(blocks),) or not np.all(np.isfinite(blocks)):
        raise SensorError(
            f"blocks: found {len(blocks)} blocks with weights of shape {weights.shape}, expected "
            "at least 2 blocks of finite values, with one weight per block"
        )
    log_size = np.log(sizes.astype(np.float64))
    centered = log_size - log_size.mean()
    line = centered / np.sum(centered**2)

    draws = np.random.default_rng(0).integers(len(blocks), size=(_DRAWS, len(blocks)))
    times_drawn = np.apply_along_axis(np.bincount, 1, draws, minlength=len(blocks))
    chosen = np.concatenate([np.ones((1, len(blocks))), times_drawn]) * weights
    means = chosen @ blocks / chosen.sum(axis=1, keepdims=True)
    if not np.all(means[0] > 0):
        raise SensorError(f"blocks: found means of {means[0].tolist()}, expected positive numbers")
    log_mean = np.log(means[np.all(means > 0, axis=1)])  # draws of blocks at rest have no law
    exponents = -(log_mean @ line)
    low, high = np.percentile(exponents[1:], [2.5, 97.5])
    factor = np.exp(log_mean[0].mean() + exponents[0] * log_size.mean())
    return PowerLaw(float(exponents[0]), float(low), float(high), float(factor))
