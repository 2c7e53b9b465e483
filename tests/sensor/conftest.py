"""What all tests of the sensor share."""

import pytest

from sensor.engine import group


@pytest.fixture(autouse=True)
def small_sensors_are_divided(monkeypatch):
    """Divide sensors of any size among the threads, as larger ones are."""
    monkeypatch.setattr(group, "_BAND_WORK", 1)
