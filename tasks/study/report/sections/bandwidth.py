"""Event rates beside what the buses of real cameras carry, as tables."""

from __future__ import annotations

from html import escape

from tasks.study.report.markup import scrolling
from tasks.study.results.bandwidth import Load, bus_loads
from tasks.study.results.metrics import Series
from tasks.study.results.scores import Condition, Scores, base_speed
from tasks.study.results.words import MISSING, cutoff_detail, cutoff_label, rate_label


def buses_html(scores: Scores, series: Series) -> str:
    """Render a table for each scene: cameras down, cutoffs across, base speed to highest."""
    tables = list(filter(None, (_table(scores, series, s) for s in scores.scenes(series))))
    if not tables:
        return ""
    others = f"<details><summary>Other scenes</summary>{''.join(tables[1:])}</details>"
    low, high = _speeds(scores, series)
    speeds = f"at speed {low:.2g}" if low == high else f"at speed {low:.2g} → {high:.2g}"
    return (
        "<h3>Which resolution survives its own bus</h3>"
        f'<p class="lead">Mean events a second {speeds} on the pixels of real cameras of these '
        "widths, in Mev/s, and how much of their bus that takes. Above 100&#8239;% events queue "
        "until they are dropped; peaks do so earlier.</p>"
        + tables[0]
        + (others if tables[1:] else "")
    )


def _speeds(scores: Scores, series: Series) -> tuple[float, float]:
    return base_speed(scores, series), max(scores.speeds(series))


def _table(scores: Scores, series: Series, scene: str) -> str:
    cutoffs = scores.cutoffs_hz(series)
    speeds = list(dict.fromkeys(_speeds(scores, series)))
    loads = {
        (cutoff, speed, load.camera.camera): load
        for cutoff in cutoffs
        for speed in speeds
        for load in bus_loads(_rates_hz(scores, series, scene, cutoff, speed))
    }
    cameras = list(dict.fromkeys((load.camera.camera, load.camera) for load in loads.values()))
    cameras.sort(key=lambda c: (c[1].model.width, c[1].max_bandwidth_mev_s))
    if not cameras:
        return ""
    heads = "".join(
        f'<th scope="col">{escape(cutoff_label(c))} <small>{escape(cutoff_detail(c))}</small></th>'
        for c in cutoffs
    )
    body = "".join(
        f'<tr><th scope="row">{escape(name)} <small>{camera.model.width}×{camera.model.height}, '
        f"{camera.year}</small></th><td>{camera.max_bandwidth_mev_s:g}</td>"
        + "".join(
            "<td>" + " → ".join(_load_text(loads.get((c, s, name))) for s in speeds) + "</td>"
            for c in cutoffs
        )
        + "</tr>"
        for name, camera in cameras
    )
    table = (
        f'<table class="buses"><caption><span>{escape(scene)}</span></caption><thead><tr>'
        f'<th scope="col">camera</th><th scope="col">bus [Mev/s]</th>{heads}</tr></thead>'
        f"<tbody>{body}</tbody></table>"
    )
    return scrolling(f"Buses, {scene}", table)


def _rates_hz(
    scores: Scores, series: Series, scene: str, cutoff_hz: float, speed: float
) -> dict[int, float]:
    """Median event rates of the widths that have all samples."""
    cells = {
        width: scores.cell(series, Condition(scene, width, cutoff_hz, speed)).event_rate_hz
        for width in scores.widths(series)
    }
    return {width: rate for width, rate in cells.items() if rate is not None}


def _load_text(load: Load | None) -> str:
    if load is None:
        return MISSING
    text = f"{rate_label(load.rate_hz)} <small>{100 * load.share:.0f}&#8239;%</small>"
    return text if load.survives else f'<b class="over">{text}</b>'
