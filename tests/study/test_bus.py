"""The page compares with the buses of real cameras."""

from __future__ import annotations

from tasks.study.results.choice import capacities_hz, usual_bus_hz


def test_capacities_are_those_of_real_buses() -> None:
    """Each camera once, from the slowest to the fastest; one without a published rate has none."""
    found = capacities_hz()
    assert found == sorted(set(found))
    assert (found[0], found[-1]) == (1e6, 1200e6)
    assert capacities_hz(127) == []


def test_the_usual_bus_is_that_of_cameras_as_fine_as_the_study() -> None:
    """1200 Mev/s belong to a DVS-Gen4 of 1280 px, 600 to a DVS-Gen3 of 640, 50 to a Rhino 3 of 320,
    12 to a DAVIS240; below 128 px there is no camera, so the slowest bus counts."""
    expected = {4000: 1200, 1280: 1200, 640: 600, 346: 50, 240: 12, 128: 1, 60: 1}
    assert {width: usual_bus_hz(width) / 1e6 for width in expected} == expected
