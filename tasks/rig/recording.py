"""`RigRecording`: the folder of one recording of a rig, virtual or real.

It holds

- `rig.toml`, and the camera file that it names, if any,
- `page.json` and `page.png`, from `eres rig page`,
- `events.*`, in any format that `eres info` reads,
- `slider.csv`: the encoder's readings, `t_us,x_m`, on the clock of the events,
- optionally `triggers.csv`: `slider_us,t_us`, times of edges on the clocks of the slider and of the
  events, if these clocks differ,
- optionally `frames.csv`: `t_us_start,t_us_end,file`, the exposures of images in `frames/`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from eres_render import Camera
from eres_render.errors import reading
from sensor import Events
from sensor.formats import FORMATS, Header, read_events, read_header, read_triggers
from tasks.errors import RigError, TaskError
from tasks.exposures import FILE_NAME, Exposure, read_exposures, write_exposures
from tasks.rig import clock
from tasks.rig import page as page_files
from tasks.rig import settings as rig_files
from tasks.rig import slider as slider_files
from tasks.rig.page import Page
from tasks.rig.settings import RigSettings
from tasks.rig.slider import Slider

FRAMES_FOLDER = "frames"
_RECORDED = "events.*", "rig.toml", "page.*", "*.csv", "*.yaml", "*.yml", "truth.json"


def recorded_files(folder: Path) -> list[Path]:
    """Return the files of a recording that no result may replace."""
    return [file for pattern in _RECORDED for file in sorted(folder.glob(pattern))]


@dataclass(frozen=True, slots=True)
class Frame:
    """One image of a frame camera, and when its exposure started and ended."""

    t_start_us: int
    t_end_us: int
    file: Path

    @property
    def t_us(self) -> int:
        """The middle of the exposure, microseconds."""
        return (self.t_start_us + self.t_end_us) // 2

    def codes(self, camera: Camera) -> NDArray[np.uint8]:
        """Read the image, (H, W)."""
        with reading(self.file, "an image", RigError):
            image = cv2.imread(str(self.file), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise RigError(f"{self.file}: cannot be read, expected an image")
        if image.shape != (camera.height, camera.width):
            raise RigError(
                f"{self.file}: found {image.shape[1]}x{image.shape[0]} px, expected "
                f"{camera.width}x{camera.height}, the camera of {rig_files.FILE_NAME}"
            )
        return np.asarray(image, np.uint8)


@dataclass(frozen=True)
class RigRecording:
    """A recording; its files are read when they are needed."""

    folder: Path

    @cached_property
    def settings(self) -> RigSettings:
        """The rig."""
        return rig_files.read_rig(self.folder / rig_files.FILE_NAME)

    @cached_property
    def camera(self) -> Camera:
        """The camera."""
        return self.settings.camera_in(self.folder)

    @cached_property
    def page(self) -> Page:
        """The print."""
        return page_files.read_page(self.folder / page_files.FILE_NAME)

    @cached_property
    def slider(self) -> Slider:
        """The readings of the encoder, on the clock of the events."""
        slider = slider_files.read_slider(self.folder / slider_files.FILE_NAME)
        edges = self.folder / clock.FILE_NAME
        if not edges.exists():
            return slider
        return clock.on_clock_of_events(slider, edges, lambda: read_triggers(self.events_file))

    @cached_property
    def events_file(self) -> Path:
        """The file of events."""
        suffixes = {suffix for one in FORMATS.values() for suffix in one.suffixes}
        files = sorted(self.folder.glob("events.*"))
        found = [file for file in files if file.suffix.lower() in suffixes]
        if len(found) != 1:
            names = ", ".join(file.name for file in found) or "none"
            raise RigError(f"{self.folder}: found {names}, expected one file events.*")
        return found[0]

    @cached_property
    def header(self) -> Header:
        """The header of the file of events."""
        header = read_header(self.events_file)
        width, height = self.camera.width, self.camera.height
        stored = header.width is not None
        if stored and (header.width, header.height) != (width, height):
            raise RigError(
                f"{self.events_file}: found events of {header.width}x{header.height} px, expected "
                f"{width}x{height}, the camera of {rig_files.FILE_NAME}"
            )
        return header

    def events(self) -> Iterator[Events]:
        """Read the events in parts, and check that their times overlap the slider's."""
        size = None if self.header.width is not None else (self.camera.width, self.camera.height)
        first_us = last_us = None
        for part in read_events(self.events_file, size=size):
            if len(part):
                first_us = int(part.t_us[0]) if first_us is None else first_us
                last_us = int(part.t_us[-1])
            yield part
        if first_us is None or last_us is None:
            raise RigError(f"{self.events_file}: found no events")
        start_us, end_us = self.slider.t_us[[0, -1]].tolist()
        if last_us <= start_us or first_us >= end_us:
            raise RigError(
                f"{self.folder}: the clocks disagree: found events from {first_us} to {last_us} "
                f"us, and readings of the slider from {start_us:.0f} to {end_us:.0f} us"
            )

    @cached_property
    def frames(self) -> tuple[Frame, ...]:
        """The images of the frame camera, in order of time; none without frames.csv."""
        if not (self.folder / FILE_NAME).exists():
            return ()
        try:
            found = read_exposures(self.folder)
        except TaskError as error:
            raise RigError(str(error)) from None
        frames = [Frame(one.start_us, one.end_us, self._image(one.file)) for one in found]
        return tuple(sorted(frames, key=lambda frame: frame.t_us))

    def _image(self, name: str) -> Path:
        """Return an image of frames.csv, which may leave out its folder."""
        listed = self.folder / name
        return listed if listed.exists() else self.folder / FRAMES_FOLDER / name


def write_frames_table(folder: Path, frames: list[Frame]) -> None:
    """Write frames.csv into the folder of a recording."""
    images = (f"{FRAMES_FOLDER}/{one.file.name}" for one in frames)  # from the table, as elsewhere
    times = ((one.t_start_us, one.t_end_us) for one in frames)
    write_exposures(folder, (Exposure(*at, one) for at, one in zip(times, images, strict=True)))


def open_rig_recording(folder: Path) -> RigRecording:
    """Open the folder of a recording."""
    if not folder.is_dir():
        raise RigError(f"{folder}: found no folder, expected that of a recording")
    recording = RigRecording(folder)
    _ = recording.settings, recording.page, recording.slider
    return recording
