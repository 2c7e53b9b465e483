"""Errors of the sensor package."""


class SensorError(ValueError):
    """The frames, times or sensor model cannot be simulated; the text says what was found."""


class EventError(ValueError):
    """Arrays that do not make a valid event stream; the text names the field."""


class EventFormatError(EventError):
    """A file of events is damaged, or cannot hold these events; the text names file and place."""
