"""Sensor models as arrays for the kernels, with the random patterns of their pixels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sensor.kernels.advance import Settings
from sensor.model import SensorModel


class Draw:
    """Kinds of random numbers; each has its own stream."""

    START, C_ON, C_OFF, HOT, NOISE = range(5)


def generator(seed: int, draw: int) -> np.random.Generator:
    """Return the generator of one kind of random numbers."""
    return np.random.Generator(np.random.Philox(key=[seed, draw]))


def settings_of(models: list[SensorModel], seed: int) -> Settings:
    """Convert models to arrays for the kernels."""
    pixels = models[0].height * models[0].width
    hot = [m.hot_pixel_fraction > 0 and m.hot_pixel_hz > 0 for m in models]
    hot_hz = np.zeros((len(models), pixels if any(hot) else 0))
    if any(hot):
        share = generator(seed, Draw.HOT).random(pixels)
        for row, model in zip(hot_hz, models, strict=True):
            row[share < model.hot_pixel_fraction] = model.hot_pixel_hz
    light_a, light_0 = np.array([_light(m) for m in models]).T.copy()
    return Settings(
        C_on=_thresholds(models, [m.contrast_threshold for m in models], seed, Draw.C_ON),
        C_off=_thresholds(models, [m.off_threshold for m in models], seed, Draw.C_OFF),
        hot_hz=hot_hz,
        poles=np.array([float(m.poles) for m in models]),
        light_a=light_a,
        light_0=light_0,
        leak_per_s=np.array([m.leak_hz * m.contrast_threshold for m in models]),
        noise_hz=np.array([m.shot_noise_hz for m in models]),
        noise_exponent=np.array([m.shot_noise_exponent for m in models]),
        filtered=np.array([math.isfinite(m.cutoff_hz) for m in models]),
        noisy=np.array([m.shot_noise_hz > 0 for m in models]) | hot,
        leader=_leaders(models),
        # Not the seed itself: kernels combine it with the pixel, so that nearby seeds would give
        # the same noise at other pixels.
        seed=generator(seed, Draw.NOISE).integers(1 << 64, dtype=np.uint64),
    )


def _thresholds(
    models: list[SensorModel], nominal: list[float], seed: int, draw: int
) -> NDArray[np.float64]:
    C = np.array(nominal)[:, None]
    mismatch = np.array([[m.threshold_mismatch] for m in models])
    if not mismatch.any():
        return C
    pattern = generator(seed, draw).standard_normal(models[0].height * models[0].width)
    return np.maximum(C + mismatch * pattern, 0.1 * C)


def _light(model: SensorModel) -> tuple[float, float]:
    """Return `light_a` and `light_0` of `Settings`."""
    reference = model.cutoff_reference
    if reference is None or model.cutoff_hz == math.inf:
        return 0.0, 0.0
    if model.photoreceptor == "v2e":
        per_unit = 2 * math.pi * model.cutoff_hz * 255 / (275 * reference)
        return per_unit, reference * 20 / 255 - (model.dark_level or 0.0)
    return 2 * math.pi * model.cutoff_hz / reference, 0.0


def _leaders(models: list[SensorModel]) -> NDArray[np.int64]:
    """Return, for each model, the first model whose events differ only in time, usually itself.

    The events of an ideal pixel between two frames depend on the light only. With a filter, leakage
    or noise they also depend on the length of the interval.
    """
    first: dict[tuple, int] = {}
    leaders = []
    for i, m in enumerate(models):
        timeless = m.cutoff_hz == math.inf and m.leak_hz == m.shot_noise_hz == 0
        timeless &= m.hot_pixel_fraction == 0
        comparator = m.contrast_threshold, m.off_threshold, m.threshold_mismatch, m.random_start
        leaders.append(first.setdefault(comparator, i) if timeless else i)
    return np.array(leaders)
