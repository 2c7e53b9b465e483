"""`RecordedFrames`: images from the camera of a recording, with the times of their exposures.

A folder has one of these files, next to the images or above them:

    frames.csv        t_us_start,t_us_end,file      microseconds on the clock of the events
    images.txt        time file                     as in the RPG's event camera dataset
    timestamps.txt    time                          one per line, for the images sorted by name

The latter two have the start of each exposure, not its end, and need a unit of time.

An exposure averages the light while it lasts. If log intensity changes little meanwhile, the
logarithm of the average is the average of the logarithm, so the change from one frame to the next
is a weighted sum of events: the weight of an event rises from 0 to 1 over the first exposure, with
the share of the exposure before the event, and falls from 1 to 0 over the second.
This is the linear form of the event-based double integral of Pan et al., "Bringing a Blurry Frame
Alive at High Frame-Rate with an Event Camera" (CVPR 2019).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eres_render.errors import reading
from sensor import Events
from sensor.time_units import TIME_UNITS
from tasks.errors import TaskError
from tasks.exposures import COLUMNS, FILE_NAME, Exposure, read_exposures
from tasks.footage import Footage
from tasks.footage.images import has_transparency, list_images, read_images, times_ns
from tasks.footage.luminance import Luminance, coding_of
from tasks.recording.recording import Recording

logger = logging.getLogger(__name__)

DARK = 1 / 64
"""Added to the light of frames before the logarithm, in units of white. Below about code 4 of 255,
a frame is mostly noise."""

_LIMIT_US = 1 << 61  # so that a shift, and the sum of start and end, fit into int64


@dataclass(frozen=True, eq=False)
class RecordedFrames:
    """Frames of a recording, in order of time.

    Parameters
    ----------
    files
        The images.
    start_us, end_us
        (N,) int64, start and end of each exposure, on the clock of the events; equal if the
        exposure is unknown.
    encoding
        Transfer function of the stored numbers, see `sensor.to_linear`.
    white_level
        Light of white: 1, or for floats that of `sensor.levels.white_level` in the first frame.
    """

    files: tuple[Path, ...]
    start_us: NDArray[np.int64]
    end_us: NDArray[np.int64]
    encoding: str
    white_level: float = 1.0

    def __len__(self) -> int:
        return len(self.files)

    def some(self, numbers: NDArray[np.int64]) -> RecordedFrames:
        """Return the frames of these indices, which ascend."""
        files = tuple(self.files[k] for k in numbers)
        start_us, end_us = self.start_us[numbers], self.end_us[numbers]
        return replace(self, files=files, start_us=start_us, end_us=end_us)

    def every_second(self) -> RecordedFrames:
        """Return every second frame, and the last one."""
        last = len(self) - 1
        return self.some(np.unique(np.append(np.arange(0, last, 2), last)))

    @property
    def middle_us(self) -> NDArray[np.int64]:
        """(N,) middle of each exposure, taken as the time of its image."""
        return (self.start_us + self.end_us) // 2

    @cached_property
    def _luminance(self) -> Luminance:
        return Luminance(self.encoding, self.white_level)

    @cached_property
    def _shape(self) -> tuple[int, ...]:
        return next(read_images([self.files[0]])).shape[:2]

    def _in_units_of_white(self, file: Path, image: NDArray[np.generic]) -> NDArray[np.float32]:
        return self._luminance(file, image) / np.float32(self.white_level)

    def light(self, k: int) -> NDArray[np.float32]:
        """Return the light of a frame, (H, W), in units of white.

        Raises
        ------
        TaskError
            The image is damaged, or has another size than the first.
        """
        file = self.files[k]
        light = self._in_units_of_white(file, next(read_images([file])))
        if light.shape != self._shape:
            size, first = ("{1}x{0} px".format(*shape) for shape in (light.shape, self._shape))
            raise TaskError(f"{file}: found {size}, expected {first} as in {self.files[0].name}")
        return light

    def log_light(self, k: int) -> NDArray[np.float64]:
        """Return the log of light plus dark level, (H, W)."""
        return np.log(self.light(k).astype(np.float64) + DARK)

    def footage(self) -> Footage:
        """Return the frames as footage with white at 1, each at the middle of its exposure."""
        height, width = self._shape
        first_us = int(self.middle_us[0])
        return Footage(
            path=self.files[0].parent,
            t_s=np.asarray(1e-6 * (self.middle_us - first_us), np.float64),
            t_offset_us=first_us,
            height=height,
            width=width,
            encoding=self.encoding,
            white_level=1.0,
            frames=lambda: map(self._in_units_of_white, self.files, read_images(list(self.files))),
        )

    def later(self, shift_us: int) -> RecordedFrames:
        """Return the same frames with all times shifted."""
        return replace(self, start_us=self.start_us + shift_us, end_us=self.end_us + shift_us)


def open_frames(
    folder: str | Path,
    *,
    time_unit: str | None = None,
    exposure_us: int | None = None,
    encoding: str | None = None,
) -> RecordedFrames:
    """Open a folder of frames.

    Parameters
    ----------
    folder
        The folder.
    time_unit
        Unit of images.txt or timestamps.txt: s, ms, us or ns.
    exposure_us
        Length of all exposures, for files that do not state it; without it, exposures are taken as
        instants, with a warning.
    encoding
        Transfer function of the stored numbers, see `sensor.to_linear`; "srgb" by default, and
        "linear" for floats.

    Returns
    -------
    Frames

    Raises
    ------
    TaskError
        The folder has no times, a file is missing or damaged, the times do not ascend, or floats
        have another encoding than "linear".
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise TaskError(f"{folder}: no such folder, expected a folder of frames")
    if exposure_us is not None and exposure_us < 0:
        raise TaskError(f"--exposure-us: found {exposure_us}, expected 0 or more")
    names = FILE_NAME, "images.txt", "timestamps.txt"
    source = next((folder / name for name in names if (folder / name).exists()), None)
    if source is None:
        listed = f"{FILE_NAME} ({','.join(COLUMNS)}), images.txt or timestamps.txt"
        raise TaskError(f"{folder}: needs one of {listed}, and has none")
    if source.name == FILE_NAME:
        for name, given in (("frames-time-unit", time_unit), ("exposure-us", exposure_us)):
            if given is not None:
                raise TaskError(f"{source}: already states the times; leave out --{name} {given}")
        return _checked(source, read_exposures(folder), encoding)
    if source.name == "images.txt":
        starts = _read_list(source, time_unit)
    else:
        files = list_images(folder)
        t_ns = times_ns(folder, files, None, time_unit, option="--frames-time-unit")
        starts = [(round(t / 1000), file.name) for t, file in zip(t_ns, files, strict=True)]
    if exposure_us is None:
        logger.warning(
            "%s: states no exposures; frames count as instants unless --exposure-us is given",
            source,
        )
    exposures = [Exposure(t_us, t_us + (exposure_us or 0), name) for t_us, name in starts]
    return _checked(source, exposures, encoding)


def _checked(source: Path, exposures: list[Exposure], encoding: str | None) -> RecordedFrames:
    """Return the frames of some exposures."""
    files = tuple(source.parent / exposure.file for exposure in exposures)
    if len(files) < 2:
        raise TaskError(f"{source}: frames: found {len(files)}, expected at least 2")
    before = -_LIMIT_US, -_LIMIT_US
    for file, (start, end, _) in zip(files, exposures, strict=True):
        if not file.is_file():
            raise TaskError(f"{source}: lists {file.name}, but there is no file {file}")
        possible = {
            "times between -2^61 and 2^61 us": max(abs(start), abs(end)) < _LIMIT_US,
            f"a start after {before[0]} us": start > before[0],
            f"a middle after {sum(before) / 2:.1f} us": start + end > sum(before),
        }
        for expected, is_possible in possible.items():
            if not is_possible:
                exposure = f"an exposure from {start} to {end} us"
                raise TaskError(f"{source}, {file.name}: found {exposure}, expected {expected}")
        before = start, end
    start_us, end_us = np.array([exposure[:2] for exposure in exposures], np.int64).T
    coding = coding_of(next(read_images([files[0]])), encoding, "srgb", files[0])
    if has_transparency(files[0]):
        logger.warning("%s: transparency is ignored; transparent pixels become visible", source)
    return RecordedFrames(files, start_us, end_us, *coding)


def _read_list(listed: Path, time_unit: str | None) -> list[tuple[int, str]]:
    """Return the times in an images.txt, us, and the names of the images."""
    if time_unit is None or time_unit not in TIME_UNITS:
        expected = "expected --frames-time-unit s, ms, us or ns"
        raise TaskError(f"{listed}: unit: found {time_unit or 'none'}, {expected}")
    with reading(listed, "text", TaskError):
        lines = listed.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    starts = []
    for k, line in enumerate(lines, start=1):
        if not (text := line.partition("#")[0].strip()):
            continue
        try:
            time, name = text.split(maxsplit=1)  # a name may have spaces
            t_us = int(np.int64(round(Decimal(time).scaleb(TIME_UNITS[time_unit]))))
        except (ArithmeticError, ValueError):
            raise TaskError(f"{listed}:{k}: found {text!r}, expected a time and a file") from None
        starts.append((t_us, name))
    return starts


def check_frames(recording: Recording, frames: RecordedFrames) -> None:
    """Check that frames and events are of one camera and on one clock.

    Parameters
    ----------
    recording, frames
        The events and frames.

    Raises
    ------
    TaskError
        The frames have another size than the sensor, or no two of them lie within the events.
    """
    height, width = frames.light(0).shape
    if (width, height) != recording.size:
        sensor = "the sensor has {}x{} px".format(*recording.size)
        raise TaskError(f"{frames.files[0]}: the frame has {width}x{height} px, but {sensor}")
    if not inside(recording, frames):
        ends_us = frames.start_us[0], frames.end_us[-1], recording.start_us, recording.end_us
        spans = "the frames cover {:.6f} to {:.6f} s, the events {:.6f} to {:.6f} s"
        raise TaskError(
            f"{recording.path}: {spans.format(*(1e-6 * int(t_us) for t_us in ends_us))}; two "
            "successive frames must lie within the events; --frames-shift-us shifts the frames"
        )


def inside(recording: Recording, frames: RecordedFrames, margin_us: int = 0) -> list[int]:
    """Find the pairs of successive frames within a recording.

    Parameters
    ----------
    recording, frames
        The events and frames.
    margin_us
        Least time from the exposures to the first and last event, microseconds.

    Returns
    -------
    The index of the first frame of each pair.
    """
    within = frames.start_us >= recording.start_us + margin_us
    within &= frames.end_us <= recording.end_us - margin_us
    return np.flatnonzero(within[:-1] & within[1:]).tolist()


def sums(events: Events, frames: RecordedFrames, k: int, shift_us: int = 0) -> NDArray[np.float64]:
    """Add up the events from frame k to frame k + 1, weighted by the exposures.

    Parameters
    ----------
    events
        The events of the pair.
    frames, k
        The frames, and the index of the first one of the pair.
    shift_us
        Added to the times of the frames, microseconds.

    Returns
    -------
    (2, H, W) weighted numbers of the brighter and of the darker events.
    """
    t_us = events.t_us - shift_us
    weight = _share(t_us, frames, k) - _share(t_us, frames, k + 1)
    size = events.height * events.width
    place = events.y.astype(np.int64) * events.width + events.x + size * (events.p < 0)
    both = np.bincount(place, weight, 2 * size).astype(np.float64, copy=False)
    return both.reshape(2, events.height, events.width)


def _share(t_us: NDArray[np.int64], frames: RecordedFrames, k: int) -> NDArray[np.float64]:
    """Return the share of exposure k that is over at each time; a step if it is an instant."""
    start_us, end_us = int(frames.start_us[k]), int(frames.end_us[k])
    if start_us == end_us:
        return (t_us >= start_us).astype(np.float64)
    return np.clip((t_us - start_us) / (end_us - start_us), 0.0, 1.0)
