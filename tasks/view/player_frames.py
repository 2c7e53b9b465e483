"""The frames behind the events of a page: few enough, and small enough, for a browser."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass

from PIL import Image

from tasks.view.event_file import EventSource

MAX_FRAMES = 200
"""Largest number of frames behind one file; of more, every second, third, ... is kept."""
MAX_PIXELS = 48_000_000
"""Largest number of pixels in all frames of a page; a browser needs 4 bytes for each."""
_MAX_PX = 640  # frames for wider sensors are scaled down
_WEBP_QUALITY = 60


@dataclass(frozen=True, slots=True)
class PackedFrames:
    """Frames behind the events of one file, for the page.

    Parameters
    ----------
    t_us
        Times from which they are shown, ascending, us after the start of the page.
    """

    t_us: list[int]
    images: list[str]


def pack_frames(
    sources: Sequence[EventSource], span_us: tuple[int, int]
) -> list[PackedFrames | None]:
    """Pack the frames behind files of events.

    Parameters
    ----------
    span_us
        The part that is shown, [start, end), us.
    """
    sizes = [_size(source) for source in sources if source.frames is not None]
    pixels = sum(width * height for width, height in sizes)
    limit = max(1, min(MAX_FRAMES, MAX_PIXELS // max(pixels, 1)))
    return [_packed(source, span_us, limit) for source in sources]


def _size(source: EventSource) -> tuple[int, int]:
    width, height = source.size
    scale = min(1.0, _MAX_PX / width)
    return max(1, round(scale * width)), max(1, round(scale * height))


def _packed(source: EventSource, span_us: tuple[int, int], limit: int) -> PackedFrames | None:
    if source.frames is None:
        return None
    times_us = source.frames.times_us(*span_us)
    times_us = times_us[:: -(-len(times_us) // limit)]
    images = []
    for t_us in times_us:
        picture, file = source.frames.seen_by(*_size(source), t_us), io.BytesIO()
        Image.fromarray(picture).save(file, "WEBP", quality=_WEBP_QUALITY, method=4)
        images.append(base64.b64encode(file.getvalue()).decode())
    return PackedFrames([t_us - span_us[0] for t_us in times_us], images)
