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
    from sensor.cameras.camera import EventCamera
    from sensor.cameras.files import (
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
_NAMES = {
    "cameras.camera": "EventCamera",
    "cameras.files": "camera_names find_camera plain_camera read_camera write_camera",
    "encoding": "to_linear",
    "errors": "EventError EventFormatError SensorError",
    "events": "Events",
    "live": "LiveCamera",
    "memory": "release_memory",
    "model": "SensorModel cutoff_in_light",
    "readout": "Readout ReadoutReport read_out",
    "simulation": "simulate simulate_bank stream stream_bank",
}
_HOMES = {name: f"sensor.{module}" for module, names in _NAMES.items() for name in names.split()}

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
    value = globals()[name] = getattr(import_module(_HOMES[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
