"""What a report shows of one job: pictures, and the statistics behind the scaling law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensor import Events
from tasks.evaluation.reference import ReferenceFrames
from tasks.evaluation.setting import Setting
from tasks.study.results.scaling import Scaling
from tasks.study.run.jobs import Job
from tasks.study.run.scaling import interval_histogram, measure_scaling

PREVIEW_S = 0.01  # events of the window's last 10 ms are kept as a picture


@dataclass(frozen=True, eq=False, slots=True)
class Exhibit:
    """Pictures and statistics of a job.

    Parameters
    ----------
    keyframe
        (H, W) radiance in units of white, at the window's end.
    previews
        (h, w) polarity sums of the window's last 10 ms, by width and cutoff.
    scaling
        Slopes, and histograms of the times between events.
    slope
        (H, W) L_t at the window's end, 1/s.
    """

    keyframe: NDArray[np.float32]
    previews: dict[tuple[int, float], NDArray[np.int64]]
    scaling: Scaling
    slope: NDArray[np.float64]


class HighlightsCollector:
    """Watches a job's sensors of the first contrast threshold, as they stand for the others.

    Pictures are taken at the first speed, intervals between events at the lowest and the highest.
    """

    def __init__(self, job: Job, settings: list[Setting]) -> None:
        speeds = job.simulate.speeds
        self._contrast_threshold = job.simulate.contrast_thresholds[0]
        self._picture_speed = speeds[0]
        self._previews = {
            (s.model.width, s.model.cutoff_hz): np.zeros((s.model.height, s.model.width), np.int64)
            for s in settings
        }
        self._histograms = {
            (s.model.width, s.model.cutoff_hz, s.speed): interval_histogram(
                s.model.width, (s.start_us, s.end_us)
            )
            for s in settings
            if s.speed in (min(speeds), max(speeds))
        }

    def push(self, setting: Setting, events: Events) -> None:
        """Take in the next events of one sensor, warm-up included."""
        if setting.model.contrast_threshold != self._contrast_threshold:
            return
        key = setting.model.width, setting.model.cutoff_hz
        if histogram := self._histograms.get((*key, setting.speed)):
            histogram.add(events)
        if setting.speed == self._picture_speed:
            last = events.between(setting.end_us - round(PREVIEW_S * 1e6), setting.end_us)
            self._previews[key] += last.polarity_sum()

    def exhibit(self, reference: ReferenceFrames) -> Exhibit:
        """What there is to show, after the last event."""
        keyframe = reference.end / np.float32(np.exp(reference.log_white))
        dark_level = reference.dark_level
        scaling, slope = measure_scaling(reference.sequence, dark_level, self._histograms)
        return Exhibit(keyframe, self._previews, scaling, slope)
