"""The clock of the slider, tied to that of the camera by pulses on its trigger input."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tasks.errors import RigError
from tasks.rig.slider import Slider, read_columns

FILE_NAME = "triggers.csv"

_COLUMNS = ("t_us", "slider_t_us")
_LARGEST_US = 1000.0  # of a pulse from the line through all
_LARGEST_DRIFT = 1e-3  # clocks of two crystals differ by some 1e-4


def on_camera_clock(slider: Slider, file: Path) -> Slider:
    """Return the readings of a slider on the clock of the camera.

    The two clocks differ by an offset and a drift: least squares of a line through the pulses; the
    offset alone from one pulse.

    Parameters
    ----------
    slider
        Readings on the slider's clock.
    file
        triggers.csv: the times of the same pulses on both clocks, `t_us,slider_t_us`.

    Returns
    -------
    Slider

    Raises
    ------
    RigError
        The file cannot be read, has no pulse, or its pulses do not follow one line.
    """
    columns = read_columns(file, _COLUMNS)
    try:
        t_us, slider_us = (np.array(columns[name], dtype=np.float64) for name in _COLUMNS)
    except ValueError as error:
        raise RigError(f"{file}: {error}") from None
    if not len(t_us) or not (np.isfinite(t_us).all() and np.isfinite(slider_us).all()):
        raise RigError(f"{file}: found {len(t_us)} pulses, expected at least one, all finite")
    middle_us, offset_us, rate = slider_us.mean(), t_us.mean(), 1.0
    if np.ptp(slider_us) > 0:
        rate = float(np.polyfit(slider_us - middle_us, t_us - offset_us, 1)[0])
    off_us = np.abs(offset_us + rate * (slider_us - middle_us) - t_us)
    if off_us.max() > _LARGEST_US or abs(rate - 1) > _LARGEST_DRIFT:
        worst = int(np.argmax(off_us))
        raise RigError(
            f"{file}: found a drift of {abs(rate - 1):.2g}, and pulse {worst} {off_us[worst]:.0f} "
            f"us from the line through all, expected at most {_LARGEST_DRIFT:g} and "
            f"{_LARGEST_US:g} us: are the pulses the same in both columns?"
        )
    return Slider(offset_us + rate * (slider.t_us - middle_us), slider.x_m)
