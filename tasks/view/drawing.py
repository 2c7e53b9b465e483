"""Draw events, light, depth and flow as colors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.Image import Resampling

from sensor.compiling import compiler
from sensor.events import Columns, Events
from tasks.errors import TaskError

jit = compiler(Path(__file__).parent)

Color = tuple[int, int, int]
Picture = NDArray[np.uint8]  # (H, W, 3) red, green, blue

STRENGTHS = (0.0, 0.65, 0.85, 1.0)
"""Opacity of a pixel whose polarities sum to 0, 1, 2, and 3 or more in magnitude."""

_GAMMA = 2.2


@dataclass(frozen=True, slots=True)
class Palette:
    """Colors of a picture, red, green and blue from 0 to 255.

    Parameters
    ----------
    brighter, darker
        Colors of pixels that became brighter and darker.
    ground
        Color behind the events.
    page, text
        Colors of the captions: background and letters.
    """

    brighter: Color
    darker: Color
    ground: Color
    page: Color
    text: Color


# Blue and vermilion, white and blue: distinct also with the common color vision deficiencies.
PALETTES = {
    "blue-red": Palette(
        brighter=(20, 92, 220),
        darker=(222, 72, 20),
        ground=(244, 244, 241),
        page=(255, 255, 255),
        text=(40, 44, 50),
    ),
    "dark": Palette(
        brighter=(255, 255, 255),
        darker=(64, 140, 255),
        ground=(22, 26, 33),
        page=(13, 16, 21),
        text=(214, 219, 226),
    ),
}


def plain(width: int, height: int, color: Color) -> Picture:
    """Return a picture of one color.

    Parameters
    ----------
    width, height
        Its size, px.
    color
        Its color.

    Returns
    -------
    (height, width, 3) uint8.
    """
    return np.full((height, width, 3), color, np.uint8)


def draw_events(events: Events, ground: Picture, palette: Palette) -> Picture:
    """Draw the sum of polarities of each pixel over a picture.

    Parameters
    ----------
    events
        Events of one window.
    ground
        (height, width, 3) uint8, of the sensor's size.
    palette
        The colors; see `STRENGTHS` for their opacity.

    Returns
    -------
    (height, width, 3) uint8.

    Raises
    ------
    TaskError
        The picture is not of the sensor's size.
    """
    if ground.shape != (events.height, events.width, 3):
        raise TaskError(
            f"ground: found shape {ground.shape}, expected {(events.height, events.width, 3)}"
        )
    picture = ground.copy()
    total = np.zeros(ground.shape[:2], np.int32)
    colors = np.array([palette.darker, palette.brighter], np.float64)
    _blend(events.columns, colors, np.array(STRENGTHS), total, picture)
    return picture


@jit
def _blend(
    events: Columns,
    colors: NDArray[np.float64],
    strengths: NDArray[np.float64],
    total: NDArray[np.int32],
    picture: Picture,
) -> None:
    for k in range(events.x.size):
        total[events.y[k], events.x[k]] += events.p[k]
    height, width = total.shape
    for y in range(height):
        for x in range(width):
            if total[y, x]:
                strength = strengths[min(abs(total[y, x]), strengths.size - 1)]
                color = colors[np.int64(total[y, x] > 0)]
                for c in range(3):
                    mixed = strength * color[c] + (1 - strength) * picture[y, x, c]
                    picture[y, x, c] = np.uint8(mixed + 0.5)


def tone_mapped(radiance: NDArray[np.float32], white_level: float) -> Picture:
    """Return radiance as gray levels for a screen, with a gamma of 2.2.

    Parameters
    ----------
    radiance
        (H, W) linear radiance.
    white_level
        Radiance shown as white; brighter light is clipped.

    Returns
    -------
    (H, W, 3) uint8.
    """
    levels = np.clip(radiance / np.float32(white_level), 0, 1) ** np.float32(1 / _GAMMA)
    return np.repeat(np.round(255 * levels).astype(np.uint8)[..., None], 3, axis=2)


def depth_colors(depth: NDArray[np.floating], near_m: float, far_m: float) -> Picture:
    """Return depth in the colors of viridis: near is yellow, far is dark blue, infinite is black.

    Parameters
    ----------
    depth
        (H, W) z-depth, m; inf where nothing is seen.
    near_m, far_m
        Ends of the scale, m. It is linear in 1 / depth, like the motion in the image.

    Returns
    -------
    (H, W, 3) uint8.
    """
    import cv2

    near, far = 1 / near_m, 1 / far_m
    share = (1 / depth - far) / max(near - far, 1e-12)
    codes = np.round(255 * np.clip(share, 0, 1)).astype(np.uint8)
    colors = np.asarray(cv2.applyColorMap(codes, cv2.COLORMAP_VIRIDIS)[..., ::-1], np.uint8).copy()
    colors[~np.isfinite(depth)] = 0
    return colors


def flow_colors(flow: NDArray[np.floating], longest: float) -> Picture:
    """Return flow on a color wheel: direction as hue, length as saturation, no motion is white.

    Parameters
    ----------
    flow
        (H, W, 2) x and y; (1, 0) is red, and hue turns clockwise as seen, toward +y.
    longest
        Length that is fully saturated, in the unit of `flow`.

    Returns
    -------
    (H, W, 3) uint8.
    """
    import cv2

    u, v = flow[..., 0].astype(np.float32), flow[..., 1].astype(np.float32)
    length, degrees = cv2.cartToPolar(u, v, angleInDegrees=True)
    saturation = np.clip(length / max(longest, 1e-12), 0, 1).astype(np.float32)
    hsv = np.dstack([degrees, saturation, np.ones_like(saturation)])
    return np.round(255 * cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)).astype(np.uint8)


def resized(picture: Picture, width: int, height: int) -> Picture:
    """Scale a picture: pixels become squares if it grows, and are averaged if it shrinks.

    Parameters
    ----------
    picture
        (H, W, 3) uint8.
    width, height
        New size, px.

    Returns
    -------
    (height, width, 3) uint8.
    """
    grows = width >= picture.shape[1] and height >= picture.shape[0]
    how = Resampling.NEAREST if grows else Resampling.BOX
    return np.asarray(Image.fromarray(picture).resize((width, height), how))
