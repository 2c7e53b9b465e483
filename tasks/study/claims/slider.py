"""The paper's claim about real data, judged on the virtual slider or on recordings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tasks.registry import TASKS
from tasks.study.claims.claim import Claim, scope_text
from tasks.study.claims.flow import PHOTOMETRIC
from tasks.study.claims.numbers import NotMeasured, Number, NumberText, SceneScores
from tasks.study.claims.statistics import margin
from tasks.study.claims.verdict import Status, Verdict
from tasks.study.results.metrics import Series
from tasks.study.results.paper_slider import (
    NOTHING_MM,
    PAPER_SIGMA_MM,
    SPEEDS_M_PER_S,
    slider_scores,
    worse_than_nothing,
)
from tasks.study.results.perturbation import TRACKING, judged_series, sweep
from tasks.study.results.scaling import Scaling
from tasks.study.results.scores import Scores
from tasks.study.results.slider import BASE_SPEED_M_PER_S, FIELD_PX, PRINTS, light_label
from tasks.study.results.words import join_words
from tasks.variants import NATIVE_PATCH, sigma_variant

_MIDDLE, _FULL = (width for width, _ in FIELD_PX[-2:])
_FAST_M_PER_S = SPEEDS_M_PER_S[-1]
_FAST = round(_FAST_M_PER_S / BASE_SPEED_M_PER_S, 9)


class _Compared(NamedTuple):
    """The cells of a print that are compared."""

    middle: int  # px, width of the field from the middle distance
    full: int  # px, from the nearest
    speed: float  # as in `Condition`
    words: str = ""  # names the cells, if the claim does not


@dataclass(frozen=True, kw_only=True)
class SliderClaim(Claim):
    """The middle distance is better than the nearest, on every print and in every real light."""

    def _prints(self, scores: Scores, series: Series) -> list[str]:
        """Return the prints of a series."""
        return [one for one in PRINTS if one in scores.scenes(series)]

    def _compared(self, scores: Scores, series: Series, scene: str) -> _Compared | None:
        """Return what is compared on a print; None if it was not measured."""
        del scores, series, scene
        return _Compared(_MIDDLE, _FULL, _FAST)

    def _lights_hz(self, scores: Scores, series: Series) -> list[float]:
        """Return the cutoffs that decide."""
        return [hz for hz in scores.cutoffs_hz(series) if not math.isinf(hz)]

    def _light(self, hz: float) -> str:
        """Return a light in words."""
        return light_label(hz)

    def _tracking(self, scores: Scores) -> Series | None:
        """Return the series of tracking that decides."""
        return judged_series(scores)

    def _only(self, prints: list[str]) -> list[str]:
        """Return the judged prints if some are missing."""
        return prints if set(PRINTS) - set(prints) else []

    def judge(self, scores: Scores, scaling: Mapping[str, Scaling]) -> Verdict:
        """Compare the two distances at the highest speed."""
        del scaling
        outcomes: list[Status] = []
        lines: list[str] = []
        samples: dict[str, int] = {}  # by print, of the series with the fewest
        missing = [PHOTOMETRIC.task, TRACKING.task]
        for series, decides in _judged(scores, self._tracking(scores)).items():
            metric = TASKS[series.task].metric
            for scene in self._prints(scores, series):
                at = self._compared(scores, series, scene)
                found = dict(self._readings(SceneScores(scores, series, scene), at))
                fails = [hz for hz, one in found.items() if one.status is Status.DOES_NOT_HOLD]
                texts = [f"{self._light(hz)} {one.text}" for hz, one in found.items()]
                lost = f" (does not hold: {', '.join(map(self._light, fails))})" if fails else ""
                where = f"{scene}{at.words if at else ''}"
                lines.append(f"{where}, {series.name} [{metric.unit}]: {'; '.join(texts)}{lost}")
                if decides:
                    missing = [task for task in missing if task != series.task]
                    outcomes += [one.status for one in found.values()]
                    count = scores.samples(series, scene)
                    samples[scene] = min(count, samples.get(scene, count))
        outcomes += [Status.NOT_MEASURED] * len(missing)
        if lines and missing:
            lines += [f"{TASKS[task].title}: not measured" for task in missing]
        scope = scope_text(self._only([*samples]), min(samples.values(), default=None))
        ours = "\n".join(lines) or "no rows of the virtual slider"
        return self.verdict(outcomes, ours, "\n".join(_paper_lines()), scope)

    def _readings(
        self, on: SceneScores, at: _Compared | None
    ) -> Iterator[tuple[float, NumberText]]:
        """Yield the lead of the middle distance in each light that decides."""
        for hz in self._lights_hz(on.scores, on.series):
            try:
                if at is None:
                    raise NotMeasured("not measured")
                lead = margin(at.middle, at.full, hz, at.speed)
                on.require(lead.cells)
                yield hz, Number(lead, above=0, unit="")(on)
            except NotMeasured:
                yield hz, NumberText("not measured", Status.NOT_MEASURED)


@dataclass(frozen=True, kw_only=True)
class RecordedSliderClaim(SliderClaim):
    """The same on recordings: the two nearest distances at the highest speed, any print and light.

    Rows state neither distance nor lens, so a wider field is taken for a nearer camera.
    """

    def _prints(self, scores: Scores, series: Series) -> list[str]:
        """Return the prints of a series."""
        return scores.scenes(series)

    def _compared(self, scores: Scores, series: Series, scene: str) -> _Compared | None:
        """Return what is compared on a print; None if there is only one distance."""
        widths = sorted({at.width for at in scores.conditions(series) if at.scene == scene})
        if len(widths) < 2:
            return None
        (middle, full), speed = widths[-2:], scores.speeds(series, scene)[-1]
        return _Compared(middle, full, speed, f", {middle} px or {full} px at {speed:g} m/s")

    def _lights_hz(self, scores: Scores, series: Series) -> list[float]:
        """Return all cutoffs, as the cutoff of a real camera may be unknown."""
        return scores.cutoffs_hz(series)

    def _light(self, hz: float) -> str:
        """Return a light in words."""
        return "cutoff unknown" if math.isinf(hz) else f"cutoff {hz:g} Hz"

    def _tracking(self, scores: Scores) -> Series | None:
        """Return tracking from the start nearest to the truth."""
        return next(iter(sweep(scores, TRACKING.method)), None)

    def _only(self, prints: list[str]) -> list[str]:
        """Return the judged prints, in words."""
        return [f"recordings of {join_words(prints)}"] if prints else []


def _judged(scores: Scores, tracking: Series | None) -> dict[Series, bool]:
    """Return the series to print, and whether each of them decides."""
    native = PHOTOMETRIC._replace(variant=NATIVE_PATCH)
    papers_start = TRACKING._replace(variant=sigma_variant(PAPER_SIGMA_MM))
    every = [one for one in (PHOTOMETRIC, native, tracking, papers_start) if one is not None]
    return {one: one in (PHOTOMETRIC, tracking) for one in every if one in scores.series()}


def _paper_lines() -> Iterator[str]:
    """Yield the paper's numbers, a line for each task."""
    found = {
        (one.method, one.picture, one.width): one.value
        for one in slider_scores()
        if one.speed_m_per_s == _FAST_M_PER_S
    }
    for series in (PHOTOMETRIC, TRACKING):
        leads = {name: _paper_lead(found, series.method, name) for name in PRINTS}
        metric = TASKS[series.task].metric
        each = ", ".join(f"{name} {lead:+.2f}" for name, lead in leads.items())
        mean = np.mean([*leads.values()])
        yield f"{series.name} [{metric.unit}]: {each}; mean {mean:+.2f}"
    yield (
        f"{worse_than_nothing(_FAST_M_PER_S)} of its 9 position errors at {_FAST_M_PER_S:g} m/s "
        f"are larger than the {NOTHING_MM:g} mm of doing nothing"
    )


def _paper_lead(found: Mapping[tuple[str, str, int], float], method: str, picture: str) -> float:
    """Return by how much the paper's error from the middle distance is smaller."""
    errors = {w: value for (m, p, w), value in found.items() if (m, p) == (method, picture)}
    _, middle, full = (errors[width] for width in sorted(errors))
    return full - middle


_NUMBER = 22

ON_THE_SLIDER = SliderClaim(
    number=_NUMBER,
    title="On a slider at 0.6 m/s, about 640x360 px is better than the full size",
    statement="On every print, with photometric flow and with pose tracking, errors at 0.6 m/s are "
    f"smaller at {_MIDDLE} px, from 43 cm, than at {_FULL} px, from 24 cm.",
    note="The paper's camera is real. Ours is simulated; eres rig judges your own recordings in "
    "the same way. The paper does not state its light, so every light with a cutoff decides. Nor "
    "does it state whether its patches of 61 px grow with the image: those that do decide, as in "
    "the other claims.",
)

ON_RECORDINGS = RecordedSliderClaim(
    number=_NUMBER,
    title="On a slider, more pixels from a nearer camera are not better",
    statement="On every print, with photometric flow and with pose tracking, errors at the highest "
    "speed are smaller from the second nearest distance than from the nearest.",
    note="Ground truth is the print seen from the solved poses. The paper does not state whether "
    "its patches of 61 px grow with the image: those that do decide, as in the other claims.",
)
