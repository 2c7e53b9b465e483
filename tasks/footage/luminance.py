"""Linear luminance of images as files store them."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sensor.encoding import to_linear
from sensor.levels import DARK_SHARE, white_level
from tasks.errors import TaskError

_log = logging.getLogger(__name__)

Float32 = NDArray[np.float32]

_BT709 = np.array([0.2126, 0.7152, 0.0722], np.float32)  # ITU-R BT.709-6, item 3.2


class Luminance:
    """Converts stored numbers to linear luminance; mends and counts floats that are no light.

    Luminance below 0 by at most the dark level, a thousandth of white, becomes black: filters with
    negative lobes leave it beside edges. A pixel that is NaN, infinite or further below 0 is an
    error that ends with `advice`; with `repair` it gets the median of its valid neighbors in 3 x 3
    px.
    """

    def __init__(
        self, encoding: str, white_level: float, repair: bool = False, advice: str = ""
    ) -> None:
        codes = [np.arange(np.iinfo(kind).max + 1, dtype=kind) for kind in (np.uint8, np.uint16)]
        self._light = {code.dtype.name: to_linear(code, encoding) for code in codes}
        self._least = -DARK_SHARE * white_level
        self._repair = repair
        self._advice = advice
        # Pixels by file, as footage may be read several times.
        self._black: dict[Path, int] = {}
        self._repaired: dict[Path, int] = {}

    def __call__(self, file: Path, image: NDArray[np.generic]) -> Float32:
        """Return the luminance of an image, (H, W) float32, finite, 0 or more.

        The image is (H, W) or (H, W, 3) red, green, blue; uint8, uint16, or floats, which are
        linear.
        """
        if image.dtype.kind == "u":
            return _without_color(self._light[image.dtype.name][image])
        light = _without_color(image)
        if light.min() >= 0 and light.max() < np.inf:  # NaN shows in both
            return light
        valid = np.isfinite(light) & (light >= self._least)
        invalid = int(np.sum(~valid))
        if invalid and not (self._repair and valid.any()):
            y, x = np.argwhere(~valid)[0]
            raise TaskError(
                f"{file}: {light[y, x]:g} at pixel x={x} y={y} is invalid; {invalid} of "
                f"{light.size} pixels are negative or not finite"
                f"{'' if self._repair else self._advice}"
            )
        if black := int(np.sum(valid & (light < 0))):
            self._black[file] = black
        if not invalid:
            return np.maximum(light, 0)
        self._repaired[file] = invalid
        return _filled(np.where(valid, np.maximum(light, 0), np.float32(np.nan)))

    def warn(self, footage: Path) -> None:
        """Warn of the pixels that were mended, if there were any."""
        for counts, what in (
            (self._black, "slightly below 0, and become black"),
            (self._repaired, "not finite or below 0, and get the median of their neighbors"),
        ):
            if counts:
                number = sum(counts.values()), len(counts)
                _log.warning("%s: %d pixels in %d frames were %s", footage, *number, what)


def coding_of(
    first: NDArray[np.generic], given: str | None, usual: str, path: Path
) -> tuple[str, float]:
    """Return the encoding of images like the first, and the light of white.

    White is 1, but for floats the 99.9th percentile of the finite pixels of the first image.
    """
    if first.dtype.kind != "f":
        return given or usual, 1.0
    if given not in (None, "linear"):
        raise TaskError(f"{path}: images of floats are linear; leave out --encoding {given}")
    light = _without_color(first)
    finite = light[np.isfinite(light)]
    white = white_level(finite) if finite.size else 0.0
    if white <= 0:
        raise TaskError(f"{path}: the first frame defines white, but is black or not finite")
    return "linear", white


def _without_color(light: NDArray[np.generic]) -> Float32:
    linear: Float32 = light.astype(np.float32, copy=False)
    return linear if linear.ndim == 2 else linear @ _BT709


def _filled(light: Float32) -> Float32:
    """Return an image in which NaN pixels have the median of their neighbors, from the rim in."""
    padded = np.pad(light, 1, constant_values=np.nan)
    inside = padded[1:-1, 1:-1]
    while np.isnan(inside).any():
        y, x = np.nonzero(np.isnan(inside))
        around = np.stack([padded[y + dy, x + dx] for dy in range(3) for dx in range(3)])
        known = ~np.isnan(around).all(axis=0)
        inside[y[known], x[known]] = np.nanmedian(around[:, known], axis=0)
    return inside
