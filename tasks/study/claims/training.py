"""The paper's claim about training, tested with twins: networks that differ only in the light of
the events they learned from."""

from __future__ import annotations

from contextlib import suppress

from tasks.study.claims.claim import Claim, SceneClaim
from tasks.study.claims.numbers import (
    NotMeasured,
    Number,
    NumberText,
    SceneScores,
    best_and_lead,
    estimated,
)
from tasks.study.claims.reconstruction import ONE_VIDEO
from tasks.study.claims.statistics import IDEAL, NIGHT, Statistic, lead, median
from tasks.study.results.asked import Series

_NOTE = (
    "The twin learned from the same crops in ideal light alone; everything else about its training "
    "is the same. Gain and cost are at 1280 px."
)


def _overcomes(title: str, statement: str, series: Series, twin: str, note: str) -> SceneClaim:
    """Return the claim about a network and its twin."""
    return SceneClaim(
        number=23,
        why="It differs by scene and training.",
        title=title,
        statement=statement,
        series=series,
        numbers={
            **best_and_lead([1280], NIGHT),
            "fast": Number(lead([1280], NIGHT, 2.0)),
            "twin": Number(lead([1280], NIGHT, method=twin)),
            "gain": Number(_over_twin(twin, NIGHT), above=0),
            "cost": Number(_over_twin(twin, IDEAL)),
            "others": lambda on: _other_nights(on, twin),
        },
        text="night: best {best}, lead of 1280 px {lead}, at speed 2 {fast}; of the twin {twin}; "
        "over the twin {gain} at night, {cost} in ideal light{others}",
        paper="only the sentence, no numbers",
        note=note,
    )


def _over_twin(twin: str, cutoff_hz: float) -> Statistic:
    """Return how much better the network is than its twin, on the same images."""
    cell, other = (median(1280, cutoff_hz, method=method).cells[0] for method in ("", twin))
    return Statistic((cell, other), lambda medians: medians.difference(cell, other))


def _other_nights(on: SceneScores, twin: str) -> NumberText:
    """Read the same numbers in further low lights, of those that were measured."""
    text = ""
    for cutoff_hz in (100.0, 20.0):  # the second is slower than anything in training
        numbers = lead([1280], cutoff_hz), _over_twin(twin, cutoff_hz)
        with suppress(NotMeasured):
            ahead, gain = (estimated(number, on).text(unit=on.metric.unit) for number in numbers)
            text += f"; {cutoff_hz:g} Hz: lead of 1280 px {ahead}, over the twin {gain}"
    return NumberText(text)


TRAINING_CLAIMS: tuple[Claim, ...] = (
    _overcomes(
        "Trained at night, a network reconstructs best with the finest sensor",
        "With night events in the training set, image reconstruction at 50 Hz is best at 1280 px.",
        Series("video", "our_reconstruction_all_light", "psnr_db"),
        "our_reconstruction_ideal_light",
        f"{_NOTE} {ONE_VIDEO}",
    ),
    _overcomes(
        "Trained at night, a network estimates flow best with the finest sensor",
        "With night events in the training set, dense flow at 50 Hz is best at 1280 px.",
        Series("dense_flow", "our_flow_all_light", "rnepe_px"),
        "our_flow_ideal_light",
        _NOTE,
    ),
)
