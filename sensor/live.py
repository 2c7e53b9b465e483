"""`LiveCamera`: a sensor that gets its frames one by one, and answers each with events."""

from __future__ import annotations

from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sensor.engine import arguments, frames
from sensor.engine.devices import device_called
from sensor.engine.live import Live
from sensor.errors import SensorError
from sensor.events import Events, concatenate, no_events
from sensor.numbers import refusal
from sensor.readout import Readout, ReadoutReport, Sender


class LiveCamera:
    """A sensor in a loop: push a frame, get the events since the last frame.

    However the frames are divided into pushes, the events are those of `simulate`, followed by
    `read_out` if there is a bus, to the bit. Memory does not grow with the number of frames.

    Use it in a `with` statement, which ends its threads.

    Parameters
    ----------
    model
        The sensor, or a function that returns it for a radiance of white, such as `model` of an
        `EventCamera`.
    seed
        Seed of all random parts of the model, 0 to 2^63 - 1.
    readout
        The bus; with None, events leave at once.
    white
        Radiance of white, for models without a `dark_level`, or with "v2e" and without a
        `cutoff_reference`. None is the 99.9th percentile of the first frame.
    threads
        Number of threads, 1 to 1024; None is one for each core.
    device
        "cpu"; or "cuda" for an NVIDIA GPU, as in `simulate`.

    Attributes
    ----------
    model
        The sensor. After the first push it has the dark level and the cutoff reference in use.

    Raises
    ------
    SensorError
        An argument is out of range, the sensor needs too much memory, or there is no such device.

    Examples
    --------
    The light of all pixels rises by 0.25 in log intensity from frame to frame, so that each fires
    whenever it has risen by another 0.3:

    >>> import numpy as np
    >>> from sensor import LiveCamera, SensorModel
    >>> model = SensorModel(width=6, height=4, contrast_threshold=0.3)
    >>> with LiveCamera(model) as live:
    ...     for k in range(5):
    ...         live.push(np.full((4, 6), np.exp(0.25 * k)), t_s=0.1 * k)
    ...     live.finish()
    Events(0 of 6x4 px)
    Events(0 of 6x4 px)
    Events(24 of 6x4 px, 120102..120102 us)
    Events(24 of 6x4 px, 240179..240179 us)
    Events(24 of 6x4 px, 360236..360236 us)
    Events(0 of 6x4 px)
    >>> live.model.dark_level
    0.001
    """

    def __init__(
        self,
        model: arguments.Lit,
        *,
        seed: int = 0,
        readout: Readout | None = None,
        white: float | None = None,
        threads: int | None = None,
        device: str = "cpu",
    ) -> None:
        self._white = arguments.checked_white(white)
        self._given = model
        (self.model,) = arguments.checked_models([model], self._white or 1.0)
        self._seed = arguments.checked_seed(seed)
        if not isinstance(readout, Readout | None):
            raise refusal("readout", readout, "a sensor.Readout, or None")
        self._sender = None if readout is None else Sender(readout)
        self._device = device_called(device, arguments.checked_threads(threads))
        arguments.check_memory([self.model], [0])
        self._shape: tuple[int, ...] = ()  # of the frames, after the first
        self._frames = 0  # so far
        self._last_s = np.empty(0)  # time of the last of them
        self._live: Live | None = None  # from the first frame on
        self._ended = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def push(self, frame: NDArray[np.floating], t_s: ArrayLike) -> Events:
        """Simulate the next frame, or a few frames.

        The first frame starts the pixels and causes no events.

        Parameters
        ----------
        frame
            (H, W) or (F, H, W) linear radiance, float32 or float64, as for `simulate`. Its memory
            may be reused after the call.
        t_s
            Its time in seconds, or (F,) times, all later than earlier frames.

        Returns
        -------
        Events
            The events before the microsecond of the last frame, sorted by time, ties by (y, x).
            `latency_s` shifts this limit. With a bus, the events that have left it by then.

        Raises
        ------
        SensorError
            Frames differ in size from the first or do not fit the sensor, radiance is invalid,
            times do not increase, the first frame is too dark to take white from, or the camera has
            ended. The message names the frame and the value. Invalid radiance after the first frame
            ends the camera.
        """
        self._check_open("push")
        given = frame if hasattr(frame, "ndim") else np.asarray(frame)
        chunk = self._device.frames(given[None] if given.ndim == 2 else given, self._frames)
        times_s = self._next_times(t_s, len(chunk))
        if self._live is None:
            self._live = self._started(chunk[0])
        elif chunk.shape[1:] != self._shape:
            raise SensorError(
                f"frame {self._frames}: found shape {chunk.shape[1:]}, expected {self._shape}, the "
                "shape of the first frame"
            )
        try:
            parts = [events for _, events in self._live.push(chunk, times_s)]
        except BaseException:  # some pixels have seen the frames, others not
            self._end()
            raise
        self._frames += len(chunk)
        self._last_s = times_s[-1:]
        events = self._joined(parts)
        if self._sender is None:
            return events
        last_us = int(frames.whole_microseconds(self._last_s)[0][0])
        return self._sender.push(events, last_us + round(self.model.latency_s * 1e6))

    def finish(self) -> Events:
        """Return the remaining events, and end the camera.

        Returns
        -------
        Events
            The events in the microsecond of the last frame, and the events that wait for the bus.

        Raises
        ------
        SensorError
            The camera has ended.
        """
        self._check_open("finish")
        self._end()
        parts = [] if self._live is None else [events for _, events in self._live.finish()]
        events = self._joined(parts)
        if self._sender is None:
            return events
        sent = self._sender.push(events), self._sender.finish()
        return self._joined([part for part in sent if part is not None])

    @property
    def report(self) -> ReadoutReport | None:
        """Counts and delays of the bus so far; None without a bus."""
        return None if self._sender is None else self._sender.report

    def _check_open(self, name: str) -> None:
        if self._ended:
            raise SensorError(
                f"LiveCamera.{name}: this camera has ended, after {self._frames} frames, by "
                "`finish`, the end of `with` or an error; make a new camera"
            )

    def _end(self) -> None:
        self._ended = True
        if self._live is not None:
            self._live.close()

    def _next_times(self, t_s: ArrayLike, count: int) -> NDArray[np.float64]:
        """Return the times of the next frames, checked against the last time."""
        before = len(self._last_s)
        times_s = frames.checked_times(np.append(self._last_s, t_s), self._frames - before)
        if len(times_s) - before != count:
            given = len(times_s) - before
            raise SensorError(f"t_s: {given} times for {count} frames; expected one per frame")
        frames.check_spans(times_s, 1.0, self._frames - before)
        if self._frames < 2:  # the first interval
            frames.warn_of_long_intervals(times_s)
        return times_s[before:]

    def _started(self, first: NDArray[np.floating]) -> Live:
        """Start the pixels at a first frame (H, W), and complete the model."""
        first = first.copy_to_host() if hasattr(first, "copy_to_host") else first
        arguments.check_fit(self.model, *first.shape)
        frames.refuse_bad_radiance(first[None], 0)
        frames.warn_of_whole_numbers(first)
        (self.model,) = arguments.completed([self._given], first, self._white)
        self._shape = first.shape
        return Live([self.model], [1.0], [0], self._seed, self._device, first.size)

    def _joined(self, parts: list[Events]) -> Events:
        if len(parts) == 1:
            return parts[0]
        return concatenate([no_events(self.model.width, self.model.height, self.model), *parts])
