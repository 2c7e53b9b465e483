"""Tables print medians over the same samples everywhere, and never hide what is missing."""

import csv
import io
import math
from dataclasses import replace

import pytest
from rich.console import Console

from tasks.errors import ResultError
from tasks.row import Row
from tasks.study.tables import (
    Condition,
    Scores,
    Series,
    comparison_table,
    to_csv,
    to_html,
    to_rich,
)

EI = Series("reconstruction", "event_integration", "psnr_db")


def row(width: int, sample: int, value: float, **changes: object) -> Row:
    base = Row(
        "carpet", *EI[:2], width, math.inf, 1.0, sample, "psnr_db", value, 1e6 * (1 + sample)
    )
    return replace(base, **changes)  # type: ignore[arg-type]


def grid() -> list[Row]:
    """Two widths, three samples, medians 16 and 25 dB, nothing 12 dB."""
    values = {128: (15.0, 16.0, 30.0), 1280: (24.0, 25.0, 26.0)}
    rows = [row(w, i, v) for w, samples in values.items() for i, v in enumerate(samples)]
    return rows + [replace(r, method="no_events", value=12.0, event_rate_hz=0.0) for r in rows]


def terminal_text(rows: list[Row]) -> str:
    console = Console(width=100, file=io.StringIO(), color_system=None)
    console.print(to_rich(comparison_table(Scores(rows), EI)))
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_a_cell_is_the_median_over_samples() -> None:
    """Scores and event rates are medians, not means."""
    cell = Scores(grid()).cell(EI, Condition("carpet", 128, math.inf, 1.0))
    assert cell.median == 16.0
    assert cell.event_rate_hz == 2e6


def test_ours_the_papers_and_the_difference_stand_side_by_side() -> None:
    """128 px ideal on carpet is 15.389 dB in the paper; ours is 16."""
    block = comparison_table(Scores(grid()), EI).blocks[0]
    entry = block.lines[0].entries[0]
    assert entry.paper == 15.389
    assert entry.difference == pytest.approx(16.0 - 15.389)
    assert [line.width for line in block.lines] == [128, 1280, None]


def test_the_best_of_a_column_is_marked_and_the_baseline_is_not() -> None:
    """1280 px wins; the do-nothing line is never best."""
    lines = comparison_table(Scores(grid()), EI).blocks[0].lines
    assert [line.entries[0].best for line in lines] == [False, True, False]
    assert lines[-1].entries[0].cell.median == 12.0


@pytest.mark.parametrize("broken", ["absent", "nan"])
def test_a_cell_without_all_samples_has_no_median(broken: str) -> None:
    """A sample that is absent, or not finite, leaves a marked gap and no winner."""
    rows = grid()
    lost = next(r for r in rows if r.width == 1280 and r.sample == 1 and r.method == EI.method)
    rows.remove(lost)
    if broken == "nan":
        rows.append(replace(lost, value=math.nan))
    table = comparison_table(Scores(rows), EI)
    entry = table.blocks[0].lines[1].entries[0]
    assert entry.cell.median is None
    assert entry.difference is None
    assert not any(line.entries[0].best for line in table.blocks[0].lines)
    assert "– (2 of 3)" in terminal_text(rows)
    assert "– (2 of 3)" in to_html(table)


def test_a_condition_that_was_not_run_prints_as_missing() -> None:
    """The night was run at 128 px only: 1280 px has a dash there, not a number."""
    night = [row(128, i, 14.0, cutoff_hz=50.0) for i in range(3)]
    table = comparison_table(Scores(grid() + night), EI)
    assert table.cutoffs_hz == (math.inf, 50.0)
    assert table.blocks[0].lines[1].entries[1].cell.median is None
    records = list(csv.DictReader(io.StringIO(to_csv([table]))))
    night_1280 = next(r for r in records if (r["width"], r["cutoff_hz"]) == ("1280", "50.0"))
    assert (night_1280["samples"], night_1280["median"], night_1280["best"]) == ("0", "", "0")


def test_speeds_select_the_layout() -> None:
    """Base speed only as in the paper's Table 2, or a block for each speed as in its appendix."""
    scores = Scores(grid() + [replace(r, speed=4 / 3) for r in grid()])
    assert [b.speed for b in comparison_table(scores, EI, [1.0]).blocks] == [1.0]
    assert [b.speed for b in comparison_table(scores, EI).blocks] == [1.0, 4 / 3]
    assert "speed 1.3 (1.2 m/s)" in to_html(comparison_table(scores, EI))


def test_a_scene_outside_the_paper_has_no_paper_numbers() -> None:
    """An own scene gets the same table, with dashes for the paper and no m/s."""
    table = comparison_table(Scores([replace(r, scene="<mine>") for r in grid()]), EI)
    assert table.blocks[0].lines[0].entries[0].paper is None
    assert "&lt;mine&gt; <small>speed 1</small>" in to_html(table)


def test_every_rendering_has_the_same_numbers() -> None:
    """Terminal, HTML and CSV agree; brackets of the unit survive the terminal's markup."""
    table = comparison_table(Scores(grid()), EI)
    text = terminal_text(grid())
    assert "[dB]" in text
    for number in ("16.00", "15.39", "+0.61", "12.00"):
        assert number in text
        assert number in to_html(table)
    assert "16,15.389,0.611,2,0" in to_csv([table])


def test_contradictory_rows_are_refused() -> None:
    """The same sample twice, or a do-nothing score that depends on the sensor, is an error."""
    with pytest.raises(ResultError, match="two rows of sample 0"):
        Scores([*grid(), row(128, 0, 1.0)])
    rows = grid()
    rows[-1] = replace(rows[-1], value=13.0)
    with pytest.raises(ResultError, match=r"no_events on carpet, sample 2.*expected the same"):
        comparison_table(Scores(rows), EI)


def test_unknown_names_and_empty_runs_are_refused() -> None:
    """What cannot be judged is named."""
    with pytest.raises(ResultError, match="unknown metric 'ssim'"):
        Scores([row(128, 0, 1.0, metric="ssim")])
    with pytest.raises(ResultError, match="unknown task 'juggling'"):
        Scores([row(128, 0, 1.0, task="juggling")])
    with pytest.raises(ResultError, match="no rows"):
        Scores([])
