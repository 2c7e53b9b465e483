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
from tasks.study.results.paper import PRINTED

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


def slider_scores() -> dict[tuple[str, str], dict[tuple[str, float], list[float]]]:
    """Return the numbers of the table by task and method, then by print and speed in m/s.

    Values go from far to near, in dB, px at full width (RNEPE) or mm.
    """
    scores: dict[tuple[str, str], dict[tuple[str, float], list[float]]] = {}
    for name in PRINTS:
        for line in PRINTED["slider"][name].strip().splitlines():
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

    Its cameras have one lens and the slider's full size, and lose no events.
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
