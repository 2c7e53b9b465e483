"""Promise: `published` returns the paper's printed numbers."""

import math
from collections import Counter

import pytest

from tasks.study.results.paper import (
    BASE_SPEED_M_PER_S,
    CUTOFFS_HZ,
    SPEEDS,
    WIDTHS,
    every_published,
    published,
    source,
)

INF = math.inf
EI = ("reconstruction", "event_integration")


@pytest.mark.parametrize(
    ("scene", "task", "method", "width", "cutoff_hz", "speed", "value"),
    [
        ("carpet", *EI, 1280, INF, 2.0, 24.101),
        ("rocks", *EI, 128, 50.0, 2.0, 14.627),
        ("room", *EI, 346, 200.0, 4 / 3, 26.806),
        ("carpet", "video", "e2vid", 1280, 50.0, 1.0, 10.050),
        ("carpet", "video", "high_pass_filter", 240, 200.0, 2.0, 11.512),
        ("rocks", "flow", "photometric_flow", 1280, 50.0, 2.0, 7.59),
        ("carpet", "flow", "photometric_flow", 1280, 50.0, 10.0, 3.75),
        ("carpet", "flow", "contrast_maximization", 640, 50.0, 10.0, 3.09),
        ("carpet", "flow", "contrast_maximization", 1280, 50.0, 10.0, 3.21),
        ("carpet", "video", "e2vid", 240, 200.0, 4 / 3, 12.129),
        ("carpet", "video", "e2vid", 128, INF, 2.0, 11.528),
        ("carpet", "dense_flow", "eraft", 128, 50.0, 10.0, 7.97),
        ("carpet", "dense_flow", "eraft", 640, 200.0, 4 / 3, 0.82),
        ("carpet", "dense_flow", "eraft", 1280, INF, 1.0, 0.61),
        ("carpet", "tracking", "photometric_tracking", 128, 50.0, 2.0, 193.6),
        ("rocks", "tracking", "photometric_tracking", 1280, INF, 1.0, 0.953),
    ],
)
def test_a_cell_is_what_the_paper_printed(
    scene: str,
    task: str,
    method: str,
    width: int,
    cutoff_hz: float,
    speed: float,
    value: float,
) -> None:
    """Spot cells of every appendix table, from its corners."""
    assert published(scene, task, method, width, cutoff_hz, speed) == value


# tab:all_tasks_syn, the paper's Table 2: a row for each width; ideal, daytime and nighttime at base
# speed for image reconstruction, then optical flow, then camera pose tracking.
TABLE_2 = {
    "carpet": """
        15.389 15.343 14.892  2.09 2.11 3.24  37.5  37.3 29.5
        17.122 16.954 15.474  0.91 0.75 3.69  17.1  21.6 33.0
        18.373 17.918 15.688  0.58 0.65 3.60  2.34  5.82 30.9
        20.375 19.11  15.719  0.36 0.88 3.51  0.888 2.53 11.0
        24.093 20.362 15.699  0.48 0.94 3.48  0.617 2.21 6.39
    """,
    "rocks": """
        16.381 16.279 15.453  1.90 2.10 3.98  14.0  18.5 38.4
        18.224 17.747 15.697  0.74 1.68 4.07  3.84  7.17 17.2
        19.397 18.403 15.722  0.53 1.74 4.24  1.63  5.81 13.2
        20.913 18.848 15.624  0.38 1.47 4.81  1.18  5.3  14.4
        24.236 19.211 15.590  0.42 1.43 6.07  0.953 5.0  16.4
    """,
    "room": """
        24.786 24.44  22.282  2.36 2.21 8.54
        27.764 26.687 22.379  1.26 1.76 6.96
        29.853 28.015 22.372  1.03 1.84 6.68
        31.695 28.885 22.229  0.96 1.70 6.32
        34.184 29.844 22.167  1.33 1.95 6.23
    """,
}
TASKS_OF_TABLE_2 = (
    EI,
    ("flow", "photometric_flow"),
    ("tracking", "photometric_tracking"),
)


@pytest.mark.parametrize("scene", TABLE_2)
def test_base_speed_columns_agree_with_the_main_table(scene: str) -> None:
    """The appendix and the paper's Table 2 print the same numbers at base speed."""
    for width, line in zip(WIDTHS, TABLE_2[scene].strip().splitlines(), strict=True):
        columns = [(*task, cutoff) for task in TASKS_OF_TABLE_2 for cutoff in CUTOFFS_HZ]
        for (task, method, cutoff), number in zip(columns, line.split(), strict=False):
            ours = published(scene, task, method, width, cutoff, 1.0)
            assert ours == float(number), (scene, task, width, cutoff)


def test_every_table_is_complete() -> None:
    """5 widths x 3 cutoffs at every speed of every scene that the paper prints."""
    counts = Counter((task, method) for (_, task, method, *_), _ in every_published())
    assert counts == {
        EI: 3 * 45,
        ("video", "e2vid"): 45,
        ("video", "high_pass_filter"): 45,
        ("flow", "photometric_flow"): 3 * 45 + 15,
        ("flow", "contrast_maximization"): 60,
        ("dense_flow", "eraft"): 60,
        ("tracking", "photometric_tracking"): 2 * 45,
    }


def test_event_integration_is_complete() -> None:
    """Event integration has all 3 scenes x 5 widths x 3 cutoffs x 3 speeds."""
    cells = [
        published(scene, *EI, width, cutoff, speed)
        for scene in BASE_SPEED_M_PER_S
        for width in WIDTHS
        for cutoff in CUTOFFS_HZ
        for speed in SPEEDS
    ]
    assert len(cells) == 135
    assert None not in cells


def test_a_cell_that_the_paper_lacks_is_none() -> None:
    """A cell outside the paper is None, not an error and not a neighbor's number."""
    assert published("carpet", *EI, 1280, INF, 10.0) is None
    assert published("carpet", *EI, 512, INF, 1.0) is None
    assert published("rocks", "video", "e2vid", 640, INF, 1.0) is None
    assert source("reconstruction", "no_events", [1.0]) is None


def test_the_printed_margins_of_the_text_follow_from_the_table() -> None:
    """1280 px over 640 px, mean of the scenes: 3.18 dB in ideal light, 0.86 dB in daylight."""

    def mean_margin(cutoff_hz: float) -> float:
        margins = []
        for scene in BASE_SPEED_M_PER_S:
            fine = published(scene, *EI, 1280, cutoff_hz, 1.0)
            coarse = published(scene, *EI, 640, cutoff_hz, 1.0)
            assert fine is not None
            assert coarse is not None
            margins.append(fine - coarse)
        return sum(margins) / len(margins)

    assert round(mean_margin(INF), 2) == 3.18
    assert round(mean_margin(200.0), 2) == 0.86


def test_the_source_of_a_method_is_its_table() -> None:
    """Each method has the table of its numbers."""
    assert source(*EI, [1.0, 2.0]) == "Table 6"
    assert source("tracking", "photometric_tracking", [4 / 3]) == "Table 10"
    assert source("flow", "photometric_flow", [1.0]) == "Table 8"
    assert source("flow", "photometric_flow", [10.0]) == "Table 9"
    assert source("flow", "photometric_flow", [3.0]) is None
