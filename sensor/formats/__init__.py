"""Event files, streamed in bounded memory: DSEC HDF5, Prophesee EVT2 and EVT3, npz and text; to
read, also CSV, AEDAT4, DAT and Event Stream.

>>> write_events("carpet.h5", stream(frames, t_s, model, seed=3), origin={"seed": 3})
>>> for events in read_events("carpet.h5"): ...
"""

from sensor.formats.header import Header
from sensor.formats.registry import (
    FORMATS,
    Format,
    find_format,
    load_events,
    read_events,
    read_header,
    read_triggers,
    write_events,
)
from sensor.formats.triggers import Triggers

__all__ = [
    "FORMATS",
    "Format",
    "Header",
    "Triggers",
    "find_format",
    "load_events",
    "read_events",
    "read_header",
    "read_triggers",
    "write_events",
]
