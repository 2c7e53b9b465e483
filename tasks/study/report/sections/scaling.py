"""The report's section on why finer sensors fire faster: the paper's Fig. 2, for each scene."""

from __future__ import annotations

import base64
from html import escape
from pathlib import Path

import numpy as np

from tasks.errors import ResultError
from tasks.study.report.chart import Chart
from tasks.study.results.scaling import FIT_PX, Intervals, Scaling, Slopes
from tasks.study.results.words import cutoff_detail, cutoff_label, number_text

_LEAD = (
    '<p class="lead">A pixel’s log brightness L changes where contrast passes by (a, in the middle '
    "quarter of the image’s side). Pixels that gather less of the image see more of that slope: "
    "|L<sub>t</sub>| grows as a power of 1/p (b). So they fire at shorter intervals (c), until a "
    "slow photoreceptor holds them back.</p>"
)


def scaling_html(folder: Path, scaling: dict[str, Scaling], scenes: list[str]) -> str:
    """Render the section.

    Parameters
    ----------
    folder
        Where each scene's picture lies.
    scaling
        The numbers by scene.
    scenes
        Which to show; those without numbers are left out.

    Raises
    ------
    ResultError
        A scene has numbers but no picture.
    """
    shown = [scaling[scene] for scene in scenes if scene in scaling]
    if not shown:
        return "<p>This run has no scaling statistics.</p>"
    parts = [_LEAD]
    for one in shown:
        parts.append(f"<h3>{escape(one.scene)}, clip {one.clip}</h3>")
        figures = [_picture(folder, one), _slopes_figure(one), *_interval_figures(one)]
        parts.append(f"{_legend(one)}<div class='panels'>{''.join(figures)}</div>")
    return "".join(parts)


def _legend(one: Scaling) -> str:
    keys = "".join(
        f'<span><i style="background:{_colour(one, width)}"></i>{width} px</span>'
        for width in _widths(one)
    )
    return f'<p class="key">{keys}</p>'


def _widths(one: Scaling) -> list[int]:
    return sorted({interval.width for interval in one.intervals})


def _colour(one: Scaling, width: int) -> str:
    return f"var(--series-{_widths(one).index(width) % 8})"


def _figure(caption: str, detail: str, content: str) -> str:
    return (
        f'<figure class="panel"><figcaption>{caption} <small>{detail}</small></figcaption>'
        f"{content}</figure>"
    )


def _picture(folder: Path, one: Scaling) -> str:
    file = folder / f"{one.scene}.png"
    try:
        data = base64.b64encode(file.read_bytes()).decode()
    except FileNotFoundError:
        raise ResultError(f"{file}: no such file, but {one.scene}.json is there") from None
    image = (
        f'<img class="slope pixels" src="data:image/png;base64,{data}" '
        f'alt="Log-brightness slope of {escape(one.scene)}, semi-dense along contrasts">'
    )
    detail = "blue: brighter, red: darker"
    return _figure("(a) L<sub>t</sub>", detail, image)


def _slopes_figure(one: Scaling) -> str:
    curves = {"at edges": (one.edges, "var(--ink)"), "everywhere": (one.everywhere, "var(--soft)")}
    values = [v for slopes, _ in curves.values() for v in slopes.mean_hz]
    chart = Chart(
        (min(one.sizes_px) / 1.25, max(one.sizes_px) * 1.25),
        (min(values) / 1.5, max(values) * 1.8),
        "pixel size p [px of the render]",
        "|Lₜ| [1/s]",
        log_y=True,
    )
    for k, (name, (slopes, colour)) in enumerate(curves.items()):
        chart.dots(one.sizes_px, slopes.mean_hz, colour)
        ends = np.array([min(one.sizes_px), FIT_PX])
        chart.line(ends, slopes.law.factor * ends**-slopes.law.exponent, colour)
        chart.text(340, 32 + 17 * k, f"{name}: {_law_text(slopes)}", anchor="end", colour=colour)
    svg = chart.svg(
        f"Slope against pixel size, {one.scene}: power laws {_law_text(one.edges)} at "
        f"edges, {_law_text(one.everywhere)} everywhere"
    )
    return _figure("(b) |L<sub>t</sub>| against pixel size", f"fitted up to {FIT_PX:g} px", svg)


def _law_text(slopes: Slopes) -> str:
    law = slopes.law
    exponent, low, high = (number_text(v, 2) for v in (law.exponent, law.low, law.high))
    return f"γ = {exponent} [{low}, {high}]"


def _interval_figures(one: Scaling) -> list[str]:
    """Histograms in the best light and in the worst, at base speed and at the highest."""
    settings = one.settings()
    chosen = [min(settings, key=lambda s: (-s[0], s[1])), min(settings)]
    if len({speed for _, speed in settings}) > 1:
        chosen.append(min(settings, key=lambda s: (s[0], -s[1])))
    shares = {
        (one_histogram.width, one_histogram.cutoff_hz, one_histogram.speed): _shares(one_histogram)
        for one_histogram in one.intervals
    }
    edges = np.array(one.edges_us) * 1e-3
    seen = np.any([shares[w, *setting] > 5e-4 for w in _widths(one) for setting in chosen], axis=0)
    first, last = np.flatnonzero(seen)[[0, -1]]
    top = max(shares[w, *setting].max() for w in _widths(one) for setting in chosen)
    figures = []
    for cutoff_hz, speed in dict.fromkeys(chosen):
        chart = Chart(
            (edges[first], edges[last + 1]),
            (0, 1.1 * top),
            "time between a pixel’s events [ms]",
            "share of the intervals [% a bin]",
            log_y=False,
        )
        modes = []
        for width in _widths(one):
            share = shares[width, cutoff_hz, speed][first : last + 1]
            middles = np.sqrt(edges[first : last + 1] * edges[first + 1 : last + 2])
            chart.line(middles, share, _colour(one, width))
            if (mode := one.mode_us(width, cutoff_hz, speed)) is not None:
                k = int(np.argmin(np.abs(np.log(middles / (mode * 1e-3)))))
                chart.dots([middles[k]], [share[k]], _colour(one, width))
                modes.append(f"{width} px: {mode * 1e-3:.2g} ms")
        detail = f"{cutoff_detail(cutoff_hz)}, speed {speed:.2g}; dots: the mode"
        label = f"Intervals between events, {one.scene}, {detail}: {'; '.join(modes)}"
        figures.append(_figure(f"(c) {cutoff_label(cutoff_hz)}", detail, chart.svg(label)))
    return figures


def _shares(histogram: Intervals) -> np.ndarray:
    """Percent of all intervals in each bin."""
    total = sum(histogram.counts) + histogram.shorter + histogram.longer
    return 100 * np.array(histogram.counts) / max(total, 1)
