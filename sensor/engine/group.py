"""Sensors with the same light on their pixels: equal size, dark level and fill factor."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensor.engine.frames import refuse_bad_radiance, whole_microseconds
from sensor.engine.settings import Draw, generator, settings_of
from sensor.engine.sorting import Room, UnsortedEvents
from sensor.engine.workers import Workers
from sensor.errors import SensorError
from sensor.events import Events, no_events
from sensor.kernels import advance
from sensor.kernels.comparator import outside_refractory
from sensor.kernels.packing import FULL
from sensor.kernels.photoreceptor import STEP, photoreceptor_step
from sensor.kernels.radiance import (
    BAD,
    MIN_LIGHT,
    PixelLight,
    integrate_area,
    light_on_pixels,
    log_of_block,
)
from sensor.memory import MEMORY
from sensor.model import SensorModel
from sensor.optics import pixel_overlaps

# Pixels of a block: smaller ones cost more calls, larger ones leave the caches. The distance
# between rows of its state is not a power of two, so that they do not share lines of the L1 cache.
_BLOCK_PX = 8136
_BAND_WORK = 1 << 16  # pixels x frames x settings of a band, or its call takes longer than they do


@dataclass(eq=False)
class SensorGroup:
    """Sensors with the same light, and the state of their pixels at the last frame."""

    members: list[int]  # indices of the models in the bank
    models: list[SensorModel]
    speeds: NDArray[np.float64]  # (S,)
    settings: advance.Settings
    state: advance.State
    held: list[Events]  # in the microsecond of the last frame, which the next chunk shares
    ready_us: list[NDArray[np.int64] | None]  # (height, width) end of the refractory periods
    first: int  # index of the frame at which the group starts; random numbers count from there
    fired: int = 0  # events of all members in the last chunk, before any is removed

    @classmethod
    def start(
        cls,
        members: list[int],
        models: list[SensorModel],
        speeds: list[float],
        frame: NDArray[np.floating],
        seed: int,
        first: int,
    ) -> SensorGroup:
        """Initialize the group at its first frame, (H, W) linear radiance."""
        light = light_of(frame[None], models[0], first)
        pixels = models[0].height * models[0].width
        u = MEMORY.array(pixels)
        log_of_block(light, 0, slice(0, pixels), u)
        settings = settings_of(models, seed)
        memory = MEMORY.array((len(models), pixels))
        memory[:] = u
        for s, model in enumerate(models):
            if model.random_start:
                share = generator(seed, Draw.START).random(u.size)
                memory[s] += settings.C_off[s] - share * (settings.C_on[s] + settings.C_off[s])
        v1, v2 = MEMORY.array((2, len(models), pixels if settings.filtered.any() else 0))
        v1[:] = v2[:] = u[: v1.shape[1]]
        never_us = np.iinfo(np.int64).min
        return cls(
            members,
            models,
            np.array(speeds),
            settings,
            advance.State(u, v1, v2, memory),
            [no_events(m.width, m.height, m) for m in models],
            [
                np.full((m.height, m.width), never_us) if m.refractory_s > 0 else None
                for m in models
            ],
            first,
        )

    def advance(
        self,
        chunk: NDArray[np.floating],
        index: int,
        t_s: NDArray[np.float64],
        rooms: Sequence[Room],
        workers: Workers,
    ) -> Iterator[tuple[int, Events]]:
        """Simulate a chunk of frames; yield indices of models with their next events.

        The chunk is (F, H, W) linear radiance, and `index` belongs to its first frame. `t_s` is
        (F + 1,): times of the frame before the chunk and of its frames.
        """
        light = light_of(chunk, self.models[0], index, workers.map)
        t_s = t_s / self.speeds[:, None]
        frame_us, after_us = whole_microseconds(t_s)
        dt_s = np.diff(t_s)
        steps = [
            [photoreceptor_step(each, model.cutoff_hz, model.poles) for each in row]
            for row, model in zip(dt_s, self.models, strict=True)
        ]
        clock = advance.Clock(
            index - 1 - self.first, np.array(steps, STEP), dt_s, after_us, np.diff(frame_us)
        )
        count = min(len(workers.pools), max(1, dt_s.size * self.state.u.size // _BAND_WORK))
        edges = np.linspace(0, self.state.u.size, count + 1).astype(int).tolist()
        bands = [(k, *band) for k, band in enumerate(itertools.pairwise(edges)) if len({*band}) > 1]

        def advance_band(band: tuple[int, int, int]) -> NDArray[np.int64]:
            k, start, stop = band
            pixels = advance.Band(self.models[0].width, start, stop, _BLOCK_PX)
            segment = np.zeros((-(-(stop - start) // _BLOCK_PX), *dt_s.shape, 2), np.int64)
            outcome, resume = FULL, advance.Resume(0, 0, 0)
            while outcome == FULL:
                alike = self.settings.C_on.shape[1] == 1
                block = advance.room_for_block(len(chunk), _BLOCK_PX, alike, workers.pools[k])
                outcome, resume = advance.advance_pixels(
                    light, pixels, self.state, self.settings, clock, block, resume, segment
                )
                if outcome == FULL:
                    workers.enlarge_pool(k)
            if outcome == BAD:
                refuse_bad_radiance(chunk, index)
            return segment

        segments = workers.map(advance_band, bands)
        pools = [workers.pools[k] for k, *_ in bands]
        counts = sum(np.diff(segment, axis=3)[..., 0].sum(axis=0) for segment in segments)
        self.fired = int(np.sum(counts))
        for s, member in enumerate(self.members):
            unsorted = UnsortedEvents(pools, segments, counts[s], frame_us[s], s)
            for part in unsorted.parts(workers.threads):
                events = unsorted.sort(part, self.held[s], rooms[member], workers)
                yield member, self._passed_on(s, events, int(frame_us[s, part.stop]))

    def finish(self) -> Iterator[tuple[int, Events]]:
        """Yield `(index of the model, its remaining events)` after the last chunk."""
        for s, member in enumerate(self.members):
            yield member, self._reported(s, self.held[s])

    def _passed_on(self, s: int, events: Events, last_us: int) -> Events:
        """Hold back the events of the last frame's microsecond; report the others."""
        self.held[s] = events.between(last_us, last_us + 1).copy()
        return self._reported(s, events[: len(events) - len(self.held[s])])

    def _reported(self, s: int, events: Events) -> Events:
        """Remove the events within the refractory periods of the s-th member; add its latency."""
        model, ready_us = self.models[s], self.ready_us[s]
        if ready_us is not None:
            refractory_us = round(model.refractory_s * 1e6)
            events = events.where(outside_refractory(events.columns, refractory_us, ready_us))
        if model.latency_s > 0:
            events = events.later(round(model.latency_s * 1e6))
        return events


def members_by_light(models: Sequence[SensorModel], starts: Sequence[int]) -> list[list[int]]:
    """Divide models into groups: those with one light that start together."""
    groups: dict[tuple[int, int, float | None, float, int], list[int]] = {}
    for i, (m, start) in enumerate(zip(models, starts, strict=True)):
        groups.setdefault((m.height, m.width, m.dark_level, m.fill_factor, start), []).append(i)
    return list(groups.values())


def least_bytes(models: Sequence[SensorModel]) -> int:
    """Return the memory that `SensorGroup.start` allocates for the models of a group, bytes."""
    of_each = 1  # the memory
    of_each += 2 * any(m.cutoff_hz < math.inf for m in models)  # v1, v2
    of_each += 2 * any(m.threshold_mismatch > 0 for m in models)  # C_on, C_off
    of_each += any(m.hot_pixel_fraction > 0 and m.hot_pixel_hz > 0 for m in models)
    once = 1 + sum(m.refractory_s > 0 for m in models)  # u, ends of refractory periods
    return 8 * (once + of_each * len(models)) * models[0].height * models[0].width


def light_of(
    chunk: NDArray[np.floating],
    model: SensorModel,
    index: int,
    apply: Callable[..., Iterable] = map,
) -> PixelLight:
    """Average (F, H, W) linear radiance, from frame `index` on, over the pixels of a model."""
    dark = model.dark_level or 0.0
    if chunk.shape[1:] == (model.height, model.width):
        radiance = chunk  # one sample per pixel, so the fill factor has no effect
    else:
        overlaps = pixel_overlaps(chunk.shape[1:], model.height, model.width, model.fill_factor)
        radiance = MEMORY.array((len(chunk), model.height, model.width))
        frames = zip(chunk, radiance, strict=True)
        if not all(apply(lambda pair: integrate_area(pair[0], *overlaps, pair[1]), frames)):
            refuse_bad_radiance(chunk, index)
    if dark == 0 and not float(radiance.min()) >= MIN_LIGHT:
        refuse_bad_radiance(chunk, index)
        f, y, x = np.unravel_index(radiance.argmin(), radiance.shape)
        raise SensorError(
            f"frame {index + f}, pixel x={x} y={y}: found radiance {radiance[f, y, x]:g}, "
            f"expected at least {MIN_LIGHT:.3g}, since dark_level is 0 and radiance needs a "
            "logarithm; set dark_level to a positive value, or to None"
        )
    return light_on_pixels(radiance.reshape(len(chunk), -1), dark)
