"""The statistics of Fig. 2: times between events, slopes of log intensity, and their scaling law.

- `event_rates_hz`: the event rate of each pixel.
- `IntervalHistogram`: times between consecutive events of a pixel, from a stream, Eq. (7).
- `log_slope`: L_t, the slope of log intensity in time at each pixel, Eq. (5).
- `slopes_by_pixel_size`: |L_t| at the edges of the image for pixels of increasing size.
- `fit_power_law`: the exponent gamma of |L_t| ~ p^-gamma, Eq. (6), with a bootstrap interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from sensor.compiling import compiler
from sensor.errors import EventError
from sensor.events import Columns, Events

_NEVER = -(1 << 62)
_DRAWS = 2000


@compiler(Path(__file__).parent)
def _count_intervals(
    events: Columns,
    start_us: int,
    end_us: int,
    slot_of: NDArray[np.int64],  # (height,) row of last_us for each row of pixels, -1 for none
    bin_of: NDArray[np.uint8],  # (longest interval + 2,) bin of each interval, us
    last_us: NDArray[np.int64],  # (rows, width) updated
    counts: NDArray[np.int64],  # (B + 2,) updated
) -> None:
    t_us, x, y, _ = events
    for i in range(t_us.size):
        row = slot_of[y[i]]
        if row < 0:
            continue
        before_us = last_us[row, x[i]]
        last_us[row, x[i]] = t_us[i]
        if before_us != _NEVER and start_us <= t_us[i] < end_us:
            counts[bin_of[min(t_us[i] - before_us, bin_of.size - 1)]] += 1


class IntervalHistogram:
    """Counts the times between consecutive events of each pixel in a stream.

    An interval counts if its second event is in the window; the first may be before it. So all
    intervals up to the length of the stream before the window have full weight, and longer ones
    have less.

    Parameters
    ----------
    width, height
        Size of the sensor, px.
    edges_us
        (B + 1,) ascending bin edges, whole microseconds. Bins are half-open, [edge, next edge).
    window_us
        (start, end) of the half-open window.
    every_row
        Use only every n-th row of pixels, an unbiased sample.

    Attributes
    ----------
    counts : (B,) int64
        Intervals in each bin.
    shorter, longer : int
        Number of intervals below the first edge, and at or above the last.

    Examples
    --------
    >>> import numpy as np
    >>> from sensor import Events
    >>> from sensor.statistics import IntervalHistogram
    >>> t_us, x = np.array([0, 100, 300, 1200]), np.zeros(4, np.uint16)
    >>> events = Events(t_us, x, x, np.ones(4, np.int8), width=1, height=1)
    >>> histogram = IntervalHistogram(1, 1, edges_us=[50, 150, 450], window_us=(0, 2000))
    >>> histogram.add(events)
    >>> histogram.counts, histogram.longer
    (array([1, 1]), 1)
    """

    def __init__(
        self,
        width: int,
        height: int,
        edges_us: Sequence[int] | NDArray[np.int64],
        window_us: tuple[int, int],
        every_row: int = 1,
    ) -> None:
        self.edges_us = np.asarray(edges_us, dtype=np.int64)
        self._window_us = window_us
        self._slot_of = np.full(height, -1)
        self._slot_of[::every_row] = np.arange(-(-height // every_row))
        self._bin_of = np.searchsorted(
            self.edges_us, np.arange(self.edges_us[-1] + 2), side="right"
        ).astype(np.min_scalar_type(len(self.edges_us)))
        self._last_us = np.full((-(-height // every_row), width), _NEVER)
        self._counts = np.zeros(len(self.edges_us) + 1, np.int64)
        self._end_us = int(_NEVER)

    def add(self, events: Events) -> None:
        """Count the next part of the stream.

        Raises
        ------
        EventError
            The events are of a sensor of another size, or start before the end of those before.
        """
        width, height = self._last_us.shape[1], len(self._slot_of)
        if (events.width, events.height) != (width, height):
            raise EventError(
                f"IntervalHistogram.add: found events of {events.width}x{events.height} px, "
                f"expected {width}x{height} px"
            )
        if not len(events):
            return
        if events.t_us[0] < self._end_us:
            raise EventError(
                f"IntervalHistogram.add: found an event at {events.t_us[0]} us after one at "
                f"{self._end_us} us, expected parts in order"
            )
        self._end_us = int(events.t_us[-1])
        _count_intervals(
            events.columns,
            *self._window_us,
            self._slot_of,
            self._bin_of,
            self._last_us,
            self._counts,
        )

    @property
    def counts(self) -> NDArray[np.int64]:
        return self._counts[1:-1].copy()

    @property
    def shorter(self) -> int:
        return int(self._counts[0])

    @property
    def longer(self) -> int:
        return int(self._counts[-1])


def event_rates_hz(events: Events, t_start_us: int, t_end_us: int) -> NDArray[np.float64]:
    """Return the event rate of each pixel in a window.

    Parameters
    ----------
    events
        The stream.
    t_start_us, t_end_us
        The window [t_start_us, t_end_us).

    Returns
    -------
    (height, width) float64, 1/s

    Raises
    ------
    EventError
        A time is not an integer, or the window is empty.

    Examples
    --------
    A pixel that fires a hundred times as often as its neighbors is hot:

    >>> import numpy as np
    >>> from sensor import Events
    >>> from sensor.statistics import event_rates_hz
    >>> t_us, x = np.arange(0, 10_000, 100), np.zeros(100, np.uint16)
    >>> events = Events(t_us, x, x, np.ones(100, np.int8), width=3, height=1)
    >>> event_rates_hz(events, 0, 10_000)
    array([[10000.,     0.,     0.]])
    """
    window = events.between(t_start_us, t_end_us)
    if t_end_us <= t_start_us:
        raise EventError(
            f"event_rates_hz: found a window from {t_start_us} to {t_end_us} us, expected an end "
            "after the start"
        )
    pixel = window.y.astype(np.int64) * events.width + window.x
    counts = np.bincount(pixel, minlength=events.height * events.width)
    return counts.reshape(events.height, events.width) / ((t_end_us - t_start_us) * 1e-6)


def log_bin_edges_us(
    shortest_us: float = 10.0, longest_us: float = 1e5, per_decade: int = 10
) -> NDArray[np.int64]:
    """Return logarithmically spaced bin edges, rounded to whole microseconds.

    Parameters
    ----------
    shortest_us, longest_us
        First edge, and about the last: the whole number of bins whose last edge is nearest.
    per_decade
        Number of bins per decade.

    Returns
    -------
    (B + 1,) int64

    Examples
    --------
    >>> from sensor.statistics import log_bin_edges_us
    >>> log_bin_edges_us(10, 1000, per_decade=3)
    array([  10,   22,   46,  100,  215,  464, 1000])
    """
    decades = np.log10(longest_us / shortest_us)
    steps = np.arange(round(decades * per_decade) + 1) / per_decade
    return np.unique(np.round(shortest_us * 10**steps).astype(np.int64))


def mode_us(
    edges_us: Sequence[int] | NDArray[np.int64],
    counts: Sequence[int] | NDArray[np.int64],
) -> float | None:
    """Return the mode of a histogram over log time.

    Parameters
    ----------
    edges_us
        (B + 1,) bin edges.
    counts
        (B,) counts, which are divided by the widths of the bins in log time.

    Returns
    -------
    float or None
        Geometric center of the highest bin, us; None without counts.

    Examples
    --------
    >>> from sensor.statistics import mode_us
    >>> mode_us([10, 100, 1000], [3, 8])
    316.22776601683796
    """
    edges = np.asarray(edges_us, dtype=np.float64)
    if not np.any(counts):
        return None
    k = int(np.argmax(np.asarray(counts) / np.diff(np.log(edges))))
    return float(np.sqrt(edges[k] * edges[k + 1]))


def log_slope(
    radiance_0: NDArray[np.floating],
    radiance_1: NDArray[np.floating],
    dt_s: float,
    dark_level: float,
) -> NDArray[np.float64]:
    """Return L_t of Eq. (5), the mean slope of log(I + I_dark) between two frames.

    Parameters
    ----------
    radiance_0, radiance_1
        (H, W) linear radiance of the frames.
    dt_s
        Time between them, s.
    dark_level
        I_dark, in the unit of radiance.

    Returns
    -------
    (H, W) float64, 1/s

    Examples
    --------
    >>> import numpy as np
    >>> from sensor.statistics import log_slope
    >>> log_slope(np.array([[1.0, 2.0]]), np.array([[np.e, 2.0]]), dt_s=0.01, dark_level=0.0)
    array([[100.,   0.]])
    """
    after, before = (f.astype(np.float64) + dark_level for f in (radiance_1, radiance_0))
    return np.log(after / before) / dt_s


@dataclass(frozen=True, eq=False, slots=True)
class SlopesBySize:
    """|L_t| of square pixels of increasing size, in blocks of the image.

    Attributes
    ----------
    sizes_px : (P,) int64
        Widths of the pixels, in pixels of the frames.
    everywhere, edges : (N, P) float64
        Mean |L_t| of each block, 1/s: over all its pixels, and over its edge pixels. `edges` omits
        blocks without an edge.
    edge_weights : (len(edges),) int64
        Number of edge pixels of each block in `edges`.
    """

    sizes_px: NDArray[np.int64]
    everywhere: NDArray[np.float64]
    edges: NDArray[np.float64]
    edge_weights: NDArray[np.int64]


def slopes_by_pixel_size(
    radiance_0: NDArray[np.floating],
    radiance_1: NDArray[np.floating],
    dt_s: float,
    dark_level: float,
    *,
    sizes_px: Sequence[int] = (1, 3, 5, 7, 9, 13, 19, 27, 39, 55),
    edge_share: float = 0.05,
    blocks_a_side: int = 8,
) -> SlopesBySize:
    """Return |L_t| for pixels of increasing size at the same points: Fig. 2 (b).

    Radiance is averaged over the square of each pixel, Eq. (3), before the logarithm. Motion
    between the two frames blurs finer structure.

    Parameters
    ----------
    radiance_0, radiance_1, dt_s, dark_level
        As in `log_slope`.
    sizes_px
        Odd widths; the first determines the edges.
    edge_share
        Share of pixels that count as edges, those with the largest |L_t| at the first size. Because
        of this selection their slopes decrease more steeply from that size than the mean.
    blocks_a_side
        The image is divided into this many blocks per side, for a bootstrap over blocks, since
        neighboring pixels are correlated.

    Returns
    -------
    SlopesBySize

    Raises
    ------
    ValueError
        A size is even, or the frames are too small for the largest size.

    Examples
    --------
    Stripes that move: coarse pixels see them as gray.

    >>> import numpy as np
    >>> from sensor.statistics import slopes_by_pixel_size
    >>> x = np.arange(64)
    >>> before, after = (np.tile(2 + np.sin(x + shift), (64, 1)) for shift in (0.0, 0.1))
    >>> slopes = slopes_by_pixel_size(
    ...     before, after, 0.01, 0.0, sizes_px=(1, 3, 7), blocks_a_side=2
    ... )
    >>> slopes.everywhere.mean(axis=0).round(1)
    array([3.5, 2.3, 0.3])
    """
    if any(size % 2 == 0 for size in sizes_px):
        raise ValueError(f"sizes_px: found {tuple(sizes_px)}, expected odd numbers")
    margin = max(sizes_px) // 2
    if min(radiance_0.shape) - 2 * margin < blocks_a_side:
        raise ValueError(
            f"frames of {radiance_0.shape[1]}x{radiance_0.shape[0]} px have no room for "
            f"{blocks_a_side} blocks per side inside a margin of {margin} px"
        )
    inside = tuple(slice(margin, side - margin) for side in radiance_0.shape)
    slopes = []
    for size in sizes_px:
        before, after = (
            uniform_filter(f, size, np.float64)[inside] for f in (radiance_0, radiance_1)
        )
        slopes.append(np.abs(log_slope(before, after, dt_s, dark_level)))
    edge = slopes[0] >= np.quantile(slopes[0], 1 - edge_share)

    rows, cols = (np.arange(side) * blocks_a_side // side for side in edge.shape)
    block = rows[:, None] * blocks_a_side + cols

    def means(where: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        many = np.bincount(block[where], minlength=blocks_a_side**2)
        totals = [np.bincount(block[where], s[where], minlength=many.size) for s in slopes]
        some = many > 0
        return np.stack(totals, axis=1)[some] / many[some, None], many[some]

    everywhere, _ = means(np.ones_like(edge))
    return SlopesBySize(np.array(sizes_px), everywhere, *means(edge))


@dataclass(frozen=True, slots=True)
class PowerLaw:
    """value = factor * size ** -exponent, with the 95 % interval of the exponent."""

    exponent: float
    low: float
    high: float
    factor: float


def fit_power_law(
    sizes: NDArray[np.number],
    blocks: NDArray[np.float64],
    weights: NDArray[np.number] | None = None,
    seed: int = 0,
) -> PowerLaw:
    """Fit gamma of value ~ size^-gamma, Eq. (6), to the weighted mean over blocks.

    Fits a line to the logarithms by least squares; the interval is a percentile bootstrap over
    blocks.

    Parameters
    ----------
    sizes
        (P,) sizes.
    blocks
        (N, P) positive values.
    weights
        (N,) weights of the blocks; None is 1 for all.
    seed
        Seed of the bootstrap.

    Returns
    -------
    PowerLaw

    Raises
    ------
    ValueError
        Fewer than two sizes or blocks.

    Examples
    --------
    >>> import numpy as np
    >>> from sensor.statistics import fit_power_law
    >>> sizes = np.array([1, 3, 9])
    >>> law = fit_power_law(sizes, np.array([8.0, 12.0])[:, None] * sizes**-0.5)
    >>> round(law.exponent, 3), round(law.factor, 3)
    (0.5, 10.0)
    """
    if len(sizes) < 2 or len(blocks) < 2:
        raise ValueError(
            f"found {len(sizes)} sizes and {len(blocks)} blocks, expected at least 2 of each"
        )
    weights = np.ones(len(blocks)) if weights is None else weights
    log_size = np.log(np.asarray(sizes, dtype=np.float64))
    centered = log_size - log_size.mean()
    line = centered / np.sum(centered**2)

    draws = np.random.default_rng(seed).integers(len(blocks), size=(_DRAWS, len(blocks)))
    times_drawn = np.apply_along_axis(np.bincount, 1, draws, minlength=len(blocks))
    chosen = np.concatenate([np.ones((1, len(blocks))), times_drawn]) * weights
    log_mean = np.log(chosen @ blocks / chosen.sum(axis=1, keepdims=True))
    exponents = -(log_mean @ line)
    low, high = np.percentile(exponents[1:], [2.5, 97.5])
    factor = np.exp(log_mean[0].mean() + exponents[0] * log_size.mean())
    return PowerLaw(float(exponents[0]), float(low), float(high), float(factor))
