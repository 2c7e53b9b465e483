"""Signals while HDF5 is written: they wait until HDF5 has returned, and nothing is lost."""

import signal
import threading

import h5py
import pytest

from another_process import run_python
from event_streams import random_events
from sensor.formats import write_events
from sensor.formats.hdf5_file import writable
from sensor.formats.held_signals import held_signals

# Writes a file of events once for each call of HDF5 to Python, with Ctrl-C in that call. In a
# process of its own, as HDF5 used to end it with a segmentation fault.
EVERY_CALL = """
import signal, sys
from pathlib import Path
import numpy as np
from sensor import Events
from sensor.formats import batching, load_events, write_events
from sensor.formats.hdf5_file import Storage, writable

calls, at = [], None

def counting(name):
    function = getattr(Storage, name)
    def counted(*arguments):
        calls.append(name)
        if len(calls) == at:
            signal.raise_signal(signal.SIGINT)
        return function(*arguments)
    setattr(Storage, name, counted)

for name in ("seek", "tell", "readinto", "write", "truncate", "flush"):
    counting(name)

def add(path):
    with writable(path, new=False) as (file, storage):
        for k in storage.each(range(2)):
            file[f"more/{k}"] = np.arange(k, 50)

def write():
    write_events(out, events, add=add)

batching.PART_EVENTS = 100
out, x = Path(sys.argv[1], "events.h5"), np.arange(300, dtype=np.uint16)
events = Events(np.arange(300), x, x // 2, np.int8(x % 2 * 2 - 1), 300, 150)
write()
total = len(calls)
out.unlink()
assert {"seek", "readinto", "write"} < set(calls), calls
for at in range(1, total + 1):
    calls.clear()
    try:
        write()
        raise AssertionError(f"call {at}, {calls[at - 1]}: the signal was lost")
    except KeyboardInterrupt:
        assert list(out.parent.iterdir()) == [], f"call {at}: a file was left"
at = None
write()
assert all(map(np.array_equal, load_events(out).columns, events.columns))
print(total)
"""


@pytest.mark.slow
def test_ctrl_c_at_every_call_of_hdf5(tmp_path):
    """Promise: Ctrl-C at any moment in HDF5 ends the writing, and leaves no file and no harm."""
    assert int(run_python(EVERY_CALL, tmp_path).stdout) > 50


def test_signals_are_handled_between_parts_and_while_a_part_is_made(tmp_path):
    """Promise: they wait for HDF5, not for the stream, and all handlers are those from before."""
    seen = []
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGUSR1)}
    signal.signal(signal.SIGUSR1, lambda *_: seen.append("handled"))
    try:

        def parts():
            seen.append("asked")
            signal.raise_signal(signal.SIGUSR1)
            yield random_events(5)
            seen.append("asked")

        with writable(tmp_path / "a.h5", new=True) as (file, storage):
            for part in storage.each(parts()):
                signal.raise_signal(signal.SIGUSR1)
                file["t"] = part.t_us
                seen.append("written")
            signal.raise_signal(signal.SIGUSR1)
            seen.append("end")
    finally:
        signal.signal(signal.SIGUSR1, before[signal.SIGUSR1])
    order = ["asked", "handled", "written", "handled", "asked", "end", "handled"]
    assert seen == order
    assert signal.getsignal(signal.SIGINT) is before[signal.SIGINT]


def test_other_threads_write_too(tmp_path):
    """Promise: a thread, which handles no signals, writes without changing any handler."""
    handlers, count = [], []

    def write():
        with held_signals():
            handlers.append(signal.getsignal(signal.SIGINT))
        count.append(write_events(tmp_path / "a.h5", random_events(5)))

    thread = threading.Thread(target=write)
    thread.start()
    thread.join()
    assert (handlers, count) == ([signal.getsignal(signal.SIGINT)], [5])


def test_others_may_lock_the_file_while_it_is_written(tmp_path):
    """Promise: what adds to a file may open it with HDF5, which locks it."""

    def add(path):
        with h5py.File(path, "r+") as file:
            file["more"] = 1

    write_events(tmp_path / "a.h5", random_events(5), add=add)
    assert [file.name for file in tmp_path.iterdir()] == ["a.h5"]
