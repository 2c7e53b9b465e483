"""Options for reading files of events, and footage, that do not store all that is needed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import sensor
from tasks.errors import TaskError

if TYPE_CHECKING:
    from eres_render import RadianceSequence
    from tasks.footage import Footage

SHIFT_LIMIT_US = 1 << 62
"""Shifts of times are smaller, so that int64 holds the sum of two."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """What a file of events does not store.

    Parameters
    ----------
    size
        Width and height of the sensor, px, if the file does not store them.
    time_unit
        Unit of the times of a text file: s, ms, us or ns. Required if the times are whole numbers
        and no header line names the unit.
    sort
        Sort the events of text, AEDAT, DAT, ES or a bag by time. This needs all events in memory.
    topic
        Topic of a ROS bag, if several topics have events.
    """

    size: tuple[int, int] | None = None
    time_unit: str | None = None
    sort: bool = False
    topic: str | None = None

    def parts(self, path: str | Path, format: str | None) -> Iterator[sensor.Events]:
        """Read a file.

        Parameters
        ----------
        path, format
            As in `sensor.formats.read_events`.

        Returns
        -------
        Its events in parts.
        """
        from sensor.formats import read_events

        return read_events(path, format=format, **asdict(self))


AS_STORED = ReadOptions()


@dataclass(frozen=True, slots=True, kw_only=True)
class FootageOptions:
    """Videos, and folders of images.

    Parameters
    ----------
    fps
        Frames per second. A folder needs it unless its timestamps.txt has one time per line. For a
        video it replaces the stored times: 960 for slow motion that plays at 30.
    time_unit
        Unit of timestamps.txt: s, ms, us or ns. Required unless its first line names the unit, as
        in "# unit: us".
    encoding
        Transfer function of the stored numbers: srgb, rec709, linear, or gamma:2.2. By default
        that of the video's tags or rec709; for images, linear for floats, else srgb.
    interpolate
        Insert motion-compensated frames: replace each interval between frames by this many, 1 to
        1000, or auto, which limits motion to half a pixel a frame.
    layer
        Layer of OpenEXR files to read, such as ViewLayer.Combined. By default the channels without
        a layer, the only layer with light, or Blender's Combined.
    repair
        Replace pixels that are NaN, infinite or negative by the median of their neighbors.
    start, end
        Part of the footage to simulate, seconds from its first frame. Times of events stay those of
        the whole.
    """

    fps: float | None = None
    time_unit: str | None = None
    encoding: str | None = None
    interpolate: str | None = None
    layer: str | None = None
    repair: bool = False
    start: float | None = None
    end: float | None = None

    def open(self, path: Path) -> RadianceSequence | Footage:
        """Open the frames of a rendered clip (recognized by its manifest) or of footage."""
        from eres_render import open_sequence
        from tasks.footage import open_footage

        if not (any(path.glob("manifest.json")) or any(path.glob("*/manifest.json"))):
            names = "fps", "time_unit", "encoding", "layer", "repair"
            opened = open_footage(path, **{name: getattr(self, name) for name in names})
            if self.start is None and self.end is None:
                return opened
            return opened.between(self.start or 0.0, self.end)
        if self != NO_FOOTAGE:
            raise TaskError(f"{path}: is a rendered sequence; footage options do not apply to it")
        return open_sequence(path)


NO_FOOTAGE = FootageOptions()
