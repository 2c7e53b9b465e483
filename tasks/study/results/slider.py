"""The slider of Gehrig and Scaramuzza, with their numbers of a real camera, and the virtual one.

`tab:all_tasks_real` of the paper, 162 numbers: a Prophesee Gen4 on a motorized slider in front of
three prints. Its "resolutions" are distances: the same part of a print covers fewer pixels from
farther away. The virtual slider has prints of the same subjects, the same distances and speeds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from sensor import cutoff_in_light

SPEEDS_M_PER_S = (0.2, 0.4, 0.6)
"""Speeds of the slider."""

FACTORS = {speed: round(speed / SPEEDS_M_PER_S[0], 9) for speed in SPEEDS_M_PER_S}
"""Factors of the virtual slider on its base speed, by its speed in m/s."""

SIZES_PX: Mapping[str, tuple[tuple[int, int], ...]] = {
    "forest": ((442, 249), (649, 365), (1190, 669)),
    "pebbles": ((451, 254), (652, 367), (1215, 683)),
    "split_rocks": ((442, 249), (640, 360), (1193, 671)),
}
"""Width and height of the common field of view by print, from the farthest distance on, px.

The paper gives the distances from the wall as 0.6, 0.4 and 0.2 m. The sizes are proportional to
1 / (d + c) with c = 3.7, 3.5 and 3.5 cm within 0.6 %, so the optical center is about 63.6, 43.6 and
23.6 cm from the print.
"""

PRINTS = tuple(SIZES_PX)
"""Names of the scenes; the paper's prints show the same subjects."""

FIELD_PX = SIZES_PX["forest"]
"""Size of the field of view of every print, by distance from the farthest on, px."""

NEAREST_M = 0.236
"""Distance of the camera at the full size; the others follow from the widths."""

PAPER_SIGMA_MM = 50.0
"""Standard deviation of the error of the paper's initial control positions, per component, mm."""

NOTHING_MM = 54.7
"""Median position error of that start, mm: the mean distance over 14 ms of a spline through 10
control positions with this error. It depends on nothing else."""

_METHODS = (
    ("video", "e2vid"),
    ("video", "high_pass_filter"),
    ("flow", "photometric_flow"),
    ("flow", "contrast_maximization"),
    ("dense_flow", "eraft"),
    ("tracking", "photometric_tracking"),
)

# A line per distance, a group of columns per method in `_METHODS`, a column per speed.
_TABLE = {
    "forest": """
    12.79 12.72 12.54 | 12.24 12.21 12.03 | 2.44 2.84 3.10 | 1.96 2.24 2.42 | 0.64 0.64 0.75 | 17.47 24.44 64.97
    13.56 13.50 13.25 | 12.91 12.85 12.55 | 1.36 1.81 2.27 | 1.05 1.41 1.60 | 0.33 0.36 0.45 | 4.08 19.96 61.53
    14.09 13.33 12.67 | 13.37 12.64 11.89 | 1.17 1.77 2.32 | 0.39 0.53 0.79 | 0.31 0.34 0.37 | 2.72 14.58 75.55
    """,  # noqa: E501
    "pebbles": """
    14.37 13.79 13.15 | 13.62 13.06 12.42 | 1.23 1.67 2.20 | 1.36 1.61 2.02 | 0.52 0.59 0.70 | 5.80 27.13 79.42
    14.82 14.24 13.65 | 13.82 13.27 12.72 | 0.90 1.40 1.76 | 0.73 0.947 1.16 | 0.34 0.36 0.43 | 3.97 11.34 49.65
    14.41 14.16 13.67 | 13.395 13.00 12.32 | 0.84 1.29 1.92 | 0.31 0.39 0.54 | 0.34 0.35 0.38 | 3.21 26.98 97.08
    """,  # noqa: E501
    "split_rocks": """
    12.21 12.31 12.16 | 11.56 11.69 11.58 | 2.16 2.59 3.01 | 1.52 1.80 2.23 | 0.49 0.53 0.61 | 11.97 41.33 50.25
    12.73 12.37 12.06 | 12.02 11.81 11.50 | 1.88 2.36 2.64 | 0.91 1.31 1.66 | 0.36 0.38 0.36 | 3.74 12.00 47.11
    12.76 12.52 11.24 | 12.09 11.89 11.56 | 1.87 2.39 2.64 | 0.45 0.76 0.96 | 0.18 0.20 0.23 | 1.708 11.11 78.91
    """,  # noqa: E501
}


def slider_scores() -> dict[tuple[str, str], dict[tuple[str, float], list[float]]]:
    """Return the numbers of the table.

    Returns
    -------
    dict
        By task and method, then by print and speed in m/s: values from far to near in dB, px at
        full width (RNEPE) or mm.
    """
    scores: dict[tuple[str, str], dict[tuple[str, float], list[float]]] = {}
    for name, block in _TABLE.items():
        for line in block.strip().splitlines():
            for method, group in zip(_METHODS, line.split("|"), strict=True):
                of_method = scores.setdefault(method, {})
                for speed, number in zip(SPEEDS_M_PER_S, group.split(), strict=True):
                    of_method.setdefault((name, speed), []).append(float(number))
    return scores


def worse_than_nothing(speed_m_per_s: float) -> int:
    """Return how many of the paper's position errors at a speed are larger than `NOTHING_MM`."""
    errors = slider_scores()["tracking", "photometric_tracking"]
    at_speed = [values for (_, speed), values in errors.items() if speed == speed_m_per_s]
    return sum(value > NOTHING_MM for values in at_speed for value in values)


def is_of_slider(config: Mapping[str, Any]) -> bool:
    """Return whether a study, the content of study.json, is on the virtual slider.

    The distances, and what the paper measured, are those of cameras of one lens, whose full size is
    the slider's, and which lose no events.
    """
    render, simulate = config.get("render", {}), config.get("simulate", {})
    return (
        bool(simulate.get("same_lens"))
        and simulate.get("bus_mev_s") is None
        and render.get("resolution") == FIELD_PX[-1][0]
    )


def distance_label(width: int) -> str:
    """Name the distance from which the field is `width` px wide."""
    return f"{100 * NEAREST_M * FIELD_PX[-1][0] / width:.1f} cm"


def light_label(cutoff_hz: float) -> str:
    """Name the light that gives a pixel this cutoff, see `sensor.cutoff_in_light`."""
    if math.isinf(cutoff_hz):
        return "ideal"
    return f"{cutoff_hz / cutoff_in_light(1.0):.3g} lux"
