"""`simulate` and `stream`, for one sensor or for several that see the same frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from numpy.typing import ArrayLike

from sensor.engine.bank import Bank, collect
from sensor.engine.frames import FrameInput
from sensor.events import Events
from sensor.model import SensorModel


def simulate(
    frames: FrameInput,
    t_s: ArrayLike,
    model: SensorModel,
    *,
    seed: int = 0,
    threads: int | None = None,
    device: str = "cpu",
) -> Events:
    """Simulate the events of a sensor that sees the frames.

    Log intensity is linear in time between frames. Area integration, both poles of the
    photoreceptor and the crossing times of the filtered signal are exact.

    Parameters
    ----------
    frames
        (T, H, W) linear radiance, float32 or float64, at least as large as the sensor, with its
        aspect ratio; or an iterable of (H, W) frames, which is read once, a few frames at a time.
        Convert images encoded for a screen with `to_linear`. A warning is logged if the first frame
        looks like an 8-bit image: whole numbers from 0 to 255, with at least 16 different values.

        Pixels are square, so the frames must have the aspect ratio of the sensor, to less than one
        of its pixels: 346x259 and 346x260 both fit 1280x960, but not 1280x720.
    t_s
        (T,) strictly increasing frame times in seconds. A warning is logged if the median interval
        is above 1 s, since the times may be in milliseconds.
    model
        The sensor.
    seed
        Seed of all random parts of the model, 0 to 2^63 - 1. The same seed gives the same events;
        on another kind of processor the last digit of a time may differ.
    threads
        Number of threads, 1 to 1024; None is one for each core. Results do not depend on it.
    device
        "cpu"; or "cuda" for an NVIDIA GPU, with the extra `cuda`. Frames may then also be arrays on
        the GPU with `__cuda_array_interface__`, such as arrays of CuPy and PyTorch. The events are
        the same as on the CPU, except that the last digit of a time may differ. Where a refractory
        period ends, that digit may decide on an event.

    Returns
    -------
    Events
        Sorted by time, ties by (y, x). `Events.model` has the dark level that was used.

    Raises
    ------
    SensorError
        Frames or times are invalid or do not fit the sensor, the sensor needs too much memory, or
        the device does not work. The message names the frame and the value.

    Examples
    --------
    The light of all pixels rises by 1 in log intensity within a second, so that each fires whenever
    it has risen by another 0.3:

    >>> import numpy as np
    >>> from sensor import SensorModel, simulate
    >>> frames = np.exp([0.0, 1.0])[:, None, None] * np.ones((4, 6))
    >>> model = SensorModel(width=6, height=4, contrast_threshold=0.3, dark_level=0)
    >>> events = simulate(frames, [0.0, 1.0], model)
    >>> events
    Events(72 of 6x4 px, 300000..900000 us)
    >>> np.unique(events.t_us)
    array([300000, 600000, 900000])
    """
    return collect(Bank(frames, t_s, [model], None, seed, threads, device))[0]


def stream(
    frames: FrameInput,
    t_s: ArrayLike,
    model: SensorModel,
    *,
    seed: int = 0,
    threads: int | None = None,
    device: str = "cpu",
) -> Iterator[Events]:
    """Simulate the events of a sensor in parts. Memory does not grow with the number of frames.

    Parameters
    ----------
    frames, t_s, model, seed, threads, device
        As in `simulate`.

    Yields
    ------
    Events
        Consecutive parts of the stream.

    Raises
    ------
    SensorError
        As in `simulate`.

    Examples
    --------
    Frames from a generator, and events as they come; neither is in memory all at once:

    >>> import numpy as np
    >>> from sensor import SensorModel, stream
    >>> t_s = np.arange(200) * 1e-3
    >>> frames = (np.full((4, 6), np.exp(np.sin(50 * t))) for t in t_s)
    >>> count = 0
    >>> for events in stream(frames, t_s, SensorModel(width=6, height=4)):
    ...     count += len(events)
    >>> count
    624
    """
    for _, events in Bank(frames, t_s, [model], None, seed, threads, device).run():
        yield events


def simulate_bank(
    frames: FrameInput,
    t_s: ArrayLike,
    models: Sequence[SensorModel],
    *,
    speeds: Sequence[float] | None = None,
    starts: Sequence[int] | None = None,
    seed: int = 0,
    threads: int | None = None,
    device: str = "cpu",
) -> list[Events]:
    """Simulate the events of several sensors that see the same frames.

    Sensors of equal size, fill factor and dark level share the area integration and the logarithm.

    Parameters
    ----------
    frames, t_s, seed, threads, device
        As in `simulate`.
    models
        The sensors.
    speeds
        A factor for each model, whose frame times are `t_s / speed`. None is 1 for all.
    starts
        Index of the first frame that each model sees, as if there were no earlier frames. None is 0
        for all.

    Returns
    -------
    list of Events
        For each model the result of `simulate` with its frames.

    Raises
    ------
    SensorError
        As in `simulate`.

    Examples
    --------
    A light that flickers at 100 Hz, seen by an ideal pixel, by day and by night:

    >>> from dataclasses import replace
    >>> import numpy as np
    >>> from sensor import SensorModel, simulate_bank
    >>> t_s = np.arange(200) * 1e-3
    >>> frames = np.exp(np.sin(200 * np.pi * t_s))[:, None, None] * np.ones((1, 1))
    >>> ideal = SensorModel(width=1, height=1, dark_level=0)
    >>> models = [replace(ideal, cutoff_hz=hz) for hz in (np.inf, 200, 50)]
    >>> [len(events) for events in simulate_bank(frames, t_s, models)]
    [317, 237, 4]
    """
    return collect(Bank(frames, t_s, models, speeds, seed, threads, device, starts))


def stream_bank(
    frames: FrameInput,
    t_s: ArrayLike,
    models: Sequence[SensorModel],
    *,
    speeds: Sequence[float] | None = None,
    starts: Sequence[int] | None = None,
    seed: int = 0,
    threads: int | None = None,
    device: str = "cpu",
) -> Iterator[tuple[int, Events]]:
    """Simulate the events of several sensors in parts. Memory does not grow with the frame count.

    Parameters
    ----------
    frames, t_s, models, speeds, starts, seed, threads, device
        As in `simulate_bank`.

    Yields
    ------
    (int, Events)
        Index of the model, and the next part of its stream.

    Raises
    ------
    SensorError
        As in `simulate`.

    Examples
    --------
    >>> import numpy as np
    >>> from sensor import SensorModel, stream_bank
    >>> frames = np.exp(np.arange(5.0))[:, None, None] * np.ones((4, 4))
    >>> models = [SensorModel(width=side, height=side) for side in (2, 4)]
    >>> counts = [0, 0]
    >>> for k, events in stream_bank(frames, np.arange(5) * 0.1, models):
    ...     counts[k] += len(events)
    >>> counts  # 4 and 16 pixels
    [76, 304]
    """
    yield from Bank(frames, t_s, models, speeds, seed, threads, device, starts).run()
