"""`SensorGroup` on a GPU."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sensor.engine.frames import refuse_bad_radiance, whole_microseconds
from sensor.engine.group import SensorGroup, light_of
from sensor.engine.sorting import Room, merge_ties, put_first
from sensor.engine.workers import Workers
from sensor.events import Columns, Events
from sensor.gpu import kernels
from sensor.gpu.kernels import launch
from sensor.gpu.memory import DeviceArray, Scratch, upload
from sensor.kernels.packing import MAX_INTERVAL_US, TIME_SHIFT
from sensor.kernels.photoreceptor import photoreceptor_step
from sensor.optics import pixel_overlaps

_PART_EVENTS = 1 << 24  # of a part, unless one interval has more
_DTYPES = np.int64, np.uint16, np.uint16, np.int8  # of `Columns`


@dataclass(eq=False)
class DeviceGroup(SensorGroup):
    """Sensors with the same light, and the state of their pixels on the GPU."""

    scratch: Scratch = field(default_factory=lambda: Scratch("pixels"))

    def __post_init__(self) -> None:
        """Copy the state and the patterns of the pixels to the GPU."""
        u, v1, v2, memory = self.state
        rows = [u] * len(self.models), v1, v2, memory, *self.settings[:3]
        self.state_there = [[upload(row) for row in each] for each in rows]

    def advance(
        self,
        chunk: DeviceArray,
        index: int,
        t_s: NDArray[np.float64],
        rooms: Sequence[Room],
        workers: Workers,
    ) -> Iterator[tuple[int, Events]]:
        """Simulate a chunk of frames."""
        light = self._light(chunk)
        t_s = t_s / self.speeds[:, None]
        frame_us, after_us = whole_microseconds(t_s)
        for s, member in enumerate(self.members):
            work = _Chunk(self, s, light, index, np.diff(t_s[s]), frame_us[s], after_us[s])
            if work.count():
                host = chunk.copy_to_host()
                refuse_bad_radiance(host, index)
                light_of(host, self.models[0], index)  # refuses too little light for no dark level
            for part in work.parts():
                columns = work.write(part, self.held[s], rooms[member])
                merge_ties(columns, frame_us[s, part])
                events = Events.trusted(*columns, like=self.held[s])
                yield member, self._passed_on(s, events, int(frame_us[s, part.stop]))
            del work  # and its memory, before the next takes its own

    def _light(self, chunk: DeviceArray) -> DeviceArray:
        """Average frames (F, H, W) over the pixels: (F, height * width)."""
        model, frames = self.models[0], len(chunk)
        if chunk.shape[1:] != (model.height, model.width):
            overlaps = pixel_overlaps(chunk.shape[1:], model.height, model.width, model.fill_factor)
            arrays_there = [upload(array) for overlap in overlaps for array in overlap]
            larger, size = chunk, (frames, model.height, model.width)
            chunk = self.scratch.array("light", size, np.float64)
            blocks = -(-model.width // 32), -(-model.height // 8), frames
            launch(kernels.integrate_area, blocks, larger, *arrays_there, chunk, threads=(32, 8, 1))
        return chunk.reshape((frames, model.height * model.width))


class _Chunk:
    """One setting of a group over a chunk of F intervals.

    `light` is (F, P) radiance on the GPU, and `index` belongs to the chunk's first frame. `dt_s` is
    (F,), `frame_us` (F + 1,) in whole microseconds, and `after_us` what their rounding left.
    """

    def __init__(
        self,
        group: DeviceGroup,
        s: int,
        light: DeviceArray,
        index: int,
        dt_s: NDArray[np.float64],
        frame_us: NDArray[np.int64],
        after_us: NDArray[np.float64],
    ) -> None:
        model, settings, scratch = group.models[s], group.settings, group.scratch
        self._group, self._s, self._light = group, s, light
        self._frame_us = frame_us
        spans = dt_s, settings.leak_per_s[s] * dt_s, after_us[:-1], *_whole(frame_us)
        steps = [photoreceptor_step(each, model.cutoff_hz, model.poles) for each in dt_s]
        self._clock = upload(np.column_stack((*spans, np.array(steps, np.float64))))
        self._dark = model.dark_level or 0.0
        self._electronics = (
            *(float(values[s]) for values in (*settings[3:6], *settings[7:9])),
            math.log(self._dark) if self._dark > 0 else 0.0,
            settings.seed,
        )
        self._first_frame = index - 1 - group.first
        blocks = -(-light.shape[1] // kernels.THREADS)
        self._upto = scratch.array("upto", light.shape, np.int32)
        self._base = scratch.array("base", (len(dt_s), blocks), np.int64)
        self._stops = np.zeros(len(dt_s) + 1, np.int64)  # events before each interval

    def count(self) -> bool:
        """Count the events; return whether some radiance is invalid."""
        bad = upload(np.zeros(1, np.int32))
        nothing = self._group.scratch.array("words", 1, np.uint64)
        self._advance(slice(0, len(self._stops) - 1), 0, nothing, False, bad)
        starts = self._group.scratch.array("starts", len(self._stops), np.int64)
        launch(kernels.sums_before, 1, self._base, starts, threads=kernels.SCAN_THREADS)
        self._stops = starts.copy_to_host()
        return bool(bad.copy_to_host()[0])

    def parts(self) -> Iterator[slice]:
        """Yield ranges of intervals with about `_PART_EVENTS` events, in which the time fits."""
        start, last = 0, len(self._stops) - 1
        while start < last:
            few = int(np.searchsorted(self._stops, self._stops[start] + _PART_EVENTS, "right")) - 1
            soon = np.searchsorted(self._frame_us, self._frame_us[start] + MAX_INTERVAL_US, "right")
            stop = min(max(start + 1, min(few, int(soon) - 1)), last)
            yield slice(start, stop)
            start = stop

    def write(self, part: slice, held: Events, room: Room) -> Columns:
        """Fire the events of some intervals, and update the state."""
        first = int(self._stops[part.start])
        count = int(self._stops[part.stop]) - first
        scratch = self._group.scratch
        words, other = (scratch.array(name, count, np.uint64) for name in ("words", "sorted"))
        start_us = self._frame_us[part.start]
        self._advance(part, first, words, True, scratch.array("bad", 1, np.int32))
        span_us = int(self._frame_us[part.stop] - start_us)
        words = _sorted(words, other, span_us, scratch) if count else words
        columns = room(len(held) + count, int(self._frame_us[part.stop]))
        arrays: tuple[NDArray, ...] = columns.part(slice(len(held), None))
        put_first(held, columns)
        if count:
            sizes = zip("txyp", [count] * 4, _DTYPES, strict=True)
            arrays_there = [scratch.array(*size) for size in sizes]
            launch(kernels.unpack, -(-count // kernels.THREADS), words, start_us, *arrays_there)
            for array, new in zip(arrays, arrays_there, strict=True):
                new.copy_to_host(array)
        return columns

    def _advance(
        self, part: slice, first: int, words: DeviceArray, writes: bool, bad: DeviceArray
    ) -> None:
        group, s = self._group, self._s
        settings = group.settings
        launch(
            kernels.advance(bool(settings.filtered[s]), bool(settings.noisy[s])),
            self._base.shape[1],
            self._light[part],
            self._dark,
            group.models[s].width,
            *(state[s] for state in group.state_there),
            self._clock[part],
            int(self._frame_us[part.start] - self._frame_us[0]),
            *self._electronics,
            self._first_frame + part.start,
            self._upto[part],
            self._base[part],
            first,
            words,
            writes,
            bad,
        )


def _whole(frame_us: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lengths of intervals, and their starts since the first, whole microseconds."""
    return np.diff(frame_us).astype(np.float64), (frame_us[:-1] - frame_us[0]).astype(np.float64)


def _sorted(words: DeviceArray, other: DeviceArray, span_us: int, scratch: Scratch) -> DeviceArray:
    """Sort packed events by time, and keep the order of equal times; return one of both arrays."""
    tiles = -(-words.size // kernels.SORT_TILE)
    counts = scratch.array("counts", (kernels.DIGITS, tiles), np.int64)
    starts = scratch.array("starts", kernels.DIGITS + 1, np.int64)
    for bit in range(0, span_us.bit_length(), kernels.DIGIT_BITS):
        shift = np.uint64(int(TIME_SHIFT) + bit)
        launch(kernels.count_digits, tiles, words, shift, counts)
        launch(kernels.sums_before, 1, counts, starts, threads=kernels.SCAN_THREADS)
        launch(kernels.move_by_digit, tiles, words, shift, counts, other)
        words, other = other, words
    return words
