"""The slider's readings on the clock of the events, from edges on a wire that both recorded."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eres_render.errors import reading
from sensor import errors
from sensor.formats import Triggers
from tasks.errors import RigError
from tasks.rig.slider import Slider, read_columns

Float64 = NDArray[np.float64]

FILE_NAME = "triggers.csv"

_MAX_DRIFT = 1e-3  # clocks of cameras and controllers drift by less than a tenth of this
_FARTHEST_US = 1000.0  # largest distance of an edge from the fitted line
_MIN_SPAN = 0.1  # of the edges, as a part of the readings, for a drift that holds for all of these


def on_clock_of_events(slider: Slider, file: Path, triggers: Callable[[], Triggers]) -> Slider:
    """Return readings on the clock of the events.

    Parameters
    ----------
    file
        triggers.csv: a line for each edge with its time on the slider's clock, `slider_us`, and on
        the events' clock, `t_us`. Without a column `t_us`, the edges are the rising ones in the
        file of events, in the same order.
    """
    columns = read_columns(file, ("slider_us",), optional=("t_us",))
    with reading(file, "numbers", RigError):
        numbers = {name: np.array(texts, np.float64) for name, texts in columns.items()}
    slider_us = numbers["slider_us"]
    t_us = numbers.get("t_us")
    if t_us is None:
        with errors.reading(file, error=RigError):
            t_us = triggers().rising_us().astype(np.float64)
    if not 0 < len(t_us) == len(slider_us):
        raise RigError(
            f"{file}: has {len(slider_us)} edges of the slider, and the events have {len(t_us)} "
            "rising edges; each edge needs a time on both clocks"
        )
    spans = float(np.ptp(slider_us)) >= _MIN_SPAN * float(np.ptp(slider.t_us))
    drift = _drift(slider_us, t_us) if spans else 0.0
    zero_us = float(np.mean(t_us)) - (1 + drift) * float(np.mean(slider_us))
    off_us = np.abs(zero_us + (1 + drift) * slider_us - t_us)
    if not (abs(drift) < _MAX_DRIFT and off_us.max() < _FARTHEST_US):
        raise RigError(
            f"{file}: the sync edges of slider and events disagree by {off_us.max():.0f} us (limit "
            f"{_FARTHEST_US:.0f} us), with a clock drift of {drift:.2g} (limit {_MAX_DRIFT:g}); "
            "check for a missing edge"
        )
    return Slider(zero_us + (1 + drift) * slider.t_us, slider.x_m)


def _drift(slider_us: Float64, t_us: Float64) -> float:
    """Return how much faster the clock of the events runs, as a fraction, by least squares."""
    from_mean = slider_us - slider_us.mean()
    spread = float(from_mean @ from_mean)
    return float(from_mean @ (t_us - slider_us)) / spread if spread else 0.0
