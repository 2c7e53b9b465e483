"""Show why finer sensors fire faster, as in Fig. 2 of the paper."""

from __future__ import annotations

import numpy as np

from tasks.study.report.plot import CIRCLE, Key, Line, Panel, Plot, Point, plot, sensor_keys
from tasks.study.results.asked import sensor_of
from tasks.study.results.intervals import Interval
from tasks.study.results.scaling import FIT_PX, Intervals, Scaling
from tasks.study.results.words import PACKAGED, BaseSpeeds, cutoff_detail, cutoff_label, speed_label


def slope_plot(scaling: Scaling) -> Plot:
    """Plot |L_t| against pixel size, with its power laws; without lines where nothing moves."""
    curves = {"at edges": ("ink", scaling.edges), "everywhere": ("soft", scaling.everywhere)}
    ends = [float(min(scaling.sizes_px)), FIT_PX]
    keys, lines = [], []
    for name, (color, slopes) in curves.items():
        if (law := slopes.law) is None:
            keys.append(Key(f"{name}: 0, nothing moves", color, CIRCLE))
            lines.append(Line([], []))
            continue
        exponent = Interval(law.exponent, law.low, law.high)
        keys.append(Key(f"{name}: γ = {exponent.text(sign='')}", color, CIRCLE))
        points = [
            Point(size, mean, [name, f"{size:g} px", f"{mean:.3g} /s"])
            for size, mean in zip(scaling.sizes_px, slopes.mean_hz, strict=True)
        ]
        lines.append(Line(points, [(size, law.factor * size**-law.exponent) for size in ends]))
    panel = Panel("(b) |Lₜ| against pixel size", f"fitted up to {FIT_PX:g} px", lines)
    axes = "pixel size p [px of the render]", "|Lₜ| [1/s]"
    return plot(f"Slope, {scaling.scene}", *axes, keys, [panel], log_y=True)


def interval_plot(scaling: Scaling, base: BaseSpeeds = PACKAGED) -> Plot:
    """Plot interval histograms: highest cutoff at lowest speed, lowest cutoff at both extremes."""
    settings = scaling.settings()
    best_light, worst = (min(settings, key=lambda s: (sign * s[0], s[1])) for sign in (-1, 1))
    chosen = dict.fromkeys([best_light, worst, min(settings, key=lambda s: (s[0], -s[1]))])
    sensors = sorted({sensor_of(interval) for interval in scaling.intervals})
    shares = {(sensor_of(i), i.cutoff_hz, i.speed): _shares(i) for i in scaling.intervals}
    edges_ms = np.array(scaling.edges_us) * 1e-3
    drawn = [share for (_, *setting), share in shares.items() if tuple(setting) in chosen]
    # Without events, all bins are drawn.
    visible = np.any([share > 5e-4 for share in drawn], axis=0)
    first, last = np.flatnonzero(visible if visible.any() else ~visible)[[0, -1]]
    middles_ms = np.sqrt(edges_ms[:-1] * edges_ms[1:])[first : last + 1]
    keys, panels = sensor_keys(sensors), []
    for cutoff_hz, speed in chosen:
        lines = []
        for sensor, key in zip(sensors, keys, strict=True):
            # None of a sensor that has another cutoff in this light.
            share = shares.get((sensor, cutoff_hz, speed), np.array([]))[first : last + 1].tolist()
            points = []
            if (mode_us := scaling.mode_us(sensor, cutoff_hz, speed)) is not None:
                k = int(np.argmin(np.abs(np.log(middles_ms / (mode_us * 1e-3)))))
                mode, most = f"mode: {mode_us * 1e-3:.2g} ms", f"{share[k]:.2g}\u202f%"
                points.append(Point(float(middles_ms[k]), share[k], [key.name, mode, most]))
            lines.append(Line(points, list(zip(middles_ms.tolist(), share, strict=False))))
        fast = speed_label(scaling.scene, speed, base)
        detail = f"{cutoff_detail(cutoff_hz)}, {fast}; marks: the mode"
        panels.append(Panel(f"(c) {cutoff_label(cutoff_hz)}", detail, lines))
    title = f"Intervals between events, {scaling.scene}"
    axes = "time between a pixel’s events [ms]", "share of the intervals [% per bin]"
    return plot(title, *axes, keys, panels, include_y=[0])


def _shares(histogram: Intervals) -> np.ndarray:
    """Return the percentage of all intervals in each bin."""
    total = sum(histogram.counts) + histogram.shorter + histogram.longer
    return 100 * np.array(histogram.counts) / max(total, 1)
