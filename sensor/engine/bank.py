"""The engine behind `simulate`: many sensors, one reading of the frames."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from queue import SimpleQueue

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sensor.engine.arguments import (
    check_fit,
    check_memory,
    checked_models,
    checked_seed,
    checked_speeds,
    checked_threads,
)
from sensor.engine.frames import (
    FrameReader,
    Frames,
    check_spans,
    checked_times,
    refuse_bad_radiance,
    warn_of_long_intervals,
    warn_of_whole_numbers,
    whole_microseconds,
)
from sensor.errors import SensorError
from sensor.events import Events, concatenate
from sensor.kernels import advance, comparator, packing, photoreceptor
from sensor.kernels.radiance import log_intensity
from sensor.model import SensorModel
from sensor.optics import integrate

DARK_FRACTION = 1e-3  # of the white level, where a model leaves its dark level open
# Pixels taken through several frames at a time: their state fits the L2 cache, and its rows, which
# are no power of two apart, do not fall on the same lines of the L1 cache.
_BLOCK_PX = 4040
_CHUNK_FRAMES = 8
_BANDS_A_THREAD = 4  # so that a thread that is held up leaves its share to the others
_POOL_EVENTS = 1 << 22  # 32 MiB of addresses; memory is taken as it is filled
_LEAST_LIGHT = float(np.finfo(np.float64).tiny)  # below it, float64 loses digits one by one
_CHUNK_WORK = 1 << 26  # pixels x frames x settings at a time: bounds the memory of unsorted events


@dataclass(eq=False)
class _Group:
    """Sensors of one size and dark level, and their pixels' state at the last frame read."""

    height: int
    width: int
    dark: float
    fill_factor: float
    members: list[int]  # indices into the bank's models
    models: list[SensorModel]
    C_on: NDArray[np.float64]  # (S, height * width), or (S, 1) where no member has a mismatch
    C_off: NDArray[np.float64]
    hot_hz: NDArray[np.float64]  # (S, height * width), or (S, 0) where no member has hot pixels
    electronics: NDArray[np.float64]  # (S, photoreceptor.ELECTRONICS_SIZE)
    noisy: NDArray[np.bool_]  # (S,)
    filtered: NDArray[np.bool_]  # (S,)
    leader: NDArray[np.int64]  # (S,) see `_leaders`
    speed: NDArray[np.float64]  # (S,)
    u: NDArray[np.float64]  # (height * width,) log intensity
    v1: NDArray[np.float64]  # (S, height * width), or (S, 0) where no member has a filter
    v2: NDArray[np.float64]
    memory: NDArray[np.float64]  # (S, height * width)
    held: list[Events]  # of the last frame's microsecond, in which the next chunk may fire too
    ready_us: list[NDArray[np.int64] | None]  # (height, width) when refractory pixels fire again


class Bank:
    """Sensors that look at the same frames; `run` yields their events as the frames go by."""

    def __init__(
        self,
        frames: Frames,
        t_s: ArrayLike,
        models: Sequence[SensorModel],
        speeds: Sequence[float] | None,
        seed: int,
        threads: int | None,
    ) -> None:
        models = checked_models(models)
        self.speeds = checked_speeds(speeds, len(models))
        self.seed = checked_seed(seed)
        self.threads = checked_threads(threads)
        self.t_s = checked_times(t_s)
        self.reader = FrameReader(frames, len(self.t_s))
        for speed in {*self.speeds}:
            check_spans(self.t_s / speed, packing.MAX_INTERVAL_US, speed)
        for model in models:
            check_fit(model, *self.reader.shape)
        check_memory(models)
        warn_of_long_intervals(self.t_s)
        warn_of_whole_numbers(self.reader.first)
        if any(m.dark_level is None for m in models):
            dark_level = self._default_dark_level()
            models = [
                m if m.dark_level is not None else replace(m, dark_level=dark_level) for m in models
            ]
        self.models = models
        # Room for the kernels' events, one a band; and for each thread that sorts, room to do so.
        self._bands = 1 if self.threads == 1 else _BANDS_A_THREAD * self.threads
        self._pools = [np.empty(_POOL_EVENTS, np.uint64) for _ in range(self._bands)]
        self._scratch: SimpleQueue[NDArray[np.uint64]] = SimpleQueue()
        for _ in range(self.threads):
            self._scratch.put(np.empty((2, 0), np.uint64))

    def _default_dark_level(self) -> float:
        white = float(np.percentile(self.reader.first, 99.9))
        if white <= 0:
            raise SensorError(
                "dark_level: the first frame is black, so None has no white level to go by; "
                "give SensorModel.dark_level a value"
            )
        return DARK_FRACTION * white

    def no_events(self, i: int) -> Events:
        """An empty stream of the i-th model."""
        model = self.models[i]
        x, y = np.empty((2, 0), np.uint16)
        t_us, p = np.empty(0, np.int64), np.empty(0, np.int8)
        return Events(t_us, x, y, p, model.width, model.height, model)

    def run(self) -> Iterator[tuple[int, Events]]:
        """Yield `(index of the model, its next events)`; the parts of one model are in order."""
        members: dict[tuple[int, int, float | None, float], list[int]] = {}
        for i, m in enumerate(self.models):
            light = m.height, m.width, m.dark_level, m.fill_factor
            members.setdefault(light, []).append(i)
        groups = [self._start(indices) for indices in members.values()]
        work = max(g.memory.size for g in groups)
        chunk_frames = max(1, min(_CHUNK_FRAMES, _CHUNK_WORK // work))
        done = 1
        with ThreadPoolExecutor(self.threads) as workers:
            for chunk in self.reader.chunks(chunk_frames):
                t_s = self.t_s[done - 1 : done + len(chunk)]
                for group in groups:
                    yield from self._advance(group, chunk, done, t_s, workers)
                done += len(chunk)
        for group in groups:
            for s, i in enumerate(group.members):
                yield i, _after_refractory(group, s, group.held[s])

    def _start(self, members: list[int]) -> _Group:
        models = [self.models[i] for i in members]
        one = models[0]
        pixels, dark = one.height * one.width, one.dark_level or 0.0
        u = np.empty(pixels)
        radiance = _at_pixels(self.reader.first, one)
        assert radiance is not None, "the reader has checked the first frame"
        _check_positive(radiance, dark, 0)
        log_intensity(radiance.ravel(), dark, u)
        C_on, C_off = (self._thresholds(models, draw) for draw in (_Draw.C_ON, _Draw.C_OFF))
        memory = np.tile(u, (len(models), 1))
        for row, model, on, off in zip(memory, models, C_on, C_off, strict=True):
            if model.random_start:
                share = self._uniform(_Draw.START, pixels)
                row += off - share * (on + off)
        filtered = np.array([math.isfinite(m.cutoff_hz) for m in models])
        v = np.tile(u, (len(models), 1)) if filtered.any() else memory[:, :0]
        hot = [m.hot_pixel_fraction > 0 and m.hot_pixel_hz > 0 for m in models]
        hot_hz = np.zeros((len(models), pixels if any(hot) else 0))
        if any(hot):
            share = self._uniform(_Draw.HOT, pixels)
            for row, model in zip(hot_hz, models, strict=True):
                row[share < model.hot_pixel_fraction] = model.hot_pixel_hz
        return _Group(
            one.height,
            one.width,
            dark,
            one.fill_factor,
            members,
            models,
            C_on,
            C_off,
            hot_hz,
            electronics=np.array([_electronics(m) for m in models]),
            noisy=np.array([m.shot_noise_hz > 0 for m in models]) | hot,
            filtered=filtered,
            leader=_leaders(models),
            speed=np.array([self.speeds[i] for i in members]),
            u=u,
            v1=v,
            v2=v.copy(),
            memory=memory,
            held=[self.no_events(i) for i in members],
            ready_us=[
                np.full((m.height, m.width), np.iinfo(np.int64).min) if m.refractory_s > 0 else None
                for m in models
            ],
        )

    def _uniform(self, draw: int, count: int) -> NDArray[np.float64]:
        """A number in [0, 1) for each pixel, the same for all models of that size."""
        return np.random.Generator(np.random.Philox(key=[self.seed, draw])).random(count)

    def _thresholds(self, models: list[SensorModel], draw: int) -> NDArray[np.float64]:
        C = np.array([[m.contrast_threshold] for m in models])
        mismatch = np.array([[m.threshold_mismatch] for m in models])
        if not mismatch.any():
            return C
        generator = np.random.Generator(np.random.Philox(key=[self.seed, draw]))
        pattern = generator.standard_normal(models[0].height * models[0].width)
        return np.maximum(C + mismatch * pattern, 0.1 * C)

    def _advance(
        self,
        group: _Group,
        chunk: NDArray[np.floating],  # (F, H, W)
        index: int,
        t_base_s: NDArray[np.float64],  # (F + 1,)
        workers: ThreadPoolExecutor,
    ) -> Iterator[tuple[int, Events]]:
        """Take one group through one chunk of frames, and yield the events that are final."""
        S, F = len(group.members), len(chunk)
        one = group.models[0]
        if chunk.shape[1:] == (group.height, group.width):
            radiance = chunk
        else:
            means = workers.map(lambda frame: _at_pixels(frame, one), chunk)
            good = [mean for mean in means if mean is not None]
            if len(good) < F:
                refuse_bad_radiance(chunk, index)
            radiance = np.stack(good)
        _check_positive(radiance, group.dark, index)
        t_s = t_base_s / group.speed[:, None]
        frame_us, after_us = whole_microseconds(t_s)
        steps = np.array(
            [
                [
                    photoreceptor.photoreceptor_step(dt_s, model.cutoff_hz, model.poles)
                    for dt_s in np.diff(row)
                ]
                for row, model in zip(t_s, group.models, strict=True)
            ]
        )
        edges = np.linspace(0, group.u.size, self._bands + 1).astype(int).tolist()
        bands = [(k, *band) for k, band in enumerate(itertools.pairwise(edges)) if len({*band}) > 1]

        def advance_band(band: tuple[int, int, int]) -> NDArray[np.int64]:
            k, pixel_start, pixel_stop = band
            blocks = -(-(pixel_stop - pixel_start) // _BLOCK_PX)
            segment = np.zeros((blocks, S, F, 2), np.int64)
            outcome, block, setting, used = advance.FULL, 0, 0, 0
            while outcome == advance.FULL:
                outcome, block, setting, used = advance.advance_pixels(
                    radiance.reshape(F, -1),
                    group.dark,
                    group.width,
                    pixel_start,
                    pixel_stop,
                    _BLOCK_PX,
                    group.u,
                    group.v1,
                    group.v2,
                    group.memory,
                    group.C_on,
                    group.C_off,
                    group.hot_hz,
                    group.electronics,
                    group.filtered,
                    group.noisy,
                    group.leader,
                    np.uint64(self.seed),
                    index - 1,
                    steps,
                    after_us,
                    np.diff(frame_us),
                    block,
                    setting,
                    used,
                    self._pools[k],
                    segment,
                )
                if outcome == advance.FULL:
                    larger = np.empty(2 * self._pools[k].size, np.uint64)
                    larger[: self._pools[k].size] = self._pools[k]
                    self._pools[k] = larger
            if outcome == advance.BAD:
                refuse_bad_radiance(chunk, index)
            return segment

        segments = list(workers.map(advance_band, bands))
        pools = [self._pools[k] for k, *_ in bands]
        counts = sum(np.diff(segment, axis=3)[..., 0].sum(axis=0) for segment in segments)
        for s, i in enumerate(group.members):
            intervals = _Unsorted(pools, segments, counts[s], frame_us[s], s)
            events = intervals.sort(group.held[s], workers, self._scratch)
            last_us = int(frame_us[s, -1])
            group.held[s] = events.between(last_us, last_us + 1).copy()
            yield i, _after_refractory(group, s, events[: len(events) - len(group.held[s])])


@dataclass(frozen=True)
class _Unsorted:
    """One setting's events of a chunk, where the kernels left them."""

    pools: list[NDArray[np.uint64]]  # one a band
    segments: list[NDArray[np.int64]]
    counts: NDArray[np.int64]  # (F,)
    frame_us: NDArray[np.int64]  # (F + 1,)
    setting: int

    def sort(
        self,
        held: Events,
        workers: ThreadPoolExecutor,
        scratch: SimpleQueue[NDArray[np.uint64]],
    ) -> Events:
        """All of them after the events held back before, by time, ties by (y, x)."""
        starts = len(held) + np.concatenate(([0], np.cumsum(self.counts)))
        size = int(starts[-1])
        t_us, p = np.empty(size, np.int64), np.empty(size, np.int8)
        x, y = np.empty(size, np.uint16), np.empty(size, np.uint16)
        columns: tuple[NDArray, ...] = (t_us, x, y, p)
        for column, old in zip(columns, (held.t_us, held.x, held.y, held.p), strict=True):
            column[: len(held)] = old

        def sort_interval(f: int) -> None:
            room = scratch.get()
            if room.shape[1] < self.counts[f]:
                room = np.empty((2, self.counts[f]), np.uint64)
            words, other = room[:, : self.counts[f]]
            used = 0
            for pool, segment in zip(self.pools, self.segments, strict=True):
                used = packing.gather(pool, segment, self.setting, f, words, used)
            start_us, end_us = self.frame_us[f : f + 2]
            part = (column[starts[f] : starts[f + 1]] for column in columns)
            packing.sort_by_time(words, other, end_us - start_us, start_us, *part)
            scratch.put(room)

        list(workers.map(sort_interval, range(len(self.counts))))
        # A frame's microsecond holds events of the interval before it and of the one after it.
        for frame_us in self.frame_us[:-1]:
            tie = slice(*np.searchsorted(t_us, (frame_us, frame_us + 1)))
            order = np.lexsort((x[tie], y[tie]))  # stable: one pixel's events keep their order
            for column in columns:
                column[tie] = column[tie][order]
        return Events.trusted(t_us, x, y, p, like=held)


def collect(bank: Bank) -> list[Events]:
    """Run a bank to its end; one `Events` for each model."""
    parts: list[list[Events]] = [[] for _ in bank.models]
    for i, events in bank.run():
        parts[i].append(events)
    return [concatenate(part) for part in parts]


class _Draw:
    """Which random numbers: each kind has its own stream of the seed."""

    START, C_ON, C_OFF, HOT = range(4)


def _leaders(models: list[SensorModel]) -> NDArray[np.int64]:
    """For each model the first that fires the same events, times apart; as a rule that is itself.

    What an ideal pixel fires between two frames depends on their light alone. A filter, a leak and
    noise depend on the time between them as well.
    """
    first: dict[tuple, int] = {}
    leaders = []
    for i, m in enumerate(models):
        timeless = m.cutoff_hz == math.inf and m.leak_hz == m.shot_noise_hz == 0
        timeless &= m.hot_pixel_fraction == 0
        comparator = m.contrast_threshold, m.threshold_mismatch, m.random_start
        leaders.append(first.setdefault(comparator, i) if timeless else i)
    return np.array(leaders)


def _electronics(model: SensorModel) -> list[float]:
    reference = model.cutoff_reference
    row = [0.0] * photoreceptor.ELECTRONICS_SIZE
    row[photoreceptor.POLES] = model.poles
    row[photoreceptor.LEAK_PER_S] = model.leak_hz * model.contrast_threshold
    row[photoreceptor.NOISE_HZ] = model.shot_noise_hz
    row[photoreceptor.NOISE_EXPONENT] = model.shot_noise_exponent
    if reference is not None:
        row[photoreceptor.LIGHT_A] = 2 * math.pi * model.cutoff_hz / reference
    return row


def _after_refractory(group: _Group, s: int, events: Events) -> Events:
    """The events that a refractory pixel reports."""
    ready_us = group.ready_us[s]
    if ready_us is None:
        return events
    keep = np.empty(len(events), np.bool_)
    refractory_us = min(round(group.models[s].refractory_s * 1e6), np.iinfo(np.int64).max)
    comparator.outside_refractory(events.t_us, events.x, events.y, refractory_us, ready_us, keep)
    return events.where(keep)


def _at_pixels(frame: NDArray[np.floating], model: SensorModel) -> NDArray[np.floating] | None:
    if frame.shape == (model.height, model.width):
        return frame  # one sample a pixel: no part of a pixel differs from the rest
    return integrate(frame, model.height, model.width, model.fill_factor)


def _check_positive(radiance: NDArray[np.floating], dark: float, index: int) -> None:
    least = float(radiance.min())
    if dark == 0 and not least >= _LEAST_LIGHT:
        raise SensorError(
            f"frame {index} or one soon after: found a pixel of radiance {least:g}, "
            f"expected at least {_LEAST_LIGHT:.3g} where dark_level is 0, so that its logarithm "
            "exists; give dark_level a positive value, or None"
        )
