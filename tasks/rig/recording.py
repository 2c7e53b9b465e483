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

import numpy as np
from numpy.typing import NDArray

from eres_render import Camera
from sensor import Events
from sensor.formats import FORMATS, Header, read_events, read_header, read_triggers
from tasks.errors import RigError
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
        return page_files.read_gray(self.file, (camera.width, camera.height))


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
        suffixes = {suffix for format in FORMATS.values() for suffix in format.suffixes}
        files = [
            file for file in sorted(self.folder.glob("events.*")) if file.suffix.lower() in suffixes
        ]
        if len(files) != 1:
            names = ", ".join(file.name for file in files) or "none"
            raise RigError(f"{self.folder}: expected one file events.*, found {names}")
        return files[0]

    @cached_property
    def header(self) -> Header:
        """The header of the file of events."""
        header = read_header(self.events_file)
        camera = self.camera
        if header.width and (header.width, header.height) != (camera.width, camera.height):
            raise RigError(
                f"{self.events_file}: the sensor has {header.width}x{header.height} px, but the "
                f"camera in {rig_files.FILE_NAME} has {camera.width}x{camera.height} px"
            )
        return header

    def events(self) -> Iterator[Events]:
        """Read the events in parts, and check that their times overlap the slider's."""
        size = None if self.header.width is not None else (self.camera.width, self.camera.height)
        ends_us: list[int] = []
        for part in read_events(self.events_file, size=size):
            if len(part):
                ends_us = [*ends_us[:1], int(part.t_us[0]), int(part.t_us[-1])]
            yield part
        if not ends_us:
            raise RigError(f"{self.events_file}: has no events")
        start_us, end_us = self.slider.t_us[[0, -1]].tolist()
        if ends_us[-1] <= start_us or ends_us[0] >= end_us:
            raise RigError(
                f"{self.folder}: the events last from {ends_us[0]} to {ends_us[-1]} us, the "
                f"slider's readings from {start_us:.0f} to {end_us:.0f} us; check the clocks"
            )

    @cached_property
    def frames(self) -> tuple[Frame, ...]:
        """The images of the frame camera, in order of time; none without frames.csv."""
        if not (self.folder / FILE_NAME).exists():
            return ()
        exposures = read_exposures(self.folder)
        frames = [
            Frame(start_us, end_us, self._image(name)) for start_us, end_us, name in exposures
        ]
        return tuple(sorted(frames, key=lambda frame: frame.t_us))

    def _image(self, name: str) -> Path:
        """Return an image of frames.csv, which may leave out its folder."""
        listed = self.folder / name
        return listed if listed.exists() else self.folder / FRAMES_FOLDER / name


def thresholds_of(file: Path, given: float | None) -> tuple[float, float]:
    """Return the given contrast threshold for ON and OFF, or those of a file's sensor."""
    if given is not None:
        return given, given
    model = read_header(file).model
    if model is None:
        raise RigError(f"{file}: the contrast threshold is unknown; give --threshold")
    return model.contrast_threshold, model.off_threshold


def write_frames_table(folder: Path, frames: list[Frame]) -> None:
    """Write frames.csv into the folder of a recording."""
    exposures = (
        Exposure(frame.t_start_us, frame.t_end_us, f"{FRAMES_FOLDER}/{frame.file.name}")
        for frame in frames
    )
    write_exposures(folder, exposures)


def open_rig_recording(folder: Path) -> RigRecording:
    """Open the folder of a recording."""
    recording = RigRecording(folder)
    _ = recording.settings, recording.page, recording.slider
    return recording
