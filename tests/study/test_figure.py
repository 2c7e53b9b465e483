"""The static figure is complete, the same for the same scores, and legible."""

import math
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.legend import Legend

from made_scaling import made
from study_rows import CM, EI, nothing_rows, paper_rows
from tasks.row import Row
from tasks.study.report.figures import figure, figure_files
from tasks.study.report.finished_run import FinishedRun
from tasks.study.report.plot import COLORS, Line, Panel, Plot, Point, plot, sensor_keys
from tasks.study.report.sections.scaling import interval_plot, slope_plot
from tasks.study.report.sections.tradeoff import tradeoff_plots
from tasks.study.results.asked import SensorId, Series
from tasks.study.results.paper import WIDTHS
from tasks.study.results.scores import Scores


def plots(scores: Scores, series: Series) -> dict[str, Plot]:
    return tradeoff_plots(FinishedRun(Path(), [scores], {}, {}), series)


@pytest.mark.parametrize(("column", "page"), [(0, "#fafbfc"), (1, "#1a1e23")])
def test_labels_in_the_colors_of_series_can_be_read(column: int, page: str) -> None:
    """Promise: WCAG AA, a contrast of 4.5, for text in every color of a plot."""

    def luminance(color: str) -> float:
        codes = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)]) / 255
        linear = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    for name, colors in COLORS.items():
        light, dark = sorted((luminance(colors[column]), luminance(page)), reverse=True)
        assert (light + 0.05) / (dark + 0.05) >= 4.5, name


def scores(nothing_db: float) -> Scores:
    """Two widths at two speeds: in ideal light the finer one is better, at night worse."""
    rows = []
    for width in (128, 1280):
        for cutoff_hz in (math.inf, 50.0):
            for speed in (1.0, 2.0):
                at = (width, cutoff_hz, 0.2, speed, 0, "psnr_db")
                gain_db = math.log2(width / 128) / speed
                value = 12.0 + (gain_db if math.isinf(cutoff_hz) else -gain_db)
                rate = speed * width**3
                rows.append(Row("rocks", "reconstruction", "event_integration", *at, value, rate))
                rows.append(
                    Row("rocks", "reconstruction", "no_events", *at, nothing_db + 1e-3 * speed, 0.0)
                )
    return Scores(rows)


def test_the_files_are_whole_and_the_same_each_time() -> None:
    """A PNG that decodes, a complete SVG, and no date or random name in them."""
    drawn = {
        name: replace(one, panels=one.panels[:1]) for name, one in plots(scores(12.0), EI).items()
    }
    files = figure_files(drawn)
    assert set(files) == {"png", "svg"}
    assert cv2.imdecode(np.frombuffer(files["png"], np.uint8), cv2.IMREAD_COLOR) is not None
    assert files["svg"].rstrip().endswith(b"</svg>")
    assert figure_files(drawn) == files


def test_the_label_of_doing_nothing_is_clear_of_marks() -> None:
    """Below, amid and above the scores: no mark within 4 points of the label's box. Scores that
    differ by less than is shown are named once."""
    for nothing_db in (8.0, 9.0, 12.0, 16.0):
        drawn = figure(plots(scores(nothing_db), EI))
        drawn.draw_without_rendering()
        for axes in drawn.axes:
            legend = axes.get_legend()
            assert legend is not None
            (label,) = legend.get_texts()
            assert label.get_text() == f"no events {nothing_db:.2f}"
            box = legend.get_window_extent().padded(4 * drawn.dpi / 72)
            lines = [line for line in axes.get_lines() if line.get_marker() != "None"]
            assert len(lines) == 2
            for line in lines:
                marks = axes.transData.transform(np.column_stack(line.get_data()))
                assert not any(box.contains(x, y) for x, y in marks)


def test_errors_have_a_logarithmic_axis_and_say_which_way_is_better() -> None:
    """Errors span decades and less is better; PSNR is in dB already and more is better."""
    rows = paper_rows(CM, samples=1)
    flow = figure(plots(Scores(rows + nothing_rows(rows, 3.5)), CM)).axes[0]
    assert flow.get_yscale() == "log"
    assert flow.get_ylabel() == "RNEPE [px], less is better"
    psnr = figure(plots(scores(12.0), EI)).axes[0]
    assert psnr.get_yscale() == "linear"
    assert psnr.get_ylabel() == "PSNR [dB]"


def test_the_bus_is_a_line_and_what_does_not_fit_is_shaded() -> None:
    """Promise: in every panel a line is at the capacity of the bus, the part above it is shaded up
    to the edge, and all marks are still inside: 1280 px fires 2097 Mev/s, the bus carries 1200."""
    for axes in figure(plots(scores(12.0), EI)).axes:
        (line,) = (one for one in axes.get_lines() if list(one.get_xdata()) == [1200, 1200])
        assert line.get_linestyle() == "-"
        (shade,) = axes.patches
        low, high = axes.get_xlim()
        assert shade.get_extents().transformed(axes.transData.inverted()).x0 == pytest.approx(1200)
        assert shade.get_x() + shade.get_width() == pytest.approx(high)
        assert low < 2 * 128**3 / 1e6 < 2 * 1280**3 / 1e6 < high
        assert "bus 1200 Mev/s" in [text.get_text() for text in axes.texts]


def test_a_panel_has_its_own_axis_where_a_tenth_of_a_db_would_not_show() -> None:
    """Promise: ideal light spans 12 dB and night 0.4 dB: 0.1 dB is 1/120 of a shared axis, so each
    panel has its own. Two panels of 4 dB share one, and so do panels of 12 dB, as an axis of their
    own shows no more."""

    def own(*spans_db: float) -> bool:
        panels = [
            Panel(f"{i}", "", [Line([Point(1.0, 20.0, []), Point(2.0, 20.0 + span, [])])])
            for i, span in enumerate(spans_db)
        ]
        return plot("", "", "", sensor_keys([SensorId(128)]), panels, deciding=0.1).own_axes

    assert own(12.0, 0.4)
    assert not own(4.0, 3.0)
    assert not own(12.0, 11.0)
    assert not own(0.4)
    ideal, night = figure(plots(scores(12.0), EI)).axes  # 3 dB up, and 3 dB down
    assert ideal.get_ylim()[0] > night.get_ylim()[0] + 2


def test_figures_of_scaling_name_their_series_and_keep_titles_apart() -> None:
    """Promise: slopes of all scenes are in a row with a legend each, intervals have a row for each
    scene with a legend in its first panel, and no title reaches over its panel's neighbor."""
    scenes = {name: made(name) for name in ("carpet", "split_rocks")}
    slopes = figure({name: slope_plot(one) for name, one in scenes.items()})
    intervals = figure({name: interval_plot(one) for name, one in scenes.items()})
    assert [len(drawn.axes) for drawn in (slopes, intervals)] == [2, 6]
    for drawn in (slopes, intervals):
        drawn.draw_without_rendering()
        shown = [axes._left_title.get_window_extent() for axes in drawn.axes]
        assert not any(a.overlaps(b) for a, b in combinations(shown, 2))
        assert all(box.x0 >= 0 and box.x1 <= drawn.bbox.x1 for box in shown)
    keys = [[text.get_text() for text in legend.get_texts()] for legend in legends(slopes)]
    assert keys == [[key.name for key in slope_plot(one).keys] for one in scenes.values()]
    assert [len(legend.get_texts()) for legend in legends(intervals)] == [len(WIDTHS)] * 2
    assert all(axes.get_ylim()[0] == 0 for axes in intervals.axes)


def legends(drawn: Figure) -> list[Legend]:
    return [legend for axes in drawn.axes if (legend := axes.get_legend())]


def test_names_with_dollar_signs_are_drawn_as_they_are() -> None:
    """Promise: a pair of dollar signs in a name is no formula, so names never stop a report."""
    name = "a$_{b$"
    rows = [
        Row(name, *EI[:2], width, math.inf, 0.2, 1.0, 0, "psnr_db", 20.0, 1e6, sensor=f"$^{width}$")
        for width in (128, 346)
    ]
    files = figure_files(plots(Scores(rows), EI))
    assert set(files) == {"png", "svg"}
