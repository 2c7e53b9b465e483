"""`SENSORS` contains the cameras of the paper's Table 1."""

import pytest

from sensor import SensorError
from sensor.presets import SENSORS, find_sensor

# Supplier, camera, year, resolution, interface, max. bandwidth in Mev/s: Table 1 as printed.
TABLE_1 = """
iniVation | DVS128 | 2008 | 128x128 | USB 2 | 1
iniVation | DAVIS240 | 2014 | 240x180 | USB 2 | 12
iniVation | DAVIS346 | 2017 | 346x260 | USB 3 | 12
iniVation | DVXPlorer | 2020 | 640x480 | USB 3 | 165
Prophesee | ATIS | 2011 | 304x240 | - | -
Prophesee | Gen3 CD | 2017 | 640x480 | USB 3 | 66
Prophesee | Gen3 ATIS | 2017 | 480x360 | USB 3 | 66
Prophesee | Gen4 CD | 2020 | 1280x720 | USB 3 | 1066
Samsung | DVS-Gen2 | 2017 | 640x480 | USB 2 | 300
Samsung | DVS-Gen3 | 2018 | 640x480 | USB 3 | 600
Samsung | DVS-Gen4 | 2020 | 1280x960 | USB 3 | 1200
CelePixel | CeleX-IV | 2017 | 768x640 | - | 200
CelePixel | CeleX-V | 2019 | 1280x800 | - | 140
Insightness | Rhino 3 | 2018 | 320x262 | USB 2 | 50
"""


def test_presets_are_the_papers_table():
    """Source: every row of Table 1, and no other."""
    rows = []
    for preset in SENSORS.values():
        size = f"{preset.model.width}x{preset.model.height}"
        rate = "-" if preset.max_bandwidth_mev_s is None else f"{preset.max_bandwidth_mev_s:g}"
        facts = (
            preset.supplier,
            preset.camera,
            str(preset.year),
            size,
            preset.interface or "-",
            rate,
        )
        rows.append(" | ".join(facts))
    assert rows == TABLE_1.strip().splitlines()


def test_presets_have_the_pitch_and_fill_factor_of_the_survey():
    """Source: table 1 of Gallego et al., IEEE TPAMI 2022: pixel size, um, and fill factor, %; the
    DVS128's fill factor from Lichtsteiner, Posch and Delbruck 2008; the DVXPlorer is not there."""
    pitches = [40, 18.5, 18.5, 9, 30, 15, 20, 4.86, 9, 9, 4.95, 18, 9.8, 13]
    fills = [9.4, 22, 22, None, 20, 25, 20, 77, 11, 12, 22, 8.5, 8, 22]
    for preset, pitch, fill in zip(SENSORS.values(), pitches, fills, strict=True):
        assert preset.pixel_pitch_um == pitch
        assert preset.fill_factor == (None if fill is None else pytest.approx(fill / 100))
        assert preset.model.fill_factor == (preset.fill_factor or 1)


def test_presets_are_found_by_name():
    """Promise: the error suggests a similar name; the pixels are the paper's ideal ones."""
    model = find_sensor("davis346").model
    assert (model.contrast_threshold, model.cutoff_hz) == (0.2, float("inf"))
    with pytest.raises(SensorError, match="did you mean 'davis346'"):
        find_sensor("DAVIS346")
    with pytest.raises(SensorError, match="expected one of dvs128, davis240"):
        find_sensor("retina")
