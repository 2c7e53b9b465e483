"""Wood: single boards, and floors of them."""

from __future__ import annotations

import numpy as np

from eres_render.textures.fractal_noise import Float32, fractal_noise

_BOARD_M = 0.13, 1.3  # width and length


def wood(
    shape: tuple[int, int],
    texel_m: float,
    rng: np.random.Generator,
    tone: float = 0.3,
    *,
    along_u: bool = True,
    ring_m: float = 0.018,
) -> Float32:
    """Return the reflectance of a board: growth rings `ring_m` apart, fibers, pores."""
    if along_u:
        return wood(shape[::-1], texel_m, rng, tone, along_u=False, ring_m=ring_m).T
    across = np.arange(shape[1], dtype=np.float32) * np.float32(texel_m / ring_m)
    wander = fractal_noise(shape, 0.25 / texel_m, 0.03 / texel_m, rng, stretch=6)
    phase = (across + rng.uniform(0, 10) + 1.6 * wander) % 1
    ring = phase**3 - 0.25  # slowly darker toward late summer, then light again at once
    fiber = fractal_noise(shape, 8, 1, rng, stretch=20)
    pore = np.maximum(fractal_noise(shape, 2, 1, rng, stretch=12) - 1.3, 0)
    stain = fractal_noise(shape, 0.4 / texel_m, 0.05 / texel_m, rng, stretch=3)
    log_tone = np.log(tone) - 0.45 * ring + 0.10 * fiber - 0.45 * pore + 0.07 * stain
    return np.exp(log_tone, dtype=np.float32)


def planks(
    shape: tuple[int, int], texel_m: float, rng: np.random.Generator, tone: float = 0.3
) -> Float32:
    """Return a floor of boards that run along u, each of its own shade, with dark joints."""
    height, width = shape
    board, length = (round(side_m / texel_m) for side_m in _BOARD_M)
    joint = max(1, round(0.002 / texel_m))
    floor = np.empty(shape, dtype=np.float32)
    for top in range(0, height, board):
        rows = min(board, height - top)
        strip = wood((board, width), texel_m, rng, tone)[:rows]
        start = -int(rng.integers(length))
        while start < width:
            left, right = max(start, 0), min(start + length, width)
            if right > left:
                strip[:, left:right] *= np.exp(0.16 * rng.standard_normal())
                strip[:, max(right - joint, 0) : right] *= 0.35
            start += length
        strip[:joint] *= 0.35
        floor[top : top + rows] = strip
    return floor
