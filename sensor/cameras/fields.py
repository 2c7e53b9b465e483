"""The keys of a camera's file: one table for its reader, its writer, its schema and its options."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from dataclasses import field as field_of
from typing import Literal

from sensor.model import (
    MAX_RATE_HZ,
    MAX_SIDE_PX,
    MAX_THRESHOLD,
    MAX_TIME_S,
    MIN_FILL_FACTOR,
    MIN_THRESHOLD,
    PHOTORECEPTORS,
)

Convert = Callable[[float], float]


def _times(factor: float) -> Convert:
    return lambda value: factor * value


def _rise(percent: float) -> float:
    """Convert a contrast of brighter light to log units."""
    return math.log1p(percent / 100)


def _fall(percent: float) -> float:
    """Convert a contrast of darker light to log units."""
    return -math.log1p(-percent / 100) if percent < 100 else math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class Key:
    """A key of a camera's file.

    Parameters
    ----------
    meaning
        What its value is, in words.
    note
        More about it, for the help of its option.
    field
        Its field of `EventCamera`; "" if it is the key itself.
    kind
        "number", "integer", "text", "flag" or "word".
    units
        Units of a number, each with the conversion to the unit of the field, the default first.
    least, most
        Smallest and largest number, in the unit of the field.
    words
        All values of a word.
    part
        "name" for words about the camera, which need no source; "grid" for its size and the area of
        its pixels; else "electronics", the bus included.
    """

    meaning: str = field_of(kw_only=False)
    note: str = ""
    field: str = ""
    kind: Literal["number", "integer", "text", "flag", "word"] = "number"
    units: Mapping[str, Convert] = field_of(default_factory=lambda: {"1": float})
    least: float = 0.0
    most: float = math.inf
    words: tuple[str, ...] = ()
    part: Literal["name", "grid", "electronics"] = "electronics"


_HZ = {"Hz": _times(1), "kHz": _times(1e3)}
_SECONDS = {"s": _times(1), "ms": _times(1e-3), "us": _times(1e-6)}
_SHARE = {"1": _times(1), "%": _times(1e-2)}
_LOG = {"log": _times(1), "%": _times(1e-2)}
_SIDE = Key("width", kind="integer", units={"px": float}, least=1, most=MAX_SIDE_PX, part="grid")

KEYS: dict[str, Key] = {
    "title": Key("name of the camera, in words", kind="text", part="name"),
    "supplier": Key("who sells it", kind="text", part="name"),
    "year": Key("year of release", kind="integer", least=1900, most=2200, part="name"),
    "interface": Key("its connection to a computer", kind="text", part="name"),
    "width": _SIDE,
    "height": replace(_SIDE, meaning="height"),
    "pitch": Key(
        "side of a pixel",
        field="pitch_um",
        units={"um": _times(1)},
        least=1e-3,
        most=1e6,
        part="grid",
    ),
    "fill_factor": Key(
        "light-sensitive share of a pixel's area",
        units=_SHARE,
        least=MIN_FILL_FACTOR,
        most=1.0,
        part="grid",
    ),
    "threshold": Key(
        "contrast threshold of ON events, and of OFF events that have none",
        note="0.2 by default",
        field="contrast_threshold",
        units={"log": _times(1), "%": _rise},
        least=MIN_THRESHOLD,
        most=MAX_THRESHOLD,
    ),
    "threshold_off": Key(
        "contrast threshold of OFF events",
        field="contrast_threshold_off",
        units={"log": _times(1), "%": _fall},
        least=MIN_THRESHOLD,
        most=MAX_THRESHOLD,
    ),
    "threshold_mismatch": Key(
        "standard deviation of the thresholds between pixels",
        note="typically 0.03",
        units=_LOG,
        most=1e6,
    ),
    "photoreceptor": Key(
        "filter of its pixels",
        note="v2e's is one pole whose cutoff follows the light of each pixel",
        kind="word",
        words=PHOTORECEPTORS,
    ),
    "cutoff": Key(
        "corner frequency of each pole of the photoreceptor",
        note="the paper has 200 for day and 50 for night",
        field="cutoff_hz",
        units=_HZ,
        least=math.ulp(0.0),
    ),
    "cutoff_follows_light": Key(
        "whether a pixel's cutoff is proportional to its own light", kind="flag"
    ),
    "illuminance": Key(
        "light on the scene for which cutoff and shot noise hold",
        field="illuminance_lux",
        units={"lux": _times(1), "klux": _times(1e3)},
        least=math.ulp(0.0),
        most=1e12,
    ),
    "like": Key("camera that lends its cutoff per lux", note="dvs128 by default", kind="text"),
    "area_exponent": Key(
        "exponent of the photodiode's area in a cutoff that is lent",
        note="0 by default, at most 1",
        most=1.0,
    ),
    "leak": Key(
        "rate of ON events of a pixel in constant light",
        note="typically 0.1",
        field="leak_hz",
        units=_HZ,
        most=MAX_RATE_HZ,
    ),
    "shot_noise": Key(
        "rate of noise events of a pixel in the dark",
        field="shot_noise_hz",
        units=_HZ,
        most=MAX_RATE_HZ,
    ),
    "shot_noise_exponent": Key(
        "fall of the shot noise with the light", note="0.5 by default", most=1e6
    ),
    "hot_pixels": Key("share of hot pixels", field="hot_pixel_fraction", units=_SHARE, most=1.0),
    "hot_pixel_rate": Key(
        "rate of noise events of a hot pixel",
        note="100 by default",
        field="hot_pixel_hz",
        units=_HZ,
        most=MAX_RATE_HZ,
    ),
    "refractory": Key(
        "dead time after an event", field="refractory_s", units=_SECONDS, most=MAX_TIME_S
    ),
    "latency": Key(
        "delay from the crossing of a threshold to its event",
        note="on top of that of the photoreceptor",
        field="latency_s",
        units=_SECONDS,
        most=1000.0,
    ),
    "random_start": Key(
        "whether memories start at random levels, as in a camera that has been running", kind="flag"
    ),
    "dark": Key(
        "dark level, as a share of white", note="0.001 by default", field="dark_share", units=_SHARE
    ),
    "warm_up": Key(
        "warm-up before a window, in time constants of the photoreceptor",
        note="6 by default",
        most=1e6,
    ),
    "bus": Key(
        "capacity of the bus",
        note='"unlimited" for events that leave at once',
        field="bus_hz",
        units={"Mev/s": _times(1e6), "ev/s": _times(1)},
        least=math.ulp(0.0),
    ),
    "fifo": Key(
        "events that can wait for the bus",
        note="an event that finds the queue full is lost; 4096 by default",
        kind="integer",
        units={"events": float},
        least=1,
        most=100_000_000,
    ),
    "row_overhead": Key(
        "time to open a row of pixels",
        note="the row that has waited longest is read next",
        field="row_overhead_s",
        units=_SECONDS,
        most=1e9,
    ),
}
"""All keys, in the order of files and lists."""

FIELDS: dict[str, str] = {name: key.field or name for name, key in KEYS.items()}
"""The field of `EventCamera` of each key."""

ALIASES = {"threshold_on": "threshold"}
"""Other names of keys, in files of earlier versions."""
