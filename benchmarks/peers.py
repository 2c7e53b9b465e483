"""Compare the sensor's speed with that of the other simulators that this Python can import.

    python benchmarks/peers.py [--size 1280] [--frames 25] [--runs 3]

All see the same frames, moving textures as in bench_sensor.py, with one thread and C = 0.2, without
noise, with the filter off and at 200 Hz. They take turns; the result of each is the run with the
least CPU time, user and system. All events stay in memory until the end of a run and are sorted by
time.

- OpenEB's CPU simulator (Numba), `metavision_core_ml.video_to_event`; from
  https://github.com/prophesee-ai/openeb. Its buffer of events is reused. At its end it sorts all
  events by an argsort of their times. "OpenEB, unsorted" is its time without this argsort, which is
  measured alone.
- v2e's emulator (PyTorch), `v2ecore.emulator`, with its own lin-log scale and on the CPU; from
  https://github.com/SensorsINI/v2e: `pip install -e` of a clone, or its folder on PYTHONPATH.
- EventCV's simulator in Rust, `eventcv.simulate`: `pip install eventcv`. It follows v2e, with the
  same lin-log scale, and has no way around it. It linearizes its frames, so it gets floats that are
  encoded as sRGB, which the first run makes. Its upsampling is off.
- evlib's `ESIMSimulator` (PyTorch): `pip install evlib torch`. It has no filter.
- ESIM's core in C++, `esim_py`; from https://github.com/uzh-rpg/rpg_vid2e. It reads image files: it
  gets the frames rounded to 8 bits, as uncompressed files in memory, which the first run writes.
  It has no filter.

OpenEB, v2e and evlib get frames that are scaled to 0..255, but not rounded. The filters differ, so
at 200 Hz the simulators fire different events.
"""

from __future__ import annotations

import argparse
import atexit
import importlib.util
import logging
import math
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from bench_sensor import moving_texture
from numpy.typing import NDArray
from process_times import Times, times_now

from sensor import SensorModel, simulate, stream
from sensor.encoding import to_srgb

_C = 0.2
_ARGSORT = "OpenEB's argsort"
_IN_MEMORY = Path("/dev/shm")
_SHIFT_PX = {"dense": 0.97, "sparse": 0.097, "very dense": 9.0}
_INTERVAL_US = {"dense": 1000, "sparse": 100, "very dense": 1000}

Simulator = Callable[[NDArray[np.float32], NDArray[np.int64], float], int]


def run_stream(frames: NDArray[np.float32], t_us: NDArray[np.int64], cutoff_hz: float) -> int:
    """Run `sensor.stream` and return the number of events.

    Parameters
    ----------
    frames, t_us, cutoff_hz
        (T, H, W) radiance, (T,) microseconds, and cutoff, inf for none; this and the rest alike.
    """
    return sum(map(len, stream(frames, t_us * 1e-6, model_of(frames, cutoff_hz), threads=1)))


def run_simulate(frames: NDArray[np.float32], t_us: NDArray[np.int64], cutoff_hz: float) -> int:
    """Run `sensor.simulate`."""
    return len(simulate(frames, t_us * 1e-6, model_of(frames, cutoff_hz), threads=1))


def model_of(frames: NDArray[np.float32], cutoff_hz: float) -> SensorModel:
    """Return the model of the size of the frames."""
    height, width = frames.shape[1:]
    return SensorModel(
        width=width, height=height, contrast_threshold=_C, cutoff_hz=cutoff_hz, dark_level=1e-6
    )


def openeb(most_events: int) -> dict[str, Simulator]:
    """Return OpenEB's simulator with room for a number of events, and the argsort at its end."""
    from metavision_core_ml.video_to_event.simulator import EventSimulator
    from metavision_core_ml.video_to_event.single_image_make_events_cpu import EventCPU

    maker = EventCPU()
    maker.event_buffer = maker.event_buffer[:most_events]
    maker.max_nb_events = most_events

    def run(frames: NDArray[np.float32], t_us: NDArray[np.int64], cutoff_hz: float) -> int:
        height, width = frames.shape[1:]
        filter_hz = 0.0 if math.isinf(cutoff_hz) else cutoff_hz
        simulator = EventSimulator(height, width, _C, _C, 0, cutoff_hz=filter_hz)
        simulator.event_maker = maker
        maker.num = 0
        for frame, t in zip(frames, t_us.tolist(), strict=True):
            simulator.image_callback(frame, t)
        return len(simulator.get_events())

    def argsort(*_: object) -> int:
        return len(np.argsort(maker.event_buffer[: maker.num]["t"]))  # left by `run`

    return {"OpenEB": run, _ARGSORT: argsort}


def v2e(_: int) -> dict[str, Simulator]:
    """Return v2e's emulator."""
    import torch
    from v2ecore.emulator import EventEmulator

    torch.set_num_threads(1)

    def run(frames: NDArray[np.float32], t_us: NDArray[np.int64], cutoff_hz: float) -> int:
        emulator = EventEmulator(
            pos_thres=_C,
            neg_thres=_C,
            sigma_thres=0.0,
            cutoff_hz=0.0 if math.isinf(cutoff_hz) else cutoff_hz,
            leak_rate_hz=0.0,
            shot_noise_rate_hz=0.0,
            device="cpu",
        )
        found = (
            emulator.generate_events(frame, t * 1e-6)
            for frame, t in zip(frames, t_us.tolist(), strict=True)
        )
        return len(np.concatenate([np.empty((0, 4)), *(e for e in found if e is not None)]))

    return {"v2e, lin-log": run}


def eventcv(_: int) -> dict[str, Simulator]:
    """Return EventCV's simulator."""
    os.environ["RAYON_NUM_THREADS"] = "1"
    import eventcv as library

    encoded: list[NDArray[np.float32]] = []

    def run(frames: NDArray[np.float32], t_us: NDArray[np.int64], cutoff_hz: float) -> int:
        if not encoded or not any(frames is one for one in encoded):
            encoded[:] = [frames, to_srgb(frames / 255)]
        events = library.simulate(
            encoded[1],
            pos_thres=_C,
            neg_thres=_C,
            sigma_thres=0.0,
            refractory_us=0,
            cutoff_hz=0.0 if math.isinf(cutoff_hz) else cutoff_hz,
            leak_rate_hz=0.0,
            shot_noise_rate_hz=0.0,
            upsample="off",
            fps=1e6 / float(t_us[1] - t_us[0]),
        )
        return len(events)

    return {"EventCV, lin-log": run}


def evlib(_: int) -> dict[str, Simulator]:
    """Return evlib's simulator, with the filter off only."""
    import torch
    from evlib.simulation import ESIMConfig, ESIMSimulator

    torch.set_num_threads(1)
    config = ESIMConfig(
        positive_threshold=_C,
        negative_threshold=_C,
        refractory_period_ms=0.0,
        device="cpu",
    )

    def run(frames: NDArray[np.float32], t_us: NDArray[np.int64], cutoff_hz: float) -> int:
        simulator = ESIMSimulator(config)
        found = [
            simulator.process_frame(frame, t * 1e-6)
            for frame, t in zip(frames, t_us.tolist(), strict=True)
        ]
        return len(np.concatenate([t for _, _, t, _ in found]))

    return {"evlib": run}


def esim(_: int) -> dict[str, Simulator]:
    """Return ESIM's core, with the filter off only."""
    import esim_py

    folder = tempfile.mkdtemp(dir=_IN_MEMORY if _IN_MEMORY.is_dir() else None)
    atexit.register(shutil.rmtree, folder)
    written: list[NDArray[np.float32]] = []

    def run(frames: NDArray[np.float32], t_us: NDArray[np.int64], cutoff_hz: float) -> int:
        files = [f"{folder}/{k:05}.pgm" for k in range(len(frames))]
        if not any(frames is one for one in written):  # in the first run, which is not the least
            written[:] = [frames]
            for file, frame in zip(files, frames, strict=True):
                cv2.imwrite(file, np.round(frame).astype(np.uint8))
        simulator = esim_py.EventSimulator(_C, _C, 0.0, 1e-6, True)
        return len(simulator.generateFromStampedImageSequence(files, t_us * 1e-6))

    return {"ESIM, 8 bits": run}


# The module that must be installed, and the function that makes the simulator.
PEERS = {
    "metavision_core_ml": openeb,
    "v2ecore": v2e,
    "eventcv": eventcv,
    "evlib": evlib,
    "esim_py": esim,
}
UNFILTERED = {"evlib", "ESIM, 8 bits"}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--size", type=int, default=1280, help="sensor and frame side in pixels")
    parser.add_argument("--frames", type=int, default=25, help="frames in the sequence")
    parser.add_argument("--runs", type=int, default=3, help="runs of each kind; the least counts")
    args = parser.parse_args()
    logging.disable(logging.WARNING)  # v2e writes one for each frame
    most = args.size**2 * (args.frames - 1)  # pixel-frames
    simulators: dict[str, Simulator] = {"stream": run_stream, "simulate": run_simulate}
    for module, make in PEERS.items():
        if importlib.util.find_spec(module):
            simulators |= make(3 * most)
        else:
            print(f"no module {module}; the top of this file says where it is")

    print(
        f"{args.size}x{args.size} px, up to {args.frames} frames, one thread, least of {args.runs}"
    )
    print(
        "scene       filter  simulator        Mpx-frames/s  CPU ns  sys ns  of stream's"
        "  ev/px/frame"
    )
    for scene, shift_px in _SHIFT_PX.items():
        # 8-bit values for the peers; a logarithm has the same differences at any scale.
        frames = moving_texture(args.size, args.frames, shift_px)
        frames *= 255 / frames.max()
        work = args.size**2 * (len(frames) - 1)
        t_us = np.arange(1, len(frames) + 1) * _INTERVAL_US[scene]
        for cutoff_hz in (math.inf, 200.0):
            able = {
                name: run
                for name, run in simulators.items()
                if math.isinf(cutoff_hz) or name not in UNFILTERED
            }
            runs = {name: list[Times]() for name in able}
            fired = dict.fromkeys(able, 0)
            for _ in range(args.runs):
                for name, run in able.items():
                    start = times_now()
                    fired[name] = run(frames, t_us, cutoff_hz)
                    runs[name].append(times_now() - start)
            best = {name: min(runs[name], key=lambda one: one.cpu_s) for name in runs}
            if _ARGSORT in best:
                best["OpenEB, unsorted"] = best["OpenEB"] - best.pop(_ARGSORT)
                fired["OpenEB, unsorted"] = fired["OpenEB"]
            for name, times in best.items():
                seconds = times.cpu_s
                print(
                    f"{scene:11} {'off' if math.isinf(cutoff_hz) else '200 Hz':7} {name:16} "
                    f"{work / seconds / 1e6:12.1f} {seconds / work * 1e9:7.1f} "
                    f"{times.system_s / work * 1e9:7.1f} "
                    f"{seconds / best['stream'].cpu_s:12.2f} {fired[name] / work:12.3f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
