"""Options of `eres simulate` for videos and folders of images."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tasks.errors import TaskError

if TYPE_CHECKING:
    from eres_render import RadianceSequence
    from tasks.footage import Footage


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


NO_FOOTAGE = FootageOptions()


def open_source_frames(path: Path, footage: FootageOptions) -> RadianceSequence | Footage:
    """Open the frames to simulate a sensor on.

    Parameters
    ----------
    path
        Folder of a rendered clip, recognized by its manifest; a video; or a folder of images.
    """
    from eres_render import open_sequence
    from tasks.footage import open_footage

    if not (any(path.glob("manifest.json")) or any(path.glob("*/manifest.json"))):
        options = asdict(footage)
        start_s, end_s = options.pop("start"), options.pop("end")
        del options["interpolate"]
        opened = open_footage(path, **options)
        if start_s is None and end_s is None:
            return opened
        return opened.between(start_s or 0.0, end_s)
    if footage != NO_FOOTAGE:
        raise TaskError(f"{path}: is a rendered sequence; the footage options do not apply to it")
    return open_sequence(path)
