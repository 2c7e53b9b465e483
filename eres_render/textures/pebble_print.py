"""A print of a bed of stones: each a dome, shaded by a low sun and a blurred sky."""

from __future__ import annotations

import numpy as np

from eres_render.textures.fractal_noise import Float32
from eres_render.textures.reflectance import saturated
from eres_render.textures.relief import faces_of, lit
from eres_render.textures.stones import MIDDLE_FROM, unlit_bed

_SUN = (-0.45, -0.55, 0.70)  # toward the light that shades the stones: left, above, out of the bed
_SKY = 0.45  # share of the light that comes from everywhere

# Middle of the log reflectance after its contrast is reduced, as if by ink.
_MIDDLE_TO, _CONTRAST = -1.42, 0.45


def pebble_print(width_px: int, height_px: int, texel_m: float, seed: int) -> Float32:
    """Return the reflectance of a print of a bed of stones; `texel_m` is a size in the bed."""
    log_reflectance, relief = unlit_bed(width_px, height_px, texel_m, seed)
    log_reflectance += _log_shading(relief)
    return saturated(_MIDDLE_TO + _CONTRAST * (log_reflectance - MIDDLE_FROM))


def _log_shading(relief: Float32) -> Float32:
    """Return the log of the light on a relief, heights in texels: the sun with shadows, the sky."""
    import cv2

    sun = np.array(_SUN) / np.linalg.norm(_SUN)
    faces = faces_of(relief)
    buried = np.zeros_like(relief)
    for size_px in (2, 8, 32):
        # Blurring at a coarser scale loses nothing, and is 20 times faster.
        step = min(max(1, size_px // 4), *relief.shape)
        small = cv2.resize(relief, None, fx=1 / step, fy=1 / step, interpolation=cv2.INTER_AREA)
        small = cv2.GaussianBlur(small, (0, 0), size_px / step, borderType=cv2.BORDER_REFLECT)
        around = cv2.resize(small, relief.shape[::-1], interpolation=cv2.INTER_LINEAR)
        buried += np.maximum(around - relief, 0) / np.float32(size_px)
    sky = np.exp(np.float32(-1.2) * buried) * (np.float32(0.5) + np.float32(0.5) * faces.up)
    light = (1 - _SKY) * np.maximum(faces.cosine(*sun), 0) * lit(relief, *sun) + _SKY * sky
    return np.log(light + np.float32(0.015), dtype=np.float32)
