"""The paper's claims about optical flow: photometric flow (EPF), contrast maximization (CM)
and E-RAFT."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from itertools import pairwise

from tasks.study.claims.claim import Claim, SceneClaim
from tasks.study.claims.numbers import (
    Best,
    MedianOf,
    Number,
    NumberText,
    SceneScores,
    best_and_lead,
)
from tasks.study.claims.statistics import (
    DAY,
    IDEAL,
    NIGHT,
    SceneCell,
    growth,
    lead,
    margin,
    median,
    smallest,
    smallest_fall,
)
from tasks.study.results.asked import Condition, Series
from tasks.study.results.paper import CUTOFFS_HZ, SPEEDS, WIDTHS
from tasks.study.results.words import capitalized, cutoff_label

PHOTOMETRIC = Series("flow", "photometric_flow", "rnepe_px")
CONTRAST = Series("flow", "contrast_maximization", "rnepe_px")
ERAFT = Series("dense_flow", "eraft", "rnepe_px")

_photometric = partial(SceneClaim, series=PHOTOMETRIC)
_contrast = partial(SceneClaim, series=CONTRAST, scenes=("carpet",))

# The paper's search is first order and does not know C.
_SEARCHES = tuple({"method": f"photometric_flow_{n}"} for n in ("unknown_contrast", "by_descent"))
_FAST = 10.0  # factor of the paper's 9 m/s on carpet
_UP_TO_2 = [(IDEAL, 1.0), *((cutoff_hz, speed) for cutoff_hz in (DAY, NIGHT) for speed in SPEEDS)]
_GAINS = [margin(fine, coarse, *at) for coarse, fine in pairwise(WIDTHS) for at in _UP_TO_2]
_OURS = ({"method": "our_flow_ideal_light"}, {"method": "our_flow_all_light"})


def _wins_of_finest(on: SceneScores) -> NumberText:
    """Count the lights and speeds at which 1280 px is best, and name the others."""
    best = {where: on.best_width(*where) for where in _UP_TO_2}
    lost = [
        f"{cutoff_label(cutoff_hz)}, speed {speed:.2g}: {width} px"
        for (cutoff_hz, speed), width in best.items()
        if width != 1280
    ]
    elsewhere = f" (not at {'; '.join(lost)})" if lost else ""
    return NumberText(f"{len(best) - len(lost)} of {len(best)} cells{elsewhere}")


def _against_initial_flow(on: SceneScores) -> NumberText:
    """Compare the best score at night with the flow that the method starts from."""
    width = on.best_width(NIGHT, 1.0)
    nothing = on.scores.baseline(on.series, Condition(on.scene, width, NIGHT, 1.0)).median
    if nothing is None:
        return NumberText("")
    better = "better" if on.median(SceneCell(width, NIGHT)) < nothing else "no better"
    return NumberText(f", {better} than the initial flow's {on.metric.text(nothing)} px")


def _suffers_less(
    name: str, series: Series, *beside: Mapping[str, str], note: str = ""
) -> SceneClaim:
    """Return claim 21, which the paper makes of two methods."""
    growths = [growth(width) for width in WIDTHS]
    photometric = [growth(width, PHOTOMETRIC.method, PHOTOMETRIC.task) for width in WIDTHS]
    quotients = [other / own for other, own in zip(photometric, growths, strict=True)]
    return SceneClaim(
        number=21,
        why="It does not see a common delay.",
        title=f"{capitalized(name)} suffers less from low light than photometric flow",
        statement="On carpet and at every width, the error grows less from no cutoff to 50 Hz "
        f"with {name} than with photometric flow.",
        series=series,
        scenes=("carpet",),
        numbers={
            "own": Number(growths[-1], unit="times", sign=""),
            "photometric": Number(photometric[-1], unit="times", sign=""),
            "quotient": Number(smallest(*quotients), above=1, unit="", sign=""),
        },
        text="{own} against {photometric} at 1280 px; smallest quotient {quotient}",
        beside=beside,
        note="At base speed. The quotient is the growth with photometric flow over that with "
        f"{name}. {note}".strip(),
    )


FLOW_CLAIMS: tuple[Claim, ...] = (
    _photometric(
        number=12,
        why="Exact times make both equal.",
        title="Photometric flow in ideal light: 640 px is best",
        statement="With no cutoff, 640 px has the smallest error.",
        numbers=best_and_lead([640], IDEAL),
        text="best {best}, lead of 640 px {lead}",
        beside=_SEARCHES,
        note="At base speed: ideal pixels send the same events at every speed, only faster. The "
        "caption of the paper's appendix table says that ideal light favors high resolution. In "
        "the table 640 px is best in 9 of 9 cells, so we check that.",
    ),
    _photometric(
        number=13,
        why="Its error is about the delay.",
        title="Photometric flow at 1280 px worsens as the light falls",
        statement="On carpet, the error at 1280 px rises from no cutoff to 200 Hz to 50 Hz.",
        scenes=("carpet",),
        numbers={
            "ideal": MedianOf(1280, IDEAL),
            "day": MedianOf(1280, DAY),
            "night": MedianOf(1280, NIGHT),
            "rise": Number(smallest_fall(*(median(1280, c) for c in CUTOFFS_HZ)), above=0),
        },
        text="{ideal} → {day} → {night}, smallest rise {rise}",
        beside=({"method": "photometric_flow_with_delay"},),
        note="At base speed.",
    ),
    _photometric(
        number=14,
        why="The delay exceeds the start's error: all fail.",
        title="Photometric flow at night: coarse wins on planes, fine in the room",
        statement="At 50 Hz, one of 128, 240, 346 and 640 px has a smaller error than 1280 px on "
        "carpet and rocks. In the room none of them has.",
        scenes=("carpet", "rocks", "room"),
        numbers={
            "best": Best(NIGHT),
            "initial": _against_initial_flow,
            "lead": Number(lead(WIDTHS[:-1], NIGHT), above=0, below_on=("room",)),
        },
        text="best {best}{initial}; coarser widths over 1280 px {lead}",
        beside=_SEARCHES,
        note="At base speed. Half of the initial flows are within "
        f"{3 * math.sqrt(2 * math.log(2)):.2f} px of the truth. The paper's errors for carpet at "
        "night are about as large, so their order may mean nothing. The paper says that lower "
        "resolution is best at night “almost always”; in its Table 2 it is in 6 of 8 columns.",
    ),
    _contrast(
        number=15,
        why="It does not see a common delay.",
        title="Contrast maximization: the finest sensor is best",
        statement="On carpet, 1280 px has the smallest error at every cutoff and speed up to "
        "1.8 m/s.",
        numbers={
            "wins": _wins_of_finest,
            "lead": Number(smallest(*(lead([1280], *where) for where in _UP_TO_2)), above=0),
        },
        text="1280 px is best in {wins}; smallest lead {lead}",
        note="Ideal light counts once: there, ideal pixels send the same events at every speed.",
    ),
    _contrast(
        number=16,
        why="The size of the patch decides.",
        title="Contrast maximization at 9 m/s and night: 640 beats 1280 px",
        statement="On carpet at ten times the base speed and 50 Hz, 640 px has a smaller error "
        "than 1280 px.",
        numbers={
            "coarse": MedianOf(640, NIGHT, _FAST),
            "fine": MedianOf(1280, NIGHT, _FAST),
            "margin": Number(margin(640, 1280, NIGHT, _FAST), above=0),
        },
        text="{coarse} at 640 px, {fine} at 1280 px; 640 over 1280 px {margin}",
        beside=({"method": "contrast_maximization_by_plain_variance"},),
        note="The paper's text says 0.2 px. Both of its tables have 0.12 px, so we compare with "
        "the tables.",
    ),
    _suffers_less("contrast maximization", CONTRAST, note="The paper says the same of E-RAFT."),
    SceneClaim(
        number=17,
        why="Not known, for lack of weights.",
        title="E-RAFT: the finer, the better",
        statement="On carpet, the error falls from each width to the next finer one, at every "
        "cutoff and speed up to 1.8 m/s.",
        series=ERAFT,
        scenes=("carpet",),
        numbers={
            "coarse": MedianOf(128, NIGHT),
            "fine": MedianOf(1280, NIGHT),
            "gain": Number(smallest(*_GAINS), above=0),
        },
        text="at night {coarse} at 128 px, {fine} at 1280 px; smallest gain {gain}",
        beside=_OURS,
        note="Ideal light counts once: there, ideal pixels send the same events at every speed. In "
        "the paper's table the same holds at 9 m/s.",
    ),
    _suffers_less("E-RAFT", ERAFT, *_OURS),
)
