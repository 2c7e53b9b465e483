"""The pixels of several sensors, which get the frames of one stream a few at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack

import numpy as np
from numpy.typing import NDArray

from sensor.engine.devices import Device
from sensor.engine.group import SensorGroup, members_by_light
from sensor.engine.sorting import Room
from sensor.events import Events
from sensor.model import SensorModel


class Live:
    """Groups of sensors with the same light, and the threads that simulate them."""

    def __init__(
        self,
        models: Sequence[SensorModel],
        speeds: Sequence[float],
        starts: Sequence[int],
        seed: int,
        device: Device,
        samples: int,
    ) -> None:
        self._models, self._speeds, self._starts = models, speeds, starts
        self._seed, self._device = seed, device
        self.members = sorted(members_by_light(models, starts), key=lambda group: starts[group[0]])
        work = max(
            len(group) * models[group[0]].width * models[group[0]].height for group in self.members
        )
        if device.on_gpu:
            work = max(work, samples)  # the frames are there, too
        self.most_frames = max(1, min(device.most_frames, device.most_work // work))  # at once
        self.fired = 0  # events of the last push, of the group with the most of them
        self._rooms: list[Room] = [lambda size, _: device.room(size)] * len(models)
        self._waiting = deque(self.members)
        self._groups: list[SensorGroup] = []
        self._done = 0  # frames so far
        self._last_s = np.empty(0)  # time of the last of them
        self._stack = ExitStack()
        self._workers = self._stack.enter_context(device.workers())

    def push(
        self,
        chunk: NDArray[np.floating],
        t_s: NDArray[np.float64],
        rooms: Sequence[Room] | None = None,
    ) -> Iterator[tuple[int, Events]]:
        """Simulate the next frames; the events do not depend on the division into chunks.

        The chunk is (F, H, W) linear radiance on the device, and `t_s` its (F,) times. The first
        frame of the stream may also be in host memory. The results are indices of models with their
        next events. The parts of each model are in order, and end before the microsecond of the
        last frame. Most are views of the columns that the model's `Room` returned last.
        """
        rooms = rooms or self._rooms
        self.fired, begin = 0, 0
        while begin < len(chunk):
            wanted = self.most_frames
            if self._waiting:
                wanted = min(wanted, self._next_start + 1 - self._done)
            part = chunk[begin : begin + wanted]
            times_s = np.append(self._last_s, t_s[begin : begin + len(part)])
            for group in self._groups:
                yield from group.advance(part, self._done, times_s, rooms, self._workers)
            self.fired += max((group.fired for group in self._groups), default=0)
            begin += len(part)
            self._done += len(part)
            self._last_s = times_s[-1:]
            while self._waiting and self._next_start == self._done - 1:
                self._groups.append(self._started(self._waiting.popleft(), part[len(part) - 1]))

    def finish(self) -> Iterator[tuple[int, Events]]:
        """Yield `(index of the model, its events in the microsecond of the last frame)`."""
        for group in self._groups:
            yield from group.finish()

    def close(self) -> None:
        """End the threads."""
        self._stack.close()

    @property
    def _next_start(self) -> int:
        """Index of the first frame of the next group."""
        return self._starts[self._waiting[0][0]]

    def _started(self, members: list[int], frame: NDArray[np.floating]) -> SensorGroup:
        """Return the group of some models, whose pixels see this frame first."""
        return self._device.group.start(
            members,
            [self._models[i] for i in members],
            [self._speeds[i] for i in members],
            frame.copy_to_host() if hasattr(frame, "copy_to_host") else frame,
            self._seed,
            self._starts[members[0]],
        )
