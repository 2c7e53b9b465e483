"""Sort the events of a chunk into their final order."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensor.engine.workers import Workers
from sensor.events import Columns, Events
from sensor.kernels import packing
from sensor.memory import MEMORY, Memory

# Takes a number of events and a time in us, before which they come; returns columns for them.
Room = Callable[[int, int], Columns]

_PART_EVENTS = 1 << 20  # of a part, unless one interval has more


@dataclass(frozen=True)
class UnsortedEvents:
    """Events of one setting and chunk as the kernels return them."""

    pools: list[NDArray[np.uint64]]  # one for each band
    segments: list[NDArray[np.int64]]  # (blocks, S, F, 2) each
    counts: NDArray[np.int64]  # (F,) events of each interval
    frame_us: NDArray[np.int64]  # (F + 1,) frame times
    setting: int

    def parts(self, threads: int) -> Iterator[range]:
        """Yield ranges of about `_PART_EVENTS` events, with an interval for each thread or more.

        Small parts let the next ones reuse memory that is still in the cache.
        """
        F = len(self.counts)
        step = max(threads, _PART_EVENTS // max(1, int(self.counts.max())))
        for first in range(0, F, step):
            yield range(first, min(first + step, F))

    def sort(self, part: range, held: Events, room: Room, workers: Workers) -> Events:
        """Sort the events of some intervals by time, ties by (y, x)."""
        counts = self.counts[part.start : part.stop]
        stops = len(held) + np.cumsum(counts)
        columns = room(int(stops[-1]), int(self.frame_us[part.stop]))
        put_first(held, columns)

        def sort_one(f: int) -> None:
            stop = stops[f - part.start]
            self._sort_interval(f, columns.part(slice(stop - self.counts[f], stop)), held.height)

        workers.map(sort_one, part)
        merge_ties(columns, self.frame_us[part.start : part.stop])
        return Events.trusted(*columns, like=held)

    def _sort_interval(self, f: int, columns: Columns, height: int) -> None:
        start_us, end_us = self.frame_us[f : f + 2]
        bands = list(zip(self.pools, self.segments, strict=True))
        if end_us - start_us < packing.SHORT_INTERVAL_US and height <= packing.FEW_ROWS:
            words = MEMORY.array(int(self.counts[f]), np.uint32)
            stops = np.zeros(end_us - start_us + 2, np.uint64)
            for pool, segment in bands:
                packing.count_times(pool, segment, self.setting, f, stops[1:])
            np.cumsum(stops, out=stops)
            for pool, segment in bands:
                packing.spread(pool, segment, self.setting, f, stops, words)
            packing.unpack(words, stops, start_us, columns)
        else:
            both = MEMORY.array((2, int(self.counts[f])), np.uint64)
            used = 0
            for pool, segment in bands:
                used = packing.gather(pool, segment, self.setting, f, both[0], used)
            packing.sort_by_time(both[0], both[1], end_us - start_us, start_us, columns)


def put_first(held: Events, columns: Columns) -> None:
    """Copy events to the start of columns."""
    arrays: tuple[NDArray, ...] = columns
    for array, old in zip(arrays, held.columns, strict=True):
        array[: len(held)] = old


def merge_ties(columns: Columns, frame_us: NDArray[np.int64]) -> None:
    """Put the events of the microsecond of each frame in raster order, in place.

    They come from the intervals before and after the frame, each in raster order.
    """
    arrays: tuple[NDArray, ...] = columns
    for each_us in np.unique(frame_us):  # many frames may share a microsecond
        tie = slice(*np.searchsorted(columns.t_us, (each_us, each_us + 1)))
        order = np.lexsort((columns.x[tie], columns.y[tie]))  # stable
        for array in arrays:
            array[tie] = array[tie][order]


def room_for_events(size: int, memory: Memory = MEMORY) -> Columns:
    """Allocate columns for `size` events in one block."""
    block = memory.array(13 * size, np.uint8)
    t_us, x, y, p = np.split(block, (8 * size, 10 * size, 12 * size))
    return Columns(t_us.view(np.int64), x.view(np.uint16), y.view(np.uint16), p.view(np.int8))
