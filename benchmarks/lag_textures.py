"""Find the lag at which a finer sensor stops to win, on textures that move past it.

    python benchmarks/lag_textures.py

takes random textures of log light, with a power of k^-2.2 and a standard deviation of 0.45, that
move along x at a constant speed. Sensors of 256, 128 and 64 px see the same frames of 256 px, half
a pixel apart. There are three of each texture, from seeds. It prints a Markdown table: for each
photoreceptor and contrast threshold, the lag at which the mean margin over the next coarser sensor
changes its sign, v / (pi f) in px of the finer one, and the smallest margin.

- all directions: detail in all directions;
- stripes: detail along the motion only, as of stripes across it;
- courses: detail a quarter as fine along the motion as across it, as of a wall along its courses.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from sensor import SensorModel, simulate
from tasks.methods.event_integration import reconstruct
from tasks.reconstruction import ReconstructionSample, log_white_level, psnr_db

_SIDE = 256
_WIDTHS = (64, 128, 256)
_SPEED_PX_S = 1000.0
_STEP_PX = 0.5
_WINDOW_PX = 40.0
_LAGS_PX = (0.25, 0.375, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 9.0)  # of the finest
_WARM_UP = 4.0  # lags, eight time constants
_POWER, _DEVIATION = 2.2, 0.45
_TEXTURES = "all directions", "stripes", "courses"
_THRESHOLDS = (0.1, 0.2, 0.4)
_SEEDS = range(3)


def texture(kind: str, seed: int) -> NDArray[np.complex128]:
    """Return the spectrum of a texture."""
    k = np.fft.fftfreq(_SIDE)
    kx, ky = np.meshgrid(k, k)
    radius = np.hypot((4 if kind == "courses" else 1) * kx, ky)
    exponent = -_POWER / 2
    if kind == "stripes":
        radius[ky != 0] = np.inf
        exponent += 0.5  # along a line through an isotropic texture, power falls by k less
    radius[radius < 1 / 64] = np.inf
    amplitude = radius**exponent * np.exp(-((np.minimum(radius, 1) / 0.4) ** 4))  # no aliasing
    noise = np.fft.fft2(np.random.default_rng(seed).standard_normal((_SIDE, _SIDE)))
    spectrum = noise * amplitude
    return np.asarray(_DEVIATION / np.fft.ifft2(spectrum).real.std() * spectrum)


def frames_of(spectrum: NDArray[np.complex128], count: int) -> NDArray[np.float32]:
    """Return frames of linear light of a texture in motion, (T, H, W)."""
    kx = np.fft.fftfreq(_SIDE)
    moves = [np.exp(-2j * np.pi * kx * _STEP_PX * step) for step in range(count)]
    return np.stack(
        [np.exp(np.fft.ifft2(spectrum * move).real) for move in moves], dtype=np.float32
    )


def margins(
    frames: NDArray[np.float32], lag_px: float, photoreceptor: str, threshold: float, seed: int
) -> NDArray[np.float64]:
    """Return the PSNR of each width above the coarsest minus that of the next coarser one, dB."""
    warm_up = math.ceil((_WARM_UP * lag_px + 3) / _STEP_PX)
    count = warm_up + round(_WINDOW_PX / _STEP_PX) + 1
    t_s = np.arange(count) * _STEP_PX / _SPEED_PX_S
    ends_us = (round(1e6 * t_s[warm_up]), round(1e6 * t_s[-1]) + 1)
    first, last = (np.log(frames[k].astype(np.float64)) for k in (warm_up, count - 1))
    found = []
    for width in _WIDTHS:
        model = SensorModel(
            width=width,
            height=width,
            contrast_threshold=threshold,
            photoreceptor=photoreceptor,  # type: ignore[arg-type]
            cutoff_hz=_SPEED_PX_S / (math.pi * lag_px),
            random_start=True,
        )
        events = simulate(frames[:count], t_s, model, seed=seed).between(*ends_us)
        sums = events.polarity_sum().astype(np.float64)
        image = reconstruct(ReconstructionSample(first, sums, threshold))
        found.append(psnr_db(image, last, log_white_level(first)))
    return np.diff(found)


def crossing(lags_px: NDArray[np.float64], margins_db: NDArray[np.float64]) -> str:
    """Return where margins change their sign, and the smallest of those beyond."""
    lost = np.flatnonzero(margins_db < 0)
    if not len(lost):
        return "none"
    k = lost[0]
    if not k:
        return f"below {lags_px[0]:.2f}, {margins_db.min():+.2f} dB"
    (a, b), (high, low) = lags_px[k - 1 : k + 1], margins_db[k - 1 : k + 1]
    return f"{a + (b - a) * high / (high - low):.2f}, {margins_db.min():+.2f} dB"


def main() -> None:
    longest = round((_WARM_UP * max(_LAGS_PX) + 4 + _WINDOW_PX) / _STEP_PX) + 2
    pairs = [f"{fine} over {coarse}" for coarse, fine in itertools.pairwise(_WIDTHS)]
    print(
        f"| texture | photoreceptor | C | {' | '.join(pairs)} |\n|---|---|---|{'---|' * len(pairs)}"
    )
    lags_px = np.array(_LAGS_PX)
    for kind in _TEXTURES:
        textures = {seed: frames_of(texture(kind, seed), longest) for seed in _SEEDS}
        for photoreceptor, threshold in itertools.product(("two_pole", "one_pole"), _THRESHOLDS):
            found = np.mean(
                [
                    [margins(frames, lag, photoreceptor, threshold, seed) for lag in _LAGS_PX]
                    for seed, frames in textures.items()
                ],
                axis=0,
            )
            # A sensor of half the width has half the lag, px.
            cells = [
                crossing(lags_px * fine / _SIDE, found[:, k]) for k, fine in enumerate(_WIDTHS[1:])
            ]
            print(f"| {kind} | {photoreceptor} | {threshold} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
