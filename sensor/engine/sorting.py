"""Sort the events of a chunk into their final order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensor.engine.workers import Workers
from sensor.events import Columns, Events
from sensor.kernels.packing import gather, sort_by_time


@dataclass(frozen=True)
class UnsortedEvents:
    """Events of one setting and chunk as the kernels return them."""

    pools: list[NDArray[np.uint64]]  # one for each band
    segments: list[NDArray[np.int64]]  # (blocks, S, F, 2) each
    counts: NDArray[np.int64]  # (F,) events of each interval
    frame_us: NDArray[np.int64]  # (F + 1,) frame times
    setting: int

    def sort(self, held: Events, workers: Workers) -> Events:
        """Sort by time, ties by (y, x).

        Parameters
        ----------
        held
            Events of the chunk before that may share a microsecond with this chunk.
        workers
            Threads.

        Returns
        -------
        Events
            `held`, then the events of this chunk.
        """
        starts = len(held) + np.concatenate(([0], np.cumsum(self.counts)))
        columns = Columns.room(int(starts[-1]))
        arrays: tuple[NDArray, ...] = columns
        for array, old in zip(arrays, held.columns, strict=True):
            array[: len(held)] = old

        def sort_interval(f: int) -> None:
            room = workers.scratch.get()
            if room.shape[1] < self.counts[f]:
                room = np.empty((2, self.counts[f]), np.uint64)
            words, other = room[:, : self.counts[f]]
            used = 0
            for pool, segment in zip(self.pools, self.segments, strict=True):
                used = gather(pool, segment, self.setting, f, words, used)
            start_us, end_us = self.frame_us[f : f + 2]
            part = columns.part(slice(starts[f], starts[f + 1]))
            sort_by_time(words, other, end_us - start_us, start_us, part)
            workers.scratch.put(room)

        list(workers.map(sort_interval, range(len(self.counts))))
        # The microsecond of a frame has events of the intervals before and after it.
        for frame_us in self.frame_us[:-1]:
            tie = slice(*np.searchsorted(columns.t_us, (frame_us, frame_us + 1)))
            order = np.lexsort((columns.x[tie], columns.y[tie]))  # stable
            for array in arrays:
                array[tie] = array[tie][order]
        return Events.trusted(*columns, like=held)
