"""Synthetic rows with the paper's medians; samples and items have the same shifts everywhere."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from tasks.registry import TASKS
from tasks.row import Row
from tasks.study.claims.judge import CLAIMS, judge_all
from tasks.study.claims.verdict import Verdict
from tasks.study.results.asked import Series
from tasks.study.results.paper import BASE_SPEED_M_PER_S, CUTOFFS_HZ, SPEEDS, WIDTHS, published

EI = Series("reconstruction", "event_integration", "psnr_db")
HF = Series("video", "high_pass_filter", "psnr_db")
EPF = Series("flow", "photometric_flow", "rnepe_px")
CM = Series("flow", "contrast_maximization", "rnepe_px")
EPPT = Series("tracking", "photometric_tracking", "position_error_mm", "sigma 5 mm")
FAST = 10.0

Change = Callable[[int, float, float, float], float]  # width, cutoff_hz, speed, value -> value


def rate_hz(width: int, cutoff_hz: float) -> float:
    """Return an event rate that grows 8 times from 640 to 1280 px in ideal light, else 6 times."""
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
    """Return rows with the paper's medians after `change`, for every cell of the paper.

    Samples and items lie evenly around the median, in steps of dB or by factors for errors; both
    counts must be odd. `method` is another name for the method.
    """
    rows = []
    for scene in scenes:
        for width in WIDTHS:
            for cutoff in CUTOFFS_HZ:
                for speed in (*SPEEDS, FAST):
                    where = (width, cutoff, speed)
                    median = published(scene, *series[:2], *where)
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


def verdict(number: int, rows: list[Row]) -> Verdict:
    """Return the verdict on a claim; on the first of those that share a number."""
    found, *_ = judge_all(rows, {}, [claim for claim in CLAIMS if claim.number == number])
    return found


def nothing_rows(rows: Iterable[Row], value: float) -> list[Row]:
    """Return the baseline's rows for the same cells, all with one value."""
    return [
        Row(
            *(r.scene, r.task, TASKS[r.task].baseline, r.width, r.cutoff_hz),
            *(r.contrast_threshold, r.speed, r.sample, r.metric, value, 0.0, r.variant, r.item),
        )
        for r in rows
    ]
