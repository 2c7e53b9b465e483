"""The rows of a run in cells: one method under one condition, over all samples.

"carpet@1" is the scene "carpet" with other seeds: its samples are further samples of "carpet".
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Hashable, Iterable
from functools import cache, partial
from typing import TypeVar

import numpy as np

from eres_render.scene.scene import name_and_seed
from tasks.errors import ResultError
from tasks.registry import TASKS
from tasks.row import Row
from tasks.study.results.asked import (
    Condition,
    MetersPerSecond,
    SensorId,
    Series,
    light_of,
    sensor_of,
)
from tasks.study.results.cells import Cell
from tasks.study.results.paper import (
    CONTRAST_THRESHOLD,
    CUTOFFS_HZ,
    WIDTHS,
    every_published,
    published,
)

Value = TypeVar("Value", bound=Hashable)


def by_photoreceptor(
    rows: Iterable[Row], *, square: bool = True, trainings: int = 1
) -> dict[str, list[Scores]]:
    """Return the scores of each photoreceptor at each contrast threshold.

    A camera with a photoreceptor or a threshold of its own is in the scores of all.
    """
    groups = _divided(rows, lambda row: row.reading)
    by_reading = {}
    for name in sorted(groups, key=lambda name: name != "two_pole"):
        scores = partial(Scores, square=square, trainings=trainings, photoreceptor=name)
        thresholds = _divided(groups[name], lambda row: row.contrast_threshold)
        by_reading[name] = [
            scores(of_one, contrast_threshold=C) for C, of_one in thresholds.items()
        ]
    return by_reading


def _divided(rows: Iterable[Row], value_of: Callable[[Row], Value]) -> dict[Value, list[Row]]:
    """Group rows by a value of their sensors; a camera with a single value is in all groups."""
    rows = _some(rows)
    values: dict[str, set[Value]] = {}
    for row in rows:
        values.setdefault(row.sensor, set()).add(value_of(row))
    own = {name for name, of_sensor in values.items() if name and len(of_sensor) == 1}
    keys = dict.fromkeys(value_of(row) for row in rows if row.sensor not in own)
    return {
        key: [row for row in rows if row.sensor in own or value_of(row) == key]
        for key in keys or [value_of(rows[0])]
    }


def _some(rows: Iterable[Row]) -> list[Row]:
    rows = list(rows)
    if not rows:
        raise ResultError("has no rows; a run needs at least one row")
    return rows


_Item = tuple[int, int, int]  # seed of the scene, sample and item
_Values = dict[_Item, Row]


class Scores:
    """The rows of a run with one photoreceptor and contrast threshold, grouped into cells.

    Values that are not finite count as missing. `square` says whether sensors without a name are
    square, as the paper's are. Item T i + k is item i of run k, if T `trainings` differ in weights
    of networks. `contrast_threshold` (log units) and `photoreceptor` are of all sensors without
    their own, by default from the first plain sensor, or from the first camera if there is none.

    `asks_as_paper` says whether all sensors and lights are the paper's, which has no buses; only
    then are its numbers shown. `buses_hz` are the capacities of the buses, events/s, and `dropped`
    is the largest share of a window's events that a bus lost, by sensor.
    """

    def __init__(
        self,
        rows: Iterable[Row],
        *,
        square: bool = True,
        trainings: int = 1,
        contrast_threshold: float | None = None,
        photoreceptor: str | None = None,
    ) -> None:
        rows = _some(rows)
        self._trainings = trainings
        first = next((row for row in rows if not row.sensor), rows[0])
        self.contrast_threshold = contrast_threshold or first.contrast_threshold
        self.photoreceptor = photoreceptor or first.reading
        of_each = {(row.width, row.sensor): row for row in rows}  # plain tuples are faster
        self.contrast_thresholds = {sensor_of(r): r.contrast_threshold for r in of_each.values()}
        on_bus = [row for row in rows if row.bus_mev_s < math.inf]
        self.buses_hz = {sensor_of(row): 1e6 * row.bus_mev_s for row in on_bus}
        self.dropped = dict.fromkeys(self.buses_hz, 0.0)
        for row in on_bus:
            sensor = sensor_of(row)
            self.dropped[sensor] = max(row.dropped, self.dropped[sensor])
        self._rows = _grouped(rows)
        lights = {where.cutoff_hz for conditions in self._rows.values() for where in conditions}
        plain = square and not self.buses_hz and lights <= {*CUTOFFS_HZ}
        self.asks_as_paper = plain and self.contrast_thresholds.keys() <= {*map(SensorId, WIDTHS)}
        self._expected, self._cell = cache(self._expected_items), cache(self._cell_of)

    def _expected_items(self, series: Series, scene: str) -> list[_Item]:
        """Return every item that a complete cell of a series has on a scene."""
        items = {item for at in self.conditions(series, scene) for item in self._rows[series][at]}
        trainings = self._trainings
        return sorted(
            {
                (seed, sample, item // trainings * trainings + training)
                for seed, sample, item in items
                for training in range(trainings)
            }
        )

    def series(self) -> list[Series]:
        """Return all series except the do-nothing baselines, in the order of the rows."""
        return [series for series in self._rows if series.method != series.spec.baseline]

    def scenes(self, *series: Series) -> list[str]:
        """Return the scenes of some series, by default all but the baselines, in their order."""
        every = series or self.series()
        return list(dict.fromkeys(where.scene for of in every for where in self.conditions(of)))

    def sensors(self, series: Series, scene: str | None = None) -> list[SensorId]:
        """Return the sensors of a series, by width, then name; prints may have different widths."""
        return sorted({sensor_of(where) for where in self.conditions(series, scene)})

    def cutoffs_hz(self, series: Series) -> list[float]:
        """Return the cutoffs of a series, Hz, from ideal (inf) down."""
        return sorted({where.cutoff_hz for where in self.conditions(series)}, reverse=True)

    def speeds(self, series: Series, scene: str | None = None) -> list[float]:
        """Return the speeds of a series, ascending; factors follow speeds in m/s."""
        speeds = {where.speed for where in self.conditions(series, scene)}
        return sorted(speeds, key=lambda speed: (not isinstance(speed, MetersPerSecond), speed))

    def conditions(self, series: Series, scene: str | None = None) -> list[Condition]:
        """Return the conditions of a series, on one scene or on all, in the order of the rows."""
        return [at for at in self._rows.get(series, ()) if scene is None or at.scene == scene]

    def cell(self, series: Series, condition: Condition) -> Cell:
        """Return one cell."""
        return self._cell(series, condition, False)

    def samples(self, series: Series, scene: str) -> int:
        """Return how many samples a complete cell has."""
        return len({item[:2] for item in self._expected(series, scene)})

    def seeds(self, series: Series, scene: str) -> int:
        """Return how many seeds of a scene a complete cell has."""
        return len({seed for seed, *_ in self._expected(series, scene)})

    def baseline(self, series: Series, condition: Condition) -> Cell:
        """Return the score of doing nothing under a condition, over the samples of `series`."""
        return self._cell(series, condition, True)

    def published(self, series: Series, condition: Condition) -> float | None:
        """Return the paper's score, None at another contrast threshold than the paper's.

        It is also None if any sensor or light of the run is not the paper's.
        """
        scene, width, cutoff_hz, speed, _ = condition
        papers = self.asks_as_paper and self.contrast_threshold == CONTRAST_THRESHOLD
        if not papers or isinstance(speed, MetersPerSecond):
            return None
        return published(scene, *series[:2], width, cutoff_hz, speed)

    def answers(self, series: Series) -> int:
        """Count the scores of a series, those that are not finite included."""
        return sum(map(len, self._rows.get(series, {}).values()))

    def failures(self, series: Series) -> Counter[str]:
        """Count the failures of a series by reason; numbers in the reasons are written as n."""
        return Counter(
            re.sub(r"\d+(\.\d+)?", "n", row.failure)
            for values in self._rows.get(series, {}).values()
            for row in values.values()
            if row.failure
        )

    def _nothing(self, series: Series, condition: Condition) -> _Values:
        baseline = series.spec.baseline
        for variant in (series.variant, ""):
            idle = self._rows.get(Series(series.task, baseline, series.metric, variant), {})
            if condition in idle:
                return idle[condition]
            for other, values in idle.items():
                if other._replace(width=condition.width, sensor=condition.sensor) == condition:
                    return values
        return {}

    def _cell_of(self, series: Series, condition: Condition, nothing: bool) -> Cell:
        answers = self._rows.get(series, {}).get(condition, {})
        rows = self._nothing(series, condition) if nothing else answers
        expected = self._expected(series, condition.scene)
        keys = [key for key in expected if key in rows and math.isfinite(rows[key].value)]
        finite = [rows[key] for key in keys]
        index = {at: i for i, at in enumerate(sorted({key[:2] for key in keys}))}
        # Joined runs repeat methods without weights; only networks differ between trainings.
        trainings = self._trainings if series.method in series.spec.networks else 1
        return Cell(
            scene=condition.scene,
            values=np.array([row.value for row in finite], dtype=np.float64),
            event_rates_hz=np.array([row.event_rate_hz for row in finite], dtype=np.float64),
            failed=np.array([row.failure != "" for row in finite], dtype=np.bool_),
            sample=np.array([index[key[:2]] for key in keys], dtype=np.int64),
            training=np.array([item % trainings for *_, item in keys], dtype=np.int64),
            expected=len(expected),
            paths=(*Counter(seed for seed, _ in index).values(),),
        )


def _grouped(rows: Iterable[Row]) -> dict[Series, dict[Condition, _Values]]:
    """Return the rows of each series and condition by sample and item."""
    groups: dict[Series, dict[Condition, _Values]] = {}
    of_cell: dict[tuple[str | int | float, ...], _Values] = {}  # by plain tuples, as there are many
    named = cache(name_and_seed)
    for row in rows:
        key = (row.task, row.method, row.metric, row.variant)
        scene, seed = named(row.scene)
        light = light_of(row.cutoff_hz, row.illuminance_lux)
        speed = MetersPerSecond(row.speed_m_s) if row.speed_m_s else row.speed
        where = (scene, row.width, light, speed, row.sensor)
        values = of_cell.get(key + where)
        if values is None:
            _check_known(row)
            of_series = groups.setdefault(Series(*key), {})
            values = of_cell[key + where] = of_series.setdefault(Condition(*where), {})
        if (seed, row.sample, row.item) in values:
            raise ResultError(
                f"found two rows of sample {row.sample}, item {row.item} of {Series(*key)}, "
                f"{Condition(*where)}"
            )
        values[seed, row.sample, row.item] = row
    return groups


def _check_known(row: Row) -> None:
    metrics = {task: spec.metric.name for task, spec in TASKS.items()}
    if metrics.get(row.task) != row.metric:
        known = ", ".join(f"{task} {metric}" for task, metric in sorted(metrics.items()))
        raise ResultError(f"unknown task {row.task!r} with metric {row.metric!r}; known: {known}")


@cache
def paper_scores() -> Scores:
    """Return the paper's medians as scores of a single sample, without event rates."""
    rows = []
    for (scene, task, method, width, cutoff_hz, speed), value in every_published():
        where = scene, task, method, width, cutoff_hz, CONTRAST_THRESHOLD, speed
        rows.append(Row(*where, 0, TASKS[task].metric.name, value, math.nan))
    return Scores(rows)


def base_speed(scores: Scores, series: Series) -> float:
    """Return the speed factor nearest to 1, or the lowest speed in m/s."""
    speeds = scores.speeds(series)
    in_m_s = [speed for speed in speeds if isinstance(speed, MetersPerSecond)]
    return min(in_m_s or speeds, key=lambda speed: speed if in_m_s else abs(math.log(speed)))


def beats(cell: Cell, nothing: Cell, series: Series) -> bool | None:
    """Return whether a median score is better than that of doing nothing."""
    if cell.median is None or nothing.median is None:
        return None
    return series.spec.metric.sign * (cell.median - nothing.median) > 0
