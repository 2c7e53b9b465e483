"""Cells of a run's scores: one method under one condition, over all samples."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tasks.metric import MIN_SAMPLES_FOR_INTERVAL
from tasks.study.results.bootstrap import effective_samples, resampled_medians


class Condition(NamedTuple):
    """A scene and a sensor setting."""

    scene: str
    width: int  # px
    cutoff_hz: float  # `CutoffInLux` where the study asks in lux
    speed: float  # factor on the base speed; `MetersPerSecond` where the study asks in m/s
    sensor: str = ""  # its name; "" for a plain sensor


@dataclass(frozen=True, eq=False)
class Cell:
    """All values of one series under one condition. A sample has one or more of them.

    Attributes
    ----------
    values : (N,) float64
        Finite scores in the metric's unit, in the order of samples and items.
    failed : (N,) bool
        Whether the method gave up or ended far off. The value is then that of its starting point
        or of its end; it counts too.
    training : (N,) int64
        Run of each value, counted from 0, where several runs differ in the weights of networks.
    expected : int
        Number of values in a complete cell of the series on this scene.
    paths : tuple of int
        Number of samples on each of the scene's paths, one after the other; () for a single path.
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
        """How many independent samples those of the median score are worth.

        None if values are missing, or the samples are too few for an interval.
        """
        if not self.complete or self.samples < MIN_SAMPLES_FOR_INTERVAL:
            return None
        each = [np.median(self.of_sample(i).values) for i in range(self.samples)]
        return effective_samples(np.array(each), self.paths)

    def of_sample(self, sample: int, count: int = 1) -> Cell:
        """Return the values of one sample, or of several from that on."""
        here = (sample <= self.sample) & (self.sample < sample + count)
        names = "values", "event_rates_hz", "failed", "sample", "training"
        chosen: dict[str, Any] = {name: getattr(self, name)[here] for name in names}
        return replace(self, **chosen)

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
        return self.resampled_of(self.values)

    @cached_property
    def rates(self) -> Cell:
        """The event rates of the whole sensor, events per second, in place of the scores."""
        return replace(self, values=self.event_rates_hz)

    def resampled_of(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return medians of bootstrap draws of values in the order of the cell's, (draws,)."""
        return resampled_medians(values, self.sample, self.training, self.scene, self.paths)
