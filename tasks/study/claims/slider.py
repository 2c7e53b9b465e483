"""The paper's claim about real data, judged on the virtual slider."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from tasks.registry import TASKS
from tasks.study.claims.claim import Claim, scope_text
from tasks.study.claims.flow import PHOTOMETRIC
from tasks.study.claims.numbers import NotMeasured, Number, Reading, SceneScores
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
from tasks.study.results.perturbation import TRACKING, judged_series
from tasks.study.results.scaling import Scaling
from tasks.study.results.scores import Scores
from tasks.study.results.slider import (
    BASE_SPEED_M_PER_S,
    FIELD_PX,
    PRINTS,
    light_label,
)

_MIDDLE, _FULL = (width for width, _ in FIELD_PX[-2:])
_FAST_M_PER_S = SPEEDS_M_PER_S[-1]
_FAST = round(_FAST_M_PER_S / BASE_SPEED_M_PER_S, 9)
_NATIVE_PATCH = "61 px patch"


@dataclass(frozen=True, kw_only=True)
class SliderClaim(Claim):
    """The middle distance is better than the nearest, on every print and in every real light."""

    def judge(self, scores: Scores, scaling: Mapping[str, Scaling]) -> Verdict:
        """Compare the two distances at the highest speed.

        Parameters
        ----------
        scores, scaling
            As `Claim.judge` takes them.

        Returns
        -------
        Verdict
            It follows from one outcome for each print, light and deciding series.
        """
        del scaling
        outcomes: list[Status] = []
        lines: list[str] = []
        samples: dict[str, int] = {}  # by print, of the series with the fewest
        missing = [PHOTOMETRIC.task, TRACKING.task]
        for series, decides in _judged(scores).items():
            metric = TASKS[series.task].metric
            for scene in (one for one in PRINTS if one in scores.scenes(series)):
                found = dict(_readings(scores, series, scene))
                fails = [hz for hz, one in found.items() if one.status is Status.DOES_NOT_HOLD]
                texts = [f"{light_label(hz)} {one.text}" for hz, one in found.items()]
                lost = f" (does not hold in {', '.join(map(light_label, fails))})" if fails else ""
                lines.append(f"{scene}, {series.name} [{metric.unit}]: {'; '.join(texts)}{lost}")
                if decides:
                    missing = [task for task in missing if task != series.task]
                    outcomes += [one.status for one in found.values()]
                    count = scores.samples(series, scene)
                    samples[scene] = min(count, samples.get(scene, count))
        outcomes += [Status.NOT_MEASURED] * len(missing)
        if lines and missing:
            lines += [f"{TASKS[task].title}: not measured" for task in missing]
        only = samples if set(PRINTS) - set(samples) else ()
        scope = scope_text(only, min(samples.values(), default=None))
        ours = "\n".join(lines) or "no rows of the virtual slider"
        return self.verdict(outcomes, ours, "\n".join(_paper_lines()), scope)


def _judged(scores: Scores) -> dict[Series, bool]:
    """Return the series of a run, and whether they decide or only stand beside."""
    tracking = judged_series(scores)
    native = PHOTOMETRIC._replace(variant=_NATIVE_PATCH)
    papers_start = TRACKING._replace(variant=f"sigma {PAPER_SIGMA_MM:g} mm")
    every = (PHOTOMETRIC, native, tracking, papers_start)
    return {one: one in (PHOTOMETRIC, tracking) for one in every if one in scores.series()}


def _readings(scores: Scores, series: Series, scene: str) -> Iterator[tuple[float, Reading]]:
    """Yield the lead of the middle distance in each light with a cutoff."""
    on = SceneScores(scores, series, scene)
    for hz in scores.cutoffs_hz(series):
        if math.isinf(hz):
            continue
        lead = margin(_MIDDLE, _FULL, hz, _FAST)
        try:
            on.require(lead.cells)
            yield hz, Number(lead, above=0, unit="")(on)
        except NotMeasured:
            yield hz, Reading("not measured", Status.NOT_MEASURED)


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


ON_THE_SLIDER = SliderClaim(
    number=22,
    title="On a slider at 0.6 m/s, about 640x360 px are better than the full size",
    statement="On every print, with photometric flow and with pose tracking, errors at 0.6 m/s are "
    f"smaller at {_MIDDLE} px, from 43 cm, than at {_FULL} px, from 24 cm.",
    note="The paper's is a real camera. Ours is simulated, and a recording of your own goes the "
    "same way (eres rig). The paper does not say its light, so every light with a cutoff decides; "
    "nor does it say whether its patches of 61 px grow with the image: those that do decide, as in "
    "the other claims.",
)
