"""Measure the event formats: million events per second, bytes per event, peak memory.

    python benchmarks/bench_formats.py [--events 10] [--runs 3]

The events come from a 1/f texture with edges that moves by 0.97 px per millisecond in front of a
640x640 sensor with C = 0.2: a few hundred thousand per frame, sorted by time, row and column. The
formats take turns, so other load affects all of them equally; the fastest run counts, with its user
and system time in ns per event. "faery" is the independent codec that the tests compare with. The
files are in the system's temporary folder, and each read follows its write, so disks matter little.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from bench_sensor import moving_texture
from process_times import Times, times_now

from sensor import Events, SensorModel, simulate
from sensor.formats import FORMATS, read_events, write_events


def stream_of(count: int, size: int = 640) -> list[Events]:
    """Return `count` events of one stream in parts of about 2^18."""
    frames = moving_texture(size, 60, 0.97)
    model = SensorModel(width=size, height=size, cutoff_hz=math.inf)
    once = simulate(frames, np.arange(60) * 1e-3, model)
    parts: list[Events] = []
    written = 0
    while written < count:
        # The same motion again, later: no format depends on events that far back.
        later = once.t_us + 60_000 * (written // len(once))
        part = Events(later, once.x, once.y, once.p, size, size, once.model)[: count - written]
        parts += [part[k : k + (1 << 18)] for k in range(0, len(part), 1 << 18)]
        written += len(part)
    return parts


def faery_write(path: Path, parts: list[Events], version: str) -> None:
    """Write with faery's encoder."""
    from faery import evt

    first = parts[0]
    with evt.Encoder(path, version, False, (first.width, first.height), True) as encoder:
        for part in parts:
            columns = [("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("on", "?")]
            packet = np.empty(len(part), columns)
            packet["t"], packet["x"], packet["y"] = part.t_us, part.x, part.y
            packet["on"] = part.p > 0
            encoder.write({"events": packet})


def faery_read(path: Path) -> Iterator[np.ndarray]:
    """Read with faery's decoder."""
    from faery import evt

    with evt.Decoder(path, None, None) as decoder:
        for packet in decoder:
            if packet and "events" in packet:
                yield packet["events"]


def peak_mib(work: Callable[[], object]) -> float:
    """Return the peak of the memory that Python and numpy allocate during `work`, MiB."""
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / (1 << 20)


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--events", type=float, default=10, help="millions of events")
    parser.add_argument("--runs", type=int, default=3, help="runs of each kind; the best counts")
    args = parser.parse_args()
    count = round(args.events * 1e6)
    parts = stream_of(count)

    with tempfile.TemporaryDirectory() as folder:
        kinds: dict[str, tuple[Path, Callable[[], object], Callable[[], int]]] = {}
        for name in (f.name for f in FORMATS.values() if f.write):
            path = Path(folder) / f"{name}.file"
            kinds[name] = (
                path,
                lambda p=path, n=name: write_events(p, parts, format=n),
                lambda p=path, n=name: sum(map(len, read_events(p, format=n))),
            )
        for version in ("evt3", "evt2"):
            path = Path(folder) / f"faery-{version}.raw"
            kinds[f"{version} by faery"] = (
                path,
                lambda p=path, v=version: faery_write(p, parts, v),
                lambda p=path: sum(map(len, faery_read(p))),
            )
        for path, write, read in kinds.values():  # compile first, and count
            write()
            assert read() == count, path
        writing, reading = ({kind: list[Times]() for kind in kinds} for _ in range(2))
        for _ in range(args.runs):
            for kind, (_, write, read) in kinds.items():
                start = times_now()
                write()
                middle = times_now()
                read()
                writing[kind].append(middle - start)
                reading[kind].append(times_now() - middle)
        print(f"{count / 1e6:g} M events of 640x640 px, minimum of {args.runs}")
        print(
            "format         write Mev/s  user ns  sys ns  read Mev/s  user ns  sys ns  bytes/event"
            "  peak MiB write  read"
        )
        for kind, (path, write, read) in kinds.items():
            memory = "".join(f"{peak_mib(work):11.0f}" for work in (write, read))
            speeds = "".join(
                f"{count / wall_s / 1e6:12.1f} {user_s / count * 1e9:8.1f}"
                f" {system_s / count * 1e9:7.1f}"
                for wall_s, user_s, system_s in (min(writing[kind]), min(reading[kind]))
            )
            print(f"{kind:14}{speeds} {os.path.getsize(path) / count:12.2f} {memory}")


if __name__ == "__main__":
    main()
