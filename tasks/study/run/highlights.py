"""Highlights of a scene for the report: pictures and scaling statistics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eres_render import RadianceSequence
from sensor import Events
from tasks.evaluation.reference import ReferenceFrames
from tasks.evaluation.sensor_setting import Setting
from tasks.study.results.asked import CutoffInLux, SensorId
from tasks.study.results.previews import FILM_PICTURES, FILM_S
from tasks.study.run.jobs import QueuedJob
from tasks.study.run.previews import Film, preview_files
from tasks.study.run.scaling import interval_histogram, measure_scaling, scaling_files


class Highlights:
    """Collects the highlights of a job's scene from the events of its sensors.

    Of each sensor only the first photoreceptor and contrast threshold are used: films at the first
    speed, intervals between events at the lowest and the highest speed. Of sensors with the same
    pixels, whose buses may differ, only the first is used.
    """

    def __init__(self, queued: QueuedJob, settings: list[Setting]) -> None:
        job = queued.job
        speeds = job.simulate.speeds
        self._job, self._key, self._first = job, queued.key, settings[0].model
        pixels = {replace(s, name="", readout=None): s for s in reversed(settings)}
        settings = [s for s in settings if s in {*pixels.values()}]
        firsts = {(*_sensor_of(s), s.speed): s for s in reversed(settings)}
        self._used = set(firsts.values())
        height, width = job.render.height_at(job.render.resolution), job.render.resolution
        self._films = {_sensor_of(s): Film.of(s.model, height, width) for s in settings}
        self._histograms = {
            (*_sensor_of(s), s.speed): interval_histogram(s.model, (s.start_us, s.end_us))
            for s in settings
            if s.speed in (min(speeds), max(speeds))
        }

    def push(self, setting: Setting, events: Events) -> None:
        """Add the next events of one sensor."""
        if setting not in self._used:
            return
        key = _sensor_of(setting)
        if histogram := self._histograms.get((*key, setting.speed)):
            histogram.add(events)
        if setting.speed == self._job.simulate.speeds[0]:
            self._films[key].add(events, setting.end_us)

    def result(self, reference: ReferenceFrames, sequence: RadianceSequence) -> dict[str, bytes]:
        """Return the highlights, after the last event.

        Returns
        -------
        Files by path in the run's folder.
        """
        speed = self._job.simulate.speeds[0]
        ago_s = FILM_S * speed * np.arange(FILM_PICTURES)[::-1] / FILM_PICTURES
        shown = np.searchsorted(sequence.t_s, sequence.window_s[1] - ago_s)
        white = np.float32(np.exp(reference.log_white(self._first)))
        frames = [sequence.frame(int(i)) / white for i in shown]
        previews = preview_files(self._job, frames, self._films)
        dark_level = self._first.dark_level or 0.0
        scaling, slope = measure_scaling(reference.sequence, dark_level, self._histograms)
        scaling = replace(scaling, job=self._key)
        return {
            **{f"previews/{name}": data for name, data in previews.items()},
            **{f"scaling/{name}": data for name, data in scaling_files(scaling, slope).items()},
        }


def _sensor_of(setting: Setting) -> tuple[SensorId, float]:
    """Return sensor and light; in lux, a profile may give a sensor another cutoff in this light."""
    lux, sensor = setting.illuminance_lux, SensorId(setting.model.width, setting.name)
    return sensor, CutoffInLux(lux) if lux else setting.model.cutoff_hz
