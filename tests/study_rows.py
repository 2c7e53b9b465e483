"""Made-up rows: the paper's medians, each sample and item shifted the same way everywhere."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from tasks.registry import TASKS
from tasks.row import Row
from tasks.study.results.metrics import Series
from tasks.study.results.paper import BASE_SPEED_M_PER_S, CUTOFFS_HZ, SPEEDS, WIDTHS, published

EI = Series("reconstruction", "event_integration", "psnr_db")
HF = Series("video", "high_pass_filter", "psnr_db")
EPF = Series("flow", "photometric_flow", "rnepe_px")
CM = Series("flow", "contrast_maximization", "rnepe_px")
EPPT = Series("tracking", "photometric_tracking", "position_error_mm", "sigma 5 mm")
FAST = 10.0

Change = Callable[[int, float, float, float], float]  # width, cutoff_hz, speed, value -> value


def rate_hz(width: int, cutoff_hz: float) -> float:
    """8x from 640 to 1280 px in ideal light, 6x otherwise."""
    return 1e3 * width ** (3.0 if math.isinf(cutoff_hz) else math.log2(6.0))


def paper_rows(
    series: Series = EI,
    change: Change = lambda width, cutoff_hz, speed, value: value,
    *,
    rate: Callable[[int, float], float] = rate_hz,
    samples: int = 9,
    items: int = 1,
    scenes: Iterable[str] = tuple(BASE_SPEED_M_PER_S),
    method: str | None = None,
) -> list[Row]:
    """Rows whose medians are the paper's, `change`d, wherever it has any.

    Samples and items are spread evenly around the median, by dB or by a factor for errors; both
    counts are odd. `method` is another name to give them.
    """
    rows = []
    for scene in scenes:
        for width in WIDTHS:
            for cutoff in CUTOFFS_HZ:
                for speed in (*SPEEDS, FAST):
                    where = (width, cutoff, speed)
                    median = published(scene, *series[:2], *where, series.metric)
                    if median is None:
                        continue
                    value = change(*where, median)
                    for i in range(samples):
                        for k in range(items):
                            shift = i - (samples - 1) / 2
                            small = 0.01 * (k - (items - 1) / 2)
                            rows.append(
                                Row(
                                    *(scene, series.task, method or series.method),
                                    *(width, cutoff, 0.2),
                                    *(speed, i),
                                    series.metric,
                                    value + shift + small
                                    if series.metric == "psnr_db"
                                    else value * 1.05**shift * 1.1**small,
                                    rate(width, cutoff),
                                    variant=series.variant,
                                    item=k,
                                )
                            )
    return rows


def nothing_rows(rows: Iterable[Row], value: float) -> list[Row]:
    """The do-nothing rows beside these, all with one value."""
    return [
        Row(
            *(r.scene, r.task, TASKS[r.task].baseline, r.width, r.cutoff_hz),
            *(r.contrast_threshold, r.speed, r.sample, r.metric, value, 0.0, r.variant, r.item),
        )
        for r in rows
    ]
