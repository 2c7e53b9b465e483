"""Tables print medians over the same samples everywhere, and never hide missing values."""

import csv
import io
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from drawn import comparison_html
from finished_runs import make_run
from study_rows import EI, EPF, EPPT, nothing_rows, paper_rows
from tasks.cli.study import to_rich
from tasks.errors import ResultError
from tasks.row import Row, write_rows
from tasks.study.results.asked import Condition, Series
from tasks.study.results.comparison import comparison_table, main_tables, to_csv
from tasks.study.results.run_files import scores_of_run
from tasks.study.results.scores import Scores, base_speed
from tasks.study.results.words import PACKAGED, BaseSpeeds, rate_label


def row(width: int, sample: int, value: float, **changes: object) -> Row:
    base = Row(
        "carpet", *EI[:2], width, math.inf, 0.2, 1.0, sample, "psnr_db", value, 1e6 * (1 + sample)
    )
    return replace(base, **changes)  # type: ignore[arg-type]


def grid() -> list[Row]:
    """Two widths, three samples, medians 16 and 25 dB, do-nothing 12 dB."""
    values = {128: (15.0, 16.0, 30.0), 1280: (24.0, 25.0, 26.0)}
    rows = [row(w, i, v) for w, samples in values.items() for i, v in enumerate(samples)]
    return rows + [replace(r, method="no_events", value=12.0, event_rate_hz=0.0) for r in rows]


def terminal_text(rows: list[Row], base: BaseSpeeds = PACKAGED) -> str:
    console = Console(width=100, file=io.StringIO(), color_system=None)
    console.print(to_rich(comparison_table(Scores(rows), EI), base))
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_speeds_are_those_of_the_run() -> None:
    """Promise: with another path through a scene, the terminal shows its speed."""
    assert "carpet, 0.9 m/s" in terminal_text(grid())
    assert "carpet, 0.3 m/s" in terminal_text(grid(), {"carpet": 0.3})


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
    assert [line.sensor for line in block.lines] == [(128, ""), (1280, ""), None]


def test_the_best_of_a_column_is_marked_and_the_baseline_is_not() -> None:
    """1280 px wins; the do-nothing line is never best."""
    lines = comparison_table(Scores(grid()), EI).blocks[0].lines
    assert ["bold" in line.entries[0].marks.get("ours", "") for line in lines] == [
        False,
        True,
        False,
    ]
    assert lines[-1].entries[0].cell.median == 12.0


def test_the_smallest_sensor_that_is_as_good_is_underlined() -> None:
    """346 px is 0.09 dB below the best, 240 px 0.11; the paper's medians choose too. Where
    doing nothing is as good, none is."""
    values = {240: 19.89, 346: 19.91, 1280: 20.0}
    rows = [row(width, 0, value) for width, value in values.items()]
    table = comparison_table(Scores(rows), EI)
    entries = [line.entries[0] for line in table.blocks[0].lines[:3]]
    assert ["underline" in one.marks["ours"] for one in entries] == [False, True, False]
    assert ["underline" in one.marks["paper"] for one in entries] == [False, False, True]
    assert re.findall(r"<u>([^<]*)</u>", comparison_html(table)) == ["19.91", "24.09"]
    assert "underlined: the smallest within 0.1 dB of it" in table.footnote(table.columns)
    idle = [replace(r, method="no_events", value=19.95, event_rate_hz=0.0) for r in rows]
    lines = comparison_table(Scores(rows + idle), EI).blocks[0].lines
    assert not any(
        "underline" in entry.marks.get("ours", "") for line in lines for entry in line.entries
    )


@pytest.mark.parametrize("broken", ["absent", "nan"])
def test_a_cell_without_all_samples_has_no_median(broken: str) -> None:
    """An absent or non-finite sample leaves a marked gap and no winner."""
    rows = grid()
    lost = next(r for r in rows if r.width == 1280 and r.sample == 1 and r.method == EI.method)
    rows.remove(lost)
    if broken == "nan":
        rows.append(replace(lost, value=math.nan))
    table = comparison_table(Scores(rows), EI)
    entry = table.blocks[0].lines[1].entries[0]
    assert entry.cell.median is None
    assert entry.difference is None
    assert not any(
        "bold" in line.entries[0].marks.get("ours", "") for line in table.blocks[0].lines
    )
    assert "– (2 of 3)" in terminal_text(rows)
    assert "– (2 of 3)" in comparison_html(table)


def test_a_condition_that_was_not_run_prints_as_missing() -> None:
    """The night has only 128 px: 1280 px has a dash there, not a number."""
    night = [row(128, i, 14.0, cutoff_hz=50.0) for i in range(3)]
    table = comparison_table(Scores(grid() + night), EI)
    assert table.cutoffs_hz == (math.inf, 50.0)
    assert table.blocks[0].lines[1].entries[1].cell.median is None
    records = list(csv.DictReader(io.StringIO(to_csv([table]))))
    night_1280 = next(r for r in records if (r["width"], r["cutoff_hz"]) == ("1280", "50.0"))
    assert (night_1280["values"], night_1280["median"], night_1280["best"]) == ("0", "", "0")


def test_speeds_select_the_layout() -> None:
    """Base speed only as in the paper's Table 2, or a block for each speed as in its appendix."""
    scores = Scores(grid() + [replace(r, speed=4 / 3) for r in grid()])
    assert [b.speed for b in comparison_table(scores, EI, [1.0]).blocks] == [1.0]
    assert [b.speed for b in comparison_table(scores, EI).blocks] == [1.0, 4 / 3]
    assert "<small>1.2 m/s</small>" in comparison_html(comparison_table(scores, EI))


def test_a_scene_outside_the_paper_has_no_paper_numbers() -> None:
    """Your own scene gets the same table, without the paper and, as here, with no speed in m/s."""
    table = comparison_table(Scores([replace(r, scene="<mine>") for r in grid()]), EI)
    assert table.blocks[0].lines[0].entries[0].paper is None
    page = comparison_html(table)
    assert "&lt;mine&gt; <small>speed 1</small>" in page
    assert "paper" not in page


@pytest.mark.parametrize(
    ("change", "shown"),
    [({}, True), ({"width": 160}, False), ({"cutoff_hz": 80.0}, False), ({"width": 240}, True)],
)
def test_the_paper_is_shown_only_next_to_its_own_sensors(change: dict, shown: bool) -> None:
    """Promise: columns and footnote of the paper are there only if every width and every light of
    the table is one of the paper's, even if it has numbers for some of them."""
    rows = grid() + [replace(r, **change) for r in grid() if change and r.width == 128]
    table = comparison_table(Scores(rows), EI)
    assert table.blocks[0].lines[0].entries[0].paper == (15.389 if shown else None)
    heads = [column.head for column in table.columns]
    assert heads == (["ours", "paper", "Δ", "M/s"] if shown else ["ours", "M/s"])
    assert ("paper" in terminal_text(rows)) is shown
    assert ('class="paper"' in comparison_html(table)) is shown
    assert table.footnote(table.columns).startswith(
        "paper: its Table 6" if shown else "bold: best of"
    )


def test_the_paper_is_shown_only_next_to_sensors_without_a_bus() -> None:
    """Promise: methods that get what a bus leaves are not those of the paper."""
    rows = [replace(row, bus_mev_s=1.0, dropped=0.99) for row in grid()]
    assert not Scores(rows).asks_as_paper
    assert [column.head for column in comparison_table(Scores(rows), EI).columns] == [
        "ours",
        "M/s",
    ]


def test_flow_at_a_factor_follows_speeds_in_m_per_s() -> None:
    """Promise: the base speed is the lowest in m/s, also with flow at a factor."""
    asked = [replace(row, speed_m_s=15.0) for row in grid()]
    asked += [replace(row, speed=2.0, speed_m_s=30.0) for row in grid()]
    scores = Scores([*asked, *(replace(row, speed=10.0) for row in grid())])
    assert [float(speed) for speed in scores.speeds(EI)] == [15.0, 30.0, 10.0]
    assert float(base_speed(scores, EI)) == 15.0


@pytest.mark.parametrize("height", [1280, 720, None])
def test_the_paper_is_shown_only_next_to_squares(height: int | None, tmp_path: Path) -> None:
    """Promise: a run whose frames are not square has the widths of the paper, not its sensors."""
    make_run(tmp_path, grid())
    said = {"render": {"resolution": 1280} | ({"height": height} if height else {})}
    (tmp_path / "study.json").write_text(json.dumps(said))
    ((scores,),) = scores_of_run(tmp_path).values()
    shown = [column.head for column in comparison_table(scores, EI).columns]
    assert ("paper" in shown) is (height != 720)


def test_every_rendering_has_the_same_numbers() -> None:
    """Terminal, HTML and CSV agree; brackets of the unit survive the terminal's markup."""
    table = comparison_table(Scores(grid()), EI)
    text = terminal_text(grid())
    assert "[dB]" in text
    for number in ("16.00", "15.39", "+0.61", "12.00"):
        assert number in text
        assert number in comparison_html(table)
    assert "16,15.389,0.611,2,0" in to_csv([table])


def test_contradictory_rows_are_refused() -> None:
    """The same item of the same sample twice is an error; another item or variant is not."""
    with pytest.raises(ResultError, match="found two rows of sample 0, item 0"):
        Scores([*grid(), row(128, 0, 1.0)])
    other = replace(row(128, 0, 1.0), variant="other")
    assert len(Scores([*grid(), row(128, 0, 1.0, item=1), other]).series()) == 2


def test_rows_that_make_no_scores_are_named_by_their_file(tmp_path: Path) -> None:
    """Promise: whatever is wrong with the rows of a run, the error starts with their file."""
    file = tmp_path / "rows.parquet"
    (tmp_path / "study.json").write_text("{}")
    for rows, said in (
        ([], "has no rows"),
        ([*grid(), row(128, 0, 1.0)], "found two rows of sample 0, item 0"),
        ([row(128, 0, 1.0, task="rate")], "unknown task 'rate'"),
    ):
        write_rows(file, rows)
        with pytest.raises(ResultError, match=rf"^{re.escape(str(file))}: {said}"):
            scores_of_run(tmp_path)


def test_doing_nothing_has_a_line_for_each_width_where_they_differ() -> None:
    """One line where all widths agree; one for each otherwise, none hidden."""
    rows = grid()
    rows[-1] = replace(rows[-1], value=13.0)
    rows[-2] = replace(rows[-2], value=13.0)
    lines = comparison_table(Scores(rows), EI).blocks[0].lines[2:]
    assert [(line.sensor.width, line.entries[0].cell.median) for line in lines] == [
        (128, 12.0),
        (1280, 13.0),
    ]
    assert "no events, 1280 px" in terminal_text(rows)


def test_a_score_that_does_not_beat_doing_nothing_is_struck_out() -> None:
    """128 px scores 16 dB, doing nothing 17 dB: struck out in HTML and 0 in the CSV; 1280 px is
    not."""
    rows = [replace(r, value=17.0) if r.method == "no_events" else r for r in grid()]
    table = comparison_table(Scores(rows), EI)
    assert "<s>16.00</s>" in comparison_html(table)
    assert "<s>25.00</s>" not in comparison_html(table)
    records = list(csv.DictReader(io.StringIO(to_csv([table]))))
    assert [r["beats_nothing"] for r in records] == ["0", "1", ""]


def flow_rows(variant: str = "") -> list[Row]:
    """One sample of three features at 640 px: 1, 2 and a failed one at 4 px."""
    flow = ("carpet", "flow", "photometric_flow", 640, math.inf, 0.2, 1.0, 0, "rnepe_px")
    rows = [Row(*flow, value, 1e6, variant, i) for i, value in enumerate((1.0, 2.0, 4.0))]
    rows[2] = replace(rows[2], failure="3 events")
    return rows + [replace(r, method="initial_flow", value=4.0, failure="") for r in rows]


def test_failed_items_count_and_are_shown() -> None:
    """The median is over all three features; native px are half at 640 px; a third failed."""
    series = Series("flow", "photometric_flow", "rnepe_px")
    table = comparison_table(Scores(flow_rows()), series)
    assert table.blocks[0].lines[0].entries[0].cell.median == 2.0
    page = comparison_html(table)
    for cell in (
        '"ideal"><strong><u>2.00</u></strong>',
        'class="rate" data-label="native px">1.00</td>',
        ">33%</td>",
    ):
        assert cell in page
    (record, nothing) = csv.DictReader(io.StringIO(to_csv([table])))
    assert (record["native_px"], record["failure_share"]) == ("1", "0.333333")
    assert (nothing["method"], nothing["median"], nothing["failure_share"]) == (
        *("initial_flow", "4"),
        "",
    )
    assert Scores(flow_rows()).failures(series) == {"n events": 1}


def test_a_line_of_the_csv_is_written_once() -> None:
    """Promise: doing nothing has one line however many methods are compared with it; a camera's
    own cutoff in lux is not that of plain sensors."""
    rows = [*flow_rows(), *(replace(r, method="contrast_maximization") for r in flow_rows()[:3])]
    scores = Scores(rows)
    tables = [comparison_table(scores, series) for series in scores.series()]
    written = list(csv.DictReader(io.StringIO(to_csv(tables))))
    assert sorted(line["method"] for line in written) == [
        *("contrast_maximization", "initial_flow", "photometric_flow")
    ]
    lit = {"illuminance_lux": 150.0, "cutoff_hz": 100.0, "sensor": "mine", "width": 346}
    (table,) = main_tables(Scores([replace(r, **lit) for r in flow_rows()]))
    line, *_ = csv.DictReader(io.StringIO(to_csv([table])))
    assert (line["sensor"], line["illuminance_lux"], line["cutoff_hz"]) == ("mine", "150.0", "")


def test_the_csv_says_what_the_samples_are_worth() -> None:
    """Theory: 9 values on a line have r = 40 / 60, so are worth 1.8; too few have no number."""
    for samples, worth in ((9, "1.8"), (5, "")):
        rows = paper_rows(EI, samples=samples, scenes=("carpet",))
        (table,) = main_tables(Scores([replace(r, value=20.0 + r.sample) for r in rows]))
        line, *_ = csv.DictReader(io.StringIO(to_csv([table])))
        assert line["effective_samples"] == worth


@pytest.mark.parametrize(
    ("rate_hz", "text"),
    [(0.0, "0.00"), (4.2, "0.0000042"), (12_300.0, "0.012"), (4.321e5, "0.43"), (1.2e9, "1200")],
)
def test_rates_have_digits_at_any_size(rate_hz: float, text: str) -> None:
    """Promise: the rate of a coarse sensor in little light is not printed as 0."""
    assert rate_label(rate_hz) == text


def test_variants_are_series_of_their_own() -> None:
    """A patch of another size has its own table, and the usual baseline if it has none."""
    rows = flow_rows() + [r for r in flow_rows("61 px patch") if r.method == "photometric_flow"]
    usual, native = Scores(rows).series()
    assert (usual.variant, native.variant) == ("", "61 px patch")
    line = comparison_table(Scores(rows), native).blocks[0].lines[-1]
    assert line.entries[0].cell.median == 4.0


def test_a_lost_item_leaves_a_gap() -> None:
    """Two of three features at 1280 px: no median there, though each sample has some."""
    finer = [replace(r, width=1280) for r in flow_rows()]
    rows = flow_rows() + [r for r in finer if r.item != 1]
    table = comparison_table(Scores(rows), Series("flow", "photometric_flow", "rnepe_px"))
    assert table.blocks[0].lines[1].entries[0].cell.median is None
    assert "– (2 of 3)" in comparison_html(table)


def test_tables_fit_a_terminal() -> None:
    """Three cutoffs with large errors and all successes: no text is cut at 80 columns."""
    for series, nothing in ((EI, 12.0), (EPF, 3.5), (EPPT, 8.0)):
        rows = paper_rows(series, samples=1, scenes=["carpet"], rate=lambda *_: 987e6)
        scores = Scores(rows + nothing_rows(rows, nothing))
        (table,) = main_tables(scores)
        console = Console(width=80, file=io.StringIO(), force_terminal=True, color_system=None)
        console.print(to_rich(table, PACKAGED), crop=False)
        shown = console.file.getvalue()  # type: ignore[attr-defined]
        assert max(map(len, shown.splitlines())) <= 80


def test_main_tables_leave_out_variants_and_our_changes() -> None:
    """The paper's methods and a user's own, at base speed, tracking at the judged perturbation."""
    methods = ("photometric_flow", "photometric_flow_with_delay", "mine.flow:estimate")
    rows = [row for m in methods for row in paper_rows(EPF, samples=1, method=m)]
    rows += paper_rows(EPF._replace(variant="61 px patch"), samples=1)
    for variant in ("sigma 2 mm", "sigma 5 mm", "sigma 10 mm"):
        failure = "no convergence" if variant == "sigma 10 mm" else ""
        of_variant = paper_rows(EPPT._replace(variant=variant), samples=1)
        rows += [replace(r, failure=failure) for r in of_variant]
    tables = main_tables(Scores(rows))
    assert [(t.series.method, t.series.variant) for t in tables] == [
        ("photometric_flow", ""),
        ("mine.flow:estimate", ""),
        ("photometric_tracking", "sigma 5 mm"),
    ]
    assert {block.speed for t in tables for block in t.blocks} == {1.0}


def test_unknown_names_and_empty_runs_are_refused() -> None:
    """The text names claims without a verdict."""
    with pytest.raises(ResultError, match="metric 'ssim'"):
        Scores([row(128, 0, 1.0, metric="ssim")])
    with pytest.raises(ResultError, match="task 'juggling'"):
        Scores([row(128, 0, 1.0, task="juggling")])
    with pytest.raises(ResultError, match="has no rows"):
        Scores([])
