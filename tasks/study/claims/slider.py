"""The paper's claim about real data, judged on the virtual slider or on recordings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass

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
_FAILS = Status.DOES_NOT_HOLD


@dataclass(frozen=True, kw_only=True)
class SliderClaim(Claim):
    """The middle distance is better than the nearest, on every print and in every real light.

    Attributes
    ----------
    recorded
        Whether the claim is judged on recordings: on the two nearest distances at the highest
        speed, on any print and in any light, as the cutoff of a real camera may be unknown. Rows
        state neither distance nor lens, so a wider field is taken for a nearer camera.
    """

    recorded: bool = False

    def judge(self, scores: Scores, scaling: Mapping[str, Scaling]) -> Verdict:
        """Compare the two distances at the highest speed."""
        del scaling
        outcomes: list[Status] = []
        lines: list[str] = []
        samples: dict[str, int] = {}  # by print, of the series with the fewest
        missing = [PHOTOMETRIC.task, TRACKING.task]
        nearest = next(iter(sweep(scores, TRACKING.method)), None)  # to the truth
        tracking = nearest if self.recorded else judged_series(scores)
        for series, decides in _judged(scores, tracking).items():
            unit, scenes = TASKS[series.task].metric.unit, scores.scenes(series)
            for scene in scenes if self.recorded else [name for name in PRINTS if name in scenes]:
                at, readings = self._readings(SceneScores(scores, series, scene))
                texts = [f"{light} {reading.text}" for light, reading in readings]
                fails = [light for light, reading in readings if reading.status is _FAILS]
                lost = f" (does not hold: {', '.join(fails)})" if fails else ""
                lines.append(f"{scene}{at}, {series.name} [{unit}]: {'; '.join(texts)}{lost}")
                if decides:
                    missing = [task for task in missing if task != series.task]
                    outcomes += [reading.status for _, reading in readings]
                    count = scores.samples(series, scene)
                    samples[scene] = min(count, samples.get(scene, count))
        outcomes += [Status.NOT_MEASURED] * len(missing)
        if lines and missing:
            lines += [f"{TASKS[task].title}: not measured" for task in missing]
        judged = [*samples] if set(PRINTS) - samples.keys() else []
        if self.recorded:
            judged = [f"recordings of {join_words([*samples])}"] if samples else []
        scope = scope_text(judged, min(samples.values(), default=None))
        ours = "\n".join(lines) or "no rows of the virtual slider"
        return self.verdict(outcomes, ours, "\n".join(_paper_lines()), scope)

    def _readings(self, on: SceneScores) -> tuple[str, list[tuple[str, NumberText]]]:
        """Return what is compared, if the claim does not say it, and the lead of the middle
        distance in each light that decides."""
        at, widths, speed = "", [_MIDDLE, _FULL], _FAST
        if self.recorded:
            widths = sorted({at.width for at in on.scores.conditions(on.series, on.scene)})[-2:]
            speed = on.scores.speeds(on.series, on.scene)[-1]
            if widths[1:]:
                at = f", {widths[0]} px or {widths[1]} px at {speed:g} m/s"
        readings = []
        for hz in on.scores.cutoffs_hz(on.series):
            if not self.recorded and math.isinf(hz):
                continue
            reading = NumberText("not measured", Status.NOT_MEASURED)
            with suppress(NotMeasured):
                if widths[1:]:
                    lead = margin(widths[0], widths[1], hz, speed)
                    on.require(lead.cells)
                    reading = Number(lead, above=0, unit="")(on)
            light = "cutoff unknown" if math.isinf(hz) else f"cutoff {hz:g} Hz"
            readings.append((light if self.recorded else light_label(hz), reading))
        return at, readings


def _judged(scores: Scores, tracking: Series | None) -> dict[Series, bool]:
    """Return the series to print, and whether each of them decides."""
    native = PHOTOMETRIC._replace(variant=NATIVE_PATCH)
    papers_start = TRACKING._replace(variant=sigma_variant(PAPER_SIGMA_MM))
    every = [PHOTOMETRIC, native, tracking, papers_start]
    deciding = PHOTOMETRIC, tracking
    return {series: series in deciding for series in every if series in scores.series()}


def _paper_lines() -> Iterator[str]:
    """Yield the paper's numbers, a line for each task."""
    for series in (PHOTOMETRIC, TRACKING):
        leads = {}
        for name in PRINTS:
            where = series.method, name, _FAST_M_PER_S
            _, middle, full = (
                score.value
                for score in slider_scores()
                if (score.method, score.picture, score.speed_m_per_s) == where
            )
            leads[name] = full - middle
        each = ", ".join(f"{name} {lead:+.2f}" for name, lead in leads.items())
        mean = np.mean([*leads.values()])
        yield f"{series.name} [{TASKS[series.task].metric.unit}]: {each}; mean {mean:+.2f}"
    yield (
        f"{worse_than_nothing(_FAST_M_PER_S)} of its 9 position errors at {_FAST_M_PER_S:g} m/s "
        f"are larger than the {NOTHING_MM:g} mm of doing nothing"
    )


ON_THE_SLIDER = SliderClaim(
    number=22,
    title="On a slider at 0.6 m/s, about 640x360 px is better than the full size",
    statement="On every print, with photometric flow and with pose tracking, errors at 0.6 m/s are "
    f"smaller at {_MIDDLE} px, from 43 cm, than at {_FULL} px, from 24 cm.",
    note="The paper's camera is real. Ours is simulated; eres rig judges your own recordings in "
    "the same way. The paper does not state its light, so every light with a cutoff decides. Nor "
    "does it state whether its patches of 61 px grow with the image: those that do decide, as in "
    "the other claims.",
)

ON_RECORDINGS = SliderClaim(
    number=22,
    recorded=True,
    title="On a slider, more pixels from a nearer camera are not better",
    statement="On every print, with photometric flow and with pose tracking, errors at the highest "
    "speed are smaller from the second nearest distance than from the nearest.",
    note="Ground truth is the print seen from the solved poses. The paper does not state whether "
    "its patches of 61 px grow with the image: those that do decide, as in the other claims.",
)
