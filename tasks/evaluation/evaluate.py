"""Simulate sensors on frames, run methods on their events, and score the answers."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from eres_render import GroundTruth, RadianceSequence
from eres_render.cores import cores
from eres_render.progress import Progress
from eres_render.sequence.sequence import read_ahead
from sensor import Events, stream_bank
from sensor.readout import Sender
from tasks.evaluation.emulated import EmulatedPixels, seen
from tasks.evaluation.reference import ReferenceFrames, central_part
from tasks.evaluation.rendered_clip import RenderedClip
from tasks.evaluation.scorers.base import Score, Scorer
from tasks.evaluation.sensor_setting import Setting
from tasks.evaluation.settings import TaskSettings
from tasks.evaluation.source import row_of
from tasks.evaluation.timings import JobTimings, MethodTimings, Stopwatch, split_shared_time
from tasks.registry import TASKS, load
from tasks.row import Row

Watch = Callable[[Setting, Events], None]
_Names = dict[Setting, list[str]]  # of sensors that differ in nothing else
_Tasks = Mapping[str, TaskSettings]

FRAMES_AHEAD = 12  # as many as sensors take at once, so that neither side waits for the other


@dataclass(frozen=True, eq=False, slots=True)
class Evaluation:
    """Rows and timings of all sensors and methods on a sequence, and the reference."""

    rows: list[Row]
    timings: JobTimings
    reference: ReferenceFrames


def evaluate(
    sequence: RadianceSequence,
    truth: GroundTruth,
    settings: Sequence[Setting],
    tasks: _Tasks,
    on_progress: Progress,
    watch: Watch | None = None,
) -> Evaluation:
    """Simulate sensors on a sequence, and score every method of the tasks on their events.

    A sensor of another shape than the frames sees the largest central part of its shape. A task
    without methods is skipped. `watch` gets each sensor's next events, warm-up included; several
    threads call it, but for one sensor only one thread at a time.
    """
    parts: dict[tuple[int, int], tuple[RadianceSequence, GroundTruth, _Names]] = {}
    for setting in settings:
        part, of_part = central_part(sequence, truth, setting.model.width, setting.model.height)
        *_, names = parts.setdefault((part.width, part.height), (part, of_part, {}))
        names.setdefault(replace(setting, name=""), []).append(setting.name)
    reference: ReferenceFrames | None = None
    stopwatch, rendered = Stopwatch(), sequence.rendered
    sensors: list[_Sensor] = []
    with ThreadPoolExecutor(cores()) as workers:
        for part, of_part, names in parts.values():
            shown = ReferenceFrames(part, of_part)
            reference = reference or shown  # the others' would fill the memory
            here = [
                _Sensor(RenderedClip(shown, replace(setting, name=own[0])), own, tasks, watch)
                for setting, own in names.items()
            ]
            before_s = rendered.seconds
            with stopwatch("sensing"):
                _collect(part, here, workers, stopwatch, on_progress)
            stopwatch.seconds["rendering"] += rendered.seconds - before_s
            with stopwatch("scoring"):
                # The largest come first, so that the cores finish at about the same time.
                order = sorted(here, key=lambda sensor: -sensor.setting.model.width)
                for k, _ in enumerate(workers.map(_Sensor.score, order), start=1):
                    on_progress("scoring", k, len(here))
            sensors += here
    assert reference is not None, "there is at least one sensor"
    rows = [row for sensor in sensors for row in sensor.rows]
    return Evaluation(rows, _timings(sequence, len(parts), stopwatch.seconds, sensors), reference)


def _timings(
    sequence: RadianceSequence, passes: int, seconds: Mapping[str, float], sensors: list[_Sensor]
) -> JobTimings:
    """Return the timings of sensors on a sequence whose frames were read in so many passes."""
    rendered, manifest = sequence.rendered, sequence.manifest
    models = [sensor.setting.model for sensor in sensors]
    scored = ((sensor.setting, *each) for sensor in sensors for each in sensor.scored)
    stages = split_shared_time(
        rendering_s=seconds["rendering"],
        waiting_s=seconds["waiting"],
        simulating_s=seconds["sensing"] - seconds["waiting"] - seconds["collecting"],
        collecting_s=seconds["collecting"],
    )
    stages["rendering_s"] += rendered.seconds - seconds["rendering"]  # before the sensors
    return JobTimings(
        scene=manifest.scene,
        sample=manifest.clip,
        cores=cores(),
        frames=len(sequence) * passes,
        resolution=manifest.width,
        spp=manifest.spp,
        sensors=len(models),
        pixel_frames=len(sequence) * sum(model.width * model.height for model in models),
        events=sum(sensor.fired for sensor in sensors),
        scoring_s=seconds["scoring"],
        methods=tuple(method_timings(scored)),
        rendered_frames=rendered.frames,
        height=manifest.height,
        **stages,
    )


class _Sensor:
    """One sensor, under one name or several, with its bus and the scorers of tasks with methods."""

    def __init__(
        self, source: RenderedClip, names: list[str], tasks: _Tasks, watch: Watch | None
    ) -> None:
        self.setting, self._source, self._names, self._watch = source.setting, source, names, watch
        self._sender = None if self.setting.readout is None else Sender(self.setting.readout)
        self._scorers: dict[str, Scorer] = {
            name: load(TASKS[name].scorer)(source, task)
            for name, task in tasks.items()
            if task.methods
        }
        self.fired = self._in_window = self._dropped = 0  # events, the dropped ones in the window
        self.scored: list[tuple[str, Score]] = []  # with their tasks
        self.rows: list[Row] = []

    def push(self, events: Events) -> None:
        """Add the next events that the pixels fire, those of the warm-up included."""
        start_us, end_us = self.setting.start_us, self.setting.end_us
        self.fired += len(events)
        first, last = np.searchsorted(events.t_us, [start_us, end_us])
        self._in_window += int(last - first)
        if self._sender is None:
            self._receive(events)
            return
        # The window's events are sent separately to count those that the bus drops.
        self._receive(self._sender.push(events[:first]))
        before = self._sender.report.dropped
        self._receive(self._sender.push(events[first:last]))
        self._dropped += self._sender.report.dropped - before
        self._receive(self._sender.push(events[last:]))

    def _receive(self, events: Events) -> None:
        """Pass on events that have left the sensor."""
        for scorer in self._scorers.values():
            scorer.push(events)
        if self._watch:
            for name in self._names:
                self._watch(replace(self.setting, name=name), events)

    def score(self) -> None:
        """Score all tasks, after the last event, and make each score a row of each name."""
        if self._sender is not None and (last := self._sender.finish()) is not None:
            self._receive(last)
        for task, scorer in self._scorers.items():
            self.scored += [(task, score) for score in scorer.scores()]
        rate_hz = self._in_window / self._source.window.seconds
        dropped = self._dropped / self._in_window if self._dropped else 0.0
        for task, score in self.scored:
            row = row_of(task, self._source, score, rate_hz, dropped)
            self.rows += [replace(row, sensor=name) for name in self._names]
        del self._scorers, self._source  # and with them its frames


def _collect(
    sequence: RadianceSequence,
    sensors: Sequence[_Sensor],
    workers: Executor,
    stopwatch: Stopwatch,
    on_progress: Progress,
) -> None:
    """Simulate all sensors; push their events while the next ones are simulated."""

    pixels: dict[Setting, list[_Sensor]] = {}  # buses may differ
    for sensor in sensors:
        pixels.setdefault(replace(sensor.setting, name="", readout=None), []).append(sensor)
    exact = [setting for setting in pixels if setting.emulation is None]
    programs = {
        EmulatedPixels(setting, sequence): on
        for setting, on in pixels.items()
        if setting.emulation is not None
    }

    def emulate(k: int, frame: NDArray[np.float32]) -> None:
        """Show a frame to the programs that see it."""
        light = cache(partial(seen, frame))  # for all that see the same
        tasks = [
            (program, light(*program.optics), on)
            for program, on in programs.items()
            if program.sees[k]
        ]
        # As a list, so that an error of a sensor is raised.
        list(workers.map(lambda task: _push(task[0].push(k, task[1]), task[2]), tasks))

    def frames(ahead: Iterator[NDArray[np.float32]]) -> Iterator[NDArray[np.float32]]:
        for k in range(len(sequence)):
            with stopwatch("waiting"):
                frame = next(ahead)
            emulate(k, frame)
            yield frame
            on_progress("simulating", k + 1, len(sequence))
        any(program.pixels.warn_if_clamped() for program in programs)

    after = np.searchsorted(sequence.t_s, [sensor.t_start_s for sensor in exact], side="right")
    source, count = iter(sequence), len(sequence)
    # Rendering and simulating use all cores, but not all of the time: together they leave few idle.
    whole = read_ahead(lambda k: next(source), range(count), threads=1, most=FRAMES_AHEAD)
    with closing(whole) as ahead:
        if not exact:
            deque(frames(ahead), maxlen=0)
            return
        events_of_all = stream_bank(
            frames(ahead),
            sequence.t_s,
            [setting.model for setting in exact],
            speeds=[setting.speed for setting in exact],
            starts=np.maximum(after - 1, 0).tolist(),  # the frame at or before it
        )
        pushes: list[Future[None]] = []
        for batch in chain(_batches(events_of_all), [{}]):  # the last waits for the others
            with stopwatch("collecting"):
                for push in pushes:
                    push.result()  # raises an error of its sensor
            # The largest come first, so that the cores finish at about the same time.
            order = sorted(batch, key=lambda i: -len(batch[i]))
            pushes = [workers.submit(_push, batch[i], pixels[exact[i]]) for i in order]


def _push(events: Events, sensors: Iterable[_Sensor]) -> None:
    for sensor in sensors:
        sensor.push(events)


def _batches(events_of_all: Iterable[tuple[int, Events]]) -> Iterator[dict[int, Events]]:
    """Group events by sensor index, into batches with one stretch of events per sensor."""
    batch: dict[int, Events] = {}
    for i, events in events_of_all:
        if i in batch:
            yield batch
            batch = {}
        batch[i] = events
    yield batch


def method_timings(scored: Iterable[tuple[Setting, str, Score]]) -> Iterator[MethodTimings]:
    """Yield the timings of each method on each sensor, from scores with their sensors and tasks."""
    groups: dict[tuple[str, str, str, int, str, int], list[Score]] = {}
    for setting, task, score in scored:
        if not score.copied:
            size = setting.model.width, setting.name, setting.model.height
            key = task, score.method, score.variant, *size
            groups.setdefault(key, []).append(score)
    for key, scores in groups.items():
        yield MethodTimings(
            *key[:4],
            estimates=len(scores),
            events=sum(score.events for score in scores),
            cpu_s=sum(score.cpu_s for score in scores),
            median_cpu_s=float(np.median([score.cpu_s for score in scores])),
            sensor=key[4],
        )
