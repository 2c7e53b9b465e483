"""Compile the sensor's and the methods' kernels in two processes, while this one makes textures.

Numba compiles in one thread of a process at a time. The first job of the first run renders, then
simulates, then scores, so the kernels of each stage would wait for the stage before, and a core
would idle. A process that needs a kernel waits if another process is compiling it.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from eres_render import Camera, Plane
from eres_render.cores import cores
from sensor import Events, SensorModel, simulate_bank
from sensor.compiling import is_cached
from sensor.kernels.advance import advance_pixels
from tasks.evaluation.settings import TaskSettings
from tasks.flow import FlowSample, flow_sample
from tasks.methods import load_method
from tasks.registry import TASKS
from tasks.tracking import TrackingSample, path_at, perturbed, tracking_sample

_C = 0.03  # small, so that there are enough events
_SIDE_PX = 96
_WINDOW_US = 50_000
_SHIFT_PX = 2.0  # of the image in the window, to the right


@contextmanager
def compiling_ahead(tasks: Iterable[tuple[str, TaskSettings]]) -> Iterator[None]:
    """Compile the sensor and the slow methods (flow, tracking), a process each, if not cached."""
    methods = {
        (task, name)
        for task, settings in tasks
        for name in settings.methods
        if task in _SAMPLES and name in TASKS[task].methods
    }
    calls = []
    if cores() > 1 and not is_cached(advance_pixels):
        calls.append("compile_sensor()")
    if cores() > 1 and methods and not _any_is_cached(methods):
        calls.append(f"compile_methods({sorted(methods)!r})")
    python, null = [sys.executable, "-P", "-c"], subprocess.DEVNULL
    codes = [f"from {__name__} import compile_methods, compile_sensor; {call}" for call in calls]
    processes = [subprocess.Popen([*python, code], stdout=null, stderr=null) for code in codes]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def compile_sensor() -> None:
    """Simulate two sensors of a few pixels; Numba caches the kernels."""
    frames = np.exp(np.random.default_rng(0).normal(size=(3, 16, 16))).astype(np.float32)
    models = [SensorModel(width=size, height=size, cutoff_hz=200.0) for size in (8, 16)]
    simulate_bank(frames, [0.0, 1e-3, 0.05], models)  # a short and a long interval


def compile_methods(methods: Iterable[tuple[str, str]]) -> None:
    """Run methods once on a small sample of a study's types; Numba caches their kernels."""
    for task, name in methods:
        load_method(task, name)(_SAMPLES[task]())


def _any_is_cached(methods: Iterable[tuple[str, str]]) -> bool:
    for task, name in methods:
        load_method(task, name)
    places = ("tasks.methods.", "tasks.numerics.")
    modules = [module for name, module in sys.modules.items() if name.startswith(places)]
    return any(is_cached(value) for module in modules for value in vars(module).values())


@cache
def _made_up() -> tuple[Events, NDArray[np.float64]]:
    """Return events of a texture that moves evenly, and its log intensity at the start.

    Each pixel's log intensity is a ramp that crosses thresholds at even times, Eq. (7).
    """
    coarse = np.random.default_rng(0).normal(0.0, 0.7, (16, 16))
    size = _SIDE_PX, _SIDE_PX
    log_image = np.asarray(cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC), np.float64)
    rise = -_SHIFT_PX * np.gradient(log_image, axis=1)
    count = (abs(rise) / _C).astype(int).ravel()
    pixel = np.repeat(np.arange(count.size), count)
    number = np.arange(pixel.size) - np.repeat(np.cumsum(count) - count, count) + 1
    t_us = (_WINDOW_US * _C * number / abs(rise).ravel()[pixel]).astype(np.int64)
    order = np.lexsort((pixel, t_us))
    y, x = np.divmod(pixel[order].astype(np.uint16), np.uint16(_SIDE_PX))
    p = np.where(rise.ravel()[pixel[order]] > 0, 1, -1).astype(np.int8)
    return Events(t_us[order], x, y, p, width=_SIDE_PX, height=_SIDE_PX), log_image


def _flow_sample() -> FlowSample:
    events, log_image = _made_up()
    return flow_sample(
        events,
        0,
        _WINDOW_US,
        log_image=log_image,
        contrast_threshold=_C,
        center_px=np.full(2, 0.5 * _SIDE_PX),
        side_px=31,
        initial=np.array([_SHIFT_PX + 0.5, 0.3]),
        initial_sigma_px=1.0,
    )


def _tracking_sample() -> TrackingSample:
    """Return the sample of a camera that looks down from 1 m and moves along -x."""
    events, log_image = _made_up()
    camera = Camera(_SIDE_PX, _SIDE_PX, np.pi / 3)
    speed_mps = _SHIFT_PX / camera.focal_px / (1e-6 * _WINDOW_US)

    def pose(t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        T = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (len(t_s), 1, 1))
        T[:, 0, 3], T[:, 2, 3] = -speed_mps * t_s, 1.0
        return T

    return tracking_sample(
        events,
        0,
        log_image=log_image,
        contrast_threshold=_C,
        camera=camera,
        plane=Plane((0.0, 0.0, 1.0), 0.0),
        T_0=pose(np.zeros(1))[0],
        initial=perturbed(path_at(pose, 0.0), 1e-3, 0),
        initial_sigma_m=0.03,  # so that the search is coarse to fine
        max_delay_us=10_000,
    )


_SAMPLES: dict[str, Callable[[], object]] = {"flow": _flow_sample, "tracking": _tracking_sample}
