"""The statistics of Fig. 2: times between events, slopes of log intensity, and their scaling law.

- `event_rates_hz`: the event rate of each pixel.
- `IntervalHistogram`: times between consecutive events of a pixel, from a stream, Eq. (7).
- `log_slope`: L_t, the slope of log intensity in time at each pixel, Eq. (5).
- `slopes_by_pixel_size`: |L_t| at the edges of the image for pixels of increasing size.
- `fit_power_law`: the exponent gamma of |L_t| ~ p^-gamma, Eq. (6), with a bootstrap interval.
"""

from sensor.statistics.intervals import IntervalHistogram, event_rates_hz, log_bin_edges_us, mode_us
from sensor.statistics.scaling import (
    PowerLaw,
    SlopesBySize,
    fit_power_law,
    log_slope,
    slopes_by_pixel_size,
)

__all__ = [
    "IntervalHistogram",
    "PowerLaw",
    "SlopesBySize",
    "event_rates_hz",
    "fit_power_law",
    "log_bin_edges_us",
    "log_slope",
    "mode_us",
    "slopes_by_pixel_size",
]
