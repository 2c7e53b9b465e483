"""The buses of real cameras carry the simulated events, or the report says that they do not."""

from __future__ import annotations

import pytest

from drawn import section
from sensor.presets import SENSORS
from study_rows import paper_rows
from tasks.study.claims.reconstruction import EVENT_INTEGRATION
from tasks.study.report.sections.bandwidth import buses
from tasks.study.results.bandwidth import bus_loads, capacities_hz
from tasks.study.results.scores import Scores


def buses_html(scores: Scores) -> str:
    return section("bandwidth.html", buses=buses(scores, EVENT_INTEGRATION))


def test_a_bus_saturates_above_its_capacity() -> None:
    """346 px square at 18 Mev/s is 13.5 on a DAVIS346's 260 rows: more than its 12."""
    (load,) = bus_loads({346: 18e6})
    assert load.camera is SENSORS["davis346"]
    assert load.rate_hz == pytest.approx(18e6 * 260 / 346)
    assert load.share == pytest.approx(18 * 260 / 346 / 12)
    assert not load.survives
    (exact,) = bus_loads({128: 1e6})
    assert exact.survives


def test_cameras_without_a_width_or_a_bandwidth_are_left_out() -> None:
    """The table invents no camera; cameras of one width are sorted by capacity."""
    assert bus_loads({304: 1e6, 1000: 1e6}) == []
    names = [load.camera.camera for load in bus_loads({1280: 1e9, 640: 1e8})]
    assert names == [
        *("Gen3 CD", "DVXPlorer", "DVS-Gen2", "DVS-Gen3"),
        *("CeleX-V", "Gen4 CD", "DVS-Gen4"),
    ]


def test_capacities_are_those_of_real_buses() -> None:
    """Each camera once, from the slowest to the fastest; one without a published rate has none."""
    found = capacities_hz()
    assert found == sorted(set(found))
    assert (found[0], found[-1]) == (1e6, 1200e6)
    assert capacities_hz({"atis": SENSORS["atis"]}) == []


def test_the_table_marks_what_saturates() -> None:
    """Rates of 1e3 width^3: 2.1 Mev/s at 128 px is too much for a DVS128, at any speed."""
    rows = paper_rows(scenes=("carpet",))
    page = buses_html(Scores(rows))
    assert "Event rate and bus bandwidth" in page
    assert '<b class="over">2097 <small>209715\u202f%</small></b>' in page
    assert page.count("<tr>") == 1 + 10  # the head, and ten cameras
    lost = [r for r in rows if (r.width, r.sample) != (128, 3)]
    assert "DVS128" not in buses_html(Scores(lost))
    other = [r for r in rows if r.width == 128]
    assert buses_html(Scores([r for r in other if r.sample])).count("<tr>") == 2
