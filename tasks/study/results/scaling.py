"""Statistics behind Fig. 2 of the paper: why finer sensors fire faster, one clip per scene.

`tasks.study.run.highlights` measures them; a run stores them in `scaling/SCENE.json`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from eres_render.storage.settings_reader import FloatOrInf, read_json
from sensor.statistics import PowerLaw, mode_us
from tasks.errors import ResultError
from tasks.study.results.asked import SensorId, sensor_of

FIT_PX = 10.0
"""Largest pixel size of the power-law fit, in pixels of the frames. The law holds "as p -> 0"; a
128 px sensor has pixels of 10 px in frames of 1280 px."""


@dataclass(frozen=True, slots=True)
class Intervals:
    """Histogram of the times between consecutive events of a pixel under one setting.

    In lux, the cutoff is of plain sensors. Older runs lack the illuminance and the sensor's name.
    """

    width: int
    cutoff_hz: FloatOrInf
    speed: float
    counts: tuple[int, ...]
    shorter: int  # intervals below the first edge
    longer: int  # intervals from the last edge on
    illuminance_lux: float = 0.0  # as in `tasks.row.Row`
    sensor: str = ""  # as in `tasks.row.Row`


@dataclass(frozen=True, slots=True)
class Slopes:
    """Mean |L_t| by pixel size, 1/s, and its power law up to `FIT_PX`, None where nothing moves."""

    mean_hz: tuple[float, ...]
    law: PowerLaw | None


@dataclass(frozen=True, slots=True)
class Scaling:
    """Statistics of one clip.

    `everywhere` is over all pixels, `edges` over the 5 % that are steepest at the finest size.
    `job` is the key of the study's job that measured them.
    """

    scene: str
    clip: int
    sizes_px: tuple[int, ...]
    everywhere: Slopes
    edges: Slopes
    edges_us: tuple[int, ...]
    intervals: tuple[Intervals, ...]
    job: str = ""

    def mode_us(self, sensor: SensorId, cutoff_hz: float, speed: float) -> float | None:
        """Return the most common interval under one setting, us; None if it was not measured."""
        for each in self.intervals:
            if (sensor_of(each), each.cutoff_hz, each.speed) == (sensor, cutoff_hz, speed):
                return mode_us(self.edges_us, each.counts)
        return None

    def settings(self) -> list[tuple[float, float]]:
        """Return (cutoff_hz, speed) of the histograms, in order."""
        return list(dict.fromkeys((each.cutoff_hz, each.speed) for each in self.intervals))


def read_scaling(folder: Path, jobs: Collection[str] | None = None) -> dict[str, Scaling]:
    """Read the statistics of all scenes in a folder; empty if the folder is missing.

    Statistics that a job outside of `jobs` measured, as for another study, are left out.
    """
    every = (read_json(Scaling, file, ResultError) for file in sorted(folder.glob("*.json")))
    return {each.scene: each for each in every if jobs is None or each.job in ("", *jobs)}
