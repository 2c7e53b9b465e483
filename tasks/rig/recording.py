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

from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sensor import Events
from sensor.errors import reading
from sensor.formats import FORMATS, Triggers, read_events, read_header, read_triggers
from tasks.errors import RigError
from tasks.exposures import FILE_NAME, Exposure, read_exposures
from tasks.rig import page as pages
from tasks.rig.settings import RIG_FILE, read_rig
from tasks.rig.slider import SLIDER_FILE, Slider, read_columns, read_slider

FRAMES_FOLDER = "frames"
_RECORDED = "events.*", "rig.toml", "page.*", "*.csv", "*.yaml", "*.yml", "truth.json"
_MAX_DRIFT = 1e-3  # clocks of cameras and controllers drift by less than a tenth of this
_FARTHEST_US = 1000.0  # largest distance of an edge of both clocks from the fitted line
_MIN_SPAN = 0.1  # of the edges, as a part of the readings, for a drift that holds for all of these


def recorded_files(folder: Path) -> list[Path]:
    """Return the files of a recording that no result may replace."""
    return [file for pattern in _RECORDED for file in sorted(folder.glob(pattern))]


class RigRecording:
    """A recording; it reads events and images when needed. Its slider is on the events' clock."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.settings = read_rig(folder / RIG_FILE)
        self.camera = self.settings.camera_in(folder)
        self.page = pages.read_page(folder / pages.FILE_NAME)
        slider, edges = read_slider(folder / SLIDER_FILE), folder / "triggers.csv"
        if edges.exists():
            slider = on_clock_of_events(slider, edges, lambda: read_triggers(self.events_file))
        self.slider = slider

    @cached_property
    def events_file(self) -> Path:
        """The file of events."""
        suffixes = {suffix for format in FORMATS.values() for suffix in format.suffixes}
        named = sorted(self.folder.glob("events.*"))
        files = [file for file in named if file.suffix.lower() in suffixes]
        if len(files) != 1:
            names = ", ".join(file.name for file in files) or "none"
            raise RigError(f"{self.folder}: expected one file events.*, found {names}")
        return files[0]

    def events(self) -> Iterator[Events]:
        """Read the events in parts, and check that their times overlap the slider's."""
        header, size = read_header(self.events_file), (self.camera.width, self.camera.height)
        with reading(f"{self.events_file}, camera of {RIG_FILE}", error=RigError):
            header.with_size(size)
        ends_us: list[int] = []
        for part in read_events(self.events_file, size=size):
            ends_us += part.t_us[[0, -1]].tolist() if len(part) else []
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
    def frames(self) -> list[Exposure]:
        """The images of the frame camera, in order of time; none without frames.csv."""
        if not (self.folder / FILE_NAME).exists():
            return []
        return sorted(read_exposures(self.folder), key=lambda frame: frame.t_us)

    def codes(self, frame: Exposure) -> NDArray[np.uint8]:
        """Read an image, (H, W); frames.csv may leave out its folder."""
        file = self.folder / frame.file
        if not file.exists():
            file = self.folder / FRAMES_FOLDER / frame.file
        return pages.read_gray(file, (self.camera.width, self.camera.height))


def span_us(file: Path, parts: Iterable[Events]) -> tuple[int, int]:
    """Return the times of the first and the last event of a file, us."""
    ends = [int(part.t_us[k]) for part in parts if len(part) for k in (0, -1)]
    if not ends:
        raise RigError(f"{file}: has no events")
    return ends[0], ends[-1]


def thresholds_of(file: Path, given: float | None) -> tuple[float, float]:
    """Return the given contrast threshold for ON and OFF, or those of a file's sensor."""
    if given is not None:
        return given, given
    model = read_header(file).model
    if model is None:
        raise RigError(f"{file}: the contrast threshold is unknown; give --threshold")
    return model.contrast_threshold, model.off_threshold


def on_clock_of_events(slider: Slider, file: Path, triggers: Callable[[], Triggers]) -> Slider:
    """Return readings on the clock of the events, from edges in triggers.csv that both clocks time.

    Without its column `t_us`, the edges are the rising edges in the file of events, in the same
    order.
    """
    columns = read_columns(file, ("slider_us",), optional=("t_us",))
    slider_us, t_us = columns["slider_us"], columns.get("t_us")
    if t_us is None:
        with reading(file, error=RigError):
            t_us = triggers().rising_us().astype(np.float64)
    if not 0 < len(t_us) == len(slider_us):
        raise RigError(
            f"{file}: has {len(slider_us)} edges of the slider, and the events have {len(t_us)} "
            "rising edges; each edge needs a time on both clocks"
        )
    drift = 0.0
    if np.ptp(slider_us) >= _MIN_SPAN * np.ptp(slider.t_us):
        from_mean_us = slider_us - slider_us.mean()  # for the slope by least squares
        drift = float(from_mean_us @ (t_us - slider_us) / (from_mean_us @ from_mean_us))
    zero_us = float(np.mean(t_us)) - (1 + drift) * float(np.mean(slider_us))
    off_us = np.abs(zero_us + (1 + drift) * slider_us - t_us)
    if not (abs(drift) < _MAX_DRIFT and off_us.max() < _FARTHEST_US):
        raise RigError(
            f"{file}: the sync edges of slider and events disagree by {off_us.max():.0f} us (limit "
            f"{_FARTHEST_US:.0f} us), with a clock drift of {drift:.2g} (limit {_MAX_DRIFT:g}); "
            "check for a missing edge"
        )
    return Slider(zero_us + (1 + drift) * slider.t_us, slider.x_m)
