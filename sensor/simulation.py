"""Frames in, events out: `simulate`, `stream`, and the bank that shares frames among sensors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from numpy.typing import ArrayLike

from sensor.engine.bank import Bank, collect
from sensor.engine.frames import Frames
from sensor.events import Events
from sensor.model import SensorModel


def simulate(
    frames: Frames,  # (T, H, W) float linear radiance, or an iterable of (H, W)
    t_s: ArrayLike,  # (T,) frame times
    model: SensorModel,
    *,
    seed: int = 0,
    threads: int | None = None,
) -> Events:
    """Events that a sensor fires while it looks at the frames.

    Log intensity is taken as linear in time between frames; everything after that is exact: area
    integration, both photoreceptor poles, and crossing times from the filtered curve.

    Parameters
    ----------
    frames
        (T, H, W) linear radiance, float32 or float64, at least as large as the sensor and of its
        shape; or any iterable of (H, W) frames, which is read once, a few frames at a time. Images
        encoded for a screen are made linear by `to_linear`; a warning says so where the first
        frame's values are whole numbers from 0 to 255, as theirs are.

        Shape means that pixels are square: the sensor's height is what its width and the frames'
        shape make of it, or its width what its height does, to less than one of its pixels. So
        both 346x259 and 346x260 can look at 1280x960, and 1280x720 cannot.
    t_s
        (T,) strictly increasing frame times in seconds. A warning says so where their median
        interval is above 1 s, as it is where they are in milliseconds.
    model
        The sensor.
    seed
        Of everything random in the model, 0 to 2^63 - 1; the same seed gives the same events on
        any machine.
    threads
        How many to use, 1 to 1024; None for one a core. Results do not depend on it.

    Returns
    -------
    Events
        Sorted by time, ties by (y, x). Their `model` carries the dark level that was used.

    Raises
    ------
    SensorError
        Frames or times that are unusable, or do not suit the sensor; the text names the frame and
        what was found. Or the sensor needs more memory than there is.
    """
    return collect(Bank(frames, t_s, [model], None, seed, threads))[0]


def stream(
    frames: Frames,
    t_s: ArrayLike,
    model: SensorModel,
    *,
    seed: int = 0,
    threads: int | None = None,
) -> Iterator[Events]:
    """As `simulate`, in consecutive parts, in memory that does not grow with the frames."""
    for _, events in Bank(frames, t_s, [model], None, seed, threads).run():
        yield events


def simulate_bank(
    frames: Frames,
    t_s: ArrayLike,
    models: Sequence[SensorModel],
    *,
    speeds: Sequence[float] | None = None,
    seed: int = 0,
    threads: int | None = None,
) -> list[Events]:
    """Events of several sensors that look at the same frames, in the order of `models`.

    Sensors of one size and dark level share one area integration and one logarithm.

    Parameters
    ----------
    frames, t_s, seed, threads
        As for `simulate`.
    models
        The sensors.
    speeds
        One factor a model: it sees the scene move that much faster, at times `t_s / speed`.

    Returns
    -------
    One `Events` for each model, equal to what `simulate` returns for it alone.
    """
    return collect(Bank(frames, t_s, models, speeds, seed, threads))


def stream_bank(
    frames: Frames,
    t_s: ArrayLike,
    models: Sequence[SensorModel],
    *,
    speeds: Sequence[float] | None = None,
    seed: int = 0,
    threads: int | None = None,
) -> Iterator[tuple[int, Events]]:
    """As `simulate_bank`, in consecutive parts `(index of the model, its next events)`."""
    yield from Bank(frames, t_s, models, speeds, seed, threads).run()
