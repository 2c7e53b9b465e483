"""The compiled kernels of the readout: one bus, one FIFO, and rows in order of their oldest event.

The bus has been busy since `BUSY_START_US`. Since then it has opened `ROWS` rows and sent `SENT`
events, so its time is `BUSY_START_US + SENT / rate + ROWS * overhead`. No rounding error
accumulates, whatever the length of the recording.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor.compiling import compiler
from sensor.events import Columns

# No fast math: the same float64 operations in the same order on any machine.
jit = compiler(Path(__file__).parent)

# Entries of `Fifo.state`. -1 is no slot or no row.
BUSY_START_US, SENT, ROWS, WAITING, FREE, BURST, BURST_ROW, QUEUE_START, QUEUED = range(9)
STATE_SIZE = 9
# Entries of `Tally.counts` and `Tally.delay_us`.
FIRED, DROPPED, LEFT, DELAYED = range(4)
COUNTS_SIZE = 4
DELAY_SUM_US, DELAY_MAX_US = range(2)
DELAYS_SIZE = 2
END_OF_TIME_US = 1 << 62


class Bus(NamedTuple):
    """Speed of the bus."""

    rate_per_us: float  # events per microsecond within a row
    overhead_us: float  # time to open a row


class Fifo(NamedTuple):
    """Waiting events, in slots, and waiting rows; updated."""

    state: NDArray[np.int64]  # (STATE_SIZE,)
    t_us: NDArray[np.int64]  # (depth,) time at which each waiting event fired
    x: NDArray[np.uint16]
    p: NDArray[np.int8]
    next_slot: NDArray[np.int64]  # (depth,) slot of the next event of the row, or next free slot
    row_first: NDArray[np.int64]  # (height,) slot of the oldest event of each waiting row
    row_last: NDArray[np.int64]  # (height,) slot of its newest event
    row_queue: NDArray[np.int64]  # (height,) ring buffer of waiting rows, oldest first


class Tally(NamedTuple):
    """Counts and delays; updated."""

    counts: NDArray[np.int64]  # (COUNTS_SIZE,)
    delay_us: NDArray[np.float64]  # (DELAYS_SIZE,)


@jit
def advance(until_us: int, bus: Bus, fifo: Fifo, tally: Tally, sent: Columns, used: int) -> int:
    """Send the events that leave no later than `until_us`; open rows only before it.

    Parameters
    ----------
    until_us
        End of the time span.
    bus, fifo, tally
        Speed, state and counts; the last two are updated.
    sent, used
        Output, and its used size.

    Returns
    -------
    New used size of `sent`.
    """
    rate_per_us, overhead_us = bus
    state, slot_t_us, slot_x, slot_p, next_slot, row_first, _, row_queue = fifo
    counts, delay_us = tally
    t_us, x, y, p = sent
    span_us = float(until_us - state[BUSY_START_US])
    while True:
        if state[BURST] < 0:
            now_us = state[SENT] / rate_per_us + state[ROWS] * overhead_us
            if state[QUEUED] == 0 or not now_us < span_us:
                return used
            row = row_queue[state[QUEUE_START]]
            state[QUEUE_START] = (state[QUEUE_START] + 1) % row_queue.size
            state[QUEUED] -= 1
            state[BURST], state[BURST_ROW] = row_first[row], row
            row_first[row] = -1
            state[ROWS] += 1
        leaves_us = (state[SENT] + 1) / rate_per_us + state[ROWS] * overhead_us
        if not leaves_us <= span_us:
            return used
        slot = state[BURST]
        t_us[used] = state[BUSY_START_US] + np.int64(np.floor(leaves_us + 0.5))
        x[used], y[used], p[used] = slot_x[slot], state[BURST_ROW], slot_p[slot]
        counts[LEFT] += 1
        counts[DELAYED] += t_us[used] > slot_t_us[slot]
        used += 1
        late_us = float(state[BUSY_START_US] - slot_t_us[slot]) + leaves_us
        delay_us[DELAY_SUM_US] += late_us
        delay_us[DELAY_MAX_US] = max(delay_us[DELAY_MAX_US], late_us)
        state[BURST] = next_slot[slot]
        next_slot[slot] = state[FREE]
        state[FREE] = slot
        state[SENT] += 1
        state[WAITING] -= 1


@jit
def accept(fired: Columns, bus: Bus, fifo: Fifo, tally: Tally, sent: Columns) -> int:
    """Put events into the FIFO one by one, and send the events that leave before each.

    Parameters
    ----------
    fired
        Events in order.
    bus, fifo, tally
        Speed, state and counts; the last two are updated.
    sent
        Output with space for all waiting events and `fired`.

    Returns
    -------
    Used size of `sent`.
    """
    fired_t_us, fired_x, fired_y, fired_p = fired
    state, slot_t_us, slot_x, slot_p, next_slot, row_first, row_last, row_queue = fifo
    counts, used = tally.counts, 0
    for i in range(fired_t_us.size):
        used = advance(fired_t_us[i], bus, fifo, tally, sent, used)
        counts[FIRED] += 1
        slot = state[FREE]
        if slot < 0:
            counts[DROPPED] += 1
            continue
        if state[WAITING] == 0:
            state[BUSY_START_US], state[SENT], state[ROWS] = fired_t_us[i], 0, 0
        state[FREE] = next_slot[slot]
        state[WAITING] += 1
        slot_t_us[slot], slot_x[slot], slot_p[slot] = fired_t_us[i], fired_x[i], fired_p[i]
        next_slot[slot] = -1
        row = np.int64(fired_y[i])
        if row_first[row] < 0:
            row_first[row] = slot
            row_queue[(state[QUEUE_START] + state[QUEUED]) % row_queue.size] = row
            state[QUEUED] += 1
        else:
            next_slot[row_last[row]] = slot
        row_last[row] = slot
    return used


@jit
def order_ties(events: Columns) -> None:
    """Sort the events of each microsecond by (y, x), in place and stable."""
    t_us, x, y, p = events
    start = 0
    while start < t_us.size:
        stop = start + 1
        while stop < t_us.size and t_us[stop] == t_us[start]:
            stop += 1
        if stop - start > 1:
            keys = np.empty(stop - start, np.uint64)
            for i in range(keys.size):
                k = start + i
                rank = np.uint64(i) << np.uint64(1) | np.uint64(p[k] > 0)
                keys[i] = np.uint64(y[k]) << np.uint64(48) | np.uint64(x[k]) << np.uint64(32) | rank
            keys.sort()
            for i in range(keys.size):
                k = start + i
                y[k] = keys[i] >> np.uint64(48)
                x[k] = (keys[i] >> np.uint64(32)) & np.uint64(0xFFFF)
                p[k] = 1 if keys[i] & np.uint64(1) else -1
        start = stop
