"""v2e (Hu, Liu and Delbruck, CVPRW 2021) as its program runs, in three versions.

The program takes one step of its filter between two frames, with the coefficient of the new frame
and at most 1, and puts the events between two frames into as many slots as the busiest pixel has
events. So both depend on the time between frames; `SensorModel(photoreceptor="v2e")` is the limit
for small steps.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sensor.compiling import compiler
from sensor.errors import SensorError
from sensor.events import Columns, Events, concatenate
from sensor.numbers import refusal

jit = compiler(Path(__file__).parent)
_log = logging.getLogger(__name__)

Version = Literal["A", "B", "C"]
Array = NDArray[Any]

V2E_DEFAULTS: dict[str, dict[str, float]] = {
    "class": {"threshold_mismatch": 0.03, "leak_hz": 0.1},
    "command line": {
        "cutoff_hz": 300.0,
        "threshold_mismatch": 0.03,
        "leak_hz": 0.01,
        "shot_noise_hz": 0.001,
        "refractory_s": 5e-4,
    },
}
"""The program's own defaults, of its class `EventEmulator` and of its command line."""

_JOINT = 20.0  # DN, up to which its logarithm is linear
_WHITE = 275.0  # DN, with the joint
_DIGITS = 8  # to which logarithms are rounded
_LEAST_THRESHOLD = 0.01
_SPREAD = 0.1  # of leaks: between pixels, decades, and between frames
_OF_WHITE = 0.75  # by how much shot noise falls from dark to white
_MOST_PX = 1 << 16


def v2e(
    frames: Iterable[ArrayLike],
    t_s: ArrayLike,
    *,
    contrast_threshold: float = 0.2,
    contrast_threshold_off: float | None = None,
    cutoff_hz: float = math.inf,
    version: Version = "C",
    threshold_mismatch: float = 0.0,
    leak_hz: float = 0.0,
    shot_noise_hz: float = 0.0,
    refractory_s: float = 0.0,
    seed: int = 0,
) -> Events:
    """Return the events of v2e on frames, as its program makes them.

    Without noise these are the program's events; with noise they have its distribution. Two traps
    are the program's own. In version C the time of the first frame is forgotten, so that the second
    interval begins at 0: start at 0. And the only event of a pixel between two frames has the time
    of the first slot, or of the later frame if no pixel has more; so cut windows as (start, end],
    at times of frames.

    Parameters
    ----------
    frames
        (T, H, W) or an iterable of (H, W): intensities from 0, 255 for white, of any real type.
        Numbers above 255 are light above white.
    t_s
        (T,) times of the frames, seconds, strictly increasing, not negative.
    contrast_threshold, contrast_threshold_off
        C of ON and OFF events, natural log units; OFF as ON by default.
    cutoff_hz
        Cutoff of a pixel at 255, Hz; that of a darker one is smaller. inf for no filter, which the
        program writes as 0.
    version
        "A", until 5 March 2021, has two poles; "B", until 25 June 2021, and "C", since then, have
        one. A and B put the slots of an interval inside it, C puts the last one on its end.
    threshold_mismatch
        Standard deviation of the thresholds between pixels, log units.
    leak_hz
        Rate of ON events in constant light, Hz.
    shot_noise_hz
        Rate of noise events of a pixel in the dark, Hz.
    refractory_s
        Dead time after an event, seconds; it acts where it is longer than a slot.
    seed
        Seed of the random parts.

    Returns
    -------
    Events
        With times rounded from the program's 32-bit floats to microseconds.

    Raises
    ------
    SensorError
        Frames differ in size, are not real numbers of at least 0 or do not match the times, or a
        value is out of range.

    Examples
    --------
    >>> from sensor.emulators import v2e
    >>> events = v2e([[[100]], [[130]], [[250]], [[250]], [[90]]], [0, 0.01, 0.02, 0.03, 0.04])
    >>> events.t_us.tolist(), events.p.tolist()
    ([10000, 13333, 16667, 20000, 32500, 35000, 37500, 40000], [1, 1, 1, 1, -1, -1, -1, -1])
    """
    pixels = V2ePixels(
        contrast_threshold=contrast_threshold,
        contrast_threshold_off=contrast_threshold_off,
        cutoff_hz=cutoff_hz,
        version=version,
        threshold_mismatch=threshold_mismatch,
        leak_hz=leak_hz,
        shot_noise_hz=shot_noise_hz,
        refractory_s=refractory_s,
        seed=seed,
    )
    times_s = np.asarray(t_s, np.float64)
    if times_s.ndim != 1 or not (times_s.size and np.all(np.diff(times_s, prepend=-1.0) > 0)):
        raise SensorError("t_s: found times that do not increase from frame to frame")
    if not times_s[0] >= 0 or not times_s[-1] < math.inf:
        raise SensorError(f"t_s: found {times_s[0]:g} to {times_s[-1]:g} s, expected 0 s or later")
    parts, k = list[Events](), 0
    for k, frame in enumerate(frames, start=1):
        if k > len(times_s):
            break
        parts.append(pixels.push(frame, float(times_s[k - 1])))
    if k != len(times_s):
        raise SensorError(f"t_s: found {len(times_s)} times for {k} frames or more")
    pixels.warn_if_clamped()
    return concatenate(parts)


class V2eFrame(NamedTuple):
    """A frame as v2e sees it, whose logarithm sensors of one size can share.

    Parameters
    ----------
    light
        (H, W) float64 intensities, 255 for white.
    logs
        (H, W) float64 their logarithms, linear in the dark, rounded as by the program.
    """

    light: NDArray[np.float64]
    logs: NDArray[np.float64]

    @classmethod
    def of(cls, frame: ArrayLike) -> V2eFrame:
        """Return an image as such a frame.

        Parameters
        ----------
        frame
            (H, W) as in `v2e`.

        Returns
        -------
        V2eFrame

        Raises
        ------
        SensorError
            It is not an image of real numbers of at least 0.
        """
        image = np.asarray(frame)
        if image.ndim != 2 or image.size == 0 or max(image.shape) > _MOST_PX:
            raise SensorError(f"found shape {image.shape}, expected (height, width)")
        if image.dtype.kind not in "uif":
            raise SensorError(f"found {image.dtype}, expected real numbers from 0 to 255")
        light = image.astype(np.float64)
        if not (light.min() >= 0 and light.max() < math.inf):
            raise SensorError("found a pixel that is not a finite number, 0 or more")
        dark = light * (math.log(_JOINT) / _JOINT)
        logs = np.where(light <= _JOINT, dark, np.log(np.maximum(light, _JOINT)))
        return cls(light, np.round(logs * 10.0**_DIGITS) / 10.0**_DIGITS)


class V2ePixels:
    """The pixels of v2e, which see one frame after another.

    Parameters
    ----------
    contrast_threshold, contrast_threshold_off, cutoff_hz, version, threshold_mismatch, leak_hz, \
shot_noise_hz, refractory_s, seed
        As in `v2e`.

    Raises
    ------
    SensorError
        A value is out of range.

    Examples
    --------
    >>> from sensor.emulators import V2ePixels
    >>> pixels = V2ePixels(contrast_threshold=0.2)
    >>> [pixels.push([[light]], 0.01 * k).t_us.tolist() for k, light in enumerate((100, 130, 250))]
    [[], [10000], [13333, 16667, 20000]]
    """

    def __init__(
        self,
        *,
        contrast_threshold: float = 0.2,
        contrast_threshold_off: float | None = None,
        cutoff_hz: float = math.inf,
        version: Version = "C",
        threshold_mismatch: float = 0.0,
        leak_hz: float = 0.0,
        shot_noise_hz: float = 0.0,
        refractory_s: float = 0.0,
        seed: int = 0,
    ) -> None:
        off = contrast_threshold if contrast_threshold_off is None else contrast_threshold_off
        for name, value, least in (
            ("contrast_threshold", contrast_threshold, _LEAST_THRESHOLD),
            ("contrast_threshold_off", off, _LEAST_THRESHOLD),
            ("cutoff_hz", cutoff_hz, math.ulp(0.0)),
            ("threshold_mismatch", threshold_mismatch, 0),
            ("leak_hz", leak_hz, 0),
            ("shot_noise_hz", shot_noise_hz, 0),
            ("refractory_s", refractory_s, 0),
        ):
            if not value >= least or (math.isinf(value) and name != "cutoff_hz"):
                raise refusal(name, value, f"a finite number, {least:.2g} or more")
        if version not in get_args(Version):
            raise refusal("version", version, "'A', 'B' or 'C'")
        self._thresholds = contrast_threshold, off
        self._cutoff_hz, self._version = cutoff_hz, version
        self._threshold_mismatch, self._leak_hz = threshold_mismatch, leak_hz
        self._shot_noise_hz, self._refractory_s = shot_noise_hz, refractory_s
        self._rng = np.random.default_rng(seed)
        self._smallest_share = math.inf  # of the input in a step of the filter
        self._memory: Array | None = None
        self._frames = 0

    def push(self, frame: ArrayLike | V2eFrame, t_s: float) -> Events:
        """Return the events between the frame before and this one, none for the first.

        Parameters
        ----------
        frame
            (H, W) as in `v2e`.
        t_s
            Its time, seconds.

        Returns
        -------
        Events

        Raises
        ------
        SensorError
            The frame differs in size from the first, or is not one of real numbers of at least 0.
        """
        self._frames += 1
        try:
            given = frame if isinstance(frame, V2eFrame) else V2eFrame.of(frame)
            if self._memory is not None and self._memory.shape != given.logs.shape:
                was = self._memory.shape
                raise SensorError(f"found shape {given.logs.shape}, expected {was} as before")
        except SensorError as error:
            raise SensorError(f"frame {self._frames - 1}: {error}") from None
        height, width = given.light.shape
        logs = given.logs.astype(np.float32) if self._version == "C" else given.logs
        if self._memory is None:
            self._start(logs)
            columns = Columns.room(0)
            self._previous_s = 0.0 if self._version == "C" else t_s
        else:
            columns = self._between(given.light, logs, t_s, self._memory)
            self._previous_s = t_s
        return Events(*columns, width=width, height=height)

    def warn_if_clamped(self) -> bool:
        """Warn if each step of the filter so far was clamped, which leaves no filter.

        Returns
        -------
        bool
            Whether it warned.
        """
        clamped = self._smallest_share == 1 and math.isfinite(self._cutoff_hz)
        if clamped:
            _log.warning(
                "v2e: each step of the filter is clamped at 1, so no pixel has any lag; at %g Hz, "
                "frames must be less than %.2g s apart",
                self._cutoff_hz,
                1 / (2 * math.pi * self._cutoff_hz),
            )
        return clamped

    def _start(self, logs: Array) -> None:
        """Set the state at the first frame; only version C without a filter is in 32 bits."""
        is_c, shape, draw = self._version == "C", logs.shape, self._rng.standard_normal
        kind = np.float32 if is_c and math.isinf(self._cutoff_hz) else np.float64
        on, off = (np.full(shape, C) for C in self._thresholds)
        if self._threshold_mismatch:
            on, off = (C + self._threshold_mismatch * draw(shape) for C in (on, off))
            on, off = (np.maximum(C, _LEAST_THRESHOLD).astype(np.float32) for C in (on, off))
        step_kind = np.float32 if is_c else np.float64
        self._C: tuple[Array, Array] = on.astype(kind), off.astype(kind)
        self._steps = on.astype(step_kind), off.astype(step_kind)
        self._poles = logs.astype(kind), logs.astype(kind)
        self._memory = logs.astype(kind)
        self._fired_s = np.full(shape, -np.inf, np.float32)
        self._leaks_hz: Any = 0.0
        if self._leak_hz:
            self._leaks_hz = self._leak_hz * 10.0 ** (_SPREAD * draw(shape))

    def _between(self, light: Array, logs: Array, end_s: float, memory: Array) -> Columns:
        """Return the events of an interval, and change the memory."""
        is_c, two_poles = self._version == "C", self._version == "A"
        interval_s, (on, off) = end_s - self._previous_s, self._C
        rate = 2 * math.pi * self._cutoff_hz * interval_s
        share = _filter(light, logs, rate, two_poles, *self._poles)
        self._smallest_share = min(self._smallest_share, share)
        level = self._poles[1 if two_poles else 0]
        if self._leak_hz:
            jitter = 1 - _SPREAD * self._rng.standard_normal(logs.shape)
            memory -= (interval_s * self._leaks_hz * jitter * on).astype(np.float32)
        noise = self._shot_noise(light, interval_s)
        counts = np.empty(logs.shape, np.int32)
        most = max(1, _count(level, memory, on, off, counts))
        slots_s = _slots_s(self._previous_s, end_s, most, is_c)
        slots_us = np.rint(1e6 * slots_s.astype(np.float64)).astype(np.int64)
        acts = self._refractory_s > interval_s / most
        dead_s = np.float32(self._refractory_s if acts else 0.0)
        columns = Columns.room(int(np.abs(counts).sum()) + int(np.count_nonzero(noise)))
        size = _emit(
            level, memory, *self._steps, counts, noise, slots_s, slots_us, dead_s, self._fired_s,
            columns,
        )  # fmt: skip
        return columns.part(slice(size))

    def _shot_noise(self, light: NDArray[np.float64], interval_s: float) -> NDArray[np.int8]:
        """Return the polarity of the noise event of each pixel, 0 for none."""
        noise = np.zeros(light.shape, np.int8)
        if self._shot_noise_hz:
            by_light = 1 - _OF_WHITE * (light + _JOINT) / _WHITE
            chance = 0.5 * self._shot_noise_hz * interval_s * by_light
            on, off = (C / own for C, own in zip(self._thresholds, self._C, strict=True))
            drawn = self._rng.random(light.shape)
            noise[drawn < chance * off] = -1
            noise[drawn > 1 - chance * on] = 1
        return noise


def _slots_s(start_s: float, end_s: float, count: int, is_c: bool) -> NDArray[np.float32]:
    """Return the times of the slots between two frames, as 32-bit floats."""
    if not is_c:
        k = np.arange(1, count + 1)
        return (start_s + (end_s - start_s) * k / (count + 1)).astype(np.float32)
    first, last = np.float32(start_s + (end_s - start_s) / count), np.float32(end_s)
    if count == 1:
        return np.array([first])
    step, k = (last - first) / np.float32(count - 1), np.arange(count, dtype=np.float32)
    # From both ends, as in the program's library, so that the last slot is exactly the end.
    return np.where(k < count // 2, first + step * k, last - step * (np.float32(count - 1) - k))


@jit
def _filter(
    light: NDArray[np.float64],
    logs: Array,
    rate: float,  # 2 pi cutoff times the interval
    two_poles: bool,
    first: Array,  # (H, W), changed: the poles
    second: Array,
) -> float:
    smallest = 1.0
    height, width = logs.shape
    for y in range(height):
        for x in range(width):
            share = min(1.0, (light[y, x] + _JOINT) / _WHITE * rate)
            smallest = min(smallest, share)
            first[y, x] = (1.0 - share) * first[y, x] + share * logs[y, x]
            if two_poles:
                second[y, x] = (1.0 - share) * second[y, x] + share * first[y, x]
    return smallest


@jit
def _count(
    level: Array,
    memory: Array,
    on: Array,
    off: Array,
    counts: NDArray[np.int32],  # (H, W), overwritten: events of each pixel, negative for OFF
) -> int:
    most = 0
    height, width = level.shape
    for y in range(height):
        for x in range(width):
            change, counted = level[y, x] - memory[y, x], np.int32(0)
            if change >= on[y, x]:  # most do not, and the program's division is slow
                counted = np.int32(change // on[y, x])
            elif -change >= off[y, x]:
                counted = -np.int32(-change // off[y, x])
            counts[y, x] = counted
            most = max(most, abs(counts[y, x]))
    return most


@jit
def _emit(
    level: Array,
    memory: Array,  # changed
    on_step: Array,
    off_step: Array,
    counts: NDArray[np.int32],  # negative for OFF
    noise: NDArray[np.int8],  # polarity of a noise event, or 0
    slots_s: NDArray[np.float32],
    slots_us: NDArray[np.int64],
    dead_s: np.float32,  # 0: all events are told
    fired_s: NDArray[np.float32],  # (H, W), changed: time of the last event
    events: Columns,  # overwritten
) -> int:
    height, width = counts.shape
    written = 0
    busy = np.flatnonzero(counts.ravel())
    told = np.zeros(busy.size, on_step.dtype)  # so that products are of this type
    for slot in range(slots_s.size):
        for k in range(busy.size):
            y, x = busy[k] // width, busy[k] % width
            if abs(counts[y, x]) <= slot:
                continue
            if dead_s > 0 and not slots_s[slot] - fired_s[y, x] > dead_s:
                continue
            fired_s[y, x] = slots_s[slot] if dead_s > 0 else fired_s[y, x]
            told[k] += 1
            events.t_us[written], events.x[written], events.y[written] = slots_us[slot], x, y
            events.p[written] = 1 if counts[y, x] > 0 else -1
            written += 1
    for k in range(busy.size):
        y, x = busy[k] // width, busy[k] % width
        if counts[y, x] > 0:
            memory[y, x] += told[k] * on_step[y, x]
        else:
            memory[y, x] -= told[k] * off_step[y, x]
    for y in range(height):
        for x in range(width):
            if noise[y, x]:
                events.t_us[written], events.x[written], events.y[written] = slots_us[-1], x, y
                events.p[written] = noise[y, x]
                memory[y, x] = level[y, x]
                written += 1
    return written
