"""The picture and captions of one source at one time."""

from __future__ import annotations

from dataclasses import dataclass

from tasks.view.drawing import Picture


@dataclass(frozen=True, slots=True)
class Panel:
    """One source at one time.

    Parameters
    ----------
    picture
        (H, W, 3) uint8.
    title, detail
        Two lines of caption: what the picture shows, and its numbers at this time.
    """

    picture: Picture
    title: str
    detail: str
