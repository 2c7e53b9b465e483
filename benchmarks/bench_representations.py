"""Measure the representations: ns of CPU time per event, and the time of the empty array.

    python benchmarks/bench_representations.py [--size 1280] [--events 2] [--runs 5]

The events come from a moving texture with edges (as in bench_formats.py) and fill one window. A
representation writes its whole array, whatever the number of events: "array" is the time of that
alone, in ms. The representations take turns; the run with the least CPU time counts, and "system"
is how much of that is system time.
"""

from __future__ import annotations

import argparse

import numpy as np
from bench_formats import stream_of
from process_times import Times, times_now

from sensor.events import Events, concatenate, no_events
from sensor.representations import event_counts, time_surface, voxel_grid

BETWEEN = "voxel grid, 15 bins, between pixels"
REPRESENTATIONS = {
    "voxel grid, 5 bins": lambda events: voxel_grid(events, 5, normalize=False),
    "voxel grid, 5 bins, normalized": lambda events: voxel_grid(events, 5),
    "voxel grid, 15 bins, E-RAFT": lambda events: voxel_grid(events, 15, convention="eraft"),
    BETWEEN: lambda events, positions: voxel_grid(
        events, 15, convention="eraft", positions=positions
    ),
    "polarity sum": Events.polarity_sum,
    "counts": event_counts,
    "time surface": lambda events: time_surface(events, 1e4),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=1280, help="side of the sensor, px")
    parser.add_argument("--events", type=float, default=2.0, help="million events in the window")
    parser.add_argument("--runs", type=int, default=5, help="runs, of which the fastest counts")
    arguments = parser.parse_args()
    events = concatenate(stream_of(round(1e6 * arguments.events), arguments.size))
    inputs = {"all": events, "none": no_events(arguments.size, arguments.size, None)}
    positions = {k: np.stack([one.x + 0.3, one.y + 0.7], 1) for k, one in inputs.items()}
    runs = {(name, which): list[Times]() for name in REPRESENTATIONS for which in inputs}
    for _ in range(arguments.runs + 1):
        for (name, which), measured in runs.items():
            given = (positions[which],) if name == BETWEEN else ()
            start = times_now()
            REPRESENTATIONS[name](inputs[which], *given)
            measured.append(times_now() - start)
    least = {key: min(measured, key=lambda one: one.cpu_s) for key, measured in runs.items()}
    print(f"{arguments.size} px, {len(events)} events")
    print(f"{'':36s} ns/event  system  array, ms  system")
    ns = 1e9 / len(events)
    for name in REPRESENTATIONS:
        whole, array = least[name, "all"], least[name, "none"]
        print(
            f"{name:36s} {ns * whole.cpu_s:8.1f} {ns * whole.system_s:7.1f}"
            f" {1e3 * array.cpu_s:10.1f} {1e3 * array.system_s:7.1f}"
        )


if __name__ == "__main__":
    main()
