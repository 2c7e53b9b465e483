"""Estimate how many frames a render has, and what they take."""

from __future__ import annotations

import time
import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eres_render.progress import cost
from eres_render.rendering.renderer import Renderer
from eres_render.sequence.clips import Clip
from eres_render.trajectory.frame_times import adaptive_times

_CLIPS = 3  # whose frames are counted
_FIRST_S = 10.0  # a frame that is faster is rendered again, as the first one compiles


def estimate(
    renderer: Renderer, clips: Sequence[Clip], max_displacement_px: float
) -> tuple[float, str]:
    """Return the time that clips take, s, and a line with their frames, disk space and time.

    Frames of a few clips are counted, and a single frame is rendered, timed and compressed.
    """
    chosen = [clips[int(k)] for k in np.unique(np.linspace(0, len(clips) - 1, _CLIPS).round())]
    counted = [
        len(adaptive_times(renderer.image_motion, clip.marks_s, max_displacement_px))
        for clip in chosen
    ]
    lengths_s = [clip.t_window_end_s - clip.anchor_s for clip in chosen]
    total_s = sum(clip.t_window_end_s - clip.t_start_s for clip in clips)
    frames = round(total_s * sum(counted) / sum(lengths_s))
    at_s = chosen[0].t_window_start_s
    for _ in range(2):
        started_s = time.perf_counter()
        frame = renderer.frame(renderer.trajectory.pose(at_s), t_s=at_s)
        frame_s = time.perf_counter() - started_s
        if frame_s > _FIRST_S:
            break
    disk_bytes = frames * _compressed_bytes(frame.astype(np.float16))
    camera, plural = renderer.camera, "s" * (len(clips) != 1)
    return frames * frame_s, (
        f"{len(clips)} sequence{plural} to render: about {frames} frames of "
        f"{camera.width}x{camera.height} px, {cost(disk_bytes, frames * frame_s)}"
    )


def _compressed_bytes(frame: NDArray[np.float16]) -> int:
    """Return the size of a frame as OpenEXR's ZIP compresses it: differences of low, then high
    bytes."""
    apart = frame.view(np.uint8).reshape(-1, 2).T.ravel()
    return len(zlib.compress(np.diff(apart, prepend=apart[:1]).tobytes(), 4))
