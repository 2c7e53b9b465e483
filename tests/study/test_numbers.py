"""The numbers of a small study, compared row by row with tests/data/study_numbers.csv.

No change of results goes unnoticed: a row that is not as stored fails, and the message says by how
much. If the change is intended, say so in CHANGELOG.md under "Numbers change", raise the number of
the stage in `STAGE_VERSIONS`, and store the new numbers:

    PYTHONPATH=tests/helpers python tests/study/test_numbers.py --rewrite

The same machine gives the same bits again, with any number of threads. Machines differ in the last
bit of rendered frames, and in whether the kernels fuse multiplication and addition. Frames off by
2e-7 at random, and kernels compiled for a plain x86-64, moved an event rate by 2.4e-4 at most (one
event of 4,100), a PSNR by 0.0012 dB, a flow by 0.0015 px and a path by 0.009 mm. `HERE` allows
about five times that, less than the effect of a contrast threshold larger by 1 %.

The numbers are those of Mitsuba's `llvm_ad_mono`. Another variant draws other samples of each
pixel, and with 4 of them the frames differ substantially: in `scalar_rgb` event rates by 2 %,
a PSNR by 0.04 dB. Features are then found elsewhere and events are drawn at other pixels, so a flow
or a path has no counterpart. `ELSEWHERE` compares the rest, roughly.
"""

import csv
import io
import json
import math
import os
import sys
import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import pytest

from small_study import STUDY, score_digest, stored_bits
from tasks.evaluation.timings import read_timings
from tasks.row import Row
from tasks.study.run import run_study

FILE = Path(__file__).parents[1] / "data" / "study_numbers.csv"
COMMAND = "PYTHONPATH=tests/helpers python tests/study/test_numbers.py --rewrite"
VARIANT = "llvm_ad_mono"
KEY = (
    *("task", "method", "variant", "width", "cutoff_hz", "contrast_threshold"),
    *("speed", "sample", "item", "metric"),
)
BASELINES = ("no_events", "blank", "initial_flow", "initial_path")


@dataclass(frozen=True)
class Tolerances:
    """Tolerance of a row; None where there is nothing to compare."""

    event_rate: float  # relative
    psnr_db: float
    rnepe_px: float | None
    position_error_mm: float | None


HERE = Tolerances(event_rate=2e-3, psnr_db=0.005, rnepe_px=0.01, position_error_mm=0.05)
ELSEWHERE = Tolerances(event_rate=0.05, psnr_db=0.1, rnepe_px=None, position_error_mm=None)


def table(rows: list[Row]) -> str:
    """Return rows as CSV in order of their keys, one per line; numbers to 7 digits."""
    file = io.StringIO()
    names = (*KEY, "value", "event_rate_hz", "failure")
    writer = csv.DictWriter(file, names, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    lines = [
        {
            **asdict(row),
            **{name: f"{getattr(row, name):.7g}" for name in ("speed", "value", "event_rate_hz")},
        }
        for row in rows
    ]
    writer.writerows(sorted(lines, key=lambda line: tuple(line[name] for name in KEY)))
    return file.getvalue()


def stored(text: str) -> dict[tuple[str, ...], dict[str, str]]:
    """Return the lines of a table by their keys."""
    lines = csv.DictReader(io.StringIO(text))
    return {tuple(line[name] for name in KEY): line for line in lines}


def changes(old: str, new: str, allowed: Tolerances) -> list[str]:
    """Return the differences of two tables, one line per row."""
    before, after = stored(old), stored(new)
    found = [f"{', '.join(key)}: is new" for key in after.keys() - before.keys()]
    found += [f"{', '.join(key)}: is gone" for key in before.keys() - after.keys()]
    for key in before.keys() & after.keys():
        if told := _change(before[key], after[key], allowed):
            found.append(f"{', '.join(key)}: {told}")
    return sorted(found)


def _change(old: dict[str, str], new: dict[str, str], allowed: Tolerances) -> str:
    told = []
    (was, value), (was_hz, rate_hz) = (
        (float(old[name]), float(new[name])) for name in ("value", "event_rate_hz")
    )
    if abs(rate_hz - was_hz) > allowed.event_rate * was_hz:
        told.append(f"event rate {was_hz:g} -> {rate_hz:g} Hz ({rate_hz / was_hz - 1:+.2%})")
    tolerance = getattr(allowed, old["metric"])
    if tolerance is None:
        if old["method"] not in BASELINES:
            return ", ".join(told)
        tolerance = getattr(HERE, old["metric"])
    if not abs(value - was) <= tolerance:
        told.append(f"{was:g} -> {value:g} ({value - was:+.3g}, allowed {tolerance:g})")
    if bool(old["failure"]) != bool(new["failure"]):
        told.append(f"failure {old['failure']!r} -> {new['failure']!r}")
    return ", ".join(told)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("run")
    return out, run_study(STUDY, out)


def test_numbers_are_those_that_are_stored(run):
    """Promise: the same study gives the same scores, until the changelog says otherwise."""
    out, rows = run
    variant = json.loads((out / "environment.json").read_text())["Mitsuba variant"]
    allowed = HERE if variant == VARIANT else ELSEWHERE
    found = changes(FILE.read_text(), table(rows), allowed)
    assert not found, (
        f"{len(found)} of {len(rows)} rows are not as stored (variant {variant}). If intended, "
        f'say so in CHANGELOG.md, "Numbers change", and run: {COMMAND}\n' + "\n".join(found)
    )


def test_scores_are_the_same_to_the_bit(run):
    """Promise: on the machine that stored them, the same to the last bit; see test_guards.py."""
    assert score_digest(run[1]) == stored_bits("scores")


def test_a_change_is_told_by_row_and_size(run):
    """Promise: 1 % of a rate, 0.02 dB, a failure, a row more or less: each is reported, alone."""
    _, rows = run
    old = table(rows)
    assert changes(old, table(rows[::-1]), HERE) == []
    k = next(k for k, row in enumerate(rows) if row.method == "event_integration")
    row = rows[k]
    for other, told in (
        (replace(row, event_rate_hz=1.01 * row.event_rate_hz), "Hz (+1.00%)"),
        (replace(row, value=row.value + 0.02), "(+0.02, allowed 0.005)"),
        (replace(row, value=math.nan), "-> nan"),
        (replace(row, failure="no convergence"), "failure '' -> 'no convergence'"),
    ):
        (found,) = changes(old, table([*rows[:k], other, *rows[k + 1 :]]), HERE)
        assert found.startswith("reconstruction, event_integration, , 64, inf, 0.2, 1, 0, 0, psnr")
        assert told in found
    (gone,) = changes(old, table(rows[1:]), HERE)
    assert gone.endswith("is gone")
    (new,) = changes(table(rows[1:]), old, HERE)
    assert new.endswith("is new")


def test_what_parts_took_is_kept_beside_them(run):
    """Promise: the clip and the stretch have their costs, of every frame and every estimate."""
    out, rows = run
    costs = read_timings(out / "costs")
    assert len(costs) == 2
    assert sum(method.estimates for one in costs for method in one.methods) == len(rows)
    for one in costs:
        assert one.rendered_frames == one.frames
        # 3 widths, each by 2 cutoffs and 2 speeds
        assert one.pixel_frames == one.frames * 4 * (64**2 + 160**2 + 320**2)
        assert 0 <= one.reading_s < 100
        assert min(one.rendering_s, one.simulating_s, one.collecting_s, one.scoring_s) > 0
        for method in one.methods:
            assert 0 <= method.median_cpu_s <= method.cpu_s
    methods = {(m.method, m.width): m for one in costs for m in one.methods}
    for method in ("event_integration", "photometric_flow", "photometric_tracking"):
        assert methods[method, 320].events > 100 * methods[method, 320].estimates


def rewrite() -> None:
    """Run the study again and store its numbers."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ.update(ERES_CACHE=f"{folder}/cache", ERES_VARIANT=VARIANT)
        new = table(run_study(STUDY, Path(folder) / "run"))
    if FILE.exists():
        print("\n".join(changes(FILE.read_text(), new, HERE)) or "no number changed by much")
    FILE.parent.mkdir(exist_ok=True)
    FILE.write_text(new)


if __name__ == "__main__":
    if sys.argv[1:] != ["--rewrite"]:
        sys.exit(f"usage: {COMMAND}")
    rewrite()
