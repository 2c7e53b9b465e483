"""Estimates on a user's own footage: events lost between frames, and events that are noise."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sensor import Events, SensorModel, simulate
from sensor.levels import DARK_SHARE
from sensor.optics import integrate
from tasks.footage import Footage
from tasks.footage.interpolation import displacements_px, followed, gray, interpolated, steps_for

_log = logging.getLogger(__name__)

_PLACES, _PIXELS = 3, 2_000_000  # intervals that are looked at, and pixels of all their frames
_EARLIER = 4  # frames, over which slow motion shows
_MOST_STEPS = 16  # of an interval; finer ones add few events
_TILE = 8  # px of the sensor
# A tile is still where its change is neither shared by neighboring pixels (correlation), nor
# explained by flow (share that flow leaves), nor larger over some frames than over one (factor).
_ALIKE, _EXPLAINED, _DRIFTING = 0.7, 0.5, 2.0
_TELLING = 0.05  # of the events; less is not worth a warning

Float32 = NDArray[np.float32]


class FootageCheck:
    """Looks at a few intervals of footage while it is simulated, and warns of what it finds.

    `footage` has no frames in between; `with_between` says whether the simulation has them. `seen`
    are the rows and columns that the sensor sees. The scene moves `speed` times as fast as in the
    frames.
    """

    def __init__(
        self,
        footage: Footage,
        part: tuple[slice, slice],
        model: SensorModel,
        speed: float,
        *,
        with_between: bool,
    ) -> None:
        dark = model.dark_level or DARK_SHARE * footage.white_level
        self._model = replace(model, dark_level=dark, random_start=True)
        self._footage, self._seen, self._between = footage, part, with_between
        self._t_s = footage.t_s / speed
        last = len(footage) - 2
        count = min(_PLACES, max(1, _PIXELS // (footage.width * footage.height)))
        self._places = np.linspace(min(_EARLIER, last), last, 2 * count + 1).astype(int)[1::2]
        self._still: dict[int, NDArray[np.bool_]] = {}  # (height, width) pixels by place
        self._motion_px: list[float] = []
        self._alone = self._dense = self._all = 0  # events
        self._noise = 0.0

    def watched(self) -> Footage:
        """Return the footage, of which some frames are looked at when they are read."""

        def frames() -> Iterator[Float32]:
            needed = {k + shift for k in self._places for shift in (-_EARLIER, -1, 0, 1)}
            recent: dict[int, Float32] = {}
            for k, frame in enumerate(self._footage):
                if k in needed:
                    recent[k] = frame[self._seen]
                if k - 1 in self._places:
                    self._find_still(k - 1, recent)
                    if not self._between:
                        self._find_lost(k - 1, recent)
                recent.pop(k - 1 - _EARLIER, None)
                yield frame

        return replace(self._footage, frames=frames)

    def count(self, events: Events) -> None:
        """Count the next events of the simulation."""
        for k, still in self._still.items():
            start, end = np.searchsorted(events.t_us, 1e6 * self._t_s[k : k + 2])
            self._all += int(end - start)
            self._noise += still[events.y[start:end], events.x[start:end]].sum()

    @property
    def lost(self) -> float:
        """Share of the events that the frames lose, where things move."""
        return max(0.0, 1 - self._alone / self._dense) if self._dense else 0.0

    @property
    def noise(self) -> float:
        """Least share of the events that is noise of the frames."""
        return max(0.0, self._noise / self._all) if self._all else 0.0

    def warn(self) -> None:
        """Warn of events that are lost, and of those that are noise."""
        if self.lost > _TELLING:
            _log.warning(
                "the image moves by %.2g px of the sensor from frame to frame, which loses about "
                "%.0f %% of the events. --interpolate auto restores most",
                np.median(self._motion_px),
                100 * self.lost,
            )
        if self.noise > _TELLING:
            _log.warning(
                "at least %.0f %% of the events are noise of the frames, where nothing moves; "
                "denoise the frames, or average them over larger pixels, such as --resolution %d",
                100 * self.noise,
                max(1, self._model.width // 2),
            )

    def _find_still(self, k: int, recent: dict[int, Float32]) -> None:
        """Find the pixels where nothing moves between two frames, and the camera's noise there."""
        model = self._model
        self._still[k] = still = np.zeros((model.height, model.width), bool)
        if k < _EARLIER:
            return
        light = [
            integrate(recent[index], model.height, model.width).astype(np.float32)
            for index in (k - _EARLIER, k, k + 1)
        ]
        dark = np.float32(model.dark_level)
        earlier, before, after = (np.log(frame + dark) for frame in light)
        change = after - before
        size, drift = _tile_means(change**2), _tile_means((after - earlier) ** 2)
        alike = sum(_tile_means(change * np.roll(change, 1, axis)) for axis in (0, 1)) / 2
        is_still = (alike < _ALIKE * size) & (drift < _DRIFTING * size)
        if is_still.sum() <= _TELLING * is_still.size:
            return
        images = [gray(frame, self._footage.white_level) for frame in light[1:]]
        left = np.log(followed(light[2], *images) + dark) - before
        is_still &= _tile_means(left**2) > _EXPLAINED * size
        tiles = is_still.repeat(_TILE, 0).repeat(_TILE, 1)
        still[: len(tiles), : tiles.shape[1]] = tiles
        steady = simulate(np.stack([light[1]] * 2), self._t_s[k : k + 2], model)
        self._noise -= float(still[steady.y, steady.x].sum())

    def _find_lost(self, k: int, recent: dict[int, Float32]) -> None:
        """Count the events between two frames where things move, alone and with frames between.

        The interval before only brings the pixels into their usual state.
        """
        first = max(0, k - 1)
        frames = [recent[index] for index in range(first, k + 2)]
        height, width = frames[0].shape
        times_s = self._t_s[first : k + 2]
        alone = replace(
            self._footage, t_s=times_s, height=height, width=width, frames=lambda: iter(frames)
        )
        motion_px = displacements_px(alone)[-1] * self._model.width / width
        self._motion_px.append(motion_px)
        steps = min(_MOST_STEPS, steps_for(motion_px))
        dense = interpolated(alone, [*[1] * (len(frames) - 2), steps])
        counts = []
        for source in (alone, dense):
            events = simulate(iter(source), source.t_s, self._model)
            moving = ~self._still[k][events.y, events.x]
            counts.append(int(np.sum(moving & (events.t_us >= 1e6 * self._t_s[k]))))
        self._alone, self._dense = self._alone + counts[0], self._dense + counts[1]


def _tile_means(values: Float32) -> Float32:
    """Return the means of the whole tiles of an image."""
    rows, columns = (side // _TILE for side in values.shape)
    whole = values[: rows * _TILE, : columns * _TILE]
    means: Float32 = whole.reshape(rows, _TILE, columns, _TILE).mean((1, 3))
    return means
