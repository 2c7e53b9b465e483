"""Rows of recordings in cells like those of a study, and claim 22 on them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from finished_runs import page_of
from study_rows import paper_rows
from tasks.errors import RigError
from tasks.rig import cells
from tasks.row import Row, write_rows
from tasks.study.claims.judge import CLAIMS, claims_of, judge_all
from tasks.study.claims.slider import ON_THE_SLIDER
from tasks.study.claims.verdict import Status
from tasks.study.config import preset, to_json
from tasks.study.results.scores import Scores
from tasks.study.run.run_folder import write_recorded

INF = float("inf")
SERIES = {
    "flow": ("photometric_flow", "initial_flow", "rnepe_px", ""),
    "tracking": ("photometric_tracking", "initial_path", "position_error_mm", "sigma 5 mm"),
}


def recording(width, speeds, lead=0.0, scene="mine", items=3):
    """Rows of a recording with a window at each speed; errors are smaller by `lead`."""
    rows = []
    for sample, speed in enumerate(speeds):
        for task, (method, nothing, metric, variant) in SERIES.items():
            for item in range(items if task == "flow" else 1):
                for name, value in ((method, 1.0 - lead + 0.01 * sample), (nothing, 3.0)):
                    at = (width, INF, 0.2, speed, sample)
                    rows.append(Row(scene, task, name, *at, metric, value, 1e6, variant, item))
    return rows


def in_cells(recordings):
    """Group rows of recordings whose visits have up to 50 patches."""
    return cells.in_cells(recordings, {"flow": 50})


def keys(rows, task):
    return {(row.width, row.speed_m_s, row.sample, row.item) for row in rows if row.task == task}


def test_speeds_and_widths_within_a_tenth_are_one():
    """Promise: two recordings at the same distance, with a speed that varies, fall into common
    cells: samples count from 0 in each, and no score is changed."""
    slow, fast = [0.199, 0.2, 0.203], [0.6, 0.59, 0.61]
    both = recording(1190, slow) + recording(1190, fast)  # at the same places
    rows = in_cells([recording(640, slow), recording(644, fast), both])
    assert keys(rows, "tracking") == {
        (w, v, k, 0) for w in (642, 1190) for v in (0.2, 0.6) for k in range(3)
    }
    assert all(row.speed == row.speed_m_s for row in rows)
    near = [row.value for row in rows if (row.method, row.width) == ("photometric_tracking", 1190)]
    assert near == [1.0 + 0.01 * k for k in range(3)] * 2


def values(rows, width, method="photometric_tracking"):
    return [row.value for row in rows if (row.method, row.width) == (method, width)]


def test_each_width_has_the_same_places_and_items():
    """Promise: of unequal recordings, what all have is kept, the first items of places that are
    evenly spread; a place with few items is left out instead of reducing all others."""
    far, near = recording(640, [0.2] * 5), recording(1190, [0.2] * 3, items=4)
    rows = in_cells([far, near])
    assert keys(rows, "flow") == {
        (w, 0.2, k, i) for w in (640, 1190) for k in range(3) for i in range(3)
    }
    sparse = [row for row in far if row.sample != 1 or row.item == 0]
    rows = in_cells([sparse, recording(1190, [0.2] * 5)])
    assert keys(rows, "flow") == {
        (w, 0.2, k, i) for w in (640, 1190) for k in range(4) for i in range(3)
    }
    assert keys(in_cells([[row for row in near if row.sample != 1]]), "flow") == {
        (1190, 0.2, k, i) for k in range(2) for i in range(4)
    }
    alone = in_cells([recording(640, [0.2, 0.6]), recording(1190, [0.8, 0.6])])
    assert {row.speed for row in alone} == {0.6}
    with pytest.raises(RigError, match="of mine: crops 640 px and 1190 px wide share no place"):
        in_cells([recording(640, [0.2]), recording(1190, [0.6])])


def test_a_task_that_one_distance_lacks_is_left_out(caplog):
    """Promise: with a warning, and the others keep their scores."""
    far = [row for row in recording(640, [0.2] * 6) if row.task == "flow"]
    rows = in_cells([far, recording(1190, [0.2] * 6)])
    assert {row.task for row in rows} == {"flow"}
    assert "tracking of mine: crops 640 px and 1190 px wide share no place" in caplog.text


def test_six_places_are_worth_more_than_many_patches():
    """Promise: an interval needs 6 places, so that none is given for patches of 4 others."""
    rich, poor = recording(640, [0.2] * 4, items=9), recording(640, [0.2] * 9, items=2)
    rows = in_cells([rich + [row for row in poor if row.sample > 3]])
    assert keys(rows, "flow") == {(640, 0.2, k, i) for k in range(9) for i in range(2)}


def test_speeds_have_as_many_places():
    """Promise: those of the speed with the fewest, evenly spread over those of the others."""
    rows = recording(640, [0.2] * 5)
    fast = [replace(row, speed=0.6) for row in rows if row.sample < 3]
    assert values(in_cells([rows, fast]), 640) == [1.0, 1.02, 1.04, 1.0, 1.01, 1.02]


def test_a_lost_window_changes_no_pair():
    """Promise: where one recording lacks a place or a patch, the others lose it too, and what is
    left is compared with itself."""
    far = recording(640, [0.2] * 9)
    near = [
        replace(row, width=1190, value=row.value + 0.5)
        for row in far
        if row.sample != 4 and (row.task, row.sample, row.item) != ("flow", 6, 0)
    ]
    rows = in_cells([far, near])
    for method, count in (("photometric_flow", 7 * 3), ("photometric_tracking", 8)):
        coarse, fine = values(rows, 640, method), values(rows, 1190, method)
        assert len(coarse) == count
        assert np.subtract(fine, coarse) == pytest.approx(0.5)
    assert 1.04 not in values(rows, 640)


def test_visits_of_a_place_are_one_sample():
    """Promise: patches there and back are items of one sample, numbered from 0; of places that were
    visited once or twice, those are kept that have the most scores."""
    once = recording(640, [0.2] * 8)
    per_visit = {"flow": 50, "tracking": 1}
    back = [replace(row, item=per_visit[row.task] + row.item, value=9.0) for row in once]
    rows = in_cells([once + back, recording(1190, [0.2] * 8)])
    assert keys(rows, "flow") == {
        (w, 0.2, k, i) for w in (640, 1190) for k in range(8) for i in range(3)
    }
    assert 9.0 not in values(rows, 640)
    rows = in_cells([[row for row in once + back if row.value < 9 or row.sample == 0]])
    assert keys(rows, "flow") == {(640, 0.2, k, i) for k in range(8) for i in range(3)}
    rows = in_cells([once + back])
    assert keys(rows, "flow") == {(640, 0.2, k, i) for k in range(8) for i in range(6)}


def test_visits_are_those_of_their_direction_and_speed():
    """Promise: the way back is compared with the way back, also if other speeds came before, in the
    same recording or in another one."""
    there = recording(640, [0.2] * 6)
    fast = [replace(row, speed=0.6, value=2.0) for row in there]
    back = [replace(row, item=(1 if row.task == "tracking" else 50) + row.item) for row in fast]
    late = [replace(row, item=(4 if row.task == "tracking" else 200) + row.item) for row in back]
    far = there + [replace(row, value=3.0) for row in late]  # after two faster strokes
    near = [replace(row, width=1190) for row in (*fast, *back)]
    rows = in_cells([far, near, recording(1190, [0.2] * 6)])
    for width, value in ((640, 3.0), (1190, 2.0)):
        assert [v for v in values(rows, width) if v > 1.5] == [value] * 6
    assert keys(rows, "flow") == {
        (w, v, k, i) for w in (640, 1190) for v in (0.2, 0.6) for k in range(6) for i in range(3)
    }
    other = [replace(row, width=1190, value=7.0) for row in there]  # a second near recording
    twice = in_cells([far, near, recording(1190, [0.2] * 6), other])
    assert values(twice, 1190) == values(rows, 1190)


def test_each_light_has_its_own_cells(caplog):
    """Promise: one print recorded in two lights has full cells in both, with samples from 0; a
    distance that one light lacks is named."""
    near, far = recording(1190, [0.6] * 8), recording(640, [0.6] * 8)
    dim = [replace(row, cutoff_hz=50.0) for row in near + far]
    rows = in_cells([near, far, dim[: len(near)], dim[len(near) :]])
    for cutoff_hz in (INF, 50.0):
        there = [row for row in rows if row.cutoff_hz == cutoff_hz]
        assert keys(there, "tracking") == {(w, 0.6, k, 0) for w in (640, 1190) for k in range(8)}
    assert not caplog.text
    in_cells([near, far, dim[: len(near)]])
    assert "mine: cutoff 50 Hz, threshold 0.2: has crops 1190 px wide" in caplog.text
    assert "but none 640 px wide" in caplog.text


def recorded(middle_lead, tasks=tuple(SERIES), places=9):
    speeds = [0.2] * places + [0.6] * places
    every = [recording(440, speeds), recording(650, speeds, middle_lead), recording(1200, speeds)]
    return [row for row in in_cells(every) if row.task in tasks]


def verdict(rows):
    (claim,) = claims_of({"recorded": []}, Scores(rows))
    (found,) = judge_all(rows, {}, [claim])
    return found


def test_claim_22_on_recordings():
    """Promise: the second nearest distance is compared with the nearest, at the highest speed, on
    any print and with an unknown cutoff. A study of prints is judged on the same claim of the
    virtual slider, one of other scenes on all claims."""
    carpet = paper_rows(scenes=["carpet"])
    forest = [replace(row, scene="forest") for row in carpet]
    config = to_json(preset("slider"))
    assert claims_of(config, Scores(carpet + forest)) is CLAIMS
    assert claims_of(config, Scores(forest)) == (ON_THE_SLIDER,)
    found = verdict(recorded(0.3))
    assert (found.number, found.status) == (22, Status.HOLDS)
    assert "mine, 650 px or 1200 px at 0.6 m/s" in found.ours
    assert "cutoff unknown: holds" in found.ours
    assert "Judged on recordings of mine only." in found.note
    assert verdict(recorded(-0.3)).status is Status.DOES_NOT_HOLD
    slower = [replace(row, value=row.value - 1) if (row.width, row.speed) == (650, 0.2) else row
              for row in recorded(-0.3)]  # fmt: skip
    assert verdict(slower).status is Status.DOES_NOT_HOLD
    assert verdict(recorded(0.3, tasks=("flow",))).status is Status.NOT_MEASURED
    one = verdict([row for row in recorded(0.3) if row.width == 1200])
    assert one.status is Status.NOT_MEASURED
    assert "too few for an interval" in verdict(recorded(0.3, places=3)).note


def test_the_folder_is_that_of_a_run(tmp_path, eres):
    """Promise: `eres claims` and the report read it, and judge only the claim that applies."""
    write_recorded(tmp_path, [tmp_path / "crops"], {"places": 9})
    assert json.loads((tmp_path / "study.json").read_text())["recorded"] == [
        str(tmp_path / "crops")
    ]
    write_rows(tmp_path / "rows.parquet", recorded(0.3))
    code, out, _ = eres("claims", tmp_path)
    assert code == 0
    assert "22 holds" in out
    assert "holds: 1, does not hold: 0, undecided: 0, not measured: 0" in out
    page = page_of(tmp_path)
    assert "650 px or 1200 px at 0.6 m/s" in page
    assert "speed 0.6" not in page  # a recording's speed is in m/s
    assert 'id="slider"' not in page  # the paper's table is of other prints and distances
