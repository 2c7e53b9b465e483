"""`RecordingScore`: one score of one method on a recording."""

from __future__ import annotations

from dataclasses import dataclass

PSNR = "psnr_db"
END_POINT_ERROR = "epe_px"
"""Distance from the tracks of the frames."""
CONTRAST_GAIN = "contrast_gain"
"""Contrast of the events moved back along a flow, over that of the unmoved events."""


@dataclass(frozen=True, slots=True)
class RecordingScore:
    """One score.

    Parameters
    ----------
    method, value
        As in `tasks.row.Row`.
    metric
        `PSNR`, `END_POINT_ERROR` or `CONTRAST_GAIN`.
    t_us
        End of the window, or time of the image, on the clock of the events.
    item
        Index of the feature.
    failure
        Reason of a failure, or "".
    """

    method: str
    metric: str
    value: float
    t_us: int
    item: int = 0
    failure: str = ""
