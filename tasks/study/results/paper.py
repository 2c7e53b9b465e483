"""Numbers that Gehrig and Scaramuzza published (ECCV 2022).

The tables are in `paper.toml`.

Our names for the paper's methods: `event_integration` is EI, `e2vid` E2VID, `high_pass_filter` HF,
`photometric_flow` EPF, `contrast_maximization` CM, `eraft` E-RAFT (a method of dense flow),
`photometric_tracking` EPPT.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path

WIDTHS = (128, 240, 346, 640, 1280)
"""Widths (and heights) of the paper's square sensors, px."""

CUTOFFS_HZ = (math.inf, 200.0, 50.0)
"""Photoreceptor cutoffs of the ideal, the daytime and the nighttime setting, Hz."""

SPEEDS = (1.0, 4 / 3, 2.0)
"""Factors on the base speed. The paper prints 4/3 as 1.3 (0.9, 1.2 and 1.8 m/s on carpet)."""

CONTRAST_THRESHOLD = 0.2
"""C of all sensors, log units ("a realistic contrast threshold of 0.2 for all experiments")."""

BASE_SPEED_M_PER_S = {"carpet": 0.9, "rocks": 0.7, "room": 1.2}
"""Camera speed at factor 1, m/s, from the heads of `tab:app:image_recons_ei`.

The heads of the pose table (`tab:pose_tracking`) are 1.2, 1.6 and 2.4 m/s for both scenes. The main
text gives 0.9, 1.2 and 1.8 m/s for the same carpet numbers. We read the columns as factors.
"""

PRINTED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
"""All tables, as printed."""

_TABLES = PRINTED["table"]


def every_published() -> Iterator[tuple[tuple[str, str, str, int, float, float], float]]:
    """Yield the arguments of `published`, with exact speeds, and the score of every cell."""
    for table in _TABLES:
        for scene in filter(table.get, BASE_SPEED_M_PER_S):
            for width, line in zip(WIDTHS, table[scene].strip().splitlines(), strict=True):
                for cutoff_hz, group in zip(CUTOFFS_HZ, line.split("|"), strict=True):
                    for speed, number in zip(table["speeds"], group.split(), strict=True):
                        where = scene, table["task"], table["method"], width, cutoff_hz, speed
                        yield where, float(number)


_PUBLISHED = {(*where, round(speed, 3)): score for (*where, speed), score in every_published()}


def published(
    scene: str, task: str, method: str, width: int, cutoff_hz: float, speed: float
) -> float | None:
    """Return the paper's median in the metric's unit, or None; the ideal cutoff is inf."""
    return _PUBLISHED.get((scene, task, method, width, cutoff_hz, round(speed, 3)))


def source(task: str, method: str, speeds: Iterable[float]) -> str | None:
    """Return the name of the paper's table for a method; the fastest speed has its own table."""
    asked = {round(speed, 3) for speed in speeds}
    for table in _TABLES:
        printed = {round(speed, 3) for speed in table["speeds"]}
        if (table["task"], table["method"]) == (task, method) and asked & printed:
            return f"Table {table['number']}"
    return None
