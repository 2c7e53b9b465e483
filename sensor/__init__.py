"""Event-camera simulation: linear radiance frames in, events out.

>>> import numpy as np
>>> from sensor import SensorModel, simulate
>>> t_s = np.arange(100) * 1e-3
>>> wave = np.sin(0.2 * np.arange(64) - 60 * t_s[:, None, None])  # moves to the right
>>> frames = (1.1 + wave) * np.ones((48, 1))  # (T, H, W) linear radiance
>>> model = SensorModel(width=64, height=48, contrast_threshold=0.2, cutoff_hz=200.0)
>>> simulate(frames, t_s, model)
Events(79008 of 64x48 px, 3044..98999 us)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sensor.cameras import (
        EventCamera,
        camera_names,
        find_camera,
        plain_camera,
        read_camera,
        write_camera,
    )
    from sensor.encoding import to_linear
    from sensor.errors import EventError, EventFormatError, SensorError
    from sensor.events import Events
    from sensor.live import LiveCamera
    from sensor.memory import release_memory
    from sensor.model import SensorModel, cutoff_in_light
    from sensor.readout import Readout, ReadoutReport, read_out
    from sensor.simulation import simulate, simulate_bank, stream, stream_bank

# Names are imported on first use (PEP 562): the command line starts without SciPy and Numba.
_HOMES = {
    "EventCamera": "sensor.cameras",
    "EventError": "sensor.errors",
    "EventFormatError": "sensor.errors",
    "Events": "sensor.events",
    "LiveCamera": "sensor.live",
    "Readout": "sensor.readout",
    "ReadoutReport": "sensor.readout",
    "SensorError": "sensor.errors",
    "SensorModel": "sensor.model",
    "camera_names": "sensor.cameras",
    "cutoff_in_light": "sensor.model",
    "find_camera": "sensor.cameras",
    "plain_camera": "sensor.cameras",
    "read_camera": "sensor.cameras",
    "read_out": "sensor.readout",
    "release_memory": "sensor.memory",
    "simulate": "sensor.simulation",
    "simulate_bank": "sensor.simulation",
    "stream": "sensor.simulation",
    "stream_bank": "sensor.simulation",
    "to_linear": "sensor.encoding",
    "write_camera": "sensor.cameras",
}

__all__ = [
    "EventCamera",
    "EventError",
    "EventFormatError",
    "Events",
    "LiveCamera",
    "Readout",
    "ReadoutReport",
    "SensorError",
    "SensorModel",
    "camera_names",
    "cutoff_in_light",
    "find_camera",
    "plain_camera",
    "read_camera",
    "read_out",
    "release_memory",
    "simulate",
    "simulate_bank",
    "stream",
    "stream_bank",
    "to_linear",
    "write_camera",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(_HOMES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
