"""Divide frames into chunks whose predicted events fit into the memory that chunks share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sensor.model import SensorModel

_CHUNK_EVENTS = 1 << 24  # about as many at most: memory that the next chunks use again
_SAMPLE_PX = 1 << 10  # of a frame, which predict its events


class Chunks:
    """Predicts the events of frames from a few pixels, and learns from the events that fire.

    Between two frames an ideal pixel fires its change of log light divided by C. A filter lets
    fewer fire, noise more. `first` is (H, W) linear radiance. The events of a group's models are in
    memory at once; their C and dark levels are known.
    """

    def __init__(
        self, first: NDArray[np.floating], groups: Sequence[Sequence[SensorModel]]
    ) -> None:
        self._per_change = max(
            sum(m.width * m.height / min(m.contrast_threshold, m.off_threshold) for m in models)
            for models in groups
        )
        self._dark = min(m.dark_level or 0.0 for models in groups for m in models)
        self._step = max(1, round((first.size / _SAMPLE_PX) ** 0.5))
        self._logs = self._sampled(first[None])[0]
        self._rate, self._predicted, self._share = 0.0, 0.0, 1.0

    def frames(self, chunk: NDArray[np.floating]) -> int:
        """Return how many frames of a chunk (F, H, W) to simulate next, at least 1."""
        logs = self._sampled(chunk)
        change = np.abs(np.diff(logs, axis=0, prepend=self._logs[None])).mean(axis=1)
        ideal = self._per_change * change
        expected = np.cumsum(np.maximum(self._rate, self._share * ideal))
        chunks = max(1.0, np.ceil(expected[-1] / _CHUNK_EVENTS))
        count = max(1, int(np.searchsorted(expected, expected[-1] / chunks, side="right")))
        self._logs, self._predicted = logs[count - 1], float(ideal[:count].sum())
        return count

    def learn(self, frames: int, events: int) -> None:
        """Take note of what fired."""
        self._rate = events / frames
        self._share = min(1.0, events / self._predicted) if self._predicted else 1.0

    def _sampled(self, frames: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the log light of a few pixels of (F, H, W) frames, 0 where it has none."""
        some = frames[:, :: self._step, :: self._step].reshape(len(frames), -1)
        light = some.astype(np.float64) + self._dark
        logs: NDArray[np.float64] = np.log(light, where=light > 0, out=np.zeros_like(light))
        return np.where(np.isfinite(logs), logs, 0.0)
