"""Frames through every sensor, their events through every method, and the scores of that."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from importlib import import_module

import numpy as np
from numpy.typing import NDArray

from eres_render import GroundTruth, RadianceSequence
from eres_render.progress import Progress
from sensor import Events, stream_bank
from tasks.evaluation.reference import ReferenceFrames
from tasks.evaluation.registry import TASKS
from tasks.evaluation.scorers.base import Score, Scorer
from tasks.evaluation.setting import Setting
from tasks.evaluation.settings import Evaluate
from tasks.evaluation.timings import JobTimings, MethodTimings
from tasks.row import Row


@dataclass(frozen=True, eq=False, slots=True)
class Evaluation:
    """Scores of all sensors and methods on a sequence, their timings, and the reference."""

    rows: list[Row]
    timings: JobTimings
    reference: ReferenceFrames


def evaluate(
    sequence: RadianceSequence,
    truth: GroundTruth,
    settings: Sequence[Setting],
    tasks: Evaluate,
    on_progress: Progress,
    watch: Callable[[Setting, Events], None] | None = None,
) -> Evaluation:
    """Simulate sensors on a sequence, and score every method of the tasks on their events.

    Parameters
    ----------
    sequence
        Frames: warm-up, then the window.
    truth
        Of the sequence's scene.
    settings
        The sensors, at least one, all of one dark level.
    tasks
        What is asked of the methods.
    on_progress
        Called as frames and then sensors are done.
    watch
        Called with each sensor's events as they come, warm-up included; from several threads, but
        from one at a time for each sensor.
    """
    dark_level = settings[0].model.dark_level
    assert dark_level is not None, "settings have the sequence's dark level"
    widths = [setting.model.width for setting in settings]
    reference = ReferenceFrames(sequence, truth, tasks, dark_level, widths)
    scorers = [_scorers(reference, setting) for setting in settings]
    counts = [0 for _ in settings]
    cores = len(os.sched_getaffinity(0))
    fired, reading_s, collecting_s = 0, 0.0, 0.0

    def frames() -> Iterator[NDArray[np.float32]]:
        nonlocal reading_s
        decoded = iter(sequence)
        for k in range(len(sequence)):
            started_s = time.perf_counter()
            frame = next(decoded)
            reading_s += time.perf_counter() - started_s
            yield frame
            on_progress("simulating", k + 1, len(sequence))

    started_s = time.perf_counter()

    events_of_all = stream_bank(
        frames(), sequence.t_s, [s.model for s in settings], speeds=[s.speed for s in settings]
    )

    def collect(i: int, events: Events) -> None:
        counts[i] += len(events.between(settings[i].start_us, settings[i].end_us))
        for scorer in scorers[i]:
            scorer.push(events)
        if watch:
            watch(settings[i], events)

    with ThreadPoolExecutor(cores) as workers:
        for batch in _batches(events_of_all):
            came_s = time.perf_counter()
            fired += sum(len(events) for events in batch.values())
            list(workers.map(collect, batch, batch.values()))
            collecting_s += time.perf_counter() - came_s
        simulated_s = time.perf_counter()
        # Large sensors take longest. They come first, so that no core is left with one at the end.
        order = sorted(range(len(settings)), key=lambda i: -settings[i].model.width)
        scored = workers.map(_scores, [scorers[i] for i in order])
        scores_of: dict[int, list[Score]] = {}
        for i, scores in zip(order, scored, strict=True):
            scores_of[i] = scores
            on_progress("scoring", len(scores_of), len(settings))
    rows, scored_of_all = [], []
    for i, (setting, count) in enumerate(zip(settings, counts, strict=True)):
        rows += [_row(sequence, setting, count / setting.seconds, s) for s in scores_of[i]]
        scored_of_all += [(setting.model.width, s) for s in scores_of[i]]
    timings = JobTimings(
        scene=sequence.manifest.scene,
        sample=sequence.manifest.clip,
        cores=cores,
        frames=len(sequence),
        resolution=sequence.manifest.width,
        spp=sequence.manifest.spp,
        reading_s=reading_s,
        sensors=len(settings),
        pixel_frames=len(sequence) * sum(s.model.width * s.model.height for s in settings),
        events=fired,
        simulating_s=simulated_s - started_s - reading_s - collecting_s,
        collecting_s=collecting_s,
        scoring_s=time.perf_counter() - simulated_s,
        methods=_method_timings(scored_of_all),
    )
    return Evaluation(rows, timings, reference)


def _scores(scorers: Iterable[Scorer]) -> list[Score]:
    return [score for scorer in scorers for score in scorer.scores()]


def _batches(events_of_all: Iterable[tuple[int, Events]]) -> Iterator[dict[int, Events]]:
    """Next events of as many sensors as come before one has more of them, by the sensor's index."""
    batch: dict[int, Events] = {}
    for i, events in events_of_all:
        if i in batch:
            yield batch
            batch = {}
        batch[i] = events
    yield batch


def _method_timings(scored: Iterable[tuple[int, Score]]) -> tuple[MethodTimings, ...]:
    """What each method took on each width, from scores with the width of their sensor."""
    groups: dict[tuple[str, str, str, int], list[Score]] = {}
    for width, score in scored:
        if score.copied:
            continue
        groups.setdefault((score.task, score.method, score.variant, width), []).append(score)
    return tuple(
        MethodTimings(
            *name,
            estimates=len(scores),
            events=sum(score.events for score in scores),
            cpu_s=sum(score.cpu_s for score in scores),
            median_cpu_s=float(np.median([score.cpu_s for score in scores])),
        )
        for name, scores in groups.items()
    )


def _scorers(reference: ReferenceFrames, setting: Setting) -> list[Scorer]:
    tasks = reference.evaluate
    wanted = [task.name for task in fields(tasks) if getattr(tasks, task.name).methods]
    return [_scorer(task)(reference, setting) for task in wanted]


def _scorer(task: str) -> Callable[[ReferenceFrames, Setting], Scorer]:
    module, _, name = TASKS[task].scorer.partition(":")
    found: Callable[[ReferenceFrames, Setting], Scorer] = getattr(import_module(module), name)
    return found


def _row(sequence: RadianceSequence, setting: Setting, event_rate_hz: float, score: Score) -> Row:
    return Row(
        scene=sequence.manifest.scene,
        task=score.task,
        method=score.method,
        width=setting.model.width,
        cutoff_hz=setting.model.cutoff_hz,
        contrast_threshold=setting.model.contrast_threshold,
        speed=setting.speed,
        sample=sequence.manifest.clip if score.sample is None else score.sample,
        metric=score.metric,
        value=score.value,
        event_rate_hz=event_rate_hz,
        variant=score.variant,
        item=score.item,
        failure=score.failure,
    )
