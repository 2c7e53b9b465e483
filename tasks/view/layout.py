"""Put panels side by side, each with two lines of caption."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from tasks.view.drawing import Palette, Picture, resized
from tasks.view.panel import Panel

_SMALL_PX = 360  # lower pictures grow, by a whole factor
_GAP_PX = 8
_TEXT_SHARE = 0.065  # of the height of the pictures
_SMALLEST_TEXT_PX, _LARGEST_TEXT_PX = 12, 24
_FINER = 4  # letters are drawn this much larger and averaged, which places them between pixels


class Layout:
    """Scales pictures of several sizes to one height, and draws their captions and a footer.

    Parameters
    ----------
    sizes
        Width and height of each picture, px.
    most
        Width and height that the result must not exceed, px, except for captions.
    palette
        Colors of captions and footer.
    height
        Height of the pictures, px; by default that of the largest, or a multiple of it for small
        sensors.
    """

    def __init__(
        self,
        sizes: Sequence[tuple[int, int]],
        most: tuple[int, int],
        palette: Palette,
        height: int | None = None,
    ) -> None:
        shapes = [width / height for width, height in sizes]
        if height is None:
            tallest = max(height for _, height in sizes)
            height = tallest * math.ceil(_SMALL_PX / tallest)
            room = most[0] - _GAP_PX * (len(sizes) - 1)
            height = max(1, min(height, most[1], int(room / sum(shapes))))
        self._height = height
        self._widths = [max(1, round(shape * height)) for shape in shapes]
        self._palette = palette

    def draw(self, panels: Sequence[Panel], footer: str) -> Picture:
        """Draw panels.

        Parameters
        ----------
        panels
            One for each of the sizes.
        footer
            A line below all of them.

        Returns
        -------
        (H, W, 3) uint8, H and W even, as videos need it.
        """
        starts = np.cumsum([0, *(width + _GAP_PX for width in self._widths)])
        width = int(starts[-1]) - _GAP_PX
        rows = [line for panel in panels for line in (panel.title, panel.detail)]
        size = self._text_px([*rows, footer])
        line = round(1.4 * size)
        below = self._height + _GAP_PX // 2
        height = below + 3 * line + 2 * _GAP_PX
        page = Image.new("RGB", (width + width % 2, height + height % 2), self._palette.page)
        for panel, left, wide in zip(panels, starts, self._widths, strict=False):
            picture = resized(panel.picture, wide, self._height)
            page.paste(Image.fromarray(picture), (int(left), 0))
            self._write(page, int(left), below, panel.title, size)
            self._write(page, int(left), below + line, panel.detail, size, dim=True)
        self._write(page, 0, below + _GAP_PX + 2 * line, footer, size, dim=True)
        return np.asarray(page)

    def _text_px(self, texts: Sequence[str]) -> int:
        """Return the size of the letters: all captions fit below the narrowest picture."""
        size = round(_TEXT_SHARE * self._height)
        size = min(max(size, _SMALLEST_TEXT_PX), _LARGEST_TEXT_PX)
        widest = max(_font(size).getlength(text) for text in texts[:-1])
        share = (min(self._widths) - 8) / max(widest, 1)
        return max(_SMALLEST_TEXT_PX, min(size, int(size * share)))

    def _write(
        self, page: Image.Image, x: int, y: int, text: str, size: int, dim: bool = False
    ) -> None:
        text_color, behind = np.array(self._palette.text), np.array(self._palette.page)
        color = text_color + (0.3 if dim else 0.0) * (behind - text_color)
        font = _font(_FINER * size)
        wide, high = math.ceil(font.getlength(text) / _FINER), round(1.4 * size)
        mask = Image.new("L", (_FINER * wide, _FINER * high))
        ImageDraw.Draw(mask).text((0, 0), text, 255, font=font)
        page.paste(tuple(color.astype(int)), (x + 4, y), mask.reduce(_FINER))


@lru_cache
def _font(size: int) -> Any:
    return ImageFont.load_default(size)
