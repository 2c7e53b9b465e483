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
    """Return the pairs within a recording, as the index of their first frame.

    Parameters
    ----------
    margin_us
        Least time from the exposures to the first and last event, microseconds.
    """
    within = frames.start_us >= recording.start_us + margin_us
    within &= frames.end_us <= recording.end_us - margin_us
    return np.flatnonzero(within[:-1] & within[1:]).tolist()


def events_of(
    recording: Recording, frames: RecordedFrames, pairs: Sequence[int], margin_us: int = 0
) -> Iterator[Events]:
    """Cut out the events of each pair, from the start of its first exposure to the end of its last.

    Parameters
    ----------
    margin_us
        How much earlier to begin and later to end, microseconds.
    """
    starts_us, ends_us = frames.start_us.tolist(), frames.end_us.tolist()
    windows = [(starts_us[k] - margin_us, ends_us[k + 1] + margin_us) for k in pairs]
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
    for image, its in ((on, events.p > 0), (off, events.p < 0)):
        image.ravel()[:] = np.bincount(pixel[its], weight[its], shape[0] * shape[1])
    return PairSums(on, off)


def _share(t_us: NDArray[np.int64], frames: RecordedFrames, k: int) -> NDArray[np.float64]:
    """Return the share of exposure k that is over at each time; a step if it is an instant."""
    start_us, end_us = int(frames.start_us[k]), int(frames.end_us[k])
    if start_us == end_us:
        return (t_us >= start_us).astype(np.float64)
    return np.clip((t_us - start_us) / (end_us - start_us), 0.0, 1.0)
