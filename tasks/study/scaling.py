"""Why finer sensors fire faster, measured: the numbers behind the paper's Fig. 2, for one clip.

A run keeps them in `scaling/`: `<scene>.json`, and the picture `<scene>.png` of L_t.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eres_render import RadianceSequence
from sensor.statistics import (
    IntervalHistogram,
    PowerLaw,
    SlopesBySize,
    fit_power_law,
    log_bin_edges_us,
    log_slope,
    mode_us,
    slopes_by_pixel_size,
)
from tasks.errors import ResultError
from tasks.study.pictures import BRIGHTER, DARKER, NONE, middle, png

FIT_PX = 10.0
"""The power law is fitted up to this pixel size, in pixels of the frames: it is one "as p -> 0",
and 10 is what a 128 px sensor makes of 1280 px."""

_ROWS_LOOKED_AT = 320  # about so many of each sensor, evenly spread
_BIN_EDGES_US = log_bin_edges_us()
_SATURATED = 0.99  # quantile of |L_t| that gets the picture's full colour


@dataclass(frozen=True, slots=True)
class Intervals:
    """Histogram of the times between consecutive events of a pixel, at one setting."""

    width: int
    cutoff_hz: float
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


def interval_histogram(side_px: int, window_us: tuple[int, int]) -> IntervalHistogram:
    """An empty histogram for a square sensor, over a fair share of its pixels."""
    every_row = max(1, side_px // _ROWS_LOOKED_AT)
    return IntervalHistogram(side_px, side_px, _BIN_EDGES_US, window_us, every_row)


def measure_scaling(
    sequence: RadianceSequence,
    dark_level: float,
    histograms: Mapping[tuple[int, float, float], IntervalHistogram],
) -> tuple[Scaling, NDArray[np.float64]]:
    """Measure the slopes at the end of a clip, and put them beside its histograms.

    Parameters
    ----------
    histograms
        Complete, by width, cutoff and speed.

    Returns
    -------
    The numbers, and L_t between the last two frames, (H, W), 1/s.
    """
    before, after = (sequence.frame(len(sequence) - k).astype(np.float64) for k in (2, 1))
    dt_s = float(sequence.t_s[-1] - sequence.t_s[-2])
    slopes = slopes_by_pixel_size(before, after, dt_s, dark_level)
    scaling = Scaling(
        scene=sequence.manifest.scene,
        clip=sequence.manifest.clip,
        sizes_px=tuple(slopes.sizes_px.tolist()),
        everywhere=_slopes(slopes, slopes.everywhere, np.ones(len(slopes.everywhere))),
        edges=_slopes(slopes, slopes.edges, slopes.edge_weights),
        edges_us=tuple(_BIN_EDGES_US.tolist()),
        intervals=tuple(
            Intervals(*setting, tuple(h.counts.tolist()), h.shorter, h.longer)
            for setting, h in histograms.items()
        ),
    )
    return scaling, log_slope(before, after, dt_s, dark_level)


def _slopes(
    slopes: SlopesBySize, blocks: NDArray[np.float64], weights: NDArray[np.number]
) -> Slopes:
    fitted = slopes.sizes_px <= FIT_PX
    law = fit_power_law(slopes.sizes_px[fitted], blocks[:, fitted], weights)
    return Slopes(tuple(np.average(blocks, axis=0, weights=weights).tolist()), law)


def scaling_files(scaling: Scaling, slope: NDArray[np.float64]) -> dict[str, bytes]:
    """The picture and, last, the numbers of a scene, by file name."""
    strength = np.clip(slope / max(np.quantile(np.abs(slope), _SATURATED), 1e-9), -1, 1)
    share = middle(strength)[..., None]
    colour = np.where(share > 0, BRIGHTER, DARKER)
    picture = np.array(NONE) + np.abs(share) * (colour - np.array(NONE))
    numbers = asdict(scaling)
    for one in numbers["intervals"]:
        one["cutoff_hz"] = f"{one['cutoff_hz']:g}"  # JSON has no inf
    return {
        f"{scaling.scene}.png": png(picture.round().astype(np.uint8)),
        f"{scaling.scene}.json": json.dumps(numbers).encode(),
    }


def read_scaling(folder: Path) -> dict[str, Scaling]:
    """The numbers of every scene in a folder, by scene; none where there is no folder.

    Raises
    ------
    ResultError
        A file is damaged; the text names it.
    """
    found = {}
    for file in sorted(folder.glob("*.json")):
        try:
            scaling = _parsed(json.loads(file.read_text()))
        except (ValueError, KeyError, TypeError) as error:
            raise ResultError(f"{file}: not the scaling statistics of a run, {error!r}") from None
        found[scaling.scene] = scaling
    return found


def _parsed(numbers: dict) -> Scaling:
    def slopes(part: dict) -> Slopes:
        return Slopes(tuple(part["mean_hz"]), PowerLaw(**part["law"]))

    def intervals(part: dict) -> Intervals:
        return Intervals(
            **{**part, "cutoff_hz": float(part["cutoff_hz"]), "counts": tuple(part["counts"])}
        )

    return Scaling(
        scene=numbers["scene"],
        clip=numbers["clip"],
        sizes_px=tuple(numbers["sizes_px"]),
        everywhere=slopes(numbers["everywhere"]),
        edges=slopes(numbers["edges"]),
        edges_us=tuple(numbers["edges_us"]),
        intervals=tuple(intervals(part) for part in numbers["intervals"]),
    )
