"""`RecordingScore`: one score of one method on a recording."""

from __future__ import annotations

from dataclasses import dataclass

from tasks.metric import Metric

PSNR = Metric("psnr_db", "PSNR", "dB", higher_is_better=True, negligible=0.1, decimals=2)
END_POINT_ERROR = Metric(
    "epe_px", "distance from the tracks of the frames", "px", False, negligible=0.05, decimals=2
)
CONTRAST_GAIN = Metric("contrast_gain", "contrast gain", "", True, negligible=0.01, decimals=3)
"""Contrast of the events moved back along a flow, over that of the unmoved events."""


@dataclass(frozen=True, slots=True)
class RecordingScore:
    """One score.

    Parameters
    ----------
    method, metric, value
        As in `tasks.row.Row`.
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
