"""The paper's claim about real data, judged on the virtual slider or on recordings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from tasks.registry import NATIVE_PATCH, TASKS, sigma_variant
from tasks.study.claims.claim import Claim, scope_text
from tasks.study.claims.flow import PHOTOMETRIC
from tasks.study.claims.numbers import NotMeasured, Number, NumberText, SceneScores, corrected
from tasks.study.claims.statistics import median
from tasks.study.claims.verdict import Status, Verdict, status_of, status_of_any
from tasks.study.results.asked import Series
from tasks.study.results.perturbation import TRACKING, judged_series, sweep
from tasks.study.results.scaling import Scaling
from tasks.study.results.scores import Scores
from tasks.study.results.slider import (
    FACTORS,
    FIELD_PX,
    NOTHING_MM,
    PAPER_SIGMA_MM,
    PRINTS,
    SPEEDS_M_PER_S,
    light_label,
    slider_scores,
    worse_than_nothing,
)
from tasks.study.results.words import join_words

_MIDDLE, _FULL = (width for width, _ in FIELD_PX[-2:])
_FAST_M_PER_S = SPEEDS_M_PER_S[-1]
_NATIVE = PHOTOMETRIC._replace(variant=NATIVE_PATCH)
_PAPERS_START = TRACKING._replace(variant=sigma_variant(PAPER_SIGMA_MM))
_UNMEASURED = Status.NOT_MEASURED
_NEAR = 1.5  # largest factor between a cutoff by area and that of a light of the run


@dataclass(frozen=True, kw_only=True)
class SliderClaim(Claim):
    """The middle distance is better than the nearest on every print, judged light by light.

    With `recorded` it is judged on recordings: on the two nearest distances at the highest speed,
    on any print and in any light, as the cutoff of a real camera may be unknown. Rows state neither
    distance nor lens, so a wider field is taken for a nearer camera.
    """

    recorded: bool = False

    def judge(self, scores: Scores, scaling: Mapping[str, Scaling]) -> Verdict:
        """Compare the two distances at the highest speed, in each light on its own."""
        nearest = next(iter(sweep(scores, TRACKING.method)), None)  # to the truth
        tracking = nearest if self.recorded else judged_series(scores)
        every = [
            SceneScores(scores, series, scene)
            for series in dict.fromkeys((PHOTOMETRIC, _NATIVE, tracking, _PAPERS_START))
            if series in scores.series()
            for scene in scores.scenes(series)
            if self.recorded or scene in PRINTS
        ]
        deciding = [on for on in every if on.series in (PHOTOMETRIC, tracking)]
        judged = {on.series.task for on in deciding}
        missing = [task for task in (PHOTOMETRIC.task, TRACKING.task) if task not in judged]
        lights = sorted({hz for on in every for hz in scores.cutoffs_hz(on.series)}, reverse=True)
        outcomes: list[Status] = []
        lines: list[str] = []
        intervals = 0
        for hz in lights if self.recorded else filter(math.isfinite, lights):
            ours, texts = self._compared(every, deciding, hz, hz)
            outcomes.append(status_of([o.status for o in ours] + [_UNMEASURED] * len(missing)))
            intervals += sum(number.fails_at is not None for number in ours)
            light = light_label(hz)
            if self.recorded:
                light = "cutoff unknown" if math.isinf(hz) else f"cutoff {hz:g} Hz"
            lines += [f"{light}: {outcomes[-1]}", *texts]
            if self.recorded:
                continue
            area_hz = hz * (_FULL / _MIDDLE) ** 2
            near_hz = min(lights, key=lambda other: abs(math.log(other / area_hz)))
            if abs(math.log(near_hz / area_hz)) < math.log(_NEAR):
                ours, texts = self._compared(deciding, deciding, hz, near_hz)
                status = status_of(number.status for number in ours)
                cutoffs = f"{near_hz:.3g} Hz at {_MIDDLE} px (by area {area_hz:.3g} Hz)"
                lines += [f"{light}, but {cutoffs}: {status}", *texts]
        if lines:
            lines += [f"{TASKS[task].title}: not measured" for task in missing]
            lines.append(f"all lights at once: {status_of(outcomes)}")
        few = min((scores.samples(on.series, on.scene) for on in deciding), default=None)
        names = list(dict.fromkeys(on.scene for on in deciding))
        if self.recorded:
            names = [f"recordings of {join_words(names)}"] if names else []
        scope = scope_text([] if {*PRINTS} <= {*names} else names, few)
        both = "\n".join(lines) or "no rows of the virtual slider", "\n".join(_paper_lines())
        return self.verdict([status_of_any(outcomes)], *both, scope, intervals=intervals)

    def _compared(
        self, every: list[SceneScores], deciding: list[SceneScores], hz: float, middle_hz: float
    ) -> tuple[list[NumberText], list[str]]:
        """Return the deciding leads of the middle distance in a light, and lines with all leads."""
        leads = {on: self._lead(on, hz, middle_hz) for on in every}
        ours = corrected([leads[on] for on in deciding])
        leads |= zip(deciding, ours, strict=True)
        of_series: dict[Series, list[str]] = {}
        for on, lead in leads.items():
            fails = " (does not hold)" * (lead.status is Status.DOES_NOT_HOLD)
            of_series.setdefault(on.series, []).append(f"{on.scene}{lead.text}{fails}")
        return ours, [
            f"- {series.name} [{series.spec.metric.unit}]: {'; '.join(texts)}"
            for series, texts in of_series.items()
        ]

    def _lead(self, on: SceneScores, hz: float, middle_hz: float) -> NumberText:
        """Return the lead of the middle distance, with what is compared if the claim does not."""
        at, widths, speed = "", [_MIDDLE, _FULL], FACTORS[_FAST_M_PER_S]
        if self.recorded:
            widths = sorted({at.width for at in on.scores.conditions(on.series, on.scene)})[-2:]
            speed = on.scores.speeds(on.series, on.scene)[-1]
            if widths[1:]:
                at = f", {widths[0]} px or {widths[1]} px at {speed:g} m/s:"
        with suppress(NotMeasured):
            if widths[1:]:
                lead = median(widths[0], middle_hz, speed) - median(widths[1], hz, speed)
                reading = Number(lead, above=0, unit="")(on)
                return reading._replace(text=f"{at} {reading.text}")
        return NumberText(f"{at} not measured", _UNMEASURED)


def _paper_lines() -> Iterator[str]:
    """Yield the paper's numbers, a line for each task."""
    for series in (PHOTOMETRIC, TRACKING):
        leads = {}
        for name in PRINTS:
            _, middle, full = slider_scores()[series[:2]][name, _FAST_M_PER_S]
            leads[name] = full - middle
        each = ", ".join(f"{name} {lead:+.2f}" for name, lead in leads.items())
        mean = np.mean([*leads.values()])
        yield f"{series.name} [{series.spec.metric.unit}]: {each}; mean {mean:+.2f}"
    yield (
        f"{worse_than_nothing(_FAST_M_PER_S)} of its 9 position errors at {_FAST_M_PER_S:g} m/s "
        f"are larger than the {NOTHING_MM:g} mm of doing nothing"
    )


ON_THE_SLIDER = SliderClaim(
    number=22,
    why="Every lag is above 1 px, where widths differ little.",
    title="On a slider at 0.6 m/s, about 640x360 px is better than the full size",
    statement="On every print, with photometric flow and with pose tracking, errors at 0.6 m/s are "
    f"smaller at {_MIDDLE} px, from 43 cm, than at {_FULL} px, from 24 cm.",
    note="The paper's camera is real. Ours is simulated; eres rig judges your own recordings in "
    "the same way. The paper has one light, which it does not state: the claim holds if it does in "
    "one of ours with a cutoff. All widths are one camera, with one cutoff; if each were a sensor "
    "of its own with a cutoff by the area of its pixels, it would be higher at 649 px. The paper "
    "does not state whether its patches of 61 px grow with the image: those that do decide, as in "
    "the other claims.",
)

ON_RECORDINGS = replace(
    ON_THE_SLIDER,
    recorded=True,
    title="On a slider, more pixels from a nearer camera are not better",
    statement="On every print, with photometric flow and with pose tracking, errors at the highest "
    "speed are smaller from the second nearest distance than from the nearest.",
    note="Holds if it does in one light. Ground truth is the print seen from the solved poses. The "
    "paper does not state whether its patches of 61 px grow with the image: those that do decide, "
    "as in the other claims.",
)
