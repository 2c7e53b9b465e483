"""What an event camera says about the light: linear radiance frames in, events out.

>>> model = SensorModel(width=346, height=346, contrast_threshold=0.2, cutoff_hz=200.0)
>>> events = simulate(frames, t_s, model)  # frames (T, H, W) float32 linear radiance
"""

from sensor.encoding import to_linear
from sensor.errors import EventError, EventFormatError, SensorError
from sensor.events import Events
from sensor.model import SensorModel, cutoff_in_light
from sensor.readout import Readout, ReadoutReport, read_out
from sensor.simulate import simulate, simulate_bank, stream, stream_bank

__all__ = [
    "EventError",
    "EventFormatError",
    "Events",
    "Readout",
    "ReadoutReport",
    "SensorError",
    "SensorModel",
    "cutoff_in_light",
    "read_out",
    "simulate",
    "simulate_bank",
    "stream",
    "stream_bank",
    "to_linear",
]
