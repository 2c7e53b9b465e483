"""What `simulate` and its kin refuse before they start: sensors, and how to run them."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from sensor.engine.group import least_bytes
from sensor.errors import SensorError
from sensor.model import SensorModel
from sensor.numbers import real, refusal, whole
from sensor.optics import crop_to_aspect

_LARGEST_SEED = (1 << 63) - 1
_MOST_THREADS = 1024


def checked_models(models: Sequence[SensorModel]) -> list[SensorModel]:
    """The models as a list; anything else among them is refused, as is a lack of them."""
    if not isinstance(models, Iterable):
        raise refusal("models", models, "a list of SensorModel")
    models = list(models)
    if not models:
        raise SensorError("models: found none, expected at least one SensorModel")
    for i, model in enumerate(models):
        if not isinstance(model, SensorModel):
            name = f"models[{i}]" if len(models) > 1 else "model"
            raise SensorError(
                f"{name}: found a {type(model).__name__}, expected a SensorModel, as "
                "SensorModel(width=346, height=260) makes one"
            )
    return models


def checked_speeds(speeds: Sequence[float] | None, count: int) -> list[float]:
    """One positive factor for each of `count` models; None is 1 for all."""
    if speeds is None:
        return [1.0] * count
    expected = f"{count} positive factors, one a model"
    if not isinstance(speeds, Iterable):
        raise refusal("speeds", speeds, expected)
    found = [real("speeds", speed, expected) for speed in speeds]
    if len(found) != count or not all(0 < speed < math.inf for speed in found):
        raise refusal("speeds", speeds, expected)
    return found


def checked_seed(seed: int) -> int:
    """The seed; NumPy's generators and files of events hold no larger one exactly."""
    return _within("seed", seed, 0, _LARGEST_SEED, "an integer in 0..2^63 - 1")


def checked_threads(threads: int | None) -> int:
    """How many threads; None is one a core."""
    if threads is None:
        return len(os.sched_getaffinity(0))
    expected = f"an integer in 1..{_MOST_THREADS}, or None for one a core"
    return _within("threads", threads, 1, _MOST_THREADS, expected)


def check_fit(model: SensorModel, height: int, width: int) -> None:
    """Refuse a sensor that is finer than its frames, or would see them stretched.

    A sensor has whole pixels. So its height may differ from what its width and the frames' shape
    make of it, or its width from what its height does, by less than one pixel: either rounding
    will do.
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
            f"sensor of {model.width}x{model.height} px is of another shape than the frames of "
            f"{width}x{height} px; crop them to frame[{rows.start}:{rows.stop}, "
            f"{columns.start}:{columns.stop}], or choose a sensor of {model.width}x{alike} px"
        )


def check_memory(models: list[SensorModel]) -> None:
    """Refuse sensors whose pixels' state alone is more than this machine's memory."""
    needed = sum(map(least_bytes, models))
    if needed > (there := memory_bytes()):
        raise SensorError(
            f"{'sensor' if len(models) == 1 else f'{len(models)} sensors'} of up to "
            f"{max(m.width for m in models)}x{max(m.height for m in models)} px: the state of the "
            f"pixels takes {needed / 1e9:.1f} GB, and this machine has {there / 1e9:.1f} GB of "
            "memory; choose smaller sensors, or fewer at a time"
        )


def memory_bytes() -> int:
    """Memory of this machine, or of the container where that has less."""
    physical = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    try:
        return min(physical, int(Path("/sys/fs/cgroup/memory.max").read_text()))
    except (OSError, ValueError):  # no such file, or "max"
        return physical


def _within(name: str, value: object, lowest: int, highest: int, expected: str) -> int:
    number = whole(name, value, expected)
    if not lowest <= number <= highest:
        raise refusal(name, value, expected)
    return number
