"""Draw plots as static figures with matplotlib."""

from __future__ import annotations

import io
from collections.abc import Mapping

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis as MatplotlibAxis
from matplotlib.figure import Figure
from PIL import Image

from tasks.study.report.plot import COLORS, Axis, Limit, Panel, Plot

_BEYOND = "#b3261e"
_SHADE = 0.09  # opacity over white
_SHADED = "#f8ebeb"  # that color
_PALETTE = 64  # colors of a PNG
_TITLE = 44  # characters of a title that fit above a panel
_STYLE = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.xmargin": 0.08,
    "axes.ymargin": 0.15,  # room for labels at one end and the legend at the other
    "grid.color": "#e4e5e1",
    "legend.frameon": False,
    "legend.fontsize": 8,
    "legend.labelcolor": COLORS["soft"][0],
    "svg.hashsalt": "eres",
    "svg.fonttype": "none",
}


def figure_files(plots: Mapping[str, Plot]) -> dict[str, bytes]:
    """Draw plots as PNG, with a palette, and SVG, the same bytes for the same plots.

    A plot's name is the first part of its panels' titles.
    """
    drawn, vector, pixels, small = figure(plots), io.BytesIO(), io.BytesIO(), io.BytesIO()
    with rc_context(_STYLE):  # type: ignore[arg-type]
        drawn.savefig(vector, format="svg", metadata={"Date": None})
        drawn.savefig(pixels, format="png", dpi=130)
    with Image.open(pixels) as image:
        palette = image.convert("RGB").quantize(_PALETTE, dither=Image.Dither.NONE)
    palette.save(small, "png", optimize=True)
    return {"png": small.getvalue(), "svg": vector.getvalue()}


@rc_context(_STYLE)  # type: ignore[arg-type]
def figure(plots: Mapping[str, Plot]) -> Figure:
    """Draw a row of panels for each plot, or one row if each has one; `plots` as in
    `figure_files`."""
    most = max(len(plot.panels) for plot in plots.values())
    rows, columns = (1, len(plots)) if most == 1 else (len(plots), most)
    drawn = Figure(figsize=(3.3 * columns, 3.1 * rows), layout="constrained")
    grid = drawn.subplots(rows, columns, sharex="row", squeeze=False)
    for place in grid[:, 0]:
        place.set_ylabel(next(iter(plots.values())).y.label)
    for row, (name, plot) in zip(grid.reshape(len(plots), most), plots.items(), strict=True):
        for axes in row[len(plot.panels) :]:
            axes.set_axis_off()
        for axes in row[1 : 1 if plot.own_axes else len(plot.panels)]:
            axes.sharey(row[0])
            axes.tick_params(labelleft=False)
        for axes, panel in zip(row, plot.panels, strict=False):
            _draw(axes, name, plot, panel)
        for axes in row[: len(plot.panels)]:  # the row shares its limits, so draw all of it first
            if 0 in plot.y.include:
                axes.set_ylim(bottom=0)
            _set_ticks(axes.xaxis, plot.x, *axes.get_xlim())
            _set_ticks(axes.yaxis, plot.y, *axes.get_ylim())
            if plot.limit is not None:
                _shade(axes, plot.limit, below=plot.labels_below)
    return drawn


def _draw(axes: Axes, name: str, plot: Plot, panel: Panel) -> None:
    below = plot.labels_below
    title, detail = f"{name}, {panel.label}", f"({panel.detail})"
    gap = " " if len(title) + len(detail) < _TITLE else "\n"
    axes.set_title(_plain(title + gap + detail))
    axes.set_xlabel(plot.x.label)
    axes.set_xscale("log" if plot.x.log else "linear")
    axes.set_yscale("log" if plot.y.log else "linear")
    for at in panel.references:
        axes.axhline(at, color=COLORS["ink"][0], linestyle="--", linewidth=1)
    if panel.references:
        legend = axes.legend(axes.lines[:1], [panel.reference_label], borderpad=0.1)
        legend.set_loc("upper left" if below else "lower left")
    if plot.limit is not None:
        axes.axvline(plot.limit.x, color=_BEYOND, linewidth=1)
    for key, line in zip(plot.keys, panel.lines, strict=True):
        marks = [(point.x, point.y) for point in line.points]
        if not marks:
            continue
        color, outline = COLORS[key.color][0], [(x, -y) for x, y in key.mark]
        axes.plot(*zip(*(line.path or marks), strict=True), color=color, linewidth=1.5)
        (drawn,) = axes.plot(*zip(*marks, strict=True), label=_plain(key.name), linewidth=0)
        drawn.set(color=color, marker=outline, markersize=6)
        place = {"xytext": (0, -6 if below else 6), "va": "top" if below else "bottom"}
        style = {"textcoords": "offset points", "ha": "center", "fontsize": 8, "weight": "bold"}
        label = _plain(key.label)
        axes.annotate(label, marks[0], color=color, **place, **style)  # type: ignore[arg-type]
    if panel is plot.panels[0] and any(x.points for x in panel.lines) and not plot.keys[0].label:
        axes.legend(borderpad=0.1, handletextpad=0.2)


def _plain(text: str) -> str:
    """Return a user's text so that matplotlib takes no part of it for a formula."""
    return text.replace("$", r"\$")


def _shade(axes: Axes, limit: Limit, *, below: bool) -> None:
    """Shade what is above a limit; its label is in the shade, at the end of doing nothing."""
    low, high = axes.get_xlim()
    axes.axvspan(limit.x, high, color=_BEYOND, alpha=_SHADE, linewidth=0)
    axes.set_xlim(low, high)
    axes.annotate(
        limit.label,
        (limit.x, 1 if below else 0),
        (2, -3 if below else 3),
        xycoords=("data", "axes fraction"),
        textcoords="offset points",
        rotation=90,
        va="top" if below else "bottom",
        fontsize=7,
        color=_BEYOND,
        bbox={"color": _SHADED, "pad": 1},  # over the line of doing nothing
    )


def _set_ticks(drawn: MatplotlibAxis, axis: Axis, low: float, high: float) -> None:
    ticks = axis.ticks_within(low, high)
    drawn.set_ticks([at for at, _ in ticks], [label for _, label in ticks])
    drawn.set_ticks([], minor=True)
