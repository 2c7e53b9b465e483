"""Promise: scenes of other seeds are further samples of their scene, in clusters; claims of many
numbers fail by Holm's correction."""

from dataclasses import replace

import numpy as np
import pytest

from study_rows import EI, paper_rows, verdict
from tasks.study.claims.claim import SceneClaim
from tasks.study.claims.judge import judge_all
from tasks.study.claims.numbers import Number
from tasks.study.claims.statistics import DAY, margin
from tasks.study.claims.verdict import Status, Verdict, holm
from tasks.study.config import preset
from tasks.study.results.asked import Condition
from tasks.study.results.cells import Cell, effective_samples
from tasks.study.results.intervals import Interval, estimate
from tasks.study.results.scores import Scores

FINE = Condition("carpet", 1280, 200.0, 1.0)


def interval(values: np.ndarray, paths: tuple[int, ...] = (), scene: str = "carpet") -> Interval:
    index, nothing = np.arange(values.size), np.zeros(values.size)
    of_run = index, np.zeros_like(index), values.size, paths
    cell = Cell(scene, values, nothing, nothing > 0, *of_run)
    return estimate(lambda medians: medians["a"], {"a": cell})


def test_rows_of_other_seeds_are_further_samples() -> None:
    """Two seeds of 9 samples are one scene of 18 on two paths; a seed that lacks a row leaves the
    cell incomplete."""
    rows = paper_rows(scenes=["carpet"])
    rows += [replace(row, scene="carpet@3") for row in rows]
    scores = Scores(rows)
    cell = scores.cell(EI, FINE)
    assert scores.scenes() == ["carpet"]
    assert (cell.samples, cell.paths, cell.complete) == (18, (9, 9), True)
    assert (scores.samples(EI, "carpet"), scores.seeds(EI, "carpet")) == (18, 2)
    lost = [row for row in rows if (row.scene, row.sample, row.width) != ("carpet@3", 4, 1280)]
    assert not Scores(lost).cell(EI, FINE).complete
    assert "2 seeds of each scene" in verdict(4, rows).note


def test_equal_samples_of_a_seed_count_once() -> None:
    """Expected: where the samples of each seed are equal, the interval is that of one sample a
    seed, to the bit; as if independent, they would make it much narrower."""
    of_seed = np.random.default_rng(1).normal(size=7)
    values = np.repeat(of_seed, 4)
    clustered, alone = interval(values, (4,) * 7), interval(of_seed)
    assert (clustered.low, clustered.high) == (alone.low, alone.high)
    assert clustered.spread == pytest.approx(of_seed.std(ddof=1))
    assert f", seeds ±{clustered.spread:.2f}]" in clustered.text()
    pooled = interval(values)
    assert pooled.spread is None
    assert pooled.high - pooled.low < 0.7 * (clustered.high - clustered.low)


def test_intervals_over_five_seeds_cover_the_median_of_all() -> None:
    """Promise: 95 % intervals hold the truth in about 95 % of cases, though seeds differ as much as
    samples do; with the samples as independent they hold it in two thirds."""
    rng = np.random.default_rng(2)
    covered = {(): 0, (10,) * 5: 0}
    for k in range(300):
        values = np.repeat(rng.normal(size=5), 10) + rng.normal(size=50)
        for paths in covered:
            covered[paths] += interval(values, paths, f"scene {k % 8}").includes(0.0)
    assert covered[(10,) * 5] / 300 > 0.92 > 0.75 > covered[()] / 300


def test_neighbors_are_those_of_one_path() -> None:
    """A jump between two paths is no correlation along them; two paths are worth twice one."""
    noise = np.random.default_rng(3).normal(size=200)
    values = np.concatenate([noise, noise + 100])
    assert effective_samples(values, (200, 200)) == pytest.approx(2 * effective_samples(noise))
    assert effective_samples(values) < 5


def test_holm_on_a_worked_example() -> None:
    """Expected: p of .005, .01, .03 and .04 at a level of .05 against .0125, .0167, .025 and .05:
    the third fails, and the fourth with it."""

    def rejected(*p: float) -> set[int]:
        return holm({k: lambda level, p=one: p <= level for k, one in enumerate(p)}, 0.05)

    assert rejected(0.03, 0.005, 0.04, 0.01) == {1, 3}
    assert rejected(0.02, 0.02) == {0, 1}
    assert rejected(0.03, 0.03) == rejected() == set()


def test_one_of_many_numbers_needs_stronger_evidence() -> None:
    """Promise: an interval that just excludes the bound contradicts a claim that rests on it alone,
    not one of three scenes; the text says so, and a clear contradiction still counts."""
    claim = SceneClaim(
        number=99,
        title="",
        statement="",
        series=EI,
        numbers={"margin": Number(margin(1280, 640, DAY), above=0)},
        text="{margin}",
    )
    noise = np.random.default_rng(7).normal(size=21)
    gain = {"rocks": 1.0 + 0.0 * noise, "room": 1.0 + 0.0 * noise}

    def judged(loss: float, *scenes: str) -> Verdict:
        at = gain | {"carpet": noise / 2 - loss}
        rows = [
            replace(row, value=20.0 + (row.width == 1280) * at[row.scene][row.sample])
            for row in paper_rows(scenes=scenes, samples=21)
            if (row.cutoff_hz, row.speed) == (DAY, 1.0)
        ]
        (found,) = judge_all(rows, {}, [claim])
        return found

    assert judged(0.06, "carpet").status is Status.DOES_NOT_HOLD
    one_of_three = judged(0.06, "carpet", "rocks", "room")
    assert (one_of_three.status, one_of_three.intervals) == (Status.UNDECIDED, 3)
    assert "not settled as one of 3" in one_of_three.ours
    assert judged(1.0, "carpet", "rocks", "room").status is Status.DOES_NOT_HOLD


def test_the_preset_has_five_seeds_of_each_scene() -> None:
    study = preset("paper-seeds")
    assert len(study.scenes) == 15
    assert study.scenes[:2] == ("carpet", "carpet@1")
    assert study.evaluate["tracking"].starts == 5
