"""Parts of a stream: of equal size to write, in order and with valid places when read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from sensor.errors import EventFormatError, reading
from sensor.events import Events, concatenate

PART_EVENTS = 1 << 20  # events in memory at a time


def rebatch(parts: Iterable[Events]) -> Iterator[Events]:
    """Yield the same events in parts of exactly `PART_EVENTS`, except for the last part.

    So a file does not depend on the original parts. An empty stream is one empty part.
    """
    held: list[Events] = []
    count = 0
    first: Events | None = None
    last_us: int | None = None
    for k, part in enumerate(parts):
        if not isinstance(part, Events):
            raise EventFormatError(f"part {k}: found {type(part).__name__}, expected Events")
        if first is None:
            first = part[:0].copy()  # keeps nothing alive
        if (part.width, part.height, part.model) != (first.width, first.height, first.model):
            raise EventFormatError(
                f"part {k}: its size, {part.width}x{part.height} px, or its SensorModel differs "
                f"from part 0 ({first.width}x{first.height} px)"
            )
        if len(part) == 0:
            continue
        if last_us is not None and part.t_us[0] < last_us:
            raise EventFormatError(
                f"part {k}: starts at {part.t_us[0]} us, but earlier parts end at {last_us} us"
            )
        last_us = int(part.t_us[-1])
        while count + len(part) >= PART_EVENTS:
            cut = PART_EVENTS - count
            yield concatenate([*held, part[:cut]])
            held, count, part = [], 0, part[cut:]
        if len(part):
            held.append(_alone(part))
            count += len(part)
    if first is None:
        raise EventFormatError("parts: found none, expected at least one part, which may be empty")
    if held:
        yield concatenate(held)
    elif last_us is None:
        yield first


def _alone(part: Events) -> Events:
    """Return the same events without the larger arrays of which they are a part."""
    for column in part.columns:
        if isinstance(column.base, np.ndarray) and column.base.nbytes > 2 * column.nbytes:
            return part.copy()
    return part


def by_time(parts: Iterable[Events]) -> Iterator[Events]:
    """Yield the same events sorted by time, ties as they were; all are in memory at once."""
    held = list(parts)
    if not held:
        return
    events = concatenate(held)
    order = np.argsort(events.t_us, kind="stable")
    for start in range(0, len(order), PART_EVENTS):
        part = order[start : start + PART_EVENTS]
        yield Events.trusted(*events.columns.part(part), like=events)


def in_order(
    packets: Iterable[tuple[str, Events]], none: Events, *, sort: bool
) -> Iterator[Events]:
    """Yield an empty part, then the parts of a file: sorted, or checked to be in order.

    A packet has its place in the file, for errors, and its events, whose times may be unsorted.
    """
    yield none
    if sort:
        yield from by_time(events for _, events in packets)
        return
    last_us: int | None = None
    for where, events in packets:
        if len(events):
            before_us = np.concatenate(
                ([events.t_us[0] if last_us is None else last_us], events.t_us)
            )
            backwards = np.flatnonzero(before_us[1:] < before_us[:-1])
            if len(backwards):
                raise EventFormatError(
                    f"{where}: its event {backwards[0]} is earlier than the previous event "
                    "(--sort or sort=True sorts the events)"
                )
            last_us = int(events.t_us[-1])
            yield events


def with_checked_places(
    t_us: NDArray[np.int64],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    on: NDArray[np.bool_],
    where: str,
    like: Events,
) -> Events:
    """Return read events, after a check of all but their times, which may be unsorted."""
    p = np.where(on, 1, -1).astype(np.int8)
    with reading(where):
        Events(np.zeros_like(t_us), x, y, p, like.width, like.height)
    return Events.trusted(t_us, x, y, p, like=like)
