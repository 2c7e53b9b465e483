"""Check and complete the arguments of `simulate` and related functions, except for the frames."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensor.engine.group import least_bytes, members_by_light
from sensor.errors import SensorError
from sensor.levels import DARK_FRACTION, white_level
from sensor.memory import memory_bytes
from sensor.model import SensorModel
from sensor.numbers import real, refusal, whole
from sensor.optics import crop_to_aspect

Lit = SensorModel | Callable[[float], SensorModel]
"""A sensor, or a function that returns it for a radiance of white."""

_MAX_SEED = (1 << 63) - 1
_MAX_THREADS = 1024
_MIN_WHITE, _MAX_WHITE = 1e-296, 1e302  # so that the dark level is one that models take


def checked_models(models: Sequence[Lit], white: float = 1.0) -> list[SensorModel]:
    """Return the models as a list.

    Parameters
    ----------
    models
        The sensors, or functions that return them for a radiance of white.
    white
        A radiance of white, for these.
    """
    if not isinstance(models, Iterable):
        raise refusal("models", models, "a list of SensorModel")
    found: list[Any] = [m(white) if isinstance(m, FunctionType) else m for m in models]
    if not found:
        raise SensorError("models: found none, expected at least one SensorModel")
    for i, model in enumerate(found):
        if not isinstance(model, SensorModel):
            name = f"models[{i}]" if len(found) > 1 else "model"
            raise SensorError(
                f"{name}: found a {type(model).__name__}, expected a SensorModel, such as "
                "SensorModel(width=346, height=260)"
            )
    return found


def checked_speeds(speeds: Sequence[float] | None, count: int) -> list[float]:
    """Return the speed factors as floats."""
    if speeds is None:
        return [1.0] * count
    expected = f"{count} positive factors, one per model"
    if not isinstance(speeds, Iterable):
        raise refusal("speeds", speeds, expected)
    found = [real("speeds", speed, expected) for speed in speeds]
    if len(found) != count or not all(0 < speed < math.inf for speed in found):
        raise refusal("speeds", speeds, expected)
    return found


def checked_starts(starts: Sequence[int] | None, count: int, frames: int) -> list[int]:
    """Return the indices of the first frames."""
    if starts is None:
        return [0] * count
    expected = f"{count} indices of frames, one per model, each in 0..{frames - 1}"
    if not isinstance(starts, Iterable):
        raise refusal("starts", starts, expected)
    found = [_within("starts", start, 0, frames - 1, expected) for start in starts]
    if len(found) != count:
        raise refusal("starts", starts, expected)
    return found


def checked_seed(seed: int) -> int:
    """Return the seed, or raise; the limit is that of NumPy's generators and of event files."""
    return _within("seed", seed, 0, _MAX_SEED, "an integer in 0..2^63 - 1")


def checked_threads(threads: int | None) -> int:
    """Return the number of threads, or raise; None is one for each core."""
    if threads is None:
        return len(os.sched_getaffinity(0))
    expected = f"an integer in 1..{_MAX_THREADS}, or None for one per core"
    return _within("threads", threads, 1, _MAX_THREADS, expected)


def check_fit(model: SensorModel, height: int, width: int) -> None:
    """Check that a sensor is not finer than the frames and has their aspect ratio.

    The height may differ by less than one pixel from the width divided by the aspect ratio of the
    frames, or the width from the height times that ratio, since a sensor has whole pixels.
    """
    if model.height > height or model.width > width:
        raise SensorError(
            f"sensor of {model.width}x{model.height} px is finer than the frames of "
            f"{width}x{height} px; render larger frames or choose a smaller sensor"
        )
    # |height - width H / W| < 1 or |width - height W / H| < 1, without a division.
    if abs(model.height * width - model.width * height) >= max(height, width):
        rows, columns = crop_to_aspect(height, width, model.height, model.width)
        alike = max(1, round(model.width * height / width))
        raise SensorError(
            f"sensor of {model.width}x{model.height} px differs in aspect ratio from the frames of "
            f"{width}x{height} px; crop them to frame[{rows.start}:{rows.stop}, "
            f"{columns.start}:{columns.stop}], or choose a sensor of {model.width}x{alike} px"
        )


def check_memory(models: list[SensorModel], starts: list[int]) -> None:
    """Check that the state of the pixels fits into memory."""
    groups = members_by_light(models, starts)
    needed = sum(least_bytes([models[i] for i in members]) for members in groups)
    if needed > (there := memory_bytes()):
        raise SensorError(
            f"{'sensor' if len(models) == 1 else f'{len(models)} sensors'} of up to "
            f"{max(m.width for m in models)}x{max(m.height for m in models)} px: the state of the "
            f"pixels needs {needed / 1e9:.1f} GB, and this machine has {there / 1e9:.1f} GB of "
            "memory; choose smaller sensors, or fewer at a time"
        )


def completed(
    models: Sequence[Lit], first: NDArray[np.floating], white: float | None = None
) -> list[SensorModel]:
    """Return the models with a dark level, and with a cutoff reference where they need one.

    Parameters
    ----------
    models
        The sensors, or functions that return them for a radiance of white; a None is replaced.
    first, white
        (H, W) the first frame, and the radiance of white; None takes that of the first frame.
    """

    def level(name: str) -> float:
        return _white_of(first, name) if white is None else white

    found = [m if isinstance(m, SensorModel) else m(level("dark_level")) for m in models]
    if any(m.dark_level is None for m in found):
        dark = DARK_FRACTION * level("dark_level")
        found = [m if m.dark_level is not None else replace(m, dark_level=dark) for m in found]
    if any(map(_needs_reference, found)):
        reference = level("cutoff_reference")
        found = [
            replace(m, cutoff_reference=reference) if _needs_reference(m) else m for m in found
        ]
    return found


def checked_white(white: float | None) -> float | None:
    """Return the radiance of white, or raise; None is that of the first frame."""
    if white is None:
        return None
    expected = f"a radiance from {_MIN_WHITE:g} to {_MAX_WHITE:g}, or None"
    if not _MIN_WHITE <= (found := real("white", white, expected)) <= _MAX_WHITE:
        raise refusal("white", white, expected)
    return found


def _needs_reference(model: SensorModel) -> bool:
    """Return whether the model has v2e's filter but no radiance of white."""
    limited = model.photoreceptor == "v2e" and model.cutoff_hz < math.inf
    return limited and model.cutoff_reference is None


def _white_of(frame: NDArray[np.floating], name: str) -> float:
    """Return the white level of the first frame, for a parameter of the model."""
    white = white_level(frame)
    if white <= 0:
        raise SensorError(
            f"{name}: found None and a black first frame, which gives no white level, "
            f"expected a value for SensorModel.{name}, or for `white` of LiveCamera"
        )
    if not _MIN_WHITE <= white <= _MAX_WHITE:
        raise SensorError(
            f"{name}: found None and a white level of {white:g} in the first frame, expected "
            f"{_MIN_WHITE:g} to {_MAX_WHITE:g}, or a value for SensorModel.{name}"
        )
    return white


def _within(name: str, value: object, lowest: int, highest: int, expected: str) -> int:
    number = whole(name, value, expected)
    if not lowest <= number <= highest:
        raise refusal(name, value, expected)
    return number
