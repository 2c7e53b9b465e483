"""Event cameras: a catalogue with a source for each value, and the files that describe others."""

from sensor.cameras.camera import EventCamera, Source
from sensor.cameras.files import camera_names, find_camera, plain_camera, read_camera, write_camera

__all__ = [
    "EventCamera",
    "Source",
    "camera_names",
    "find_camera",
    "plain_camera",
    "read_camera",
    "write_camera",
]
