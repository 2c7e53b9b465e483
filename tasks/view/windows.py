"""The events of each picture, read from a file in bounded memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sensor.events import Events, concatenate


@dataclass(frozen=True, slots=True)
class Span:
    """The time span and the number of a file's events."""

    start_us: int
    end_us: int
    count: int


def span_of(
    parts: Iterable[Events], start_us: int | None = None, end_us: int | None = None
) -> Span | None:
    """Measure the events of a stream."""
    first, last, count = None, 0, 0
    for part in parts:
        low = 0 if start_us is None else int(np.searchsorted(part.t_us, start_us))
        high = len(part) if end_us is None else int(np.searchsorted(part.t_us, end_us))
        if low < high:
            first = int(part.t_us[low]) if first is None else first
            last = int(part.t_us[high - 1])
            count += high - low
        if high < len(part):
            break
    return None if first is None else Span(first, last + 1, count)


def windows(
    parts: Iterable[Events],
    ends_us: Sequence[int],
    *,
    length_us: int | None = None,
    count: int | None = None,
) -> Iterator[Events]:
    """Yield the events of windows that end at given times.

    Parameters
    ----------
    ends_us
        Ends of the windows, ascending, us.
    """
    stream = iter(parts)
    held = next(stream)
    for end_us in ends_us:
        fresh = []
        while not (len(held) and held.t_us[-1] >= end_us):
            if (part := next(stream, None)) is None:
                break
            fresh.append(held)
            # Keep only what this window can still need, however far away its end is.
            held = part
            fresh = _needed(fresh, held, end_us, length_us, count)
        if fresh:
            held = concatenate([*fresh, held])
        stop = int(np.searchsorted(held.t_us, end_us))
        if length_us is not None:
            begin = int(np.searchsorted(held.t_us, end_us - length_us))
        else:
            begin = max(0, stop - (count or 0))
        yield held[begin:stop]
        held = held[begin:]


def _needed(
    parts: list[Events], after: Events, end_us: int, length_us: int | None, count: int | None
) -> list[Events]:
    """Return the last parts: those needed by a window that ends in `after` or later."""
    if length_us is not None:
        return [part for part in parts if len(part) and part.t_us[-1] >= end_us - length_us]
    later = int(np.searchsorted(after.t_us, end_us))
    needed: list[Events] = []
    for part in reversed(parts):
        if later >= (count or 0):
            break
        needed.insert(0, part)
        later += len(part)
    return needed
