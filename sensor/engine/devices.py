"""Where sensors are simulated: on the CPU or on an NVIDIA GPU."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from typing import Any, NamedTuple

from sensor.engine.frames import FrameReader, checked_frames
from sensor.engine.group import SensorGroup
from sensor.engine.sorting import room_for_events
from sensor.engine.workers import Workers
from sensor.errors import SensorError
from sensor.events import Columns
from sensor.numbers import refusal

# Of a chunk at most, on the CPU and on a GPU: frames, since the state of all pixels is read and
# written once a chunk, and pixels x frames x settings.
_CHUNK_FRAMES, _GPU_FRAMES = 24, 64
_CHUNK_WORK, _GPU_WORK = 1 << 26, 1 << 28
_GPU_BYTES = 64  # free memory for each of the latter, events included


class Device(NamedTuple):
    """What simulations are made of on a device."""

    frames: Callable[[Any, int], Any]  # `checked_frames`, brought onto the device
    reader: Callable[..., Any]  # makes a `FrameReader`, or one for frames on the GPU
    group: type[SensorGroup]
    workers: Callable[[], AbstractContextManager[Any]]  # makes `Workers`, or nothing
    room: Callable[[int], Columns]  # allocates columns
    most_frames: int  # of a chunk
    most_work: int  # of a chunk, pixels x frames x settings
    on_gpu: bool


def device_called(name: object, threads: int) -> Device:
    """Return the device."""
    if name == "cpu":
        return Device(
            frames=checked_frames,
            reader=FrameReader,
            group=SensorGroup,
            workers=partial(Workers, threads),
            room=room_for_events,
            most_frames=_CHUNK_FRAMES,
            most_work=_CHUNK_WORK,
            on_gpu=False,
        )
    if name != "cuda":
        raise refusal("device", name, "'cpu' or 'cuda'")
    try:
        from numba import cuda

        cuda.current_context()
        from sensor.gpu.frames import DeviceReader, ToDevice
        from sensor.gpu.group import DeviceGroup
        from sensor.gpu.memory import PINNED, free_bytes
    except Exception as error:  # any: numba-cuda ends in what it did not expect
        raise SensorError(
            "device: 'cuda' does not work here: it needs an NVIDIA GPU with its driver, and "
            f"numba-cuda (pip install 'eres-events[cuda]'): {type(error).__name__}: "
            f"{' '.join(str(error).split()).rstrip(' :') or 'no reason given'}"
        ) from error
    to_device = ToDevice(threads)
    return Device(
        frames=to_device,
        reader=partial(DeviceReader, to_device=to_device),
        group=DeviceGroup,
        workers=nullcontext,
        room=lambda size: room_for_events(size, PINNED),
        most_frames=_GPU_FRAMES,
        most_work=int(min(_GPU_WORK, free_bytes() / _GPU_BYTES)),
        on_gpu=True,
    )
