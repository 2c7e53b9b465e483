"""Promise: claims about events and event integration follow the rows."""

import inspect
import math
import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import permutations
from zlib import crc32

import numpy as np
import pytest
from scipy.stats import norm, t

from study_rows import EI, Change, paper_rows, verdict
from tasks.row import Row
from tasks.study.claims.claim import SceneClaim
from tasks.study.claims.judge import CLAIMS, judge_all
from tasks.study.claims.numbers import Number, SceneScores, estimated
from tasks.study.claims.statistics import DAY, SceneCell, event_rate, lead, margin, smallest
from tasks.study.claims.verdict import Status, settled, status_of
from tasks.study.results.asked import Condition
from tasks.study.results.cells import DRAWS, Cell, effective_samples
from tasks.study.results.intervals import Interval, Medians, estimate
from tasks.study.results.paper import WIDTHS
from tasks.study.results.scores import Scores

NUMBERS = (3, 4, 5, 6, 7, 8, 9)


def test_every_claim_is_judged_once() -> None:
    """Claims are in order of their numbers; 10, 21 and 23 are about two methods, one after the
    other."""
    judged = [v.number for v in judge_all(paper_rows(), {})]
    assert judged == [*range(1, 11), 10, *range(11, 22), 21, 22, 23, 23, 24]
    assert len(judged) == len(CLAIMS)


@pytest.mark.parametrize("number", NUMBERS)
def test_the_papers_own_numbers_uphold_its_claims(number: int) -> None:
    """Rows with the paper's medians: every claim holds, on every scene, with an interval."""
    found = verdict(number, paper_rows())
    assert found.status is Status.HOLDS
    for scene in ("carpet", "rocks", "room"):
        assert scene in found.ours
    assert "[" in found.ours
    assert "Judged" not in found.note


FAILURES: dict[int, Change] = {
    3: lambda w, c, s, v: v - 9 * (w == 1280 and math.isinf(c)),
    4: lambda w, c, s, v: v + 9 * (w == 1280 and c == 200),
    5: lambda w, c, s, v: v + 0.05 * (w == 346 and math.isinf(c) and s == 2),
    6: lambda w, c, s, v: v + 5 * (w == 1280 and c == 50),
    7: lambda w, c, s, v: v if math.isinf(c) else 10 * math.log2(w),
    9: lambda w, c, s, v: v + (s > 1) * (w == 1280 and c == 200),
}


@pytest.mark.parametrize("number", FAILURES)
def test_a_claim_fails_when_the_rows_contradict_it(number: int) -> None:
    """Rows break the condition of one claim, and its verdict says so."""
    found = verdict(number, paper_rows(EI, FAILURES[number]))
    assert found.status is Status.DOES_NOT_HOLD
    assert "(does not hold)" in found.ours


def test_event_rate_that_only_follows_the_pixels_fails_claim_8() -> None:
    """With less than 4 times the events on 4 times the pixels, the rate of a pixel falls."""
    found = verdict(8, paper_rows(rate=lambda width, cutoff_hz: float(width) ** 1.9))
    assert found.status is Status.DOES_NOT_HOLD
    silent = verdict(8, paper_rows(rate=lambda width, cutoff_hz: 0.0))
    assert silent.status is Status.NOT_MEASURED


def test_daytime_margin_that_is_smaller_but_for_another_winner_fails_claim_4() -> None:
    """By day another width wins: the smaller margin alone is not enough."""
    found = verdict(4, paper_rows(EI, lambda w, c, s, v: v + 9 * (w == 346 and c == 200)))
    assert found.status is Status.DOES_NOT_HOLD
    assert " at 346 px, " in found.ours


NEEDED: dict[int, tuple[int, float, float]] = {
    3: (128, math.inf, 1.0),
    4: (240, 200.0, 1.0),
    5: (1280, math.inf, 4 / 3),
    6: (346, 50.0, 1.0),
    7: (128, 50.0, 1.0),
    8: (640, 200.0, 1.0),
    9: (1280, 200.0, 2.0),
}


@pytest.mark.parametrize("number", NUMBERS)
@pytest.mark.parametrize("lost_samples", [1, 9])
def test_not_measured_is_never_holds(number: int, lost_samples: int) -> None:
    """A needed cell or one of its samples is missing: not measured, and the text names it."""
    width = NEEDED[number][0]
    rows = [
        r
        for r in paper_rows(scenes=("carpet",))
        if (r.width, r.cutoff_hz, r.speed) != NEEDED[number] or r.sample >= lost_samples
    ]
    found = verdict(number, rows)
    assert found.status is Status.NOT_MEASURED
    assert f"missing {width} px" in found.ours
    if lost_samples == 1:
        assert "has 8 of 9 samples" in found.ours


@pytest.mark.parametrize("number", NUMBERS)
def test_rows_of_another_method_measure_nothing(number: int) -> None:
    """Without event integration every claim is not measured."""
    rows = [r for r in paper_rows(scenes=("carpet",), samples=1) if r.width == 128]
    other = [Row(r.scene, r.task, "no_events", *_tail(r)) for r in rows]
    found = verdict(number, other)
    assert found.status is Status.NOT_MEASURED
    assert found.ours == "no rows of event integration"


def _tail(r: Row) -> tuple[int, float, float, float, int, str, float, float]:
    where = r.width, r.cutoff_hz, r.contrast_threshold, r.speed
    return *where, r.sample, r.metric, r.value, r.event_rate_hz


def test_one_scene_that_fails_settles_it_and_one_that_lacks_rows_does_not() -> None:
    """A claim that fails on any scene does not hold; one that holds on some scenes and lacks rows
    on others is not measured."""
    carpet = paper_rows(scenes=("carpet",))
    rocks = paper_rows(EI, FAILURES[3], scenes=("rocks",))
    assert verdict(3, carpet + rocks).status is Status.DOES_NOT_HOLD
    part = [r for r in paper_rows(scenes=("rocks",)) if r.width != 1280]
    found = verdict(3, carpet + part)
    assert found.status is Status.NOT_MEASURED
    assert "Judged on" not in found.note
    assert "rocks: not measured" in found.ours


def test_few_samples_say_so_instead_of_an_interval() -> None:
    """With 3 samples no interval is printed, nothing is decided, and the note says why."""
    found = verdict(3, paper_rows(samples=3, scenes=("carpet",)))
    assert found.status is Status.UNDECIDED
    assert found.likeness == ""
    assert "[" not in found.ours
    assert "on carpet only; 3 samples, too few for an interval (6 needed)" in found.note


def test_the_contradiction_in_the_papers_caption_is_told() -> None:
    """The note of claim 3 has the caption's 0.1 dB and the table's 2.5 to 3.7 dB."""
    note = verdict(3, paper_rows()).note
    assert "0.1 dB" in note
    assert "2.5 to 3.7 dB" in note


def test_a_mean_over_scenes_is_the_papers() -> None:
    """3.18 dB in ideal light and 0.86 dB by day, from rows with the paper's medians."""
    assert "mean of 3 scenes: +3.18 [+3.18, +3.18; n 3] dB" in verdict(3, paper_rows()).ours
    assert "mean of 3 scenes: +0.86 [+0.86, +0.86; n 3] dB" in verdict(4, paper_rows()).ours


def test_a_mean_over_scenes_is_printed_as_the_number_is() -> None:
    """Promise: a claim's own unit, format and scenes; the paper, without event rates, has none."""
    own = SceneClaim(
        number=99,
        title="Events per second",
        statement="The finest sensor fires events.",
        series=EI,
        text="{rate}",
        numbers={"rate": Number(event_rate(1280, math.inf), unit="events/s", decimals=0, sign="")},
        mean="rate",
        scenes=("carpet", "rocks"),
    )
    (found,) = judge_all(paper_rows(), {}, [own])
    assert re.search(r"mean of 2 scenes: \d+ \[\d+, \d+; n 2\] events/s$", found.ours), found.ours


def test_the_bootstrap_is_paired_and_seeded() -> None:
    """The difference of conditions with a common shift has no spread; a single median has one."""
    scores = Scores(paper_rows())
    fine, coarse = (Condition("carpet", width, math.inf, 1.0) for width in (1280, 640))
    cells = {where: scores.cell(EI, where) for where in (fine, coarse)}
    paired = estimate(lambda m: m[fine] - m[coarse], cells)
    assert paired.low == pytest.approx(paired.high)
    alone = estimate(lambda m: m[fine], cells)
    assert alone.low is not None
    assert alone.high is not None
    assert alone.low < alone.value < alone.high
    assert alone == estimate(lambda m: m[fine], cells)


def test_a_difference_is_that_of_each_sample_before_its_median() -> None:
    """Samples that spread by 8 dB, and a width that is better by 0.1 dB in all but the middle one.

    The medians of both widths are the same, so their difference is 0; the median of the differences
    is 0.1 dB, and its interval does not reach 0.
    """
    gain = np.array([0.1] * 4 + [0.0] + [0.1] * 4)
    rows = [
        replace(r, value=r.value + gain[r.sample]) if r.width == 1280 else r
        for r in paper_rows(EI, lambda w, c, s, v: 20.0, scenes=("carpet",))
    ]
    of_1280 = {"margin": Number(margin(1280, 640, DAY), above=0)}
    (found,) = judge_all(rows, {}, [replace(own_claim(), numbers=of_1280)])
    assert found.status is Status.HOLDS
    assert "+0.10 [+0.10, +0.10; n 9] dB" in found.ours
    scores = Scores(rows)
    fine, coarse = (Condition("carpet", width, DAY, 1.0) for width in (1280, 640))
    cells = {where: scores.cell(EI, where) for where in (fine, coarse)}
    assert estimate(lambda m: m[fine] - m[coarse], cells).value == 0.0
    assert estimate(lambda m: m.difference(fine, coarse), cells).value == pytest.approx(0.1)


def test_the_interval_of_a_lead_is_made_of_those_of_its_differences() -> None:
    """Against plain loops over the bootstrap's draws; a bound of several shares their tail."""
    rng = np.random.default_rng(5)
    table = {width: 20.0 + rng.normal(size=9) for width in WIDTHS}
    on = SceneScores(Scores(rows_of_day(table)), EI, "carpet")
    found = estimated(lead([240, 640], DAY), on)

    draws = np.random.default_rng([crc32(b"carpet"), 9]).integers(9, size=(DRAWS, 9))
    first, rest = (240, 640), (128, 346, 1280)
    medians = {
        (one, other): np.median((table[one] - table[other])[draws], axis=1)
        for one in first
        for other in rest
    }

    def plain(quantity: Callable[[tuple[int, int]], np.floating]) -> np.floating:
        return max(min(quantity((one, other)) for other in rest) for one in first)

    def bound(at: tuple[int, int], tail: float, end: float) -> np.floating:
        median = np.median(table[at[0]] - table[at[1]])
        student = t.ppf(1 - tail, 8) / norm.ppf(1 - tail) * math.sqrt(9 / 8)
        return median + student * (np.percentile(medians[at], end) - median)

    assert found.value == plain(lambda at: np.median(table[at[0]] - table[at[1]]))
    low, high = 0.025 / 2, 0.025 / 3
    assert found.low == pytest.approx(plain(lambda at: bound(at, low, 100 * low)))
    assert found.high == pytest.approx(plain(lambda at: bound(at, high, 100 - 100 * high)))


def test_scores_that_differ_in_their_last_bits_are_tied() -> None:
    """Promise: where searches keep their starts at both widths, rounding decides nothing: an
    interval that ends at such a tie reaches 0."""
    rng = np.random.default_rng(2)
    start = 20.0 + rng.normal(size=10)
    gain = np.array([0.0] * 4 + [0.3] * 6)
    for bits in (0.0, 3e-15, -3e-15):
        table = dict.fromkeys(WIDTHS, start) | {1280: start + gain + bits}
        of_1280 = {"margin": Number(margin(1280, 640, DAY), above=0)}
        (found,) = judge_all(rows_of_day(table), {}, [replace(own_claim(), numbers=of_1280)])
        assert found.status is Status.UNDECIDED
        equal = table | {1280: start + bits}
        (found,) = judge_all(rows_of_day(equal), {}, [replace(own_claim(), numbers=of_1280)])
        assert "+0.00 [+0.00, +0.00; n 1] dB, tied" in found.ours


def test_an_extreme_of_true_numbers_is_not_refuted_by_noise() -> None:
    """12 gains are all 0.05 dB above the bound, under noise of 0.3 dB: the smallest is measured
    below it, which refutes nothing. Gains of -0.3 dB do refute it, and of 0.8 dB confirm it."""
    rng = np.random.default_rng(3)
    of_two = [margin(fine, coarse, DAY) for fine, coarse in permutations(WIDTHS, 2)][:12]

    def outcomes(gain: float, runs: int = 20) -> Counter[Status]:
        found: Counter[Status] = Counter()
        for _ in range(runs):
            at = dict.fromkeys(WIDTHS, np.zeros(20))
            on = SceneScores(Scores(rows_of_day(at)), EI, "carpet")
            parts = [
                replace(part, each=None, of=noisy(gain + 0.07 * rng.normal())) for part in of_two
            ]
            found[settled(estimated(smallest(*parts), on), above=True, bound=0)] += 1
        return found

    def noisy(value: float) -> Callable[[Medians[SceneCell]], np.ndarray]:
        drawn = value + 0.07 * rng.normal(size=DRAWS)
        return lambda medians: np.full(len(medians.parts), value) if medians.parts else drawn

    assert outcomes(0.05)[Status.DOES_NOT_HOLD] <= 2
    assert outcomes(-0.3) == {Status.DOES_NOT_HOLD: 20}
    assert outcomes(0.8) == {Status.HOLDS: 20}


def test_an_interval_without_its_number_settles_nothing() -> None:
    """Promise: a number above the bound with an interval below it neither holds nor fails."""
    odd = Interval(0.004, -0.52, -0.003)
    assert settled(odd, above=True, bound=0) is Status.UNDECIDED
    assert settled(odd, above=False, bound=0) is Status.UNDECIDED


def test_numbers_are_like_the_papers_if_it_is_within_our_intervals() -> None:
    """The paper's own medians are; with a margin that is 1 dB larger on one scene they are not."""
    assert verdict(3, paper_rows()).likeness == "numbers like the paper's on 3 of 3 scenes"
    other = paper_rows(EI, lambda w, c, s, v: v + (w == 1280), scenes=("rocks",))
    rows = [r for r in paper_rows() if r.scene != "rocks"] + other
    assert verdict(3, rows).likeness == "numbers like the paper's on 2 of 3 scenes"
    alone = paper_rows(EI, lambda w, c, s, v: v + (w == 1280), scenes=("carpet",))
    assert verdict(3, alone).likeness == "numbers unlike the paper's"
    elsewhere = [replace(r, contrast_threshold=0.3) for r in paper_rows()]
    assert verdict(3, elsewhere).likeness == ""
    # Claim 8 has its numbers, 8 and 6 times, in words alone.
    for by_day, like in ((6.0, "like"), (5.0, "unlike")):

        def rate(width: int, cutoff_hz: float, by_day: float = by_day) -> float:
            return 1.0 if width < 1280 else 8.0 if math.isinf(cutoff_hz) else by_day

        rows = paper_rows(rate=rate, scenes=("carpet",))
        assert verdict(8, rows).likeness == f"numbers {like} the paper's"


def test_a_margin_that_shrinks_below_zero_fails_claim_9() -> None:
    """The paper's margins shrink and stay positive; ours must do both."""
    found = verdict(9, paper_rows(EI, lambda w, c, s, v: v - 0.5 * (w == 1280 and c == 200)))
    assert found.status is Status.DOES_NOT_HOLD
    assert "smallest fall +0.45 [" in found.ours


def test_an_interval_on_both_sides_of_the_bound_is_undecided() -> None:
    """The night's best width leads by less than the spread of the samples."""
    rows = [
        Row(*(r.scene, r.task, r.method, *_tail(r)[:6]), r.value + 0.3 * (-1) ** r.sample, 1.0)
        if r.width == 640
        else r
        for r in paper_rows(scenes=("carpet",), samples=12)
    ]
    found = verdict(6, rows)
    assert found.status is Status.UNDECIDED
    assert "not settled by these samples" in found.ours


def test_the_least_certain_scene_decides() -> None:
    """A claim fails with any scene, and holds only with all of them."""
    fails, unknown, open_, holds = (
        Status.DOES_NOT_HOLD,
        Status.NOT_MEASURED,
        Status.UNDECIDED,
        Status.HOLDS,
    )
    assert status_of([holds, open_, unknown, fails]) is fails
    assert status_of([holds, open_, unknown]) is unknown
    assert status_of([holds, open_]) is open_
    assert status_of([holds, holds]) is holds
    assert status_of([]) is unknown


def test_an_estimate_prints_its_interval_only_if_it_has_one() -> None:
    """The text has value, interval and unit, or value and unit."""
    assert Interval(1.0, 0.5, 1.5).text(unit="dB") == "+1.00 [+0.50, +1.50] dB"
    assert Interval(1.0, 0.5, 1.5, 7.78).text(unit="dB") == "+1.00 [+0.50, +1.50; n 7.8] dB"
    assert Interval(1.0, None, None).text(unit="dB") == "+1.00 dB"


def test_correlated_samples_are_worth_fewer() -> None:
    """Theory: N (1 - r) / (1 + r) for an autoregression of order 1 with r; N for white noise, and
    for neighbors on opposite sides; 1 for equal values, also in their last bits."""
    noise = np.random.default_rng(0).normal(size=20_000)
    path = noise.copy()
    for k in range(1, len(path)):
        path[k] += 0.8 * path[k - 1]
    assert effective_samples(path) == pytest.approx(20_000 / 9, rel=0.05)
    assert effective_samples(noise) == pytest.approx(20_000, rel=0.03)
    assert effective_samples(np.tile([1.0, -1.0], 10)) == 20
    assert effective_samples(np.array([1.0] * 7 + [1.0 + 1e-15])) == 1
    assert effective_samples(np.arange(30.0)) == pytest.approx(1.6, abs=0.1)


def test_the_worth_of_samples_is_that_of_their_differences() -> None:
    """A drift that both widths share leaves their difference; a sample counts once, whatever its
    number of items, and scenes add up."""
    gain = np.random.default_rng(1).normal(size=20)
    drift = 5.0 * np.arange(20)
    of_scene = {
        name: cell_of(np.repeat(values, 3), np.repeat(np.arange(20), 3))
        for name, values in {"fine": drift + gain, "coarse": drift}.items()
    }
    alone = estimate(lambda m: m["fine"], of_scene).effective_samples
    assert alone == of_scene["fine"].effective_samples == effective_samples(drift + gain) < 3
    lead = estimate(lambda m: m.difference("fine", "coarse"), of_scene)
    assert lead.effective_samples == pytest.approx(effective_samples(gain))
    both = estimate(lambda m: m.difference("fine", "coarse"), of_scene, of_scene)
    assert both.effective_samples == pytest.approx(2 * effective_samples(gain))


def cell_of(values: np.ndarray, sample: np.ndarray) -> Cell:
    nothing = np.zeros(len(values))
    training = np.zeros(len(values), np.int64)
    return Cell("carpet", values, nothing, nothing > 0, sample, training, len(values))


def test_a_bound_that_rounds_to_zero_is_on_the_side_that_decides() -> None:
    """Promise: a verdict never contradicts the interval that is printed: a negative bound has a
    minus sign, also as −0.00; zero has none, nor has a rounding error."""
    below = Interval(-0.003, -0.06, -0.0005)
    assert settled(below, above=True, bound=0) is Status.DOES_NOT_HOLD
    assert below.text(unit="px") == "−0.00 [−0.06, −0.00] px"
    around = Interval(-0.003, -0.0005, 0.0005)
    assert settled(around, above=True, bound=0) is Status.UNDECIDED
    assert around.text() == "+0.00 [−0.00, +0.00]"
    assert around.text(sign="") == "0.00 [−0.00, 0.00]"
    assert Interval(-0.0, -7e-15, 0.0).text() == "+0.00 [+0.00, +0.00]"


# ---- your own claim ---------------------------------------------------------------------------


def rows_of_day(values: Mapping[int, np.ndarray]) -> list[Row]:
    """Return rows on the carpet at base speed with these values by width."""
    samples = len(values[WIDTHS[0]])
    return [
        replace(r, value=float(values[r.width][r.sample]))
        for r in paper_rows(EI, scenes=("carpet",), samples=samples)
        if (r.cutoff_hz, r.speed) == (DAY, 1.0)
    ]


def own_claim() -> SceneClaim:
    return SceneClaim(
        number=101,
        title="The coarsest sensor is worst by day",
        statement="At 200 Hz, 240 px reconstructs better than 128 px.",
        series=EI,
        numbers={"margin": Number(margin(240, 128, DAY), above=0)},
        text="240 over 128 px {margin}",
    )


COARSEST_IS_WORST = own_claim()


def test_a_claim_of_your_own_is_a_few_lines_of_data() -> None:
    """Promise: in fewer than 20 lines, the verdict has its numbers, intervals, the paper's column
    and the scope."""
    assert len(inspect.getsource(own_claim).splitlines()) < 20
    *others, own = judge_all(paper_rows(samples=7), {}, [*CLAIMS, COARSEST_IS_WORST])
    assert len(others) == len(CLAIMS)
    assert own.number == 101
    assert own.status is Status.HOLDS
    assert own.ours.splitlines()[0] == "carpet: 240 over 128 px +1.61 [+1.61, +1.61; n 1] dB"
    assert own.paper.splitlines() == [
        "carpet: 240 over 128 px +1.61 dB",
        "rocks: 240 over 128 px +1.47 dB",
        "room: 240 over 128 px +2.25 dB",
    ]
    assert own.note == ""
    (alone,) = judge_all(
        paper_rows(EI, lambda w, c, s, v: v - 3 * (w == 240)), {}, [COARSEST_IS_WORST]
    )
    assert alone.status is Status.DOES_NOT_HOLD
    rows = paper_rows(EI, lambda w, c, s, v: 15.0, samples=7)
    (tied,) = judge_all(rows, {}, [COARSEST_IS_WORST])
    assert tied.status is Status.UNDECIDED
    assert tied.ours.splitlines()[0].endswith("+0.00 [+0.00, +0.00; n 1] dB, tied in these samples")


def test_what_the_paper_does_not_have_is_not_reported() -> None:
    """Claims about your own width, event rates or your own method have no number of the paper."""
    number = {"margin": Number(margin(512, 128, DAY), above=0)}
    (found,) = judge_all(paper_rows(), {}, [replace(COARSEST_IS_WORST, numbers=number)])
    assert (found.status, found.paper) == (Status.NOT_MEASURED, "not reported")
    rate = {"margin": Number(event_rate(640, DAY) - event_rate(128, DAY), above=0, unit="1/s")}
    (found,) = judge_all(paper_rows(), {}, [replace(COARSEST_IS_WORST, numbers=rate)])
    assert (found.status, found.paper) == (Status.HOLDS, "not reported")
    (found,) = judge_all(
        paper_rows(), {}, [replace(COARSEST_IS_WORST, series=EI._replace(method="own:method"))]
    )
    assert (found.status, found.paper) == (Status.NOT_MEASURED, "not reported")
