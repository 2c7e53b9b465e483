"""Plots as static figures, drawn by matplotlib."""

from __future__ import annotations

import io
from collections.abc import Mapping

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis as MatplotlibAxis
from matplotlib.figure import Figure

from tasks.study.report.plot import COLORS, Axis, Panel, Plot


def figure_files(plots: Mapping[str, Plot]) -> dict[str, bytes]:
    """Draw plots as PNG and SVG, the same bytes for the same plots.

    Parameters
    ----------
    plots
        By the name that stands over their panels.

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
        drawn = figure(plots)
        for kind, options in {
            "png": {"dpi": 160, "metadata": {"Software": None}},
            "svg": {"metadata": {"Date": None}},
        }.items():
            file = io.BytesIO()
            drawn.savefig(file, format=kind, facecolor="white", **options)  # type: ignore[arg-type]
            files[kind] = file.getvalue()
    return files


def figure(plots: Mapping[str, Plot]) -> Figure:
    """Draw a row for each plot, with its panels side by side."""
    columns = max(len(plot.panels) for plot in plots.values())
    drawn = Figure(figsize=(3.3 * columns, 3.1 * len(plots)), layout="constrained")
    grid = drawn.subplots(len(plots), columns, sharex="row", sharey="row", squeeze=False)
    for row, (name, plot) in zip(grid, plots.items(), strict=True):
        row[0].set_ylabel(plot.y.label)
        for axes in row[len(plot.panels) :]:
            axes.set_axis_off()
        for axes, panel in zip(row, plot.panels, strict=False):
            _draw(axes, name, plot, panel)
        for axes in row[: len(plot.panels)]:  # limits are those of the row once all is drawn
            _set_ticks(axes.xaxis, plot.x, *axes.get_xlim())
            _set_ticks(axes.yaxis, plot.y, *axes.get_ylim())
    return drawn


def _draw(axes: Axes, name: str, plot: Plot, panel: Panel) -> None:
    below = plot.labels_below
    axes.set_title(f"{name}, {panel.label} ({panel.detail})", fontsize=9, loc="left")
    axes.set_xscale("log" if plot.x.log else "linear")
    axes.set_yscale("log" if plot.y.log else "linear")
    axes.margins(x=0.08, y=0.15)  # room for labels at one end and the legend at the other
    axes.set_xlabel(plot.x.label)
    references = [
        axes.axhline(at, color=COLORS["ink"][0], linestyle="--", linewidth=1)
        for at in panel.references
    ]
    if references:
        axes.legend(
            references[:1],
            [panel.reference_label],
            loc="upper right" if below else "lower right",
            frameon=False,
            fontsize=8,
            labelcolor=COLORS["soft"][0],
            borderpad=0.1,
            borderaxespad=0.3,
        )
    for key, line in zip(plot.keys, panel.lines, strict=True):
        marks = [(point.x, point.y) for point in line.points]
        if not marks:
            continue
        color = COLORS[key.color][0]
        axes.plot(*zip(*(line.path or marks), strict=True), color=color, linewidth=1.5)
        outline = [(x, -y) for x, y in key.mark]
        axes.plot(*zip(*marks, strict=True), color=color, marker=outline, markersize=6, linewidth=0)
        axes.annotate(
            key.label,
            marks[0],
            xytext=(0, -6 if below else 6),
            va="top" if below else "bottom",
            textcoords="offset points",
            ha="center",
            color=color,
            fontsize=8,
            fontweight="bold",
        )


def _set_ticks(drawn: MatplotlibAxis, axis: Axis, low: float, high: float) -> None:
    ticks = axis.ticks_within(low, high)
    drawn.set_ticks([at for at, _ in ticks], [label for _, label in ticks])
    drawn.set_ticks([], minor=True)
