"""Highlights of a scene for the report: pictures and scaling statistics."""

from __future__ import annotations

import numpy as np

from sensor import Events
from tasks.evaluation.reference import ReferenceFrames
from tasks.evaluation.setting import Setting
from tasks.study.run.jobs import Job
from tasks.study.run.previews import PREVIEW_S, preview_files
from tasks.study.run.scaling import interval_histogram, measure_scaling, scaling_files


class Highlights:
    """Collects the highlights of a job's scene from the events of its sensors.

    Only sensors of the first contrast threshold are used: pictures at the first speed, intervals
    between events at the lowest and the highest speed.

    Parameters
    ----------
    job
        The job.
    settings
        All its sensors.
    """

    def __init__(self, job: Job, settings: list[Setting]) -> None:
        speeds = job.simulate.speeds
        self._job = job
        self._previews = {
            (s.model.width, s.model.cutoff_hz): np.zeros((s.model.height, s.model.width), np.int64)
            for s in settings
        }
        self._histograms = {
            (s.model.width, s.model.cutoff_hz, s.speed): interval_histogram(
                s.model.width, s.model.height, (s.start_us, s.end_us)
            )
            for s in settings
            if s.speed in (min(speeds), max(speeds))
        }

    def push(self, setting: Setting, events: Events) -> None:
        """Add the next events of one sensor.

        Parameters
        ----------
        setting
            The sensor.
        events
            Its events, those of the warm-up included.
        """
        sensors = self._job.simulate
        if setting.model.contrast_threshold != sensors.contrast_thresholds[0]:
            return
        key = setting.model.width, setting.model.cutoff_hz
        if histogram := self._histograms.get((*key, setting.speed)):
            histogram.add(events)
        if setting.speed == sensors.speeds[0]:
            last = events.between(setting.end_us - round(PREVIEW_S * 1e6), setting.end_us)
            self._previews[key] += last.polarity_sum()

    def result(self, reference: ReferenceFrames) -> dict[str, bytes]:
        """Return the files by path in the run's folder, after the last event."""
        keyframe = reference.end / np.float32(np.exp(reference.log_white))
        previews = preview_files(self._job, keyframe, self._previews)
        scaling, slope = measure_scaling(reference.sequence, reference.dark_level, self._histograms)
        return {
            **{f"previews/{name}": data for name, data in previews.items()},
            **{f"scaling/{name}": data for name, data in scaling_files(scaling, slope).items()},
        }
