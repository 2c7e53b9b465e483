"""Errors of the sensor package."""


class SensorError(ValueError):
    """Frames, times or a sensor model cannot be simulated; the text says why."""


class EventError(ValueError):
    """Arrays are not a valid event stream; the text names the field."""


class EventFormatError(EventError):
    """An event file is damaged or cannot store the events; the text names file and place."""
