"""Bootstrap medians over samples; every interval of the study uses them."""

from __future__ import annotations

import zlib
from functools import lru_cache

import numba
import numpy as np
from numpy.typing import NDArray

DRAWS = 2000


def resampled_medians(
    values: NDArray[np.float64],  # (N,)
    sample: NDArray[np.int64],  # (N,) index of each value's sample, 0 to S - 1
    seed: str,
) -> NDArray[np.float64]:
    """Return medians over samples drawn with replacement.

    A sample is drawn with all its values, because the values of one sample (features, trials) share
    frames and events. The draws depend only on `seed` and on the number of samples, so cells with
    the same samples have paired draws.

    Parameters
    ----------
    values
        (N,) float64, finite scores.
    sample
        (N,) int64, index of each value's sample, 0 to S - 1.
    seed
        Text that seeds the draws.

    Returns
    -------
    (DRAWS,) float64
        One median per draw.
    """
    order = np.argsort(values, kind="stable")
    return _weighted_medians(values[order], sample[order], _counts(seed, int(sample.max()) + 1))


@lru_cache(maxsize=64)
def _counts(seed: str, samples: int) -> NDArray[np.int64]:
    """Return how often each draw contains each sample, (DRAWS, samples)."""
    rng = np.random.default_rng([zlib.crc32(seed.encode()), samples])
    drawn = rng.integers(samples, size=(DRAWS, samples))
    counts = np.zeros((DRAWS, samples), np.int64)
    np.add.at(counts, (np.arange(DRAWS)[:, None], drawn), 1)
    return counts


@numba.njit(cache=True, nogil=True)
def _weighted_medians(
    values: NDArray[np.float64],  # (N,) ascending
    sample: NDArray[np.int64],  # (N,)
    counts: NDArray[np.int64],  # (D, S) multiplicity of each sample in each draw
) -> NDArray[np.float64]:
    medians = np.empty(counts.shape[0])
    for draw in range(counts.shape[0]):
        total = 0
        for i in range(values.size):
            total += counts[draw, sample[i]]
        below, i = counts[draw, sample[0]], 0
        while below <= (total - 1) // 2:
            i += 1
            below += counts[draw, sample[i]]
        lower = values[i]
        while below <= total // 2:
            i += 1
            below += counts[draw, sample[i]]
        medians[draw] = 0.5 * (lower + values[i])
    return medians
