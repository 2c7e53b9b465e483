"""Numbers that Gehrig and Scaramuzza published (ECCV 2022).

Each block below is one scene of one table: a line per sensor width, a group of columns per
photoreceptor cutoff, a column per camera speed. The name of a table is its label in the paper's
LaTeX source.

Our names for the paper's methods: `event_integration` is EI, `e2vid` E2VID, `high_pass_filter` HF,
`photometric_flow` EPF, `contrast_maximization` CM, `eraft` E-RAFT (a method of dense flow),
`photometric_tracking` EPPT.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

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

IDEAL_MARGIN_IN_CAPTION_DB = 0.1
"""Margin of the highest resolution in ideal light, from the caption of `tab:app:image_recons_ei`
("~0.1 dB"); the table itself contradicts it."""

# By printed number, task, method and speeds: blocks by scene.
_TABLES = {
    # tab:app:image_recons_ei
    (6, "reconstruction", "event_integration", SPEEDS): {
        "carpet": """
        15.389  15.39 15.385  |  15.343 15.314 15.233  |  14.892  14.65 14.283
        17.122  17.12 17.123  |  16.954 16.785 16.414  |  15.474 14.973 14.326
        18.373 18.374 18.374  |  17.918 17.617 17.016  |  15.688 15.056 14.313
        20.375 20.376 20.375  |   19.11  18.47 17.464  |  15.719 14.997 14.221
        24.093 24.096 24.101  |  20.362 19.184 17.731  |  15.699 14.949 14.171
        """,
        "rocks": """
        16.381 16.385 16.384  |  16.279 16.198 16.013  |  15.453 15.141 14.627
        18.224 18.223 18.223  |  17.747  17.45 16.899  |  15.697 15.194 14.549
        19.397 19.395 19.395  |  18.403  17.91 17.123  |  15.722 15.175 14.501
        20.913 20.914 20.912  |  18.848 18.162 17.182  |  15.624 15.057 14.385
        24.236 24.234 24.235  |  19.211 18.349 17.236  |   15.59 15.017 14.343
        """,
        "room": """
        24.786 24.791 24.787  |   24.44 24.076 23.428  |  22.282 21.951 21.608
        27.764 27.768 27.769  |  26.687 25.842 24.493  |  22.379 21.809 21.355
        29.853 29.853 29.854  |  28.015 26.806  24.97  |  22.372 21.751 21.278
        31.695 31.686 31.694  |  28.885 27.218 25.007  |  22.229 21.609 21.171
        34.184  34.18 34.179  |  29.844 27.605 25.081  |  22.167 21.548 21.123
        """,
    },
    # tab:app:image_recons_comp
    (7, "video", "e2vid", SPEEDS): {
        "carpet": """
        11.532 11.557 11.528  |  11.541 11.532 11.501  |  11.387 11.268 10.972
        12.186 12.190 12.167  |  12.168 12.129 12.027  |  11.629 11.301 10.871
        12.254 12.249 12.260  |  12.211 12.139 11.965  |  11.359 11.009 10.531
        12.317 12.293 12.316  |  12.029 11.754 11.396  |  10.605 10.254  9.858
        13.379 13.378 13.381  |  12.331 11.631 10.946  |  10.050  9.761  9.457
        """
    },
    (7, "video", "high_pass_filter", SPEEDS): {
        "carpet": """
        11.143 11.156 11.152  |  11.146 11.136 11.094  |  10.972 10.810 10.518
        11.570 11.569 11.562  |  11.576 11.572 11.512  |  11.142 10.892 10.488
        11.606 11.609 11.605  |  11.599 11.562 11.428  |  10.976 10.683 10.212
        11.646 11.649 11.649  |  11.552 11.420 11.174  |  10.433 10.085  9.612
        12.626 12.609 12.609  |  12.041 11.606 11.013  |   9.932  9.591  9.142
        """
    },
    # tab:app:optical_flow
    (8, "flow", "photometric_flow", SPEEDS): {
        "carpet": """
        2.09 1.89 2.11  |  2.11 1.92 2.19  |  3.24 3.59 5.16
        0.91 0.93 0.93  |  0.75 0.95 1.72  |  3.69 4.49 5.52
        0.58 0.62 0.61  |  0.65 1.01 1.82  |  3.60 4.51 5.85
        0.36 0.37 0.36  |  0.88 1.26 1.91  |  3.51 4.55 5.87
        0.48 0.45 0.46  |  0.94 1.32 2.06  |  3.48 4.29 4.78
        """,
        "rocks": """
        1.90 1.56 1.64  |  2.10 2.36 2.67  |  3.98 4.96 6.32
        0.74 0.79 0.76  |  1.68 2.03 2.60  |  4.07 5.35 6.39
        0.53 0.47 0.50  |  1.74 2.13 2.85  |  4.24 5.24 6.52
        0.38 0.37 0.34  |  1.47 1.92 2.71  |  4.81 5.62 6.89
        0.42 0.41 0.42  |  1.43 1.93 3.04  |  6.07 6.78 7.59
        """,
        "room": """
        2.36 2.31 2.62  |  2.21 3.12 4.35  |  8.54 8.62 9.26
        1.26 1.25 1.37  |  1.76 2.39 3.97  |  6.96 7.29 8.03
        1.03 1.03 1.04  |  1.84 2.72 4.09  |  6.68 7.16 8.56
        0.96 0.92 0.93  |  1.70 2.40 4.21  |  6.32 6.75 8.28
        1.33 1.34 1.37  |  1.95 2.68 3.98  |  6.23 6.86 7.50
        """,
    },
    # tab:app:optical_flow_sota
    (9, "flow", "photometric_flow", (10.0,)): {
        "carpet": """
        1.87  |  5.09  |  4.08
        0.89  |  5.84  |  4.72
        0.62  |  6.10  |  4.64
        0.36  |  6.19  |  4.01
        0.48  |  5.06  |  3.75
        """
    },
    (9, "flow", "contrast_maximization", (*SPEEDS, 10.0)): {
        "carpet": """
        5.06 4.94 5.16 5.06  |  4.89 4.97 4.92 4.92  |  4.76 4.78 5.17 5.30
        2.51 2.45 2.49 2.51  |  2.59 2.61 2.42 2.92  |  2.57 2.52 2.85 3.92
        1.74 1.73 1.78 1.72  |  1.69 1.75 1.73 2.07  |  1.72 1.70 1.77 3.18
        0.71 0.69 0.72 0.69  |  0.67 0.66 0.63 1.20  |  0.69 0.84 1.04 3.09
        0.32 0.32 0.32 0.33  |  0.25 0.29 0.30 0.88  |  0.37 0.45 0.63 3.21
        """
    },
    (9, "dense_flow", "eraft", (*SPEEDS, 10.0)): {
        "carpet": """
        2.44 2.87 2.41 2.91  |  2.32 3.04 3.14 3.12  |  2.56 2.87 2.98 7.97
        1.01 0.97 1.01 0.97  |  1.10 1.22 1.37 2.04  |  1.59 1.71 1.92 5.89
        0.94 0.85 0.91 0.92  |  0.93 0.99 1.01 1.38  |  1.24 1.37 1.47 4.68
        0.79 0.82 0.76 0.78  |  0.84 0.82 0.85 1.31  |  0.86 1.02 1.09 3.90
        0.61 0.64 0.63 0.62  |  0.63 0.65 0.65 1.03  |  0.68 0.75 0.92 2.85
        """
    },
    # tab:pose_tracking
    (10, "tracking", "photometric_tracking", SPEEDS): {
        "carpet": """
         37.5  17.8  32.7  |   37.3  10.9  4.88  |   29.5  2.44 193.6
         17.1  18.2  30.4  |   21.6  20.4  59.1  |   33.0  59.6  4.27
         2.34  2.02  2.43  |   5.82  6.26  11.1  |   30.9  41.7  11.6
        0.888 0.854 0.959  |   2.53  3.12  6.84  |   11.0  15.4 102.0
        0.617 0.775 0.661  |   2.21  2.81  4.22  |   6.39  11.5  24.9
        """,
        "rocks": """
         14.0  13.3  15.8  |   18.5  24.6  27.5  |   38.4  46.6  22.4
         3.84  3.38  5.15  |   7.17  8.68  12.2  |   17.2  19.2  20.6
         1.63   1.4  1.83  |   5.81  7.79  8.59  |   13.2  17.9  21.2
         1.18  1.17  1.26  |    5.3  7.54  8.12  |   14.4  16.0  18.2
        0.953 0.925  1.01  |    5.0  8.88  9.42  |   16.4  19.1  31.8
        """,
    },
}

_Key = tuple[str, str, str, int, float, float]


def every_published() -> Iterator[tuple[_Key, float]]:
    """Yield the arguments of `published`, with exact speeds, and the score of every cell."""
    for (_, task, method, speeds), scenes in _TABLES.items():
        for scene, block in scenes.items():
            for width, line in zip(WIDTHS, block.strip().splitlines(), strict=True):
                for cutoff_hz, group in zip(CUTOFFS_HZ, line.split("|"), strict=True):
                    for speed, number in zip(speeds, group.split(), strict=True):
                        yield (scene, task, method, width, cutoff_hz, speed), float(number)


_PUBLISHED = {(*where, round(speed, 3)): score for (*where, speed), score in every_published()}


def published(
    scene: str, task: str, method: str, width: int, cutoff_hz: float, speed: float
) -> float | None:
    """Return the paper's median score of one cell, or None if the paper lacks the cell.

    Parameters
    ----------
    width
        Sensor width, px.
    cutoff_hz
        Photoreceptor cutoff, Hz; inf is the ideal setting.

    Returns
    -------
    float or None
        In the unit of the task's metric.
    """
    return _PUBLISHED.get((scene, task, method, width, cutoff_hz, round(speed, 3)))


def source(task: str, method: str, speeds: Iterable[float]) -> str | None:
    """Return the printed name of the paper's table for a method.

    Parameters
    ----------
    speeds
        Factors on the base speed; the paper has a separate table for the fastest.
    """
    asked = {round(speed, 3) for speed in speeds}
    for number, *of, printed in _TABLES:
        if of == [task, method] and asked & {round(speed, 3) for speed in printed}:
            return f"Table {number}"
    return None
