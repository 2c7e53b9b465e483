"""The jitted kernels of the readout: one bus, a FIFO, and rows that are served oldest first.

The bus is busy without a break from `BUSY_START_US` on. Since then it has opened `ROWS` rows and
sent `SENT` events, so its clock stands at `BUSY_START_US + SENT / rate + ROWS * overhead`: nothing
is accumulated, and a recording of any length ends as exactly as it began.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

# Nothing is relaxed: the same float64 operations in the same order on any machine.
jit = numba.njit(cache=True, nogil=True, error_model="numpy")

# The integer state; a slot of the FIFO or a row of the sensor is -1 where there is none.
BUSY_START_US, SENT, ROWS, WAITING, FREE, BURST, BURST_ROW, QUEUE_START, QUEUED = range(9)
STATE_SIZE = 9
# What is counted.
FIRED, DROPPED, LEFT, DELAYED = range(4)
COUNTS_SIZE = 4
DELAY_SUM_US, DELAY_MAX_US = range(2)
DELAYS_SIZE = 2
END_OF_TIME_US = 1 << 62


@jit
def advance(
    until_us: int,
    rate_per_us: float,
    overhead_us: float,
    state: NDArray[np.int64],  # (STATE_SIZE,) updated
    slot_t_us: NDArray[np.int64],  # (depth,) when each waiting event fired
    slot_x: NDArray[np.uint16],
    slot_p: NDArray[np.int8],
    slot_next: NDArray[np.int64],  # next event of the same row, or next free slot
    row_first: NDArray[np.int64],  # (height,) oldest event of each row that waits for its turn
    row_queue: NDArray[np.int64],  # (height,) ring: those rows, oldest first
    counts: NDArray[np.int64],  # (COUNTS_SIZE,) updated
    delay_us: NDArray[np.float64],  # (DELAYS_SIZE,) updated
    t_us: NDArray[np.int64],  # out, from `used` on
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    p: NDArray[np.int8],
    used: int,
) -> int:
    """Send what leaves no later than `until_us`, opening rows only before it. Returns used."""
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
        state[BURST] = slot_next[slot]
        slot_next[slot] = state[FREE]
        state[FREE] = slot
        state[SENT] += 1
        state[WAITING] -= 1


@jit
def accept(
    fired_t_us: NDArray[np.int64],  # (N,) events as they fire
    fired_x: NDArray[np.uint16],
    fired_y: NDArray[np.uint16],
    fired_p: NDArray[np.int8],
    rate_per_us: float,
    overhead_us: float,
    state: NDArray[np.int64],
    slot_t_us: NDArray[np.int64],
    slot_x: NDArray[np.uint16],
    slot_p: NDArray[np.int8],
    slot_next: NDArray[np.int64],
    row_first: NDArray[np.int64],
    row_last: NDArray[np.int64],  # (height,) youngest event of each row that waits for its turn
    row_queue: NDArray[np.int64],
    counts: NDArray[np.int64],
    delay_us: NDArray[np.float64],
    t_us: NDArray[np.int64],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    p: NDArray[np.int8],
    used: int,
) -> int:
    """Take events into the FIFO one by one, sending what leaves before each. Returns used."""
    for i in range(fired_t_us.size):
        used = advance(
            fired_t_us[i],
            rate_per_us,
            overhead_us,
            state,
            slot_t_us,
            slot_x,
            slot_p,
            slot_next,
            row_first,
            row_queue,
            counts,
            delay_us,
            t_us,
            x,
            y,
            p,
            used,
        )
        counts[FIRED] += 1
        slot = state[FREE]
        if slot < 0:
            counts[DROPPED] += 1
            continue
        if state[WAITING] == 0:
            state[BUSY_START_US], state[SENT], state[ROWS] = fired_t_us[i], 0, 0
        state[FREE] = slot_next[slot]
        state[WAITING] += 1
        slot_t_us[slot], slot_x[slot], slot_p[slot] = fired_t_us[i], fired_x[i], fired_p[i]
        slot_next[slot] = -1
        row = np.int64(fired_y[i])
        if row_first[row] < 0:
            row_first[row] = slot
            row_queue[(state[QUEUE_START] + state[QUEUED]) % row_queue.size] = row
            state[QUEUED] += 1
        else:
            slot_next[row_last[row]] = slot
        row_last[row] = slot
    return used


@jit
def order_ties(
    t_us: NDArray[np.int64],  # (N,) ascending
    x: NDArray[np.uint16],  # updated
    y: NDArray[np.uint16],
    p: NDArray[np.int8],
) -> None:
    """Sort the events of each microsecond by (y, x); one pixel's events keep their order."""
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
