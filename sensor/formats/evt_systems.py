"""Versions and sizes of old Prophesee RAW files, whose headers have only the number of the system.

The numbers are those of OpenEB, `hal_psee_plugins/src/boards/rawfile/psee_raw_file_header.cpp`.
"""

from __future__ import annotations

from typing import NamedTuple


class System(NamedTuple):
    """Version of the words and size of the sensor, for headers that have neither."""

    version: str
    width: int
    height: int


_VGA_EVT2 = System("evt2", 640, 480)
_VGA_EVT3 = System("evt3", 640, 480)
_HD_EVT2 = System("evt2", 1280, 720)
_HD_EVT3 = System("evt3", 1280, 720)

SYSTEMS = {
    **dict.fromkeys((0x15, 0x17, 0x19, 0x1C, 0x1D, 0x21, 0x22, 0x23, 0x29), _VGA_EVT2),
    **dict.fromkeys((0x97, 0x99, 0xA1, 0xA2), _VGA_EVT2),  # the same behind an evaluation kit
    **dict.fromkeys((0x1A, 0x1F, 0x27), _HD_EVT2),
    0x28: _VGA_EVT3,
    **dict.fromkeys((0x1E, 0x2E, 0x30, 0x31, 0x32), _HD_EVT3),
}
"""By the number in the header line `system_ID`."""


def system_of(fields: dict[str, str]) -> System | None:
    """Return the system that a header names, None if it is unknown or not Prophesee's."""
    makers = {fields.get(key, "Prophesee") for key in _MAKERS}
    number = fields.get("system_ID", "")
    if makers != {"Prophesee"} or not (number.isascii() and number.isdigit()):
        return None
    return SYSTEMS.get(int(number[:9]))


_MAKERS = ("integrator_name", "plugin_integrator_name", "camera_integrator_name")
