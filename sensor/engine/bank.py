"""The engine of `simulate`: simulate several sensors and read the frames once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing

import numpy as np
from numpy.typing import ArrayLike

from sensor.engine import arguments
from sensor.engine.chunks import Chunks
from sensor.engine.devices import device_called
from sensor.engine.frames import (
    FrameInput,
    check_spans,
    checked_times,
    warn_of_long_intervals,
    warn_of_whole_numbers,
    whole_microseconds,
)
from sensor.engine.live import Live
from sensor.engine.sorting import Room, room_for_events
from sensor.events import Columns, Events

_FIRST_FRAMES = 4  # at most, of the first chunk, so that the first events come soon
# Room for events in `collect`: _RESERVE times the expected number, but at most the larger of
# _MAX_GROWTH times the number so far and _FEW_EVENTS.
_RESERVE = 1.3
_MAX_GROWTH = 4
_FEW_EVENTS = 1 << 26


class Bank:
    """Sensors that see the same frames; checks all arguments as `sensor.simulate_bank`."""

    def __init__(
        self,
        frames: FrameInput,
        t_s: ArrayLike,
        models: Sequence[arguments.Lit],
        speeds: Sequence[float] | None,
        seed: int,
        threads: int | None,
        device: str = "cpu",
        starts: Sequence[int] | None = None,
    ) -> None:
        given = list(models) if isinstance(models, Iterable) else models
        models = arguments.checked_models(given)
        self.speeds = arguments.checked_speeds(speeds, len(models))
        self.seed = arguments.checked_seed(seed)
        self.threads = arguments.checked_threads(threads)
        self.t_s = checked_times(t_s)
        self.starts = arguments.checked_starts(starts, len(models), len(self.t_s))
        self._device = device_called(device, self.threads)
        self.reader = self._device.reader(frames, len(self.t_s))
        for speed in {*self.speeds}:
            check_spans(self.t_s / speed, speed)
        for model in models:
            arguments.check_fit(model, *self.reader.shape)
        arguments.check_memory(models, self.starts)
        warn_of_long_intervals(self.t_s)
        warn_of_whole_numbers(self.reader.first)
        self.models = arguments.completed(given, self.reader.first)

    def run(self, rooms: Sequence[Room] | None = None) -> Iterator[tuple[int, Events]]:
        """Yield `(index of the model, its next events)` as `Live.push` does."""
        first = self.reader.first
        live = Live(self.models, self.speeds, self.starts, self.seed, self._device, first.size)
        with closing(live):
            chunks = Chunks(first, [[self.models[i] for i in group] for group in live.members])
            yield from live.push(first[None], self.t_s[:1], rooms)
            done = 1
            while done < len(self.t_s):
                most = live.most_frames
                frames = self.reader.chunk(done, min(most, _FIRST_FRAMES) if done == 1 else most)
                end = done + len(frames)
                while done < end:
                    rest = frames[done - end :]
                    # A GPU counts events before it fires them; the processor has to foretell them.
                    chunk = rest if self._device.on_gpu else rest[: chunks.frames(rest)]
                    yield from live.push(chunk, self.t_s[done : done + len(chunk)], rooms)
                    chunks.learn(len(chunk), live.fired)
                    done += len(chunk)
            self.reader.check_end()
            yield from live.finish()


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
            most = max(_MAX_GROWTH * needed, _FEW_EVENTS)  # the prediction can be far off
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
