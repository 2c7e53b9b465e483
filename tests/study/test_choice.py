"""A choice is the smallest width with a score as good as the best."""

import math
from collections.abc import Mapping
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from study_rows import EI, EPF, nothing_rows, paper_rows
from tasks.row import Row
from tasks.study.results.asked import SensorId
from tasks.study.results.choice import Choice, choose, choose_all, exponents_text
from tasks.study.results.scores import Scores


def row(width: int, sample: int, value: float) -> Row:
    return Row("carpet", *EI[:2], width, math.inf, 0.2, 1.0, sample, "psnr_db", value, float(width))


def test_the_choice_is_the_smallest_width_that_is_as_good() -> None:
    """640 px is 0.09 dB below the best, 346 px 0.11 dB: 640 px is enough."""
    values = {346: 20.00, 640: 20.02, 1280: 20.11}
    rows = [row(w, i, v + i - 4) for w, v in values.items() for i in range(9)]
    choice = choose(Scores(rows), EI, "carpet", math.inf, 1.0)
    assert choice is not None
    assert (choice.best, choice.enough) == (SensorId(1280), SensorId(640))
    assert choice.event_rates_hz[choice.best] == 2 * choice.event_rates_hz[choice.enough]
    assert choice.tied is None  # the samples move together, so 0.11 dB is told apart


def test_of_two_sensors_of_one_width_the_better_is_enough() -> None:
    """Promise: the width decides before the name: 640 px are 0.05 dB below the best, by the better
    of two cameras; the other, whose samples scatter around the best, is no smaller, so not tied."""
    values = {(640, "b"): 20.05, (640, "a"): 20.04, (1280, "c"): 20.10}
    rows = [
        replace(row(width, i, value + (i - 4) * (name == "a")), sensor=name)
        for (width, name), value in values.items()
        for i in range(9)
    ]
    choice = choose(Scores(rows), EI, "carpet", math.inf, 1.0)
    assert choice is not None
    assert (choice.best.label, choice.enough.label, choice.tied) == ("c", "b", None)
    assert list(choice.event_rates_hz) == [(640, "a"), (640, "b"), (1280, "c")]


def test_a_tie_needs_samples_that_do_not_tell_the_widths_apart() -> None:
    """The lead of 1280 px changes sign from sample to sample: 640 px is tied, though not near."""
    lead = (-0.6, 0.7, -0.5, 0.6, 0.5, 0.7, -0.4, 0.5, 0.6)
    rows = [row(640, i, 20.0) for i in range(9)] + [
        row(1280, i, 20 + d) for i, d in enumerate(lead)
    ]
    choice = choose(Scores(rows), EI, "carpet", math.inf, 1.0)
    assert choice is not None
    assert (choice.best, choice.enough, choice.tied) == ((1280, ""), (1280, ""), (640, ""))
    few = choose(Scores([r for r in rows if r.sample < 5]), EI, "carpet", math.inf, 1.0)
    assert few is not None
    assert few.tied is None


def test_what_does_not_beat_doing_nothing_is_not_tied() -> None:
    """Promise: of the widths that the samples do not tell from the best, one is named only if it is
    better than doing nothing."""
    lead = (-0.6, 0.7, -0.5, 0.6, 0.5, 0.7, -0.4, 0.5, 0.6)
    rows = [row(640, i, 20.0) for i in range(9)]
    rows += [row(1280, i, 20 + d) for i, d in enumerate(lead)]
    for nothing, tied in ((19.9, SensorId(640)), (20.2, None)):
        idle = [replace(row(640, i, nothing), method="no_events") for i in range(9)]
        choice = choose(Scores(rows + idle), EI, "carpet", math.inf, 1.0)
        assert choice is not None
        assert (choice.enough, choice.worthwhile, choice.tied) == (SensorId(1280), True, tied)


def test_the_choice_may_hang_on_the_exponent_of_the_area() -> None:
    """Promise: among the sensors of each exponent and those that lend no cutoff; by day 640 px are
    0.05 dB below 1280 px at both, at night only at 1."""
    at_night = {("a area^0", 640): 19.0, ("a area^1", 640): 20.0, ("c", 1280): 20.05}
    rows = [
        replace(row(width, i, value + i - 4 + gain), sensor=name, cutoff_hz=light)
        for (name, width), value in at_night.items()
        for light in (200.0, 50.0)
        for gain in [1.0 if (name, light) == ("a area^0", 200.0) else 0.0]
        for i in range(9)
    ]
    (line,) = exponents_text(Scores(rows), [EI], {"carpet": 1.0})
    assert "with area^0; area^1," in line
    assert "the same in 1 of 2 conditions" in line
    assert line.endswith("carpet, night, 1 m/s: c with area^0 and a with area^1.")
    assert exponents_text(Scores([one for one in rows if one.sensor == "c"]), [EI], {}) == []


def test_scenes_with_widths_of_their_own_have_their_own_choices() -> None:
    """Promise: prints of a rig whose crops differ in width are each answered among their own."""
    rows = [row(w, i, 20.0 + w / 100) for w in (442, 649, 1190) for i in range(9)]
    rows += [replace(one, scene="rocks", width=one.width - 100) for one in rows]
    found = choose_all(Scores(rows), EI)
    picked = {scene: one and one.best.width for (scene, _, _), one in found.items()}
    assert picked == {"carpet": 1190, "rocks": 1090}


def test_doing_nothing_is_what_a_choice_is_worth() -> None:
    """A width is worthwhile if it beats doing nothing by over 0.1 dB; that is 20.5, 20.95 or 21.5
    dB."""
    rows = [row(w, i, v + i) for w, v in {640: 20.0, 1280: 21.0}.items() for i in range(3)]
    for nothing, worthwhile in ((20.5, True), (20.95, False), (21.5, False)):
        idle = [
            replace(row(640, i, nothing + i), method="no_events", event_rate_hz=0.0)
            for i in range(3)
        ]
        choice = choose(Scores(rows + idle), EI, "carpet", math.inf, 1.0)
        assert choice is not None
        assert choice.worthwhile is worthwhile


def measured(
    values: Mapping[int, float],
    rates_hz: Mapping[int, float],
    nothing: float | Mapping[int, float] | None = None,
) -> Choice:
    """Return the choice from medians in dB, event rates and do-nothing scores by width."""
    rows = [replace(row(w, 0, v), event_rate_hz=rates_hz[w]) for w, v in values.items()]
    for width in values if nothing is not None else ():
        idle = nothing[width] if isinstance(nothing, Mapping) else nothing
        rows.append(replace(row(width, 0, idle), method="no_events", event_rate_hz=0.0))
    choice = choose(Scores(rows), EI, "carpet", math.inf, 1.0)
    assert choice is not None
    return choice


def on_buses(choice: Choice) -> dict[float, int | None]:
    """Return the sufficient widths by capacity in Mev/s, where the next slower bus has another."""
    found = list(choice.on_buses.items())
    last = [None, *(one for _, one in found)]
    return {
        hz / 1e6: one and one.width for i, (hz, one) in enumerate(found) if i == 0 or one != last[i]
    }


def test_a_bus_is_asked_of_every_width_of_the_study() -> None:
    """No camera has 80 or 160 px, one has 320: the test asks for all three whether a bus carries
    their own events. 320 px, which doing nothing beats by 0.02 dB, is never recommended."""
    values = {80: 19.50, 160: 19.70, 320: 18.87}
    choice = measured(values, {80: 0.4e6, 160: 1.5e6, 320: 6e6}, nothing=18.89)
    assert choice.enough.width == 160
    assert on_buses(choice) == {1.0: 80, 12.0: 160}
    alone = measured({320: 18.87}, {320: 6e6}, nothing=18.89)
    assert on_buses(alone) == {1.0: None}


def test_a_bus_may_not_carry_the_best() -> None:
    """600 Mev/s just carry the events of 1280 px; 640 px fire 90 % of 66, and 128 px half of 1: the
    finer the sensor, the faster the bus must be. With three times the events each needs a faster
    one, 1280 px faster than any; if every width fires too many events for any bus, none is left."""
    values = {128: 18.0, 640: 20.0, 1280: 24.0}
    rates_hz = {128: 0.5e6, 640: 59.4e6, 1280: 600e6}
    choice = measured(values, rates_hz, nothing=10.0)
    assert choice.enough.width == 1280
    assert on_buses(choice) == {1.0: 128, 66.0: 640, 600.0: 1280}
    more = {w: 3 * rate for w, rate in rates_hz.items()}
    assert on_buses(measured(values, more)) == {1.0: None, 12.0: 128, 200.0: 640}
    too_many = dict.fromkeys(values, 1200.1e6)
    assert on_buses(measured(values, too_many)) == {1.0: None}


def test_a_slower_bus_never_asks_for_more_events() -> None:
    """A bus that is too slow for 128 px at 1.01 Mev/s cannot carry 240 px at 3.4 Mev/s, even if
    some camera of 240 px has a faster one. With that bus, it carries 128 px, the best."""
    choice = measured({128: 18.85, 240: 18.74}, {128: 1.01e6, 240: 3.4e6})
    assert on_buses(choice) == {1.0: None, 12.0: 128}


def test_what_a_bus_carries_must_beat_doing_nothing() -> None:
    """Alone 640 px beat doing nothing by 2 dB. The width that 12 Mev/s carry is within 0.1 dB of
    doing nothing, which is negligible, so the same rule recommends nothing there."""
    values = {128: 17.0, 346: 18.09, 640: 20.0}
    choice = measured(values, {128: 0.5e6, 346: 10e6, 640: 60e6}, nothing=18.0)
    assert choice.worthwhile
    assert on_buses(choice) == {1.0: None, 66.0: 640}
    useless = measured(values, {128: 0.5e6, 346: 10e6, 640: 60e6}, nothing=19.95)
    assert not useless.worthwhile
    assert on_buses(useless) == {1.0: None}


def test_equal_scores_are_won_by_the_fewest_pixels() -> None:
    """Three equal medians: the smallest is best and sufficient; so is the smaller of two on a
    bus."""
    choice = measured(dict.fromkeys((240, 346, 640), 20.0), {240: 2e6, 346: 1e6, 640: 1e6})
    assert (choice.best.width, choice.enough.width) == (240, 240)
    assert on_buses(choice) == {1.0: 346, 12.0: 240}


@given(
    st.dictionaries(
        st.integers(1, 2000),
        st.tuples(st.floats(10, 11), st.floats(10, 11), st.floats(0, 2e9)),
        min_size=1,
    )
)
def test_nothing_that_doing_nothing_beats_is_recommended(
    found: dict[int, tuple[float, float, float]],
) -> None:
    """Promise: for any scores, rates and do-nothing scores, every recommendation beats doing
    nothing at its width, is within 0.1 dB of the best that the bus carries, and is carried."""
    values, idle, rates_hz = ({w: v[k] for w, v in found.items()} for k in range(3))
    choice = measured(values, rates_hz, nothing=idle)
    recommended = [(math.inf, choice.enough)] if choice.worthwhile else []
    recommended += [(hz, one) for hz, one in choice.on_buses.items() if one]
    for capacity_hz, (width, _) in recommended:
        assert values[width] > idle[width]
        assert rates_hz[width] <= capacity_hz
        carried = [w for w in values if rates_hz[w] <= capacity_hz]
        assert max(values[w] for w in carried) - values[width] <= 0.1


def test_a_width_with_lost_samples_leaves_no_choice() -> None:
    """640 px has one sample less than 1280 px at the second speed: a choice at the first only."""
    rows = [row(width, i, 20.0) for width in (640, 1280) for i in range(3)]
    faster = [replace(r, speed=2.0) for r in rows[1:]]
    choices = choose_all(Scores(rows + faster), EI)
    assert [choice is None for choice in choices.values()] == [False, True]


def test_the_papers_choice_is_by_the_same_rule_on_its_medians() -> None:
    """At night on the carpet it prints 15.47 dB at 240 px, 15.69 at 346 and 15.72 at 640. It has no
    300 px, so it makes no choice among widths that include it."""
    choices = choose_all(Scores(paper_rows(EI, lambda width, c, s, v: 20.0 - width / 1e6)), EI)
    for cutoff_hz, width in ((math.inf, 1280), (200.0, 1280), (50.0, 346)):
        choice = choices["carpet", cutoff_hz, 1.0]
        assert choice is not None
        assert (choice.enough, choice.paper) == (SensorId(128), SensorId(width))
    other = [row(w, i, 20.0) for w in (128, 300) for i in range(3)]
    choice = choose(Scores(other), EI, "carpet", math.inf, 1.0)
    assert choice is not None
    assert choice.paper is None


def test_for_errors_the_smallest_is_best() -> None:
    """640 px has the least error, 346 px is within 0.05 px of it; doing nothing has 3.5 px. Failed
    features count with their initial error, and a speed of only one scene has a choice on that
    scene alone."""
    errors = {128: 2.0, 346: 0.40, 640: 0.36, 1280: 0.48}
    rows = paper_rows(EPF, lambda width, c, s, v: errors.get(width, 1.0), items=3)
    choices = choose_all(Scores(rows + nothing_rows(rows, 3.5)), EPF)
    choice = choices["carpet", math.inf, 10.0]
    assert choice is not None
    assert (choice.best.width, choice.enough.width) == (640, 346)
    assert choice.worthwhile
    assert ("rocks", math.inf, 10.0) not in choices
