"""Check and complete the arguments of `simulate` and related functions, except for the frames."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cache
from types import FunctionType
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from sensor.engine.group import least_bytes, members_by_light
from sensor.errors import SensorError
from sensor.levels import DARK_SHARE, white_level
from sensor.memory import memory_bytes
from sensor.model import SensorModel
from sensor.numbers import FINITE, POSITIVE, real, refusal, whole
from sensor.optics import crop_to_aspect

Lit = SensorModel | Callable[[float], SensorModel]
"""A sensor, or a function that returns it for a radiance of white."""

_MAX_SEED = (1 << 63) - 1
_MAX_THREADS = 1024
_MIN_WHITE, _MAX_WHITE = 1e-296, 1e302  # so that the dark level is one that models take


def checked_models(models: Sequence[Lit], white: float = 1.0) -> list[SensorModel]:
    """Return the models; `white` is the radiance of white for those that are functions."""
    if not isinstance(models, Iterable) or not (models := list(models)):
        raise refusal("models", models, "a list of at least one SensorModel")
    values: list[Any] = [m(white) if isinstance(m, FunctionType) else m for m in models]
    for i, model in enumerate(values):
        if not isinstance(model, SensorModel):
            name = f"models[{i}]" if len(values) > 1 else "model"
            raise SensorError(
                f"{name}: found type {type(model).__name__}, expected a SensorModel, such as "
                "SensorModel(width=346, height=260)"
            )
    return values


def checked_speeds(speeds: Sequence[float] | None, count: int) -> list[float]:
    """Return the speed factors as floats."""
    if speeds is None:
        return [1.0] * count
    expected = f"{count} positive factors, one per model"
    given = list(speeds) if isinstance(speeds, Iterable) else []
    if len(given) != count:
        raise refusal("speeds", speeds, expected)
    return [real("speeds", speed, expected, POSITIVE, FINITE) for speed in given]


def checked_starts(starts: Sequence[int] | None, count: int, frames: int) -> list[int]:
    """Return the indices of the first frames."""
    if starts is None:
        return [0] * count
    expected = f"{count} indices of frames, one per model, each in 0..{frames - 1}"
    given = list(starts) if isinstance(starts, Iterable) else []
    if len(given) != count:
        raise refusal("starts", starts, expected)
    return [whole("starts", start, expected, 0, frames - 1) for start in given]


def checked_seed(seed: int) -> int:
    """Return the seed; its limit is that of NumPy's generators and of event files."""
    return whole("seed", seed, "an integer in 0..2^63 - 1", 0, _MAX_SEED)


def cores() -> int:
    """Return how many cores this process may use; `eres_render.cores` has the same."""
    process = psutil.Process()
    if hasattr(process, "cpu_affinity"):  # macOS has none
        return len(process.cpu_affinity())
    return os.cpu_count() or 1


def checked_threads(threads: int | None) -> int:
    """Return the number of threads; None is one for each core."""
    if threads is None:
        return cores()
    expected = f"an integer in 1..{_MAX_THREADS}, or None for one per core"
    return whole("threads", threads, expected, 1, _MAX_THREADS)


def check_fit(model: SensorModel, height: int, width: int) -> None:
    """Check that a sensor is not finer than the frames and has their aspect ratio.

    A sensor has whole pixels, so its height or its width may differ by less than one pixel.
    """
    if model.height > height or model.width > width:
        raise SensorError(
            f"the sensor of {model.width}x{model.height} px is finer than the frames of "
            f"{width}x{height} px; render larger frames or choose a smaller sensor"
        )
    # |height - width H / W| < 1 or |width - height W / H| < 1, without a division.
    if abs(model.height * width - model.width * height) >= max(height, width):
        rows, columns = crop_to_aspect(height, width, model.height, model.width)
        alike = max(1, round(model.width * height / width))
        raise SensorError(
            f"the sensor of {model.width}x{model.height} px differs in aspect ratio from the "
            f"frames of {width}x{height} px; crop them to frame[{rows.start}:{rows.stop}, "
            f"{columns.start}:{columns.stop}], or choose a sensor of {model.width}x{alike} px"
        )


def check_memory(models: list[SensorModel], starts: list[int]) -> None:
    """Check that the state of the pixels fits into memory."""
    groups = members_by_light(models, starts)
    needed = sum(least_bytes([models[i] for i in members]) for members in groups)
    if needed > (available := memory_bytes()):
        raise SensorError(
            f"{'sensor' if len(models) == 1 else f'{len(models)} sensors'} of up to "
            f"{max(m.width for m in models)}x{max(m.height for m in models)} px: the state of the "
            f"pixels needs {needed / 1e9:.1f} GB, but this machine has {available / 1e9:.1f} GB of "
            "memory; choose smaller sensors, or fewer at a time"
        )


def completed(
    models: Sequence[Lit], first: NDArray[np.floating], white: float | None = None
) -> list[SensorModel]:
    """Return the models with a dark level, and with a cutoff reference where they need one.

    A model may be a function of the radiance of white: `white`, or else the white of `first`.
    """

    @cache
    def level(name: str) -> float:
        return _white_of(first, name) if white is None else white

    def whole_model(model: Lit) -> SensorModel:
        model = model if isinstance(model, SensorModel) else model(level("dark_level"))
        if model.dark_level is None:
            model = replace(model, dark_level=DARK_SHARE * level("dark_level"))
        # v2e's filter needs the radiance of white.
        limited = model.photoreceptor == "v2e" and model.cutoff_hz < math.inf
        if limited and model.cutoff_reference is None:
            model = replace(model, cutoff_reference=level("cutoff_reference"))
        return model

    return list(map(whole_model, models))


def checked_white(white: float | None) -> float | None:
    """Return the radiance of white; None is that of the first frame."""
    if white is None:
        return None
    expected = f"a radiance from {_MIN_WHITE:g} to {_MAX_WHITE:g}, or None"
    return real("white", white, expected, _MIN_WHITE, _MAX_WHITE)


def _white_of(frame: NDArray[np.floating], name: str) -> float:
    """Return the white level of the first frame, for a parameter of the model."""
    white = white_level(frame)
    if not _MIN_WHITE <= white <= _MAX_WHITE:
        what = f"has a white level of {white:g}" if white > 0 else "is black"
        raise SensorError(
            f"{name}: None derives it from the first frame's white level, but that frame {what} "
            f"(expected {_MIN_WHITE:g} to {_MAX_WHITE:g}); give SensorModel.{name}, or `white` of "
            "LiveCamera"
        )
    return white
