"""The engine of `simulate`: simulate several sensors and read the frames once."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sensor.engine.arguments import (
    check_fit,
    check_memory,
    checked_models,
    checked_seed,
    checked_speeds,
    checked_starts,
    checked_threads,
)
from sensor.engine.devices import device_called
from sensor.engine.frames import (
    Frames,
    check_spans,
    checked_times,
    warn_of_long_intervals,
    warn_of_whole_numbers,
    whole_microseconds,
)
from sensor.engine.group import SensorGroup, members_by_light
from sensor.engine.pieces import Pieces
from sensor.engine.sorting import Room, room_for_events
from sensor.errors import SensorError
from sensor.events import Columns, Events
from sensor.levels import DARK_FRACTION, white_level
from sensor.model import SensorModel

_LEAST_WHITE, _MOST_WHITE = 1e-296, 1e302  # so that the dark level is one that models take
_FIRST_FRAMES = 4  # at most, of the first chunk, so that the first events come soon
# Room for events in `collect`: _RESERVE times the expected number, but at most the larger of
# _MOST_GROWTH times the number so far and _FEW_EVENTS.
_RESERVE = 1.3
_MOST_GROWTH = 4
_FEW_EVENTS = 1 << 26


class Bank:
    """Sensors that see the same frames; checks all arguments.

    Parameters and errors are those of `sensor.simulate_bank`.
    """

    def __init__(
        self,
        frames: Frames,
        t_s: ArrayLike,
        models: Sequence[SensorModel],
        speeds: Sequence[float] | None,
        seed: int,
        threads: int | None,
        device: str = "cpu",
        starts: Sequence[int] | None = None,
    ) -> None:
        models = checked_models(models)
        self.speeds = checked_speeds(speeds, len(models))
        self.seed = checked_seed(seed)
        self.threads = checked_threads(threads)
        self.t_s = checked_times(t_s)
        self.starts = checked_starts(starts, len(models), len(self.t_s))
        self._device = device_called(device, self.threads)
        self.reader = self._device.reader(frames, len(self.t_s))
        for speed in {*self.speeds}:
            check_spans(self.t_s / speed, speed)
        for model in models:
            check_fit(model, *self.reader.shape)
        check_memory(models, self.starts)
        warn_of_long_intervals(self.t_s)
        warn_of_whole_numbers(self.reader.first)
        if any(m.dark_level is None for m in models):
            dark_level = DARK_FRACTION * self._white("dark_level")
            models = [
                m if m.dark_level is not None else replace(m, dark_level=dark_level) for m in models
            ]
        if any(map(_needs_white, models)):
            white = self._white("cutoff_reference")
            models = [replace(m, cutoff_reference=white) if _needs_white(m) else m for m in models]
        self.models = models

    def _white(self, name: str) -> float:
        white = white_level(self.reader.first)
        if white <= 0:
            raise SensorError(
                f"{name}: found None and a black first frame, which gives no white level, "
                f"expected a value for SensorModel.{name}"
            )
        if not _LEAST_WHITE <= white <= _MOST_WHITE:
            raise SensorError(
                f"{name}: found None and a white level of {white:g} in the first frame, expected "
                f"{_LEAST_WHITE:g} to {_MOST_WHITE:g}, or a value for SensorModel.{name}"
            )
        return white

    def run(self, rooms: Sequence[Room] | None = None) -> Iterator[tuple[int, Events]]:
        """Yield `(index of the model, its next events)`; the parts of each model are in order.

        Most parts are views of the columns that the model's `Room` returned last.
        """
        rooms = rooms or [lambda size, _: self._device.room(size)] * len(self.models)
        waiting = deque(
            sorted(members_by_light(self.models, self.starts), key=lambda one: self.starts[one[0]])
        )
        models = [[self.models[i] for i in members] for members in waiting]
        work = max(len(group) * group[0].width * group[0].height for group in models)
        if self._device.on_gpu:
            work = max(work, self.reader.first.size)  # the frames are there, too
        most = max(1, min(self._device.most_frames, self._device.most_work // work))
        pieces = Pieces(self.reader.first, models)
        groups: list[SensorGroup] = []
        frame, done = self.reader.first, 1
        with self._device.workers() as workers:
            while True:
                while waiting and self.starts[waiting[0][0]] == done - 1:
                    groups.append(self._started(waiting.popleft(), frame))
                if done == len(self.t_s):
                    break
                wanted = min(most, _FIRST_FRAMES) if done == 1 else most
                if waiting:
                    wanted = min(wanted, self.starts[waiting[0][0]] + 1 - done)
                chunk = self.reader.chunk(done, wanted)
                end = done + len(chunk)
                while done < end:
                    rest = chunk[done - end :]
                    # A GPU counts events before it fires them; the processor has to foretell them.
                    piece = rest if self._device.on_gpu else rest[: pieces.frames(rest)]
                    t_s = self.t_s[done - 1 : done + len(piece)]
                    for group in groups:
                        yield from group.advance(piece, done, t_s, rooms, workers)
                    pieces.learn(len(piece), max((group.fired for group in groups), default=0))
                    done += len(piece)
                frame = chunk[len(chunk) - 1]
            self.reader.check_end()
        for group in groups:
            yield from group.finish()

    def _started(self, members: list[int], frame: NDArray[np.floating]) -> SensorGroup:
        """Return the group of some models, whose pixels see this frame first."""
        return self._device.group.start(
            members,
            [self.models[i] for i in members],
            [self.speeds[i] for i in members],
            frame.copy_to_host() if hasattr(frame, "copy_to_host") else frame,
            self.seed,
            self.starts[members[0]],
        )


def _needs_white(model: SensorModel) -> bool:
    """Return whether the model has v2e's filter but no radiance of white."""
    limited = model.photoreceptor == "v2e" and model.cutoff_hz < math.inf
    return limited and model.cutoff_reference is None


def collect(bank: Bank) -> list[Events]:
    """Run a bank and return the events of each model."""
    ends_us = [
        whole_microseconds(bank.t_s[[start, -1]] / speed)[0]
        for start, speed in zip(bank.starts, bank.speeds, strict=True)
    ]
    joined = [_Joined(*map(int, end_us)) for end_us in ends_us]
    for i, events in bank.run([each.room for each in joined]):
        joined[i].append(events)
    return [each.events for each in joined]


class _Joined:
    """Consecutive parts of a stream in one array for each column.

    The arrays grow to the size that the events so far predict for the whole stream, so that few
    events are copied. New memory beyond the last event is never touched.

    Parameters
    ----------
    start_us, end_us
        Time of the first and the last frame, us.
    """

    def __init__(self, start_us: int, end_us: int) -> None:
        self._start_us = start_us
        self._span_us = end_us - start_us
        self._columns = Columns.room(0)
        self._used = 0
        self.events: Events

    def room(self, size: int, end_us: int) -> Columns:
        """Return columns for the next `size` events, before `end_us`; older columns may move."""
        used, needed = self._used, self._used + size
        if needed > len(self._columns.t_us):
            passed_us = max(1, end_us - self._start_us)
            expected = int(_RESERVE * needed * self._span_us / passed_us)
            most = max(_MOST_GROWTH * needed, _FEW_EVENTS)  # the prediction can be far off
            old = self._columns.part(slice(used))
            self._columns = room_for_events(max(needed, min(expected, most)))
            _copy(old, self._columns.part(slice(used)))
        return self._columns.part(slice(used, needed))

    def append(self, part: Events) -> None:
        """Add the next part of the stream: the first events in the latest room, or others."""
        if not np.may_share_memory(part.t_us, self._columns.t_us):
            end_us = int(part.t_us[-1]) if len(part) else self._start_us
            _copy(part.columns, self.room(len(part), end_us))
        self._used += len(part)
        self.events = Events.trusted(*self._columns.part(slice(self._used)), like=part)


def _copy(source: Columns, out: Columns) -> None:
    for k in range(len(source)):
        out[k][:] = source[k]
