"""Why finer sensors fire faster: the numbers behind the paper's Fig. 2, of one clip a scene.

`tasks.study.run.scaling` measures them; a run keeps them in `scaling/SCENE.json`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from eres_render.storage.settings_reader import FloatOrInf, read_json
from sensor.statistics import PowerLaw, mode_us
from tasks.errors import ResultError

FIT_PX = 10.0
"""The power law is fitted up to this pixel size, in pixels of the frames: it is one "as p -> 0",
and 10 is what a 128 px sensor makes of 1280 px."""


@dataclass(frozen=True, slots=True)
class Intervals:
    """Histogram of the times between consecutive events of a pixel, at one setting."""

    width: int
    cutoff_hz: FloatOrInf
    speed: float
    counts: tuple[int, ...]
    shorter: int  # intervals below the first edge
    longer: int  # and from the last edge on


@dataclass(frozen=True, slots=True)
class Slopes:
    """Mean |L_t| by pixel size, 1/s, and its power law over sizes up to `FIT_PX`."""

    mean_hz: tuple[float, ...]
    law: PowerLaw


@dataclass(frozen=True, slots=True)
class Scaling:
    """What was measured on one clip.

    Attributes
    ----------
    scene, clip
        Where.
    sizes_px
        Sides of the pixels that saw the slopes, in pixels of the frames.
    everywhere, edges
        Over all pixels, and over the 5 % that are steepest at the finest size.
    edges_us
        Edges of the histograms' bins.
    intervals
        A histogram for each setting that was looked at.
    """

    scene: str
    clip: int
    sizes_px: tuple[int, ...]
    everywhere: Slopes
    edges: Slopes
    edges_us: tuple[int, ...]
    intervals: tuple[Intervals, ...]

    def mode_us(self, width: int, cutoff_hz: float, speed: float) -> float | None:
        """The commonest interval at one setting, None where it has not been measured."""
        for one in self.intervals:
            if (one.width, one.cutoff_hz, one.speed) == (width, cutoff_hz, speed):
                return mode_us(self.edges_us, one.counts)
        return None

    def settings(self) -> list[tuple[float, float]]:
        """(cutoff_hz, speed) of the histograms, in their order."""
        return list(dict.fromkeys((one.cutoff_hz, one.speed) for one in self.intervals))


def read_scaling(folder: Path) -> dict[str, Scaling]:
    """The numbers of every scene in a folder, by scene; none where there is no folder.

    Raises
    ------
    ResultError
        A file is damaged; the text names it.
    """
    found = (read_json(Scaling, file, ResultError) for file in sorted(folder.glob("*.json")))
    return {scaling.scene: scaling for scaling in found}
