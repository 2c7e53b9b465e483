"""Event files, streamed in bounded memory.

DSEC HDF5, Prophesee EVT2 and EVT3, npz and text to read and write; CSV, AEDAT 3.1, AEDAT4, DAT,
Event Stream and ROS bags to read.

>>> import numpy as np
>>> from sensor import SensorModel, stream
>>> from sensor.formats import read_events, write_events
>>> frames, t_s = (np.full((48, 64), light) for light in (1.0, 2.0, 4.0)), [0.0, 0.1, 0.2]
>>> write_events("brighter.h5", stream(frames, t_s, SensorModel(width=64, height=48)))
18432
>>> sum(len(events) for events in read_events("brighter.h5"))  # parts of at most 2^20
18432
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

__all__ = ["FORMATS", "Format", "Header", "Triggers", "find_format"]
__all__ += ["load_events", "read_events", "read_header", "read_triggers", "write_events"]
