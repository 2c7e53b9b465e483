"""The paper's claims about dense flow: E-RAFT."""

from __future__ import annotations

from itertools import pairwise

from tasks.study.claims.claim import Claim, SceneClaim
from tasks.study.claims.flow import PHOTOMETRIC, UP_TO_2, suffers_less
from tasks.study.claims.numbers import MedianOf, Number
from tasks.study.claims.statistics import NIGHT, growth, margin, smallest
from tasks.study.results.metrics import Series
from tasks.study.results.paper import WIDTHS

ERAFT = Series("dense_flow", "eraft", "rnepe_px")

_GAINS = [margin(fine, coarse, *at) for coarse, fine in pairwise(WIDTHS) for at in UP_TO_2]
_OURS = ({"method": "our_flow_ideal_light"}, {"method": "our_flow_all_light"})

DENSE_FLOW_CLAIMS: tuple[Claim, ...] = (
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
    suffers_less(
        "E-RAFT",
        ERAFT,
        [growth(width) for width in WIDTHS],
        [growth(width, PHOTOMETRIC.method, PHOTOMETRIC.task) for width in WIDTHS],
        beside=_OURS,
    ),
)
