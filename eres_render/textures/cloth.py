"""Woven things: upholstery, curtains, a kilim."""

from __future__ import annotations

import numpy as np

from eres_render.textures.fractal_noise import Float32, fractal_noise


def tweed(
    shape: tuple[int, int], texel_m: float, rng: np.random.Generator, tone: float = 0.25
) -> Float32:
    """Return herringbone tweed: twill that turns every 2.4 cm, of uneven yarn."""
    row, column = np.arange(shape[0])[:, None], np.arange(shape[1])[None, :]
    stripe = max(8, round(0.024 / texel_m))
    lean = np.where((column // stripe) % 2 == 0, 1, -1)
    twill = np.where((column * lean + row) % 6 < 3, 0.28, -0.28).astype(np.float32)
    yarn = 0.16 * rng.standard_normal((1, shape[1]), dtype=np.float32)
    weft = 0.16 * rng.standard_normal((shape[0], 1), dtype=np.float32)
    fiber = 0.16 * rng.standard_normal(shape, dtype=np.float32)
    wear = 0.05 * fractal_noise(shape, 0.4 / texel_m, 0.02 / texel_m, rng)
    return np.exp(np.log(tone) + twill + yarn + weft + fiber + wear, dtype=np.float32)


def striped(
    shape: tuple[int, int],
    texel_m: float,
    rng: np.random.Generator,
    tones: tuple[float, ...] = (0.6, 0.25, 0.6, 0.12),
    period_m: float = 0.14,
) -> Float32:
    """Return cloth in a plain weave, with stripes along v that repeat every `period_m`."""
    x = np.arange(shape[1], dtype=np.float32) * np.float32(texel_m / period_m)
    stripe = np.log(np.array(tones, dtype=np.float32))[
        (x * len(tones)).astype(np.intp) % len(tones)
    ]
    row, column = np.arange(shape[0])[:, None], np.arange(shape[1])[None, :]
    weave = np.where((row // 2 + column // 2) % 2 == 0, 0.07, -0.07).astype(np.float32)
    fiber = 0.11 * rng.standard_normal(shape, dtype=np.float32)
    wear = 0.05 * fractal_noise(shape, 0.3 / texel_m, 0.02 / texel_m, rng)
    return np.exp(stripe + weave + fiber + wear, dtype=np.float32)


def kilim(shape: tuple[int, int], texel_m: float, rng: np.random.Generator) -> Float32:
    """Return a flat-woven rug: bands of stepped diamonds in a plain border with a toothed line."""
    yarn_m = 0.005
    rows, columns = (int(np.ceil(n * texel_m / yarn_m)) for n in shape)
    y, x = np.arange(rows)[:, None], np.arange(columns)[None, :]
    tones = np.log(np.array([0.60, 0.10, 0.32, 0.20, 0.45], dtype=np.float32))
    band, in_band = y // 40, y % 40 - 19.5
    half = 24 - 4 * (band % 3)
    u = np.abs((x + half * (band % 2)) % (2 * half) - half)
    step = (u // 4 * 4 + np.abs(in_band) // 4 * 4) * 5 // (half + 18)
    pattern = tones[(step + band).astype(np.intp) % len(tones)]
    pattern = np.where(np.abs(in_band) > 17, tones[1], pattern)
    inset = np.minimum(np.minimum(x, columns - 1 - x), np.minimum(y, rows - 1 - y))
    comb = np.where((x // 3 + y // 3) % 2 == 0, tones[0], tones[1])
    pattern = np.where(inset < 30, comb, pattern)
    pattern = np.where((inset < 24) | (inset >= 27) & (inset < 30), tones[3], pattern)
    pattern = pattern + 0.12 * rng.standard_normal((rows, 1), dtype=np.float32)
    pattern = pattern + 0.10 * rng.standard_normal((rows, columns), dtype=np.float32)
    row = (np.arange(shape[0]) * texel_m / yarn_m).astype(np.intp)
    column = (np.arange(shape[1]) * texel_m / yarn_m).astype(np.intp)
    log_tone = pattern[row][:, column].astype(np.float32)
    rib = np.sin(np.pi * ((np.arange(shape[0]) * texel_m / yarn_m) % 1))[:, None]
    log_tone += np.log(0.6 + 0.4 * rib).astype(np.float32)
    log_tone += 0.16 * rng.standard_normal(shape, dtype=np.float32)
    return np.exp(log_tone, dtype=np.float32)
