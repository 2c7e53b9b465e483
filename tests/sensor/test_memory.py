"""Memory that is reused: never while it is in use, within a limit, and released on request."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import sensor
from event_streams import COLUMNS
from moving_texture import texture_in_motion
from sensor import SensorModel, memory, simulate, stream
from sensor.engine import bank, sorting
from sensor.memory import Memory

LARGE = 1 << 21


@pytest.fixture
def small_parts(monkeypatch):
    """All arrays, however small, reuse memory, and parts are small."""
    monkeypatch.setattr(memory, "_MIN_BYTES", 1)
    monkeypatch.setattr(sorting, "_PART_EVENTS", 700)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("cutoff_hz", [math.inf, 200.0])
def test_parts_that_are_kept_stay_as_they_were(small_parts, cutoff_hz, threads):
    """Promise: parts of a stream that are kept, or a column of each, equal those of a fresh run,
    while other streams and threads reuse memory."""
    frames, t_s = texture_in_motion(3, 24, (48, 60), 2e-3, travel_px=24.0)
    model = SensorModel(width=60, height=48, cutoff_hz=cutoff_hz, contrast_threshold=0.1)
    with ThreadPoolExecutor(3) as pool:
        runs = list(pool.map(lambda _: list(stream(frames, t_s, model, threads=threads)), range(3)))
    times = []
    for part in stream(frames, t_s, model, threads=threads):  # drops all but one column
        times.append(part.t_us)
    expected = simulate(frames, t_s, model)
    assert len(runs[0]) >= 10
    for column in COLUMNS:
        for parts in runs:
            joined = np.concatenate([getattr(part, column) for part in parts])
            np.testing.assert_array_equal(joined, getattr(expected, column))
    np.testing.assert_array_equal(np.concatenate(times), expected.t_us)


@pytest.mark.parametrize("refractory_s", [0.0, 2e-3])
def test_columns_that_grow_with_each_part_hold_the_stream(monkeypatch, small_parts, refractory_s):
    """Promise: `simulate` returns what `stream` yields, however wrong its prediction of the size,
    and also where a part is not in the columns because events were removed from it."""
    monkeypatch.setattr(bank, "_RESERVE", 0.0)
    frames, t_s = texture_in_motion(3, 20, (48, 60), 2e-3, travel_px=20.0)
    model = SensorModel(width=60, height=48, contrast_threshold=0.1, refractory_s=refractory_s)
    parts = list(stream(frames, t_s, model))
    events = simulate(frames, t_s, model)
    assert len(parts) > 5
    for column in COLUMNS:
        joined = np.concatenate([getattr(part, column) for part in parts])
        np.testing.assert_array_equal(getattr(events, column), joined)


def test_memory_is_used_again_once_nobody_holds_it():
    """Promise: not while an array, a view of it or a buffer on it exists, and then again."""
    room = Memory(limit=1 << 29)
    first = room.array(LARGE, np.uint8)
    address = first.ctypes.data
    assert address % 64 == 0
    holders = [first[5:9].view(np.int16), memoryview(first)]
    del first
    while holders:
        assert not np.shares_memory(room.array(LARGE, np.uint8), np.asarray(holders[0]))
        assert room.array(LARGE, np.uint8).ctypes.data != address
        holders.pop(0)
    assert address in [room.array(LARGE, np.uint8).ctypes.data for _ in range(3)]
    both = [room.array(LARGE - 99, np.uint8).ctypes.data, room.array(LARGE, np.uint8).ctypes.data]
    assert address in both


def test_kept_memory_has_a_limit():
    """Promise: memory that is kept for later arrays stays within the limit."""
    room = Memory(limit=10 * LARGE)
    for count in range(1, 9):
        room.array(count * LARGE, np.uint8)
        assert sum(block.size for block in room._blocks) <= 10 * LARGE
    held = [room.array(LARGE, np.uint8) for _ in range(30)]
    assert sum(block.size for block in room._blocks) <= 10 * LARGE
    assert len({array.ctypes.data for array in held}) == 30
    room.release()
    assert not room._blocks


def test_arrays_that_are_held_do_not_push_out_the_rest():
    """Promise: however many results the caller keeps, the work that makes them reuses its memory;
    so it does after a block that is larger than the limit."""
    room = Memory(limit=10 * LARGE)
    held, addresses = [], set()
    for _ in range(30):
        work = room.array(3 * LARGE, np.uint8)
        addresses.add(work.ctypes.data)
        held.append(room.array(LARGE, np.uint8))
        del work
    assert len(addresses) == 1
    assert len({array.ctypes.data for array in held}) == 30
    room.array(20 * LARGE, np.uint8)
    assert room.array(3 * LARGE, np.uint8).ctypes.data in addresses


def test_release_memory_gives_everything_back(small_parts):
    frames, t_s = texture_in_motion(3, 4, (48, 60), 2e-3, travel_px=4.0)
    events = simulate(frames, t_s, SensorModel(width=60, height=48))
    copy = events.copy()
    assert memory.MEMORY._blocks
    sensor.release_memory()
    assert not memory.MEMORY._blocks
    np.testing.assert_array_equal(events.t_us, copy.t_us)
