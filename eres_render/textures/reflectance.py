"""From log reflectance to what a matte surface can reflect."""

from __future__ import annotations

import numpy as np

from eres_render.textures.fractal_noise import Float32

_DARKEST, _BRIGHTEST = 0.02, 0.85  # no dye, wool or rock is darker or brighter


def saturated(log_reflectance: Float32) -> Float32:
    """Return reflectance in [0.02, 0.85], softly saturated; overwrites `log_reflectance`."""
    x = np.exp(log_reflectance, out=log_reflectance)
    x *= 1 / _BRIGHTEST
    reflectance = _BRIGHTEST * x / np.sqrt(np.sqrt(1 + np.square(np.square(x))))
    return np.maximum(reflectance, _DARKEST, dtype=np.float32)
