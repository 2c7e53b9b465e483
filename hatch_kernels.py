"""Compile the kernels for a wheel: `hatch_build.py` runs this file for each target.

    python hatch_kernels.py run x86-64-v3 FOLDER      # twice
    python hatch_kernels.py compile x86-64-v4 FOLDER

`run` calls the kernels with small inputs. The first time Numba compiles them; the second time it
loads from its cache those that Python calls, and these are copied into the folder. `compile`
compiles for a target what the folder has for x86-64-v3, without running it: this processor may lack
the target's instructions.
"""

import math
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

from sensor import LiveCamera, Readout, SensorModel, find_camera, read_out, simulate, simulate_bank
from sensor.emulators import v2e
from sensor.formats import Triggers, load_events, read_triggers, write_events
from sensor.optics import integrate
from sensor.representations import event_counts, time_surface, voxel_grid
from sensor.shipped import contents, runs_here, ship
from sensor.statistics import IntervalHistogram
from tasks.footage import Footage
from tasks.footage.interpolation import interpolated
from tasks.registry import TASKS
from tasks.study.run.compile_ahead import compile_methods


def main(how: str, target: str, folder: str) -> None:
    if not runs_here("x86-64-v3"):
        sys.exit("found another machine, expected Linux on x86-64-v3")
    if how == "run":
        run_sensor()
        run_methods()
        run_footage()
        found = list(called_from_python())
    else:
        found = list(contents("x86-64-v3", Path(folder)))
    for kernel, signature in found:
        ship(kernel, signature, target, Path(folder))


def called_from_python() -> Iterator[tuple[Any, Any]]:
    """Yield the kernels that were loaded from the cache, and the types of their arguments."""
    for name, module in list(sys.modules.items()):
        if name.startswith(("sensor.", "tasks.")):
            for kernel in vars(module).values():
                if isinstance(kernel, Dispatcher) and kernel.__module__ == name:
                    yield from ((kernel, signature) for signature in kernel.stats.cache_hits)


def run_sensor() -> None:
    """Run what the package `sensor` can, with the types of arguments that are usual."""
    t_s = [0.0, 1e-3, 2e-3, 0.05]  # short and long intervals
    frames = np.exp(np.random.default_rng(0).normal(size=(len(t_s), 16, 16)))
    noise = {"shot_noise_hz": 5.0, "hot_pixel_fraction": 0.1, "threshold_mismatch": 0.03}
    dead = {"refractory_s": 1e-4, "latency_s": 1e-4, "leak_hz": 0.1, "random_start": True}
    own_light = {"cutoff_hz": 200.0, "cutoff_reference": 1.0}
    options: list[dict[str, Any]] = [{}, {"cutoff_hz": 200.0}, own_light, noise | dead]
    for size in (8, 16):
        models = [SensorModel(width=size, height=size, **each) for each in options]
        for kind in (np.float32, np.float64):
            typed = frames.astype(kind)
            simulate_bank(typed, t_s, models)
            typed.flags.writeable = False  # as of a file that is mapped into memory: another type
            integrate(typed[0], size, size)
    bus = Readout(max_rate_hz=1e6, fifo_depth=8, row_overhead_s=1e-7)
    with LiveCamera(models[-1], readout=bus) as live:
        for frame, time_s in zip(frames, t_s, strict=True):
            live.push(frame, time_s)
        live.finish()
    events = simulate(frames, t_s, models[1])
    list(read_out(events, bus))
    find_camera("davis346").on(16, 16).simulate(frames, t_s)
    for cutoff_hz in (200.0, math.inf):
        for version in ("A", "C"):
            v2e(100 * frames, t_s, cutoff_hz=cutoff_hz, version=version)
    run_on_events(events)


def run_on_events(events: Any) -> None:
    """Run the representations, the statistics and the formats."""
    event_counts(events)
    time_surface(events, 1e3)
    voxel_grid(events, 5)
    positions = np.stack((events.x, events.y), axis=1)
    for kind in (np.float32, np.float64):
        voxel_grid(events, 5, positions=positions.astype(kind))
    edges_us = np.array([1, 10, 100])
    window_us = 0, 1_000_000
    IntervalHistogram(events.width, events.height, edges_us, window_us).add(events)
    both = Triggers(np.array([12, 20]), np.zeros(2, np.uint8), np.array([1, -1], np.int8))
    with tempfile.TemporaryDirectory() as folder:
        for name, format in (("3.raw", "evt3"), ("2.raw", "evt2"), ("a.txt", "text")):
            path = Path(folder) / name
            triggers: dict[str, Any] = {} if format == "text" else {"triggers": both}
            write_events(path, events, format=format, **triggers)
            load_events(path)
            if triggers:
                read_triggers(path)


def run_methods() -> None:
    """Run the methods for flow and tracking that need no network."""
    compile_methods((task, name) for task in ("flow", "tracking") for name in TASKS[task].methods)


def run_footage() -> None:
    """Run the kernels of frames in between."""
    first, second = np.random.default_rng(0).random((2, 16, 16), np.float32)
    footage = Footage(
        path=Path("memory"),
        t_s=np.array([0.0, 1.0]),
        t_offset_us=0,
        height=16,
        width=16,
        encoding="linear",
        white_level=1.0,
        frames=lambda: iter((first, second)),
    )
    list(interpolated(footage, [2]))


if __name__ == "__main__":
    main(*sys.argv[1:])
