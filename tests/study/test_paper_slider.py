"""Promise: the paper's numbers of the slider are transcribed, as its own sentences about them show.

Sums and winners go through every number: a wrong digit, column or line moves them.
"""

import numpy as np
import pytest

from tasks.study.results.slider import SIZES_PX, SPEEDS_M_PER_S, slider_scores


@pytest.fixture(scope="module")
def table() -> dict[str, np.ndarray]:
    """By method: (print, distance from far to near, speed)."""
    return {
        method: np.array([[of[name, v] for v in SPEEDS_M_PER_S] for name in SIZES_PX]).swapaxes(
            1, 2
        )
        for (_, method), of in slider_scores().items()
    }


def test_there_are_162_numbers_with_their_conditions(table: dict[str, np.ndarray]) -> None:
    """Corners of the table, by all fields."""
    assert sum(values.size for values in table.values()) == 162
    scores = slider_scores()
    assert scores["video", "e2vid"]["forest", 0.2][0] == 12.79
    assert scores["tracking", "photometric_tracking"]["split_rocks", 0.6][-1] == 78.91


def test_the_text_of_the_paper_follows_from_the_table(table: dict[str, np.ndarray]) -> None:
    """At 0.6 m/s the middle distance is better: by 31 mm in tracking, 0.07 px in flow."""
    gain = {method: (of[:, 2, 2] - of[:, 1, 2]).mean() for method, of in table.items()}
    assert gain["photometric_tracking"] == pytest.approx(31.0, abs=0.1)
    assert gain["photometric_flow"] == pytest.approx(0.07, abs=0.005)
    images = np.array([table["e2vid"], table["high_pass_filter"]])
    assert (images[:, :, 1, 1] - images[:, :, 2, 1]).mean() == pytest.approx(0.08, abs=0.02)


def test_the_best_distance_of_each_column_is_the_printed_one(table: dict[str, np.ndarray]) -> None:
    """The distance in bold, 0 far to 2 near, by print and speed; one of them is not the best."""
    bold = {
        "e2vid": ["211", "112", "220"],
        "high_pass_filter": ["211", "111", "220"],
        "photometric_flow": ["221", "221", "221"],
        "contrast_maximization": ["222", "222", "222"],
        "eraft": ["222", "222", "222"],
        "photometric_tracking": ["221", "211", "221"],
    }
    wrong = []
    for method, of in table.items():
        best = of.max(axis=1) if method in ("e2vid", "high_pass_filter") else of.min(axis=1)
        for i, picture in enumerate(SIZES_PX):
            for k, speed in enumerate(SPEEDS_M_PER_S):
                if of[i, int(bold[method][i][k]), k] != best[i, k]:
                    wrong.append((method, picture, speed))
    assert wrong == [("photometric_flow", "split_rocks", 0.4)]
