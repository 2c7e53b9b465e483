"""A choice is the smallest width that does as well as the best."""

import math
from dataclasses import replace

import pytest

from study_rows import EI, EPF, nothing_rows, paper_rows
from tasks.row import Row
from tasks.study.choice import Choice, choose, choose_all
from tasks.study.choice_html import answer_html, choice_cell
from tasks.study.scores import Scores


def row(width: int, sample: int, value: float) -> Row:
    return Row("carpet", *EI[:2], width, math.inf, 0.2, 1.0, sample, "psnr_db", value, float(width))


def test_the_choice_is_the_smallest_width_that_is_as_good() -> None:
    """640 px is 0.09 dB below the best, 346 px 0.11 dB: 640 px is enough."""
    values = {346: 20.00, 640: 20.02, 1280: 20.11}
    rows = [row(w, i, v + i - 4) for w, v in values.items() for i in range(9)]
    choice = choose(Scores(rows), EI, "carpet", math.inf, 1.0)
    assert choice is not None
    assert (choice.best, choice.enough) == (1280, 640)
    assert choice.loss == pytest.approx(0.09)
    assert choice.saving(1280) == 2.0
    assert choice.tied == 1280  # the samples move together, so 0.09 dB is told apart
    assert choice.nothing is None


def test_a_tie_needs_samples_that_do_not_tell_the_widths_apart() -> None:
    """The lead of 1280 px changes sign from sample to sample: 640 px is tied, though not near."""
    lead = (-0.6, 0.7, -0.5, 0.6, 0.5, 0.7, -0.4, 0.5, 0.6)
    rows = [row(640, i, 20.0) for i in range(9)] + [
        row(1280, i, 20 + d) for i, d in enumerate(lead)
    ]
    choice = choose(Scores(rows), EI, "carpet", math.inf, 1.0)
    assert choice is not None
    assert (choice.best, choice.enough, choice.tied) == (1280, 1280, 640)
    few = choose(Scores([r for r in rows if r.sample < 5]), EI, "carpet", math.inf, 1.0)
    assert few is not None
    assert few.tied is None


def test_doing_nothing_is_what_a_choice_is_worth() -> None:
    """Worthwhile is to beat doing nothing by more than 0.1 dB, which is 20.5, 20.95 or 21.5 dB."""
    rows = [row(w, i, v + i) for w, v in {640: 20.0, 1280: 21.0}.items() for i in range(3)]
    for nothing, worthwhile in ((20.5, True), (20.95, False), (21.5, False)):
        idle = [
            replace(row(640, i, nothing + i), method="no_events", event_rate_hz=0.0)
            for i in range(3)
        ]
        choice = choose(Scores(rows + idle), EI, "carpet", math.inf, 1.0)
        assert choice is not None
        assert choice.gain == pytest.approx(abs(21.0 - nothing))
        assert choice.worthwhile is worthwhile


def test_a_bus_may_not_carry_the_best() -> None:
    """1280 px fires 1.2 times what the fastest bus of that width takes, 640 px half of it: alone
    1280 px is enough, on a bus 640 px; where every rate is too much no width is left."""
    rates_hz = {128: 0.5e6, 640: 0.5 * 600e6 / (480 / 640), 1280: 1.2 * 1200e6 / (960 / 1280)}
    values = {128: 18.0, 640: 20.0, 1280: 24.0}

    def chosen(factor: float) -> Choice:
        rows = [
            replace(row(w, i, v + i), event_rate_hz=factor * rates_hz[w])
            for w, v in values.items()
            for i in range(3)
        ]
        choice = choose(Scores(rows), EI, "carpet", math.inf, 1.0)
        assert choice is not None
        assert choice.enough == 1280
        return choice

    on_bus = chosen(1.0).on_bus
    assert on_bus is not None
    assert on_bus.camera.camera == "DVS-Gen3"
    assert on_bus.share == pytest.approx(0.5)
    assert "on a bus: 640 px, DVS-Gen3 at 50\u202f%" in choice_cell(chosen(1.0), EI)
    assert "on a bus: 1280 px, DVS-Gen4 at 60\u202f%" in choice_cell(chosen(0.5), EI)
    assert chosen(3.0).on_bus is None
    assert "on a bus: none carries it" in choice_cell(chosen(3.0), EI)


def test_a_width_with_lost_samples_leaves_no_choice() -> None:
    """640 px has one sample less than 1280 px at the second speed: a choice at the first only."""
    rows = [row(width, i, 20.0) for width in (640, 1280) for i in range(3)]
    faster = [replace(r, speed=2.0) for r in rows[1:]]
    choices = choose_all(Scores(rows + faster), EI)
    assert [choice is None for choice in choices.values()] == [False, True]


def test_the_papers_choice_is_by_the_same_rule_on_its_medians() -> None:
    """At night on the carpet it prints 15.47 dB at 240 px, 15.69 at 346 and 15.72 at 640.

    It has no 300 px, so it makes no choice among widths of which that is one.
    """
    choices = choose_all(Scores(paper_rows(EI, lambda width, c, s, v: 20.0 - width / 1e6)), EI)
    for cutoff_hz, width in ((math.inf, 1280), (200.0, 1280), (50.0, 346)):
        choice = choices["carpet", cutoff_hz, 1.0]
        assert choice is not None
        assert (choice.enough, choice.paper) == (128, width)
        assert f"paper: {width} px" in choice_cell(choice, EI)
    other = [row(w, i, 20.0) for w in (128, 300) for i in range(3)]
    choice = choose(Scores(other), EI, "carpet", math.inf, 1.0)
    assert choice is not None
    assert choice.paper is None
    assert "paper" not in choice_cell(choice, EI)


def test_for_errors_the_smallest_is_best() -> None:
    """640 px has the least error, 346 px is within 0.05 px of it; 3.5 px is what doing nothing has.

    Failed features count with their starting error, and a speed that only one scene has is chosen
    for on that scene alone.
    """
    errors = {128: 2.0, 346: 0.40, 640: 0.36, 1280: 0.48}
    rows = paper_rows(EPF, lambda width, c, s, v: errors.get(width, 1.0), items=3)
    choices = choose_all(Scores(rows + nothing_rows(rows, 3.5)), EPF)
    choice = choices["carpet", math.inf, 10.0]
    assert choice is not None
    assert (choice.best, choice.enough) == (640, 346)
    assert choice.gain == pytest.approx(3.14)
    assert choice.worthwhile
    assert ("rocks", math.inf, 10.0) not in choices
    assert "It takes" not in answer_html(choices, EPF)
    assert "<b>346&nbsp;px</b> is enough" in answer_html(choices, EPF)
