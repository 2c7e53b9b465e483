"""Promise: claims about video, flow and tracking follow the rows."""

import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from study_rows import CM, EI, EPF, EPPT, FAST, HF, Change, nothing_rows, paper_rows, verdict
from tasks.row import Row
from tasks.study.claims.verdict import Status
from tasks.study.results.asked import Condition, Series
from tasks.study.results.cells import DRAWS, Cell
from tasks.study.results.intervals import estimate
from tasks.study.results.perturbation import ideal_success, judged_series, shown_series
from tasks.study.results.scores import Scores


def resampled(values, sample, training, scene):
    failed = np.zeros(len(values), bool)
    return Cell(scene, values, values, failed, sample, training, len(values)).resampled


SERIES = {10: HF, 12: EPF, 13: EPF, 14: EPF, 15: CM, 16: CM, 18: EPPT, 19: EPPT, 20: EPPT}
INF = math.inf


def rows_for(number: int, change: Change = lambda w, c, s, v: v, **options: object) -> list[Row]:
    """Return the rows that a claim needs, with the paper's medians."""
    if number == 21:
        return paper_rows(EPF, **options) + paper_rows(CM, change, **options)  # type: ignore[arg-type]
    return paper_rows(SERIES[number], change, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("number", [*SERIES, 21])
def test_the_papers_own_numbers_uphold_its_claims(number: int) -> None:
    """Rows with the paper's medians, three items a sample: each claim holds, with an interval."""
    found = verdict(number, rows_for(number, samples=7, items=3))
    assert found.status is Status.HOLDS
    assert "[" in found.ours
    assert "too few" not in found.note
    assert "Judged on" not in found.note


FAILURES: dict[int, Change] = {
    10: lambda w, c, s, v: v + 3 * (w == 346 and c == 50),
    12: lambda w, c, s, v: v / (3 if w == 1280 and c == INF else 1),
    13: lambda w, c, s, v: v / (5 if w == 1280 and c == 200 else 1),
    14: lambda w, c, s, v: v / (9 if w == 1280 and c == 50 else 1),
    15: lambda w, c, s, v: v / (9 if w == 640 and c == 200 and s == 2 else 1),
    16: lambda w, c, s, v: v / (2 if w == 1280 and s == FAST else 1),
    18: lambda w, c, s, v: v / (9 if w == 640 and c == INF else 1),
    19: lambda w, c, s, v: v / (9 if w == 640 and c == 50 else 1),
    20: lambda w, c, s, v: v / (99 if w == 1280 and s == 2 else 1),
    21: lambda w, c, s, v: v * (9 if w == 240 and c == 50 else 1),
}


@pytest.mark.parametrize("number", FAILURES)
def test_a_claim_fails_when_the_rows_contradict_it(number: int) -> None:
    """Rows break the condition of one claim, and its verdict says so."""
    found = verdict(number, rows_for(number, FAILURES[number]))
    assert found.status is Status.DOES_NOT_HOLD
    assert "(does not hold)" in found.ours


def test_tracking_that_never_suffers_at_night_fails_claim_19() -> None:
    """346 px is still best on rocks at night, but 1280 px is better there than in ideal light."""
    found = verdict(19, rows_for(19, lambda w, c, s, v: 18 + 2 * (c == INF) if w == 1280 else v))
    assert found.status is Status.DOES_NOT_HOLD
    assert "growth 0.9 " in found.ours


def test_room_where_coarse_wins_fails_claim_14() -> None:
    """The claim has both signs: at night coarse wins on planes and loses in the room."""
    rows = rows_for(14, lambda w, c, s, v: v / (99 if w == 128 else 1))
    found = verdict(14, rows)
    assert found.status is Status.DOES_NOT_HOLD
    assert [line.endswith("(does not hold)") for line in found.ours.splitlines()] == [
        *(False, False, True)
    ]


NEEDED: dict[int, tuple[str, int, float, float]] = {
    10: ("carpet", 240, 50.0, 1.0),
    12: ("room", 128, INF, 1.0),
    13: ("carpet", 1280, 200.0, 1.0),
    14: ("rocks", 346, 50.0, 1.0),
    15: ("carpet", 640, 50.0, 4 / 3),
    16: ("carpet", 1280, 50.0, FAST),
    18: ("carpet", 240, INF, 1.0),
    19: ("rocks", 1280, INF, 1.0),
    20: ("carpet", 640, 50.0, 2.0),
    21: ("carpet", 346, 50.0, 1.0),
}


@pytest.mark.parametrize("number", NEEDED)
@pytest.mark.parametrize("lost", ["cell", "item"])
def test_not_measured_is_never_holds(number: int, lost: str) -> None:
    """A needed cell or one item of a sample is missing: not measured, and the text names it."""
    method = CM.method if number == 21 else SERIES[number].method
    rows = [
        r
        for r in rows_for(number, samples=7, items=3)
        if (r.scene, r.width, r.cutoff_hz, r.speed) != NEEDED[number]
        or r.method != method
        or (lost == "item" and (r.sample, r.item) != (4, 1))
    ]
    found = verdict(number, rows)
    assert found.status is Status.NOT_MEASURED
    assert f"missing {NEEDED[number][1]} px" in found.ours
    assert ("has 20 of 21 values" in found.ours) == (lost == "item")


@pytest.mark.parametrize("number", [*SERIES, 21])
def test_rows_of_another_task_measure_nothing(number: int) -> None:
    """With rows of event integration only, the claims about other methods are not measured."""
    found = verdict(number, paper_rows(EI, samples=1))
    assert found.status is Status.NOT_MEASURED
    assert found.ours.startswith("no rows of ")


@pytest.mark.parametrize("number", [10, 13, 15, 16, 19, 20, 21])
def test_a_claim_about_one_scene_is_judged_there_only(number: int) -> None:
    """The paper's numbers on another scene neither uphold nor break it."""
    here = [NEEDED[number][0]]
    elsewhere = [replace(r, scene="garden") for r in rows_for(number, scenes=here)]
    assert verdict(number, elsewhere).status is Status.NOT_MEASURED
    contrary = rows_for(number, FAILURES[number], scenes=here)
    broken = [replace(r, scene="garden") for r in contrary]
    assert verdict(number, rows_for(number) + broken).status is Status.HOLDS


@pytest.mark.parametrize("number", [*SERIES, 21])
def test_few_samples_say_so_instead_of_an_interval(number: int) -> None:
    """Three samples of five items are three samples: no interval, and nothing is decided."""
    found = verdict(number, rows_for(number, samples=3, items=5))
    assert found.status is Status.UNDECIDED
    assert "[" not in found.ours
    assert "3 samples, too few for an interval (6 needed)" in found.note


def test_the_papers_contradictions_are_told() -> None:
    """Each note names the chosen reading of the paper."""
    notes = {number: verdict(number, rows_for(number)).note for number in (12, 14, 16, 20)}
    assert "9 of 9" in notes[12]
    assert "6 of 8" in notes[14]
    assert "0.2 px" in notes[16]
    assert "0.12 px" in notes[16]
    assert "1.2, 1.6 and 2.4 m/s" in notes[20]
    assert "193.6" in notes[20]


@pytest.mark.parametrize("number", [13, 19])
def test_a_delay_is_reported_and_does_not_decide(number: int) -> None:
    """With an unknown delay the light does not matter: the text has the numbers, the verdict
    stays."""
    method = f"{SERIES[number].method}_with_delay"
    delayed = paper_rows(SERIES[number], lambda w, c, s, v: w / 1280, method=method)
    found = verdict(number, rows_for(number) + delayed)
    assert found.status is Status.HOLDS
    assert re.search(r"with delay(, sigma 5 mm)?: 1\.00 ", found.ours)


def test_what_beats_the_initial_flow_is_told() -> None:
    """Claim 14 compares the best score at night with the initial flow."""
    rows = rows_for(14)
    better = verdict(14, rows + nothing_rows(rows, 20.0)).ours
    worse = verdict(14, rows + nothing_rows(rows, 0.1)).ours
    assert better.count(", better than the initial flow's 20.00 px") == 3
    assert worse.count("no better than the initial flow's 0.10 px") == 3


# ---- the perturbation at which tracking is judged ----------------------------------------------


def swept(failures: dict[str, Callable[[Row], bool]]) -> list[Row]:
    """Return tracking rows for each perturbation, with the failures of its predicate."""
    return [
        replace(r, failure="no convergence" if fails(r) else "")
        for variant, fails in failures.items()
        for r in paper_rows(EPPT._replace(variant=variant), samples=5)
    ]


def test_tracking_is_judged_at_the_largest_perturbation_that_converges() -> None:
    """3 of 5 widths are enough, in ideal light at base speed only; 2 are not; 10 is after 5."""
    rows = swept(
        {
            "sigma 20 mm": lambda r: r.width < 500,
            "sigma 5 mm": lambda r: False,
            "sigma 10 mm": lambda r: r.width < 300 or r.cutoff_hz < INF or r.speed > 1,
        }
    )
    scores = Scores(rows)
    assert judged_series(scores) == EPPT._replace(variant="sigma 10 mm")
    assert [one.variant for one in shown_series(scores)] == ["sigma 10 mm"]
    note = verdict(18, rows).note
    assert "sigma 10 mm" in note
    assert "at the median width (100\u202f%)" in note


def test_trials_without_a_number_are_missing() -> None:
    """Promise: widths with such trials do not decide; where all are so, nothing is measured."""
    rows = swept({"sigma 5 mm": lambda r: False})
    some = [replace(r, value=math.nan) if r.width < 500 and r.sample == 0 else r for r in rows]
    assert ideal_success(Scores(some), EPPT._replace(variant="sigma 5 mm")) == 1.0
    none = [replace(row, value=math.nan) for row in rows]
    assert ideal_success(Scores(none), EPPT._replace(variant="sigma 5 mm")) is None
    assert verdict(18, none).status is Status.NOT_MEASURED


def test_no_perturbation_that_converges_measures_nothing() -> None:
    """If tracking rarely converges, no claim about it is judged, and the rates are printed."""
    rows = swept({"sigma 2 mm": lambda r: r.sample < 2, "sigma 5 mm": lambda r: True})
    for number in (18, 19, 20):
        found = verdict(number, rows)
        assert found.status is Status.NOT_MEASURED
        assert "sigma 2 mm 60\u202f%, sigma 5 mm 0\u202f%" in found.ours
    assert [one.variant for one in shown_series(Scores(rows))] == ["sigma 2 mm"]
    found = verdict(18, [row for row in rows if row.cutoff_hz < INF])
    assert found.status is Status.NOT_MEASURED
    assert found.ours == "no trials of photometric tracking in ideal light at base speed"


# ---- every method beats doing nothing ----------------------------------------------------------


def test_claim_24_is_a_table_by_method_and_light() -> None:
    """Promise: each series is counted in each light, ideal light once, at base speed; one cell that
    loses is counted in its own light alone, and nothing is decided for all."""
    psnr, errors = paper_rows(EI), paper_rows(EPF)
    rows = psnr + nothing_rows(psnr, 5.0) + errors + nothing_rows(errors, 20.0)
    found = verdict(24, rows)
    assert found.status is Status.NO_VERDICT
    assert found.ours.splitlines() == [
        "reconstruction by event integration: ideal 15 of 15; day 45 of 45; night 45 of 45",
        "optical flow by photometric flow: ideal 15 of 15; day 50 of 50; night 50 of 50",
    ]
    rows = paper_rows(EI, lambda w, c, s, v: 5.0 if (w, c, s) == (240, 50, 2) else 20.0)
    found = verdict(24, rows + nothing_rows(rows, 10.0))
    assert "day 45 of 45; night 42 of 45, 3 worse" in found.ours


def test_what_gets_the_truth_or_no_events_does_not_count_for_claim_24() -> None:
    """A late true image and dense flow's second baseline lose here, but neither is a method."""
    psnr, errors = paper_rows(EI), paper_rows(EPF)
    rows = psnr + nothing_rows(psnr, 5.0)
    rows += [replace(row, task="video", method="late_truth") for row in psnr]
    rows += [replace(row, task="video", method="blank", value=50.0) for row in psnr]
    rows += [replace(row, task="dense_flow", method="initial_flow") for row in errors]
    rows += [replace(row, task="dense_flow", method="zero_flow", value=0.0) for row in errors]
    found = verdict(24, rows)
    assert [line.split(":")[0] for line in found.ours.splitlines()] == [EI.title]


def test_a_lead_over_nothing_that_the_samples_do_not_settle_is_undecided() -> None:
    """The baseline lies within the spread of the samples, but the median is better."""
    rows = paper_rows(EI, lambda w, c, s, v: 20.0, scenes=["carpet"])
    found = verdict(24, rows + nothing_rows(rows, 19.9))
    assert "ideal 0 of 5, 5 undecided; day 0 of 15, 15 undecided" in found.ours


def test_cells_without_the_rows_of_doing_nothing_are_not_measured_for_claim_24() -> None:
    """One cell has no baseline, or one that lacks a sample."""
    rows = paper_rows(EI, scenes=["carpet"])
    nothing = nothing_rows([r for r in rows if r.cutoff_hz > 50 or r.sample], 5.0)
    assert "day 15 of 15; night 0 of 15, 15 not measured" in verdict(24, rows + nothing).ours


# ---- the bootstrap over samples with several items ---------------------------------------------


def test_the_bootstrap_draws_samples_with_all_their_items() -> None:
    """The same draws as an explicit concatenation of whole samples, of uneven sizes."""
    rng = np.random.default_rng(3)
    sample = np.repeat(np.arange(7), [1, 4, 2, 3, 5, 2, 2])
    values = rng.normal(size=sample.size) + 3 * rng.normal(size=7)[sample]
    medians = resampled(values, sample, np.zeros_like(sample), "carpet")
    assert medians.shape == (DRAWS,)

    from zlib import crc32

    drawn = np.random.default_rng([crc32(b"carpet"), 7]).integers(7, size=(DRAWS, 7))
    for k in range(0, DRAWS, 97):
        pooled = np.concatenate([values[sample == i] for i in drawn[k]])
        assert medians[k] == pytest.approx(np.median(pooled))


def holds_zero(values: np.ndarray, sample: np.ndarray, training: np.ndarray, k: int) -> bool:
    """Return whether the interval of the median of values, in draw k, holds 0."""
    cell = Cell(f"scene {k % 8}", values, values, values > 9, sample, training, values.size)
    found = estimate(lambda medians: medians["a"], {"a": cell})
    assert found.low is not None
    assert found.high is not None
    return found.low < 0 < found.high


@pytest.mark.parametrize("trainings", [2, 3, 5])
def test_intervals_over_few_trainings_cover_the_mean_of_all(trainings: int) -> None:
    """Promise: 95 % intervals hold the true value in about 95 % of cases, though 2 or 3 trainings
    say little about how much trainings differ: draws alone hold it in a half or three quarters."""
    rng = np.random.default_rng(trainings)
    sample, training = (index.ravel() for index in np.indices((14, trainings)))
    covered = 0
    for k in range(300):
        values = rng.normal(size=trainings)[training] + 0.1 * rng.normal(size=sample.size)
        covered += holds_zero(values, sample, training, k)
    assert covered / 300 > 0.9


@pytest.mark.parametrize(("samples", "items"), [(6, 1), (6, 20), (7, 20), (10, 20), (20, 20)])
def test_intervals_over_few_samples_cover_the_median_of_all(samples: int, items: int) -> None:
    """Promise: 95 % intervals hold the true median in about 95 % of cases, also where features of
    one sample share its error; draws alone hold it in 85 to 94 %."""
    rng = np.random.default_rng(samples + items)
    sample = np.repeat(np.arange(samples), items)
    covered = 0
    for k in range(300):
        values = rng.normal(size=samples)[sample] + (items > 1) * rng.normal(size=sample.size)
        covered += holds_zero(values, sample, np.zeros_like(sample), k)
    assert covered / 300 > 0.915


def test_the_bootstrap_draws_trainings_with_all_their_values() -> None:
    """The same draws as an explicit concatenation of whole samples of whole trainings."""
    from zlib import crc32

    rng = np.random.default_rng(4)
    sample, training = (index.ravel() for index in np.indices((6, 3)))
    values = rng.normal(size=sample.size) + 2 * rng.normal(size=3)[training]
    medians = resampled(values, sample, training, "rocks")
    samples = np.random.default_rng([crc32(b"rocks"), 6]).integers(6, size=(DRAWS, 6))
    trainings = np.random.default_rng([crc32(b"trainings"), 3]).integers(3, size=(DRAWS, 3))
    for k in range(0, DRAWS, 97):
        pooled = [values[(sample == i) & (training == j)] for i in samples[k] for j in trainings[k]]
        assert medians[k] == pytest.approx(np.median(np.concatenate(pooled)))


def test_items_of_one_sample_do_not_pass_for_independent() -> None:
    """Items that repeat their sample's value leave the interval as wide as without them."""
    intervals = []
    for items in (1, 5):
        rows = paper_rows(EPF, samples=9, items=1, scenes=["carpet"])
        repeated = [replace(r, item=k) for r in rows for k in range(items)]
        where = Condition("carpet", 640, INF, 1.0)
        cell = Scores(repeated).cell(EPF, where)
        assert (cell.samples, len(cell.values)) == (9, 9 * items)
        intervals.append(estimate(lambda m, at=where: m[at], {where: cell}))
    assert intervals[0] == intervals[1]


def test_a_series_of_another_variant_has_its_own_samples() -> None:
    """Fewer samples of a variant do not make the usual one incomplete."""
    native = paper_rows(EPF._replace(variant="61 px patch"), samples=3)
    scores = Scores(paper_rows(EPF, samples=7) + native)
    assert scores.samples(EPF, "carpet") == 7
    assert scores.samples(Series(*EPF[:3], "61 px patch"), "carpet") == 3
