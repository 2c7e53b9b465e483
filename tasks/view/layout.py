"""Put panels side by side, each with two lines of caption."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from tasks.view.drawing import Palette, Picture, plain, resized

_SMALL_PX = 360  # pictures of less height are enlarged by an integer factor
_GAP_PX, _MARGIN_PX = 8, 4
_TEXT_SHARE = 0.065  # size of the text over the height of the pictures
_MIN_TEXT_PX, _MAX_TEXT_PX = 12, 24
_FINER = 4  # letters are drawn this much larger and averaged, for positions between pixels
_OPACITY = np.arange(256)[:, None] / 255


@dataclass(frozen=True, slots=True)
class Panel:
    """One source at one time: a picture (H, W, 3), what it shows, and its numbers at this time."""

    picture: Picture
    title: str
    detail: str


class Layout:
    """Scales pictures of several sizes to one height, and draws their captions and a footer.

    `sizes` are (width, height), px. If no `height` of the pictures is given, it is the height of
    the tallest, or a multiple of it for small sensors, and the result without captions fits `most`.
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
        self._lefts = [sum(self._widths[:k]) + k * _GAP_PX for k in range(len(sizes))]
        self._palette = palette
        self._text_px = self._page_px = 0  # measured on the first picture

    def draw(self, panels: Sequence[Panel], footer: str) -> Picture:
        """Draw panels over a footer: (H, W, 3), H and W constant, and even as videos require."""
        if not self._text_px:
            self._measure(panels, footer)
        line = round(1.4 * self._text_px)
        below = self._height + _GAP_PX // 2
        height = below + 3 * line + 2 * _GAP_PX
        page = plain(self._page_px, height + height % 2, self._palette.page)
        for panel, left, width in zip(panels, self._lefts, self._widths, strict=True):
            picture = resized(panel.picture, width, self._height)
            page[: self._height, left : left + width] = picture
            self._write(page, left, below, panel.title, width)
            self._write(page, left, below + line, panel.detail, width, dim=True)
        self._write(page, 0, below + _GAP_PX + 2 * line, footer, self._page_px, dim=True)
        return page

    def _measure(self, panels: Sequence[Panel], footer: str) -> None:
        """Choose text that fits below the narrowest picture, and a page that fits the footer."""
        size = min(max(round(_TEXT_SHARE * self._height), _MIN_TEXT_PX), _MAX_TEXT_PX)
        captions = [line for panel in panels for line in (panel.title, panel.detail)]
        widest = max(_font(size).getlength(text) for text in captions) + 2 * _MARGIN_PX
        fitting = int(size * min(self._widths) / widest)
        self._text_px = max(_MIN_TEXT_PX, min(size, fitting))
        longest = math.ceil(1.1 * _font(self._text_px).getlength(footer)) + 2 * _MARGIN_PX
        width = max(self._lefts[-1] + self._widths[-1], longest)
        self._page_px = width + width % 2

    def _write(
        self, page: Picture, x: int, y: int, text: str, most: int, dim: bool = False
    ) -> None:
        """Write a line at most `most` px wide, starting at column x."""
        ink, behind = np.array(self._palette.text), np.array(self._palette.page)
        color = (ink + (0.3 if dim else 0.0) * (behind - ink)).astype(int)
        letters = _letters(text, self._text_px, most - 2 * _MARGIN_PX)
        height, width = letters.shape
        shades = np.round(behind + _OPACITY * (color - behind)).astype(np.uint8)
        page[y : y + height, x + _MARGIN_PX :][:, :width] = shades[letters]


@lru_cache
def _letters(text: str, size_px: int, most: int) -> NDArray[np.uint8]:
    """Return the (H, W) opacity of a line of text, at most `most` px wide."""
    font = _font(_FINER * size_px)
    width = min(math.ceil(font.getlength(text) / _FINER), most)
    mask = Image.new("L", (_FINER * max(width, 1), _FINER * round(1.4 * size_px)))
    ImageDraw.Draw(mask).text((0, 0), text, 255, font=font)
    return np.asarray(mask.reduce(_FINER))


@lru_cache
def _font(size: int) -> Any:
    return ImageFont.load_default(size)
