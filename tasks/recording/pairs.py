"""Pairs of consecutive frames, and the sums of events between them.

An exposure averages the light while it lasts. If log intensity changes little meanwhile, the
logarithm of the average is the average of the logarithm, so the change from one frame to the next
is a weighted sum of events: the weight of an event rises from 0 to 1 over the first exposure, with
the share of the exposure before the event, and falls from 1 to 0 over the second.
This is the linear form of the event-based double integral of Pan et al., "Bringing a Blurry Frame
Alive at High Frame-Rate with an Event Camera" (CVPR 2019).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensor import Events
from tasks.errors import TaskError
from tasks.recording.frames import RecordedFrames
from tasks.recording.recording import Recording, cut


@dataclass(frozen=True, eq=False, slots=True)
class PairSums:
    """Weighted numbers of events per pixel from a frame to the next one.

    Parameters
    ----------
    on, off
        (H, W) float64, of the brighter and of the darker events.
    """

    on: NDArray[np.float64]
    off: NDArray[np.float64]


def check_frames(recording: Recording, frames: RecordedFrames) -> None:
    """Check that frames and events are of one camera and on one clock."""
    height, width = frames.light(0).shape
    if (width, height) != recording.size:
        expected = "{}x{}".format(*recording.size)
        raise TaskError(
            f"{frames.files[0]}: found a frame of {width}x{height} px, expected {expected} px, "
            "the size of the sensor: are they of the same camera?"
        )
    if not inside(recording, frames):
        raise TaskError(
            f"{recording.path}: found frames from {_seconds(frames.start_us[0])} to "
            f"{_seconds(frames.end_us[-1])} s and events from {_seconds(recording.start_us)} to "
            f"{_seconds(recording.end_us)} s, expected two consecutive frames within the time of "
            "the events; if their clocks differ, --frames-shift-us moves the frames"
        )


def _seconds(t_us: int) -> str:
    return f"{1e-6 * int(t_us):.6f}"


def inside(recording: Recording, frames: RecordedFrames, margin_us: int = 0) -> list[int]:
    """Return the pairs within a recording, as the index of their first frame.

    Parameters
    ----------
    margin_us
        Least time from the exposures to the first and last event, microseconds.
    """
    kept = (frames.start_us >= recording.start_us + margin_us) & (
        frames.end_us <= recording.end_us - margin_us
    )
    return [int(k) for k in np.flatnonzero(kept[:-1] & kept[1:])]


def events_of(
    recording: Recording, frames: RecordedFrames, pairs: Sequence[int], margin_us: int = 0
) -> Iterator[Events]:
    """Cut out the events of each pair, from the start of its first exposure to the end of its last.

    Parameters
    ----------
    margin_us
        How much earlier to begin and later to end, microseconds.
    """
    windows = [
        (int(frames.start_us[k]) - margin_us, int(frames.end_us[k + 1]) + margin_us) for k in pairs
    ]
    return cut(recording.parts(), windows)


def sums(events: Events, frames: RecordedFrames, k: int, shift_us: int = 0) -> PairSums:
    """Add up the events from frame k to frame k + 1, weighted by the exposures.

    Parameters
    ----------
    shift_us
        Added to the times of the frames, microseconds.
    """
    t_us = events.t_us - shift_us
    weight = _share(t_us, frames, k) - _share(t_us, frames, k + 1)
    pixel = events.y.astype(np.int64) * events.width + events.x
    shape = events.height, events.width
    on, off = np.zeros((2, *shape))
    for image, kept in ((on, events.p > 0), (off, events.p < 0)):
        image.ravel()[:] = np.bincount(pixel[kept], weight[kept], shape[0] * shape[1])
    return PairSums(on, off)


def _share(t_us: NDArray[np.int64], frames: RecordedFrames, k: int) -> NDArray[np.float64]:
    """Return the share of exposure k that is over at each time; a step if it is an instant."""
    start_us, end_us = int(frames.start_us[k]), int(frames.end_us[k])
    if start_us == end_us:
        return (t_us >= start_us).astype(np.float64)
    return np.clip((t_us - start_us) / (end_us - start_us), 0.0, 1.0)
