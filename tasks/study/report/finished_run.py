"""A finished run: its scores and all that follows from them, each computed once."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

from eres_render.scene.scene import name_and_seed
from eres_render.storage.settings_reader import read_json
from tasks.errors import ResultError
from tasks.evaluation.timings import JobTimings, read_timings
from tasks.study.claims.judge import judge_readings
from tasks.study.claims.verdict import Verdict
from tasks.study.results.asked import SensorId, Series, light_of, sensor_of
from tasks.study.results.choice import usual_bus_hz
from tasks.study.results.perturbation import shown_series
from tasks.study.results.previews import INDEX_NAME, Preview
from tasks.study.results.run_files import read_config, scores_of_run
from tasks.study.results.scaling import Intervals, Scaling, read_scaling
from tasks.study.results.scores import Scores
from tasks.study.results.words import PACKAGED, BaseSpeeds


@dataclass(frozen=True, eq=False)
class FinishedRun:
    """A finished run, the input of every section of the report.

    `by_threshold` are the scores of the page's photoreceptor, `others` those of the other
    photoreceptors, each by contrast threshold.
    """

    folder: Path
    by_threshold: Sequence[Scores]
    environment: Mapping[str, str]
    config: Mapping[str, Any]
    others: Mapping[str, Sequence[Scores]] = field(default_factory=dict)

    @property
    def scores(self) -> Scores:
        """Return the scores of the first contrast threshold."""
        return self.by_threshold[0]

    @property
    def readings(self) -> dict[str, Scores]:
        """Return the scores at the first threshold by photoreceptor, that of the page first."""
        every = {self.scores.photoreceptor: self.by_threshold, **self.others}
        return {name: scores[0] for name, scores in every.items()}

    @cached_property
    def series(self) -> list[Series]:
        """Return the series that the report shows, by task."""
        return shown_series(self.scores)

    @cached_property
    def scenes(self) -> list[str]:
        """Return the scenes of all series, in the order of the rows."""
        return self.scores.scenes()

    @property
    def question(self) -> str:
        """Return the question of the study."""
        return self.config.get("question") or "Which event-camera resolution is enough?"

    @property
    def assumes(self) -> list[str]:
        """Return what the study assumes of its sensors in words; none for recordings."""
        return list(self.config.get("assumes", []))

    @cached_property
    def base_speeds(self) -> BaseSpeeds:
        """Return the base speed by scene, m/s; 1 for recordings, whose speeds are in m/s."""
        if "recorded" in self.config:
            return dict.fromkeys(self.scenes, 1.0)
        return {**PACKAGED, **self.config.get("base_m_per_s", {})}

    @property
    def config_text(self) -> str:
        """Return the configuration as JSON to be read, as HTML."""
        return escape(json.dumps(self.config, indent=2, ensure_ascii=False), quote=False)

    @cached_property
    def buses_hz(self) -> dict[SensorId, float]:
        """Return the capacity of each sensor's bus, events/s.

        A sensor without a bus has the fastest of real cameras up to the finest sensor.
        """
        sensors = sorted({sensor for s in self.series for sensor in self.scores.sensors(s)})
        usual = usual_bus_hz(sensors[-1].width)
        return {sensor: self.scores.buses_hz.get(sensor, usual) for sensor in sensors}

    @property
    def buses_differ(self) -> bool:
        """Return whether sensors have buses of different capacity."""
        return len(set(self.buses_hz.values())) > 1

    @property
    def bus_hz(self) -> float:
        """Return the capacity of the fastest bus of the sensors, events/s."""
        return max(self.buses_hz.values())

    @property
    def firsts(self) -> list[Series]:
        """Return the first series of each task."""
        return list({s.task: s for s in reversed(self.series)}.values())[::-1]

    @cached_property
    def sample_counts(self) -> list[int]:
        """Return the distinct numbers of samples per scene, ascending."""
        scores = self.scores
        return sorted({scores.samples(s, at) for s in scores.series() for at in scores.scenes(s)})

    @cached_property
    def scaling(self) -> dict[str, Scaling]:
        """Return the scaling statistics by scene, in the lights of the study."""
        scaling = read_scaling(self.folder / "scaling", self.config.get("jobs"))
        for scene, of_scene in scaling.items():
            intervals = (replace(i, cutoff_hz=_light_of(i)) for i in of_scene.intervals)
            scaling[scene] = replace(of_scene, intervals=tuple(intervals))
        return scaling

    @cached_property
    def timings(self) -> list[JobTimings]:
        """Return the times of the study's jobs."""
        return read_timings(self.folder / "costs", self.config.get("jobs"))

    @cached_property
    def previews(self) -> dict[str, list[Preview]]:
        """Return the pictures of the first seed of each scene, by falling cutoff, then rising speed
        and sensor."""
        index = self.folder / "previews" / INDEX_NAME
        entries = read_json(tuple[Preview, ...], index, ResultError) if index.is_file() else ()
        lit = [replace(entry, cutoff_hz=_light_of(entry)) for entry in entries]
        lit.sort(key=lambda each: (-each.cutoff_hz, each.speed, sensor_of(each)))
        first: dict[str, str] = {}
        for entry in entries:
            first.setdefault(name_and_seed(entry.scene)[0], entry.scene)
        return {scene: [each for each in lit if each.scene == scene] for scene in first.values()}

    @cached_property
    def verdicts(self) -> list[Verdict]:
        """Return the verdicts on the claims that the run is about; empty if there are none."""
        return self.verdicts_by_photoreceptor[self.scores.photoreceptor]

    @cached_property
    def verdicts_by_photoreceptor(self) -> dict[str, list[Verdict]]:
        """Return the verdicts with each photoreceptor, that of the page first."""
        return judge_readings(self.config, self.readings, self.scaling)

    def picture(self, name: str, reason: str) -> str:
        """Read a PNG or WebP file in the run's folder as a data URL."""
        path = self.folder / name
        try:
            content = base64.b64encode(path.read_bytes()).decode()
        except FileNotFoundError:
            raise ResultError(f"{path}: no such file, but {reason}") from None
        return f"data:image/{path.suffix[1:]};base64,{content}"


def _light_of(entry: Preview | Intervals) -> float:
    """Return the light of a picture or a histogram, as in `Condition`."""
    return light_of(entry.cutoff_hz, entry.illuminance_lux)


def read_run(folder: Path, *others: Path) -> FinishedRun:
    """Read the folder of a finished run.

    `others` are folders of runs of the same study with other weights of its networks; their scores
    join the first folder's, which gives all else.
    """
    (_, scores), *further = scores_of_run(folder, *others).items()
    environment = read_json(dict[str, str], folder / "environment.json", ResultError)
    config = read_config(folder)
    if not scores[0].series():
        raise ResultError(f"{folder / 'rows.parquet'}: has only rows of do-nothing methods")
    return FinishedRun(folder, scores, environment, config, dict(further))
