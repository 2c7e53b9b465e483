"""Measure the scaling statistics of one clip, which show why finer sensors fire faster."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from eres_render import RadianceSequence
from sensor import SensorModel
from sensor.statistics import (
    IntervalHistogram,
    SlopesBySize,
    fit_power_law,
    log_bin_edges_us,
    log_slope,
    slopes_by_pixel_size,
)
from tasks.study.results.asked import SensorId, lux_of
from tasks.study.results.scaling import FIT_PX, Intervals, Scaling, Slopes

_ROWS_USED = 320  # about, of each sensor, evenly spread
_BIN_EDGES_US = log_bin_edges_us()


def interval_histogram(sensor: SensorModel, window_us: tuple[int, int]) -> IntervalHistogram:
    """Return an empty histogram of the times between events of a sensor."""
    every_row = max(1, sensor.height // _ROWS_USED)
    return IntervalHistogram(sensor.width, sensor.height, _BIN_EDGES_US, window_us, every_row)


def measure_scaling(
    sequence: RadianceSequence,
    dark_level: float,
    histograms: Mapping[tuple[SensorId, float, float], IntervalHistogram],
) -> tuple[Scaling, NDArray[np.float64]]:
    """Measure the slopes at the end of a clip, and add the histograms of its events.

    Parameters
    ----------
    dark_level
        Dark level of the first sensor, in the frames' unit of radiance.
    histograms
        Complete histograms of times between events, by sensor, light as in `light_of`, and speed.

    Returns
    -------
    The numbers, and L_t between the last two frames: (H, W) float64, 1/s.
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
            Intervals(
                width=sensor.width,
                cutoff_hz=float(light),
                speed=speed,
                counts=tuple(h.counts.tolist()),
                shorter=h.shorter,
                longer=h.longer,
                illuminance_lux=lux_of(light),
                sensor=sensor.name,
            )
            for (sensor, light, speed), h in histograms.items()
        ),
    )
    return scaling, log_slope(before, after, dt_s, dark_level)


def _slopes(
    slopes: SlopesBySize, blocks: NDArray[np.float64], weights: NDArray[np.number]
) -> Slopes:
    if not blocks.any():
        return Slopes((0.0,) * len(slopes.sizes_px), None)
    fitted = slopes.sizes_px <= FIT_PX
    law = fit_power_law(slopes.sizes_px[fitted], blocks[:, fitted], weights)
    return Slopes(tuple(np.average(blocks, axis=0, weights=weights).tolist()), law)
