"""Cells of a run's scores: one method under one condition, over all samples.

Every interval of a study uses their bootstrap medians over samples, paths and trainings.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from sensor.compiling import compiler
from tasks.metric import LAST_BITS, MIN_SAMPLES_FOR_INTERVAL

DRAWS = 2000


@dataclass(frozen=True, eq=False)
class Cell:
    """All values of one series under one condition. A sample has at least one value.

    `values` (N,) are finite, in the metric's unit, in the order of samples and items. A value is
    `failed` if the method gave up or ended far off; it then belongs to the starting point or to the
    end, and it counts too. `training` numbers the runs, from 0, where they differ in the weights of
    networks. `expected` is N of a complete cell. `paths` are the numbers of samples on each of the
    scene's paths, () for a single path.
    """

    scene: str
    values: NDArray[np.float64]
    event_rates_hz: NDArray[np.float64]
    failed: NDArray[np.bool_]
    sample: NDArray[np.int64]
    training: NDArray[np.int64]
    expected: int
    paths: tuple[int, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether no expected value is missing; only complete cells have medians."""
        return len(self.values) == self.expected > 0

    @cached_property
    def samples(self) -> int:
        """Number of samples."""
        return len(np.unique(self.sample))

    @cached_property
    def trainings(self) -> int:
        """Number of runs that differ in the weights of networks."""
        return int(self.training.max()) + 1

    @cached_property
    def median(self) -> float | None:
        """Median score, or None if values are missing, as survivors alone would bias it."""
        return float(np.median(self.values)) if self.complete else None

    @cached_property
    def effective_samples(self) -> float | None:
        """How many independent samples the samples of the median score are worth.

        None if values are missing, or the samples are too few for an interval.
        """
        if not self.complete or self.samples < MIN_SAMPLES_FOR_INTERVAL:
            return None
        return effective_samples(self.medians_of(self.values, [1] * self.samples), self.paths)

    @cached_property
    def event_rate_hz(self) -> float | None:
        """Median event rate of the whole sensor, events per second; None if values are missing."""
        return float(np.median(self.event_rates_hz)) if self.complete else None

    @property
    def failure_share(self) -> float | None:
        """Share of the values where the method failed, or None if values are missing."""
        return float(np.mean(self.failed)) if self.complete else None

    @cached_property
    def resampled(self) -> NDArray[np.float64]:
        """Median scores of bootstrap draws of samples and trainings, (draws,) float64."""
        return self.medians_of(self.values)

    @cached_property
    def rates(self) -> Cell:
        """The event rates of the whole sensor, events per second, in place of the scores."""
        return replace(self, values=self.event_rates_hz)

    def medians_of(
        self, values: NDArray[np.float64], parts: Sequence[int] = ()
    ) -> NDArray[np.float64]:
        """Return medians of (N,) values: of (DRAWS,) draws of samples and trainings.

        They are drawn with replacement; a sample with all its values, which share frames and
        events; so is a training, whose values share weights. Of several paths, which differ in the
        seeds of their scene, paths are drawn first, and samples within each. The draws depend only
        on the scene and on the numbers of samples, paths and trainings, so cells with the same
        samples have paired draws; trainings are drawn alike for all scenes. With `parts`, nothing
        is drawn: medians are of consecutive parts of so many samples, (len(parts),).
        """
        order = np.argsort(values, kind="stable")
        if parts:
            counts = np.repeat(np.eye(len(parts), dtype=np.int64), parts, axis=1)
            of_trainings = np.ones((len(parts), self.trainings), np.int64)
        else:
            counts = _counts(self.scene, self.samples)
            if self.paths[1:]:
                counts = _clustered(self.scene, self.paths)
            of_trainings = _counts("trainings", self.trainings)
        held = np.zeros((self.samples, self.trainings), np.int64)  # values of each pair
        np.add.at(held, (self.sample, self.training), 1)
        totals = (counts @ held * of_trainings).sum(axis=1)
        drawn = counts, of_trainings, totals
        return _weighted_medians(values[order], self.sample[order], self.training[order], *drawn)


def effective_samples(values: NDArray[np.float64], paths: tuple[int, ...] = ()) -> float:
    """Return how many independent samples N samples are worth: N (1 - r) / (1 + r) of a path.

    `values` (N,) are in the order of the path; r is the correlation of neighbors, at least 0.
    `paths` are the numbers of samples on each path, () for a single path.
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
    totals: NDArray[np.int64],  # (D,) values of each draw
) -> NDArray[np.float64]:
    medians = np.empty(counts.shape[0])
    for draw in range(counts.shape[0]):
        of_sample, of_training, total = counts[draw], of_trainings[draw], totals[draw]
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
