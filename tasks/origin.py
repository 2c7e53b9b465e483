"""Where the events of a file come from: the sequence of frames, and the window on their clock.

Also the names of files in texts.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

from eres_render import RadianceSequence
from sensor.formats.header import Value


def in_text(name: str) -> str:
    """Return a file's name with U+FFFD for bytes that are not UTF-8, as no text can hold them."""
    return os.fsencode(name).decode("utf-8", "replace")


def origin_of(sequence: RadianceSequence, speed: float = 1.0) -> dict[str, Value]:
    """Return where the frames of a sequence come from, and its window on the events' clock.

    Parameters
    ----------
    sequence
        The sequence.
    speed
        Factor by which the scene moves faster than it was rendered.

    Returns
    -------
    Names and values, for `tasks.events.simulation.simulate_frames`.
    """
    manifest = sequence.manifest
    window_us = [sequence.t_offset_us + round(t_s / speed * 1e6) for t_s in sequence.window_s]
    return {
        "scene": manifest.scene,
        "clip": manifest.clip,
        "samples_per_pixel": manifest.spp,
        "window_start_us": window_us[0],
        "window_end_us": window_us[1],
    }


def shift_us(sequence: RadianceSequence, origin: Mapping[str, Value], speed: float = 1.0) -> int:
    """Return how far the events of a sequence were shifted since, as by `eres convert --shift-us`.

    It is 0 if the events are of another sequence, such as another stretch of the path.
    """
    then = origin_of(sequence, speed)
    window_us = [origin.get("window_start_us"), origin.get("window_end_us")]
    start_us, end_us = (t_us if isinstance(t_us, int) else 0 for t_us in window_us)
    then_us, then_end_us = int(then["window_start_us"]), int(then["window_end_us"])
    is_same = all(origin.get(name) == then[name] for name in ("scene", "clip"))
    return start_us - then_us if is_same and end_us - start_us == then_end_us - then_us else 0
