"""Numbers that Gehrig and Scaramuzza published from their slider (ECCV 2022, `tab:all_tasks_real`).

Two lines for each crop; a group of three columns for each of `METHODS`, at each of `SPEEDS_MPS`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SPEEDS_MPS = (0.2, 0.4, 0.6)
METHODS = (
    "e2vid",
    "high_pass_filter",
    "photometric_flow",
    "contrast_maximization",
    "e_raft",
    "photometric_tracking",
)
"""Our names for E2VID, HF (PSNR, dB), EPF, CM, E-RAFT (RNEPE, px) and EPPT (position error, mm)."""

_TABLE = {
    "forest": """
        442x249:  12.79 12.72 12.54  12.24 12.21 12.03  2.44 2.84 3.10
            1.96 2.24 2.42  0.64 0.64 0.75  17.47 24.44 64.97
        649x365:  13.56 13.50 13.25  12.91 12.85 12.55  1.36 1.81 2.27
            1.05 1.41 1.60  0.33 0.36 0.45  4.08 19.96 61.53
        1190x669:  14.09 13.33 12.67  13.37 12.64 11.89  1.17 1.77 2.32
            0.39 0.53 0.79  0.31 0.34 0.37  2.72 14.58 75.55
    """,
    "pebbles": """
        451x254:  14.37 13.79 13.15  13.62 13.06 12.42  1.23 1.67 2.20
            1.36 1.61 2.02  0.52 0.59 0.70  5.80 27.13 79.42
        652x367:  14.82 14.24 13.65  13.82 13.27 12.72  0.90 1.40 1.76
            0.73 0.947 1.16  0.34 0.36 0.43  3.97 11.34 49.65
        1215x683:  14.41 14.16 13.67  13.395 13.00 12.32  0.84 1.29 1.92
            0.31 0.39 0.54  0.34 0.35 0.38  3.21 26.98 97.08
    """,
    "split_rocks": """
        442x249:  12.21 12.31 12.16  11.56 11.69 11.58  2.16 2.59 3.01
            1.52 1.80 2.23  0.49 0.53 0.61  11.97 41.33 50.25
        640x360:  12.73 12.37 12.06  12.02 11.81 11.50  1.88 2.36 2.64
            0.91 1.31 1.66  0.36 0.38 0.36  3.74 12.00 47.11
        1193x671:  12.76 12.52 11.24  12.09 11.89 11.56  1.87 2.39 2.64
            0.45 0.76 0.96  0.18 0.20 0.23  1.708 11.11 78.91
    """,
}


@dataclass(frozen=True, slots=True)
class SliderScore:
    """One number of the table, for a crop of `width` x `height` px."""

    scene: str
    width: int
    height: int
    method: str
    speed_mps: float
    value: float


def slider_scores() -> list[SliderScore]:
    """Return the 162 numbers of the table, in the order in which it prints them."""
    found = []
    for scene, text in _TABLE.items():
        rows = np.array(text.replace(":", " ").split()).reshape(
            -1, 1 + len(METHODS) * len(SPEEDS_MPS)
        )
        for size, *numbers in rows.tolist():
            width, height = (int(side) for side in size.split("x"))
            columns = [(method, speed) for method in METHODS for speed in SPEEDS_MPS]
            for (method, speed), number in zip(columns, numbers, strict=True):
                found.append(SliderScore(scene, width, height, method, speed, float(number)))
    return found
