"""The paper's claims about optical flow: photometric flow (EPF) and contrast maximization (CM)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from tasks.study.claims.statistics import (
    FAST,
    best_width,
    grid,
    lead,
    medians_of,
    paper_medians,
    paper_text,
)
from tasks.study.claims.verdict import (
    Medians,
    Statistic,
    Verdict,
    judge_scenes,
    missing_text,
    unsettled,
)
from tasks.study.results.intervals import estimate
from tasks.study.results.metrics import Series
from tasks.study.results.paper import CUTOFFS_HZ, SPEEDS, WIDTHS
from tasks.study.results.scores import Cell, Condition, Scores
from tasks.study.results.words import cutoff_label, number_text

PHOTOMETRIC = Series("flow", "photometric_flow", "rnepe_px")
CONTRAST = Series("flow", "contrast_maximization", "rnepe_px")

_IDEAL, _DAY, _NIGHT = CUTOFFS_HZ
_PLANES = ("carpet", "rocks")


def _px(value: np.ndarray | float, sign: str = "") -> str:
    return f"{number_text(float(value), 2, sign)} px"


def _smallest(statistics: list[Statistic]) -> Statistic:
    return lambda medians: np.min([one(medians) for one in statistics], axis=0)


def inner_resolution_best_in_ideal_light(scores: Scores) -> Verdict:
    """Claim 12: EPF in ideal light is best at 640 px at all speeds (Tab. `app:optical_flow`)."""

    def smallest_lead(scene: str) -> Statistic:
        return _smallest([lead(PHOTOMETRIC, scene, 640, _IDEAL, speed) for speed in SPEEDS])

    def errors(scene: str, medians: Medians) -> str:
        parts = []
        for speed in SPEEDS:
            best = best_width(PHOTOMETRIC, medians, scene, _IDEAL, speed)
            error = _px(medians[Condition(scene, best, _IDEAL, speed)])
            parts.append(f"{error} at {best} px")
        return ", ".join(parts)

    def check(scene: str, cells: Mapping[Condition, Cell]) -> tuple[bool, str]:
        ahead = estimate(cells, smallest_lead(scene))
        text = f"best {errors(scene, medians_of(cells))}; 640 px over the rest by at least "
        return ahead.value > 0, f"{text}{ahead.text(unit='px')}{unsettled(ahead)}"

    return judge_scenes(
        scores,
        PHOTOMETRIC,
        grid([_IDEAL], SPEEDS),
        check,
        number=12,
        title="Photometric flow in ideal light: 640 px is best",
        statement="With no cutoff, 640 px has the smallest error at each of the three speeds.",
        paper=paper_text(
            PHOTOMETRIC,
            lambda scene, m: f"{errors(scene, m)}; by at least {_px(smallest_lead(scene)(m), '+')}",
        ),
        note="The caption of the paper's appendix table says that ideal light prefers high "
        "resolution, but the table's best is 640 px in 9 of 9 places, so that is what is checked.",
    )


def finest_error_rises_as_light_falls(scores: Scores) -> Verdict:
    """Claim 13: EPF on carpet at 1280 px worsens from ideal over day to night (Tab. 2, middle)."""

    def errors(scene: str, medians: Medians) -> list[np.ndarray]:
        return [medians[Condition(scene, 1280, cutoff, 1.0)] for cutoff in CUTOFFS_HZ]

    def smallest_rise(scene: str) -> Statistic:
        return lambda medians: np.min(np.diff(errors(scene, medians), axis=0), axis=0)

    def text(scene: str, medians: Medians) -> str:
        return f"{' → '.join(number_text(float(e), 2) for e in errors(scene, medians))} px"

    def check(scene: str, cells: Mapping[Condition, Cell]) -> tuple[bool, str]:
        rise = estimate(cells, smallest_rise(scene))
        ours = f"{text(scene, medians_of(cells))}, smallest rise {rise.text(unit='px')}"
        delayed = PHOTOMETRIC._replace(method="photometric_flow_with_delay")
        others = {where: scores.cell(delayed, where) for where in cells}
        beside = "" if missing_text(others) else text(scene, medians_of(others))
        return rise.value > 0, ours + unsettled(rise) + delay_text(beside)

    return judge_scenes(
        scores,
        PHOTOMETRIC,
        grid(CUTOFFS_HZ, widths=[1280]),
        check,
        number=13,
        title="Photometric flow at 1280 px worsens as the light falls",
        statement="On carpet, the error at 1280 px rises from no cutoff to 200 Hz to 50 Hz.",
        paper=paper_text(PHOTOMETRIC, text, ["carpet"]),
        note="At base speed.",
        scenes=["carpet"],
    )


def delay_text(numbers: str) -> str:
    """Numbers of the method with a delay of the sensor as one more unknown, where there are any."""
    return f"\nwith a delay as one more unknown: {numbers}" if numbers else ""


def coarse_wins_at_night_on_planes(scores: Scores) -> Verdict:
    """Claim 14: at night a coarser sensor wins on planes, the finest in the room (Tab. 2)."""
    coarser = WIDTHS[:-1]

    def advantage(scene: str) -> Statistic:
        """How much smaller the smallest error of the coarser widths is than that of 1280 px."""
        finest_ahead = lead(PHOTOMETRIC, scene, WIDTHS[-1], _NIGHT)
        return lambda medians: -finest_ahead(medians)

    def check(scene: str, cells: Mapping[Condition, Cell]) -> tuple[bool, str]:
        ahead = estimate(cells, advantage(scene))
        medians = medians_of(cells)
        best = best_width(PHOTOMETRIC, medians, scene, _NIGHT)
        text = f"best {best} px, coarser over {WIDTHS[-1]} px {ahead.text(unit='px')}"
        holds = ahead.value > 0 if scene in _PLANES else ahead.value < 0
        where = Condition(scene, best, _NIGHT, 1.0)
        return holds, text + unsettled(ahead) + idle(where, float(medians[where]))

    def idle(where: Condition, best: float) -> str:
        nothing = scores.baseline(PHOTOMETRIC, where).median
        if nothing is None:
            return ""
        better = "better" if best < nothing else "no better"
        return f"; best {_px(best)}, {better} than the initial flow's {_px(nothing)}"

    return judge_scenes(
        scores,
        PHOTOMETRIC,
        grid([_NIGHT]),
        check,
        number=14,
        title="Photometric flow at night: coarse wins on planes, fine in the room",
        statement=f"At 50 Hz one of {', '.join(map(str, coarser))} px has a smaller error than "
        f"{WIDTHS[-1]} px on carpet and rocks, and none has in the room.",
        paper=paper_text(PHOTOMETRIC, lambda scene, m: _px(advantage(scene)(m), "+")),
        note="At base speed. Half of the initial flows are within "
        f"{3 * math.sqrt(2 * math.log(2)):.2f} px, about what the paper prints for carpet at "
        "night, so its order there need not mean anything. The paper says that lower resolution "
        "is best at night “almost always”: in its Table 2, in 6 of 8 columns.",
        scenes=[*_PLANES, "room"],
    )


def contrast_best_at_finest(scores: Scores) -> Verdict:
    """Claim 15: CM is best at 1280 px at every cutoff up to 1.8 m/s (Tab. 3 and 4)."""

    def smallest_lead(scene: str) -> Statistic:
        finest = WIDTHS[-1]
        return _smallest([lead(CONTRAST, scene, finest, c, s) for c in CUTOFFS_HZ for s in SPEEDS])

    def worst(scene: str, medians: Medians) -> str:
        best = {
            (c, s): best_width(CONTRAST, medians, scene, c, s) for c in CUTOFFS_HZ for s in SPEEDS
        }
        lost = [
            f"{cutoff_label(c)}, speed {s:.2g}: {width} px"
            for (c, s), width in best.items()
            if width != WIDTHS[-1]
        ]
        text = f"best in {len(best) - len(lost)} of {len(best)}"
        return f"{text} (not at {'; '.join(lost)})" if lost else text

    def check(scene: str, cells: Mapping[Condition, Cell]) -> tuple[bool, str]:
        ahead = estimate(cells, smallest_lead(scene))
        text = f"{worst(scene, medians_of(cells))}, smallest lead {ahead.text(unit='px')}"
        return ahead.value > 0, text + unsettled(ahead)

    return judge_scenes(
        scores,
        CONTRAST,
        grid(CUTOFFS_HZ, SPEEDS),
        check,
        number=15,
        title="Contrast maximization: the finest sensor is best",
        statement="On carpet, 1280 px has the smallest error at every cutoff and speed up to "
        "1.8 m/s.",
        paper=paper_text(
            CONTRAST,
            lambda scene, m: (
                f"{worst(scene, m)}, smallest lead {_px(smallest_lead(scene)(m), '+')}"
            ),
            ["carpet"],
        ),
        note="",
        scenes=["carpet"],
    )


def contrast_prefers_coarser_when_fast_at_night(scores: Scores) -> Verdict:
    """Claim 16: at 9 m/s and night CM is better at 640 than at 1280 px (Tab. 4)."""

    def advantage(scene: str) -> Statistic:
        def statistic(medians: Medians) -> np.ndarray:
            fine, coarse = (medians[Condition(scene, w, _NIGHT, FAST)] for w in (1280, 640))
            return fine - coarse

        return statistic

    def check(scene: str, cells: Mapping[Condition, Cell]) -> tuple[bool, str]:
        ahead = estimate(cells, advantage(scene))
        medians = medians_of(cells)
        errors = [_px(medians[Condition(scene, w, _NIGHT, FAST)]) for w in (640, 1280)]
        text = f"{errors[0]} at 640, {errors[1]} at 1280 px, {ahead.text(unit='px')}"
        return ahead.value > 0, text + unsettled(ahead)

    return judge_scenes(
        scores,
        CONTRAST,
        grid([_NIGHT], [FAST], [640, 1280]),
        check,
        number=16,
        title="Contrast maximization at 9 m/s and night: 640 beats 1280 px",
        statement="On carpet at ten times the base speed and 50 Hz, 640 px has a smaller error "
        "than 1280 px.",
        paper=paper_text(CONTRAST, lambda scene, m: _px(advantage(scene)(m), "+"), ["carpet"]),
        note="The paper's text says 0.2 px; both of its tables have 0.12 px, so they are what we "
        "compare with.",
        scenes=["carpet"],
    )


def contrast_less_sensitive_than_photometric(scores: Scores) -> Verdict:
    """Claim 21: a lower cutoff costs CM less than EPF (Tab. 2 and 3)."""
    Key = tuple[Series, Condition]

    def growth(
        one: Series, scene: str, width: int, medians: Mapping[Key, np.ndarray]
    ) -> np.ndarray:
        """The error at night over that in ideal light."""
        night, ideal = (medians[one, Condition(scene, width, c, 1.0)] for c in (_NIGHT, _IDEAL))
        return night / ideal

    def smallest_excess(scene: str, medians: Mapping[Key, np.ndarray]) -> np.ndarray:
        """How many times more EPF's error grows than CM's, at the width where that is least."""
        return np.min(
            [
                growth(PHOTOMETRIC, scene, width, medians) / growth(CONTRAST, scene, width, medians)
                for width in WIDTHS
            ],
            axis=0,
        )

    def text(scene: str, medians: Mapping[Key, np.ndarray]) -> str:
        finest = [
            f"{float(growth(one, scene, WIDTHS[-1], medians)):.2f}×"
            for one in (CONTRAST, PHOTOMETRIC)
        ]
        return f"{finest[0]} against {finest[1]} at {WIDTHS[-1]} px"

    def check(scene: str, cells: Mapping[Condition, Cell]) -> tuple[bool | None, str]:
        contrast = {where: scores.cell(CONTRAST, where) for where in cells}
        if missing := missing_text(contrast):
            return None, f"{missing} of {CONTRAST.name}"
        both = {(PHOTOMETRIC, where): cell for where, cell in cells.items()}
        both |= {(CONTRAST, where): cell for where, cell in contrast.items()}
        if not all(cell.median for cell in both.values()):
            return None, "not measured, an error is 0"
        excess = estimate(both, lambda medians: smallest_excess(scene, medians))
        medians = {key: np.array(cell.median) for key, cell in both.items()}
        ours = f"{text(scene, medians)}; smallest quotient {excess.text(sign='')}"
        return excess.value > 1, ours + unsettled(excess, 1.0)

    papers = {
        (one, where): value
        for one in (PHOTOMETRIC, CONTRAST)
        for where, value in paper_medians(one, "carpet").items()
    }
    return judge_scenes(
        scores,
        PHOTOMETRIC,
        grid([_IDEAL, _NIGHT]),
        check,
        number=21,
        title="Contrast maximization suffers less from low light than photometric flow",
        statement="On carpet and at every width, the error at 50 Hz over that with no cutoff is "
        "smaller for contrast maximization than for photometric flow.",
        paper=f"carpet: {text('carpet', papers)}; smallest quotient "
        f"{float(smallest_excess('carpet', papers)):.2f}",
        note="At base speed; the quotient is photometric flow's ratio over contrast "
        "maximization's. The paper says the same of E-RAFT, which is not run here.",
        scenes=["carpet"],
    )


FLOW_CLAIMS: tuple[Callable[[Scores], Verdict], ...] = (
    inner_resolution_best_in_ideal_light,
    finest_error_rises_as_light_falls,
    coarse_wins_at_night_on_planes,
    contrast_best_at_finest,
    contrast_prefers_coarser_when_fast_at_night,
    contrast_less_sensitive_than_photometric,
)
