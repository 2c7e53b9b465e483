"""`Estimate`: a number with its interval."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special  # scipy.stats needs 0.3 s to import

TILE_PX = 8  # side of a tile; pixels of a tile see the same things, so whole tiles are resampled
_DRAWS = 400
_MIN_TILES = 8  # of fewer, too few draws differ
_LOW_HIGH = (2.5, 97.5)  # percent


class Estimate(NamedTuple):
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float

    def widened(self, by: float) -> Estimate:
        """Return the estimate with its interval wider by `by` at both ends, but not below 0."""
        return Estimate(self.value, max(0.0, self.low - by), self.high + by)

    def raised(self, share: float) -> Estimate:
        """Return the estimate with an upper end of which the old one lacks this share."""
        return Estimate(self.value, self.low, self.high / (1 - share) if share < 1 else np.inf)

    @property
    def is_bound(self) -> bool:
        """Whether one end of the interval is 0 or inf: the number is bounded, and not known."""
        return self.low <= 0 or math.isinf(self.high)

    def __str__(self) -> str:
        if self.is_bound:
            return f"at least {self.low:.4g}" if self.low > 0 else f"at most {self.high:.4g}"
        return f"{self.value:.4g} ({self.low:.4g} to {self.high:.4g})"


def poisson_rate(count: float, exposure: float, dispersion: float = 1.0) -> Estimate:
    """Estimate a rate from a count with `dispersion`, variance over mean (1 for Poisson)."""
    alone = count / dispersion
    low = special.gammaincinv(alone, 0.025) if alone > 0 else 0.0
    high = special.gammaincinv(alone + 1, 0.975)
    scale = dispersion / exposure
    return Estimate(count / exposure, float(low) * scale, float(high) * scale)


def share(count: int, total: int) -> Estimate:
    """Estimate a share, with the exact interval of Clopper and Pearson (1934)."""
    low = special.betaincinv(count, total - count + 1, 0.025) if count else 0.0
    high = special.betaincinv(count + 1, total - count, 0.975) if count < total else 1.0
    return Estimate(count / total, float(low), float(high))


def tiles_of(pixel: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """Return the tile of each pixel, (N,); pixels and tiles are numbered row by row."""
    y, x = np.divmod(pixel, width)
    return y // TILE_PX * -(-width // TILE_PX) + x // TILE_PX


def units(pixel: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """Return what a bootstrap draws: tiles, or pixels if the data are of fewer than eight tiles.

    `pixel` (N,) is the pixel of each datum; the result is (N,), numbered from 0.
    """
    tiles, unit = np.unique(tiles_of(pixel, width), return_inverse=True)
    return unit if len(tiles) >= _MIN_TILES else np.unique(pixel, return_inverse=True)[1]


def bootstrap(
    sums: NDArray[np.float64], answer: Callable[[NDArray[np.float64]], NDArray[np.float64]]
) -> list[Estimate]:
    """Resample tiles with replacement (Efron and Tibshirani 1993), from a fixed seed.

    `sums` (tiles, K) are over the data of each tile; `answer` takes their total (K,) to numbers
    (A,).
    """
    rng = np.random.default_rng(0)
    tiles = len(sums)
    weights = rng.multinomial(tiles, np.full(tiles, 1 / tiles), _DRAWS)
    drawn = np.array([answer(total) for total in weights @ sums])
    low, high = np.nanpercentile(drawn, _LOW_HIGH, axis=0)
    value = answer(sums.sum(axis=0))
    return [Estimate(*map(float, each)) for each in zip(value, low, high, strict=True)]


def lowest(x: NDArray[np.number], y: NDArray[np.float64]) -> float:
    """Return where a parabola through the lowest of (N,) points and its neighbors is lowest.

    `x` ascends. A lowest point at an end is returned itself.
    """
    k = int(np.argmin(y))
    if not 0 < k < len(x) - 1:
        return float(x[k])
    a, b, _ = np.polyfit(x[k - 1 : k + 2] - x[k], y[k - 1 : k + 2], 2)
    return float(x[k] - b / (2 * a))
