"""Bootstrap medians over samples, paths and trainings; every interval of the study uses them."""

from __future__ import annotations

import zlib
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sensor.compiling import compiler
from tasks.metric import LAST_BITS

DRAWS = 2000


def resampled_medians(
    values: NDArray[np.float64],
    sample: NDArray[np.int64],
    training: NDArray[np.int64],
    seed: str,
    paths: tuple[int, ...] = (),
) -> NDArray[np.float64]:
    """Return medians over samples and trainings, both drawn with replacement.

    A sample is drawn with all its values, because the values of one sample (features, trials) share
    frames and events, and so is a training, because its values share weights. Of several paths,
    which differ in the seeds of their scene, paths are drawn first, and samples within each. The
    draws depend only on `seed` and on the numbers of samples, paths and trainings, so cells with
    the same samples have paired draws; those of trainings are the same for all scenes.

    Parameters
    ----------
    values
        (N,) float64, finite scores.
    sample
        (N,) int64, index of each value's sample, 0 to S - 1.
    training
        (N,) int64, index of each value's training, 0 to T - 1; every sample has values of all.
    paths
        Number of samples on each path, one after the other; () for a single path.

    Returns
    -------
    (DRAWS,) float64
        One median per draw.
    """
    order = np.argsort(values, kind="stable")
    counts = _counts(seed, int(sample.max()) + 1)
    if paths[1:]:
        counts = _clustered(seed, paths)
    of_trainings = _counts("trainings", int(training.max()) + 1)
    return _weighted_medians(values[order], sample[order], training[order], counts, of_trainings)


def effective_samples(values: NDArray[np.float64], paths: tuple[int, ...] = ()) -> float:
    """Return how many independent samples N samples are worth: N (1 - r) / (1 + r) of a path.

    Parameters
    ----------
    values
        (N,) float64, a value of each sample, in the order of the path. r is the correlation of
        neighbors, at least 0.
    paths
        Number of samples on each path, one after the other; () for a single path.
    """
    if paths[1:]:
        return sum(map(effective_samples, np.split(values, np.cumsum(paths[:-1]))))
    if np.ptp(values) < LAST_BITS:
        return 1.0
    away = values - values.mean()
    r = max(0.0, float(away[:-1] @ away[1:] / (away @ away)))
    return max(1.0, len(values) * (1 - r) / (1 + r))


@lru_cache(maxsize=64)
def _counts(seed: str, things: int) -> NDArray[np.int64]:
    """Return how often each draw contains each of some things, (DRAWS, things)."""
    rng = np.random.default_rng([zlib.crc32(seed.encode(errors="surrogatepass")), things])
    drawn = rng.integers(things, size=(DRAWS, things))
    counts = np.zeros((DRAWS, things), np.int64)
    np.add.at(counts, (np.arange(DRAWS)[:, None], drawn), 1)
    return counts


@lru_cache(maxsize=64)
def _clustered(seed: str, paths: tuple[int, ...]) -> NDArray[np.int64]:
    """Return how often each draw of paths, and of samples within them, contains each sample."""
    rng = np.random.default_rng([zlib.crc32(seed.encode(errors="surrogatepass")), *paths])
    drawn = zip(paths, _counts(seed, len(paths)).T, strict=True)
    return np.hstack([rng.multinomial(times * n, np.full(n, 1 / n)) for n, times in drawn])


@compiler()
def _weighted_medians(
    values: NDArray[np.float64],  # (N,) ascending
    sample: NDArray[np.int64],  # (N,)
    training: NDArray[np.int64],  # (N,)
    counts: NDArray[np.int64],  # (D, S) multiplicity of each sample in each draw
    of_trainings: NDArray[np.int64],  # (D, T) and of each training
) -> NDArray[np.float64]:
    held = np.zeros((counts.shape[1], of_trainings.shape[1]), np.int64)  # values of each pair
    for i in range(values.size):
        held[sample[i], training[i]] += 1
    medians = np.empty(counts.shape[0])
    for draw in range(counts.shape[0]):
        of_sample, of_training = counts[draw], of_trainings[draw]
        total = 0
        for s in range(of_sample.size):
            for t in range(of_training.size):
                total += of_sample[s] * of_training[t] * held[s, t]
        below, i = of_sample[sample[0]] * of_training[training[0]], 0
        while below <= (total - 1) // 2:
            i += 1
            below += of_sample[sample[i]] * of_training[training[i]]
        lower = values[i]
        while below <= total // 2:
            i += 1
            below += of_sample[sample[i]] * of_training[training[i]]
        medians[draw] = 0.5 * (lower + values[i])
    return medians
