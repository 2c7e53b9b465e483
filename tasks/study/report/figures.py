"""The trade-offs as static figures, and the colours and marks of the resolutions."""

from __future__ import annotations

import io

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from tasks.study.report.tradeoff import Plot, plot_data
from tasks.study.results.metrics import Series
from tasks.study.results.scores import Scores

# One colour for each resolution, from coarse to fine: on a light and on a dark page. They differ in
# lightness as well as in hue, and each resolution also has its own mark, the same in report.js.
COLOURS = (
    ("#0072b2", "#5ab4f0"),
    ("#009e73", "#2ecc9b"),
    ("#b88700", "#f5cf4d"),
    ("#b03a00", "#f2894a"),
    ("#8a2c82", "#d9a0ea"),
    ("#4d5560", "#b4bcc6"),
    ("#3b7d00", "#a5d96a"),
    ("#c2185b", "#ff8ab0"),
)
_MARKS = ("o", "s", "^", "D", "v")


def figure_files(scores: Scores, series: Series) -> dict[str, bytes]:
    """Draw a trade-off as PNG and SVG, the same bytes for the same scores.

    Returns
    -------
    dict
        The files by extension, ``png`` and ``svg``.
    """
    files = {}
    with rc_context(
        {
            "font.size": 9,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "grid.color": "#e4e5e1",
            "axes.axisbelow": True,
            "svg.hashsalt": "eres",
        }
    ):
        figure = tradeoff_figure(scores, series)
        for kind, options in {
            "png": {"dpi": 160, "metadata": {"Software": None}},
            "svg": {"metadata": {"Date": None}},
        }.items():
            file = io.BytesIO()
            figure.savefig(file, format=kind, facecolor="white", **options)  # type: ignore[arg-type]
            files[kind] = file.getvalue()
    return files


def tradeoff_figure(scores: Scores, series: Series) -> Figure:
    """Draw the trade-off of one series: a row for every scene, a panel for every cutoff."""
    plots = [(scene, plot_data(scores, series, scene)) for scene in scores.scenes(series)]
    columns = max(len(plot["panels"]) for _, plot in plots)
    figure = Figure(figsize=(3.3 * columns, 3.1 * len(plots)), layout="constrained")
    grid = figure.subplots(len(plots), columns, sharex="row", sharey="row", squeeze=False)
    for axes, (scene, plot) in zip(grid, plots, strict=True):
        _draw_row(list(axes), scene, plot)
    return figure


def _draw_row(row: list[Axes], scene: str, plot: Plot) -> None:
    row[0].set_ylabel(plot["axis"])
    for axes in row[len(plot["panels"]) :]:
        axes.set_axis_off()
    for axes, panel in zip(row, plot["panels"], strict=False):
        axes.set_title(f"{scene}, {panel['label']} ({panel['detail']})", fontsize=9, loc="left")
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(FuncFormatter(lambda rate, _: f"{rate:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        if plot["log"]:
            axes.set_yscale("log")
            axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axes.yaxis.set_major_formatter(FuncFormatter(lambda score, _: f"{score:g}"))
            axes.yaxis.set_minor_formatter(NullFormatter())
        axes.margins(x=0.08, y=0.15)  # room for labels at one end and the legend at the other
        axes.set_xlabel("event rate [Mev/s]")
        nothing = [
            axes.axhline(score, color="#1d2126", linestyle="--", linewidth=1)
            for score in panel["baselines"]
        ]
        if nothing:
            axes.legend(
                nothing[:1],
                [panel["baseline_label"]],
                loc="upper right" if plot["less_is_better"] else "lower right",
                frameon=False,
                fontsize=8,
                labelcolor="#5b646e",
                borderpad=0.1,
                borderaxespad=0.3,
            )
        for index, width in enumerate(plot["widths"]):
            points = [point for point in panel["points"] if point["series"] == index]
            if not points:
                continue
            rates = [point["rate"] for point in points]
            values = [point["score"] for point in points]
            colour = COLOURS[index % len(COLOURS)][0]
            mark = _MARKS[index % len(_MARKS)]
            axes.plot(rates, values, color=colour, marker=mark, markersize=5, linewidth=1.5)
            axes.annotate(
                str(width),
                (rates[0], values[0]),
                xytext=(0, -6 if plot["less_is_better"] else 6),
                va="top" if plot["less_is_better"] else "bottom",
                textcoords="offset points",
                ha="center",
                color=colour,
                fontsize=8,
                fontweight="bold",
            )
