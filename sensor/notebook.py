"""How `Events` look in a notebook: what they are, and the events of a window as a picture."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from sensor.events import Events

_PER_EVENT = 10  # pixels for each event of the picture
_MIN_PX, _MAX_PX = 320, 640  # of the picture's longer side
_OFF, _GROUND, _ON = (222, 72, 20), (244, 244, 241), (20, 92, 220)


def html_of(events: Events) -> str:
    """Return the events as HTML: one line of text, and a picture of a window in their middle."""
    text = repr(events)
    if len(events) == 0:
        return f"<code>{text}</code>"
    count = max(1, events.width * events.height // _PER_EVENT)
    start = max(0, (len(events) - count) // 2)
    window = slice(start, start + count)
    t_us = events.t_us[window]
    code = base64.b64encode(_png(events, window)).decode()
    caption = f"{len(t_us)} events in {1e-3 * (t_us[-1] - t_us[0]):.3g} ms from {t_us[0]} us"
    return (
        f"<code>{text}</code><br>"
        f'<img src="data:image/png;base64,{code}" alt="{caption}: ON blue, OFF red"><br>{caption}'
    )


def _png(events: Events, window: slice) -> bytes:
    from PIL import Image  # here, as few sessions draw

    balance = np.zeros((events.height, events.width), np.int64)
    np.add.at(balance, (events.y[window], events.x[window]), events.p[window])
    colors = np.array([_OFF, _GROUND, _ON], np.uint8)[np.sign(balance) + 1]
    side = max(events.width, events.height)
    picture = Image.fromarray(colors)
    if side < _MIN_PX:
        times = -(-_MIN_PX // side)
        picture = picture.resize((times * events.width, times * events.height), 0)
    picture.thumbnail((_MAX_PX, _MAX_PX))
    file = io.BytesIO()
    picture.save(file, "PNG")
    return file.getvalue()
