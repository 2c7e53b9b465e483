"""The paper's claims about pose tracking (EPPT).

They are judged from one perturbation of the starting point: `perturbation.judged_series`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from tasks.study.claims.flow import delay_text
from tasks.study.claims.statistics import best_width, grid, lead, medians_of, paper_text
from tasks.study.claims.verdict import (
    Check,
    Medians,
    Statistic,
    Status,
    Verdict,
    judge_scenes,
    missing_text,
    unsettled,
)
from tasks.study.results.intervals import estimate
from tasks.study.results.metrics import METRICS
from tasks.study.results.paper import CUTOFFS_HZ, SPEEDS, WIDTHS
from tasks.study.results.perturbation import (
    REQUIRED_SUCCESS,
    TRACKING,
    ideal_success,
    judged_series,
    sweep,
)
from tasks.study.results.scores import Cell, Condition, Scores
from tasks.study.results.words import share_text

_IDEAL, _DAY, _NIGHT = CUTOFFS_HZ
_ERRATIC = (
    "At 128 px the paper's errors are erratic (29.5, 2.44 and 193.6 mm on carpet at night): some "
    "trials converge and others do not, hence our success rates."
)
_SPEEDS_READ = (
    "The paper's appendix heads the speeds 1.2, 1.6 and 2.4 m/s on both scenes, its main text 0.9, "
    "1.2 and 1.8 m/s for the same numbers on carpet; they are read as the factors 1, 1.3 and 2."
)


def _mm(value: np.ndarray | float, sign: str = "") -> str:
    return f"{METRICS[TRACKING.metric].text(float(value), sign)} mm"


def _judge(
    scores: Scores,
    conditions: list[tuple[int, float, float]],
    check: Check,
    *,
    number: int,
    title: str,
    statement: str,
    paper: str,
    note: str,
    scenes: tuple[str, ...] = (),
) -> Verdict:
    """Judge at the judged perturbation; where there is none nothing is measured."""
    series = judged_series(scores)
    if series is None:
        found = [
            f"{one.variant} {share_text(ideal_success(scores, one))}"
            for one in sweep(scores, TRACKING.method)
        ]
        ours = (
            f"not measured, no perturbation succeeds {share_text(REQUIRED_SUCCESS)} of the time in "
            f"ideal light at the median width: {', '.join(found)}"
            if found
            else f"no rows of {TRACKING.name}"
        )
        return Verdict(number, title, statement, Status.NOT_MEASURED, ours, paper, note)
    rate = share_text(ideal_success(scores, series))
    return judge_scenes(
        scores,
        series,
        conditions,
        check,
        number=number,
        title=title,
        statement=statement,
        paper=paper,
        note=f"{note} Judged from a perturbation of {series.variant}, the largest that succeeds at "
        f"least {share_text(REQUIRED_SUCCESS)} of the time in ideal light at base speed at the "
        f"median width ({rate}); the paper's is 200 mm.",
        scenes=scenes,
    )


def finest_tracks_best_in_ideal_light(scores: Scores) -> Verdict:
    """Claim 18: in ideal light EPPT is best at 1280 px (Tab. 2, right)."""
    finest = WIDTHS[-1]

    def text(scene: str, medians: Medians) -> str:
        best = best_width(TRACKING, medians, scene, _IDEAL)
        return f"best {_mm(medians[Condition(scene, best, _IDEAL, 1.0)])} at {best} px"

    def check(scene: str, cells: Mapping[Condition, Cell]) -> tuple[bool, str]:
        ahead = estimate(cells, lead(TRACKING, scene, finest, _IDEAL))
        ours = f"{text(scene, medians_of(cells))}, {finest} px over the rest "
        return ahead.value > 0, f"{ours}{ahead.text(unit='mm')}{unsettled(ahead)}"

    return _judge(
        scores,
        grid([_IDEAL]),
        check,
        number=18,
        title="Pose tracking in ideal light: the finest sensor is best",
        statement="With no cutoff, 1280 px has the smallest position error.",
        paper=paper_text(TRACKING, text, ["carpet", "rocks"]),
        note="At base speed.",
    )


def finest_tracking_suffers_at_night(scores: Scores) -> Verdict:
    """Claim 19: on rocks 1280 px worsens from ideal to night, where 346 px is best (Tab. 2)."""
    finest, winner = WIDTHS[-1], 346

    def growth(scene: str) -> Statistic:
        def statistic(medians: Medians) -> np.ndarray:
            night, ideal = (medians[Condition(scene, finest, c, 1.0)] for c in (_NIGHT, _IDEAL))
            return night / ideal

        return statistic

    def text(scene: str, medians: Medians) -> str:
        ideal, night = (medians[Condition(scene, finest, c, 1.0)] for c in (_IDEAL, _NIGHT))
        best = best_width(TRACKING, medians, scene, _NIGHT)
        return f"{_mm(ideal)} → {_mm(night)} at {finest} px, best at night {best} px"

    def check(scene: str, cells: Mapping[Condition, Cell]) -> tuple[bool | None, str]:
        medians = medians_of(cells)
        if not float(medians[Condition(scene, finest, _IDEAL, 1.0)]) > 0:
            return None, "not measured, an error is 0"
        grown = estimate(cells, growth(scene))
        ahead = estimate(cells, lead(TRACKING, scene, winner, _NIGHT))
        ours = (
            f"{text(scene, medians)}; grows {grown.text(1, '')}×{unsettled(grown, 1.0)}, "
            f"{winner} px over the rest {ahead.text(unit='mm')}{unsettled(ahead)}"
        )
        holds = grown.value > 1 and ahead.value > 0
        return holds, ours + delay_text(delayed(scene, cells))

    def delayed(scene: str, cells: Mapping[Condition, Cell]) -> str:
        series = judged_series(scores, "photometric_tracking_with_delay")
        if series is None:
            return ""
        others = {where: scores.cell(series, where) for where in cells}
        return "" if missing_text(others) else text(scene, medians_of(others))

    return _judge(
        scores,
        [*grid([_NIGHT]), (finest, _IDEAL, 1.0)],
        check,
        number=19,
        title="Pose tracking on rocks: the finest sensor suffers at night, 346 px is best",
        statement="On rocks, the error at 1280 px grows from no cutoff to 50 Hz, where 346 px has "
        "the smallest.",
        paper=paper_text(TRACKING, text, ["rocks"]),
        note="At base speed.",
        scenes=("rocks",),
    )


def finest_tracking_breaks_down_at_speed(scores: Scores) -> Verdict:
    """Claim 20: on carpet at night 1280 px is best at base speed, not at the top one (Tab. 4)."""
    finest, top = WIDTHS[-1], max(SPEEDS)

    def text(scene: str, medians: Medians) -> str:
        parts = []
        for speed in (1.0, top):
            best = best_width(TRACKING, medians, scene, _NIGHT, speed)
            errors = [medians[Condition(scene, w, _NIGHT, speed)] for w in (best, finest)]
            beside = "" if best == finest else f", {_mm(errors[1])} at {finest} px"
            parts.append(f"speed {speed:g}: best {_mm(errors[0])} at {best} px{beside}")
        return "; ".join(parts)

    def check(scene: str, cells: Mapping[Condition, Cell]) -> tuple[bool, str]:
        slow, fast = (
            estimate(cells, lead(TRACKING, scene, finest, _NIGHT, speed)) for speed in (1.0, top)
        )
        leads = [f"{one.text(unit='mm')}{unsettled(one)}" for one in (slow, fast)]
        ours = f"{text(scene, medians_of(cells))}; {finest} px over the rest {', '.join(leads)}"
        return slow.value > 0 and fast.value < 0, ours

    return _judge(
        scores,
        grid([_NIGHT], [1.0, top]),
        check,
        number=20,
        title="Pose tracking on carpet at night: the finest sensor is best only when slow",
        statement="On carpet at 50 Hz, 1280 px has the smallest error at base speed, and not at "
        "speed 2.",
        paper=paper_text(TRACKING, text, ["carpet"]),
        note=f"{_SPEEDS_READ} {_ERRATIC}",
        scenes=("carpet",),
    )


TRACKING_CLAIMS: tuple[Callable[[Scores], Verdict], ...] = (
    finest_tracks_best_in_ideal_light,
    finest_tracking_suffers_at_night,
    finest_tracking_breaks_down_at_speed,
)
