"""Random periodic textures, and views of them: noise, leaves, patches, motifs, and their layers.

None of them is a texture of a packaged scene. They have contrast at all scales down to a texel,
since resolutions differ in the detail that a pixel averages.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sensor.compiling import compiler

Float32 = NDArray[np.float32]
jit = compiler()

SIDE = 512  # texels, a power of two
DARKEST, BRIGHTEST = 0.01, 1.0
_GRAIN = (0.05, 3.0)  # of the contrast without it: flat areas, or nothing but grain
_MIN_LEAF, _MAX_LEAF = 2.0, 80.0  # radii in texels
_COVER = 4.0  # mean number of leaves over a texel
_MOTIFS = (32, 64, 128)  # sides, texels
SUBPIXELS = 2  # samples of a view along each side of a pixel


def random_texture(rng: np.random.Generator, log_contrast: float) -> Float32:
    """Return a periodic texture, (512, 512) linear radiance from 0.01 to 1."""
    kinds: list[Callable[[np.random.Generator], Float32]] = [_noise, _leaves, _patches, _motif]
    total = np.zeros((SIDE, SIDE), np.float32)
    for kind in rng.permutation(len(kinds))[: rng.integers(1, 4)]:
        total += np.float32(rng.uniform(0.3, 1.0)) * _unit(kinds[kind](rng))
    grain = fractal(rng, rng.uniform(0.0, 1.2))
    share = math.exp(rng.uniform(*np.log(_GRAIN)))
    total = _unit(_unit(total) + np.float32(share) * grain)
    bright = rng.uniform(-1.8, -0.9)  # mean of log intensity
    radiance = np.exp(np.float32(bright) + np.float32(log_contrast) * total)
    return np.clip(radiance, DARKEST, BRIGHTEST, dtype=np.float32)


def fractal(rng: np.random.Generator, slope: float) -> Float32:
    """Return periodic noise, (512, 512), of amplitude f^-slope, mean 0 and standard deviation 1."""
    rows, columns = np.fft.fftfreq(SIDE)[:, None], np.fft.rfftfreq(SIDE)[None]
    radius = np.hypot(rows, columns)
    radius[0, 0] = np.inf  # no mean
    white = rng.standard_normal((SIDE, SIDE), dtype=np.float32)
    spectrum = np.fft.rfft2(white) * radius**-slope
    return _unit(np.fft.irfft2(spectrum, s=(SIDE, SIDE)).astype(np.float32))


def _unit(image: Float32) -> Float32:
    centered = image - image.mean()
    return centered / np.float32(max(centered.std(), 1e-6))


def _noise(rng: np.random.Generator) -> Float32:
    return fractal(rng, rng.uniform(0.7, 1.6))


def _patches(rng: np.random.Generator) -> Float32:
    """Return a few gray levels with sharp borders: noise between thresholds."""
    noise = fractal(rng, rng.uniform(1.0, 2.0))
    levels = np.sort(rng.normal(0.0, 1.0, rng.integers(1, 6)))
    grays = rng.standard_normal(levels.size + 1).astype(np.float32)
    return grays[np.searchsorted(levels, noise)]


def _motif(rng: np.random.Generator) -> Float32:
    """Repeat a small image of patches, mirrored or not."""
    side = int(rng.choice(_MOTIFS))
    motif = _patches(rng)[:side, :side]
    if rng.random() < 0.5:
        half = motif[: side // 2, : side // 2]
        motif = np.block([[half, half[:, ::-1]], [half[::-1], half[::-1, ::-1]]])
    return np.tile(motif, (SIDE // side, SIDE // side))


def _leaves(rng: np.random.Generator) -> Float32:
    """Return dead leaves: ellipses and rectangles of power-law sizes, each over those before it."""
    ratio = (_MIN_LEAF / _MAX_LEAF) ** 2
    mean_square = _MIN_LEAF**2 * -np.log(ratio) / (1 - ratio)  # of radii
    count = int(_COVER * SIDE**2 / (3.5 * 0.7 * mean_square))  # leaves are 0.4 to 1 as wide as long
    share = rng.random(count)
    radii = _MIN_LEAF / np.sqrt(1 - share * (1 - ratio))  # density r^-3
    centers, widths = rng.uniform(0, SIDE, (count, 2)), radii * rng.uniform(0.4, 1.0, count)
    angles, are_rectangles = rng.uniform(0, np.pi, count), rng.random(count) < rng.random()
    grays = rng.standard_normal(count)
    leaves = np.column_stack([centers, radii, widths, angles, are_rectangles, grays])
    image = np.zeros((SIDE, SIDE), np.float32)
    paint_leaves(image, leaves)
    return image


@jit
def paint_leaves(image: Float32, leaves: NDArray[np.float64]) -> None:
    """Paint leaves over each other on a periodic image, (S, S), where S is a power of two.

    Each row of `leaves`, (N, 7), has x and y of the center, half length and half width, texels, the
    angle, radians, whether it is a rectangle, and the gray.
    """
    last = image.shape[0] - 1
    for k in range(leaves.shape[0]):
        x, y, length, width, angle, is_rectangle, gray = leaves[k]
        cosine, sine = np.cos(angle), np.sin(angle)
        reach = np.hypot(length, width) if is_rectangle else length
        for row in range(int(np.ceil(y - reach)), int(np.floor(y + reach)) + 1):
            for column in range(int(np.ceil(x - reach)), int(np.floor(x + reach)) + 1):
                along = (cosine * (column - x) + sine * (row - y)) / length
                across = (cosine * (row - y) - sine * (column - x)) / width
                if is_rectangle:
                    inside = max(abs(along), abs(across)) <= 1
                else:
                    inside = along * along + across * across <= 1
                if inside:
                    image[row & last, column & last] = gray


@jit
def view(
    texture: NDArray[np.float32], homography: NDArray[np.float64], side_px: int
) -> NDArray[np.float32]:
    """Average a texture over each pixel: the mean of 2 x 2 samples, interpolated bilinearly.

    The texture, (S, S), is periodic, and S is a power of two. The homography maps pixels to texels,
    both with centers at integers + 0.5. OpenCV's `warpPerspective` would round positions to 1/32
    px, and motion in such steps causes false events.
    """
    last = texture.shape[0] - 1
    image = np.empty((side_px, side_px), np.float32)
    h = homography
    for row in range(side_px):
        for column in range(side_px):
            total = 0.0
            for j in range(SUBPIXELS):
                y = row + (j + 0.5) / SUBPIXELS
                for i in range(SUBPIXELS):
                    x = column + (i + 0.5) / SUBPIXELS
                    scale = 1.0 / (h[2, 0] * x + h[2, 1] * y + h[2, 2])
                    u = scale * (h[0, 0] * x + h[0, 1] * y + h[0, 2]) - 0.5
                    v = scale * (h[1, 0] * x + h[1, 1] * y + h[1, 2]) - 0.5
                    left, top = math.floor(u), math.floor(v)
                    right, down = u - left, v - top
                    c0, c1 = left & last, (left + 1) & last
                    r0, r1 = top & last, (top + 1) & last
                    above = texture[r0, c0] + right * (texture[r0, c1] - texture[r0, c0])
                    below = texture[r1, c0] + right * (texture[r1, c1] - texture[r1, c0])
                    total += above + down * (below - above)
            image[row, column] = total / (SUBPIXELS * SUBPIXELS)
    return image
