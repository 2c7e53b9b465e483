"""Options of `eres evaluate`, `eres fit` and `eres video` for files of events."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tasks.errors import TaskError
from tasks.events.reading import SHIFT_LIMIT_US

if TYPE_CHECKING:
    from tasks.recording.frames import RecordedFrames


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameOptions:
    """Frames of the same camera, for a file of events.

    Parameters
    ----------
    frames
        Folder with frames.csv (t_us_start,t_us_end,file), images.txt or timestamps.txt, and the
        images.
    frames_time_unit
        Unit of images.txt or timestamps.txt: s, ms, us or ns.
    exposure_us
        Length of all exposures, microseconds, unless frames.csv has it.
    frames_shift_us
        Add this to the times of the frames, microseconds.
    estimate_shift
        Estimate the shift of the frames, up to 20 ms, that fits the events best.
    encoding
        Transfer function of the frames: srgb (by default), rec709, linear (floats always are), or
        gamma:2.2.
    """

    frames: Path | None = None
    frames_time_unit: str | None = None
    exposure_us: int | None = None
    frames_shift_us: int | None = None
    estimate_shift: bool = False
    encoding: str | None = None

    @property
    def shift_us(self) -> int | None:
        """Shift of the frames, microseconds; None to estimate it."""
        if self.estimate_shift and self.frames_shift_us is not None:
            raise TaskError("give --frames-shift-us or --estimate-shift, not both")
        shift_us = self.frames_shift_us or 0
        if abs(shift_us) >= SHIFT_LIMIT_US:
            raise TaskError(f"--frames-shift-us: found {shift_us}, expected between -2^62 and 2^62")
        return None if self.estimate_shift else shift_us

    def open_frames(self) -> RecordedFrames | None:
        """Open the frames, None if there are none."""
        from tasks.recording.frames import open_frames

        if self.frames is not None:
            unit, exposure_us = self.frames_time_unit, self.exposure_us
            return open_frames(
                self.frames, time_unit=unit, exposure_us=exposure_us, encoding=self.encoding
            )
        for name, value in asdict(self).items():
            if value != getattr(NO_FRAMES, name):
                raise TaskError(f"--{name.replace('_', '-')} {value} needs --frames")
        return None


NO_FRAMES = FrameOptions()


@dataclass(frozen=True, slots=True, kw_only=True)
class FlowOptions:
    """Windows and patches of optical flow, for a file of events.

    Parameters
    ----------
    window_ms
        Length of a window, milliseconds; by default one in which events move by 4 px, at most 500
        ms. With frames, a window lasts from one frame to the next.
    windows
        Largest number of windows, spread evenly over the recording.
    features
        Largest number of patches in a window.
    patch_px
        Side of a patch, px.
    search_px
        Largest flow to look for, px per window along each axis; by default a sixteenth of the
        width.
    """

    window_ms: float | None = None
    windows: int = 20
    features: int = 30
    patch_px: int = 33
    search_px: float | None = None


USUAL_FLOW = FlowOptions()


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoOptions:
    """Images to make.

    Parameters
    ----------
    method
        Name (`eres methods` lists them under video), or your own class as package.module:class.
    fps
        Images per second.
    start
        Time of the first image, seconds on the clock of the events; by default one step after the
        first event.
    end
        Time after which there are no images, seconds; by default just after the last event.
    equalization
        Equalization of the images' histograms: none, global, local, or clahe (local, with limited
        contrast).
    """

    method: str = "high_pass_filter"
    fps: float = 30.0
    start: float | None = None
    end: float | None = None
    equalization: str = "none"


USUAL_VIDEO = VideoOptions()
