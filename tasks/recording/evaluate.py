"""Score methods of one task on a recording."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import mode

from eres_render.errors import check_positive
from eres_render.progress import Progress, silent
from tasks.errors import TaskError
from tasks.evaluation.settings import settings_of
from tasks.evaluation.source import ALL, check_needs, score_stored
from tasks.methods import check_method
from tasks.methods.contrast_maximization import AT_BOUND, UNDETERMINED
from tasks.recording.clock import on_one_clock
from tasks.recording.flow_windows import CONTRAST_GAIN
from tasks.recording.frames import RecordedFrames
from tasks.recording.options import USUAL_FLOW, FlowOptions
from tasks.recording.recording import Recording
from tasks.recording.source import sources
from tasks.recording.threshold import ANY_THRESHOLDS, Thresholds, fit_recording, stored_thresholds
from tasks.recording.window_length import with_motion
from tasks.recording.worth import worth_of_events
from tasks.registry import TASKS
from tasks.row import Row


@dataclass(frozen=True, slots=True)
class RecordingEvaluation:
    """Scores on a recording, with the assumptions and estimates behind them.

    Parameters
    ----------
    rows
        One for each method, window or image, and feature: `scene` is the name of the file, `sample`
        the window or image, `t_us` its time.
    notes
        Sentences about the frames, their clock and the thresholds.
    """

    rows: list[Row]
    notes: list[str] = field(default_factory=list)


def evaluate_recording(
    recording: Recording,
    task: str,
    *,
    frames: RecordedFrames | None = None,
    methods: Sequence[str] = (),
    shift_us: int | None = 0,
    contrast_threshold: float | None = None,
    flow: FlowOptions = USUAL_FLOW,
    weights: Mapping[str, str] | None = None,
    on_progress: Progress = silent,
) -> RecordingEvaluation:
    """Score methods of one task on a recording.

    Parameters
    ----------
    recording
        The events.
    task
        Name of a task that needs no poses. "reconstruction" and "video" need frames.
    frames
        Frames of the same camera.
    methods
        Names, or "package.module:function"; by default all methods of the task that the recording
        has the data for.
    shift_us
        Added to the times of the frames, microseconds; None estimates it.
    contrast_threshold
        C, log units; by default that of the file's sensor model, or fitted to the frames if a
        method uses it, or 0.2.
    flow
        Windows and patches, for tasks that are not scored against frames.
    weights
        Files of weights by the names of the methods that need them.
    on_progress
        Called with the stage, the amount done, and the total.

    Returns
    -------
    RecordingEvaluation

    Raises
    ------
    TaskError
        The recording lacks data that the task or a method needs, a method does not exist, or frames
        and events do not fit.
    """
    spec = TASKS[task]
    has = ALL - {"poses", "a plane"}
    check_needs(task, recording.path, "a recording", has)
    if frames is None:
        check_needs(task, recording.path, "a recording without --frames", has - {"frames"})
    if "frames" in spec.needs and flow != USUAL_FLOW:
        raise TaskError(
            f"{recording.path}: {spec.title} uses no windows or patches; leave out their options"
        )
    names = _methods(recording, task, methods, frames, weights)
    settings = settings_of(task, names, weights)
    notes: list[str] = []
    if frames is not None:
        frames = on_one_clock(recording, frames, shift_us, notes)
    elif not any(each.continuous_s for each in settings.plan()):
        before = any(each.windows_before for each in settings.plan())
        flow = with_motion(recording, flow, notes, with_before=before, on_progress=on_progress)
    used = any("threshold" in spec.method(name).needs for name in names)
    thresholds = _thresholds(recording, frames if used else None, contrast_threshold, task, notes)
    windows = sources(recording, task, settings, frames, thresholds, flow, on_progress)
    rows = [row for source in windows for row in score_stored(task, source, settings)]
    if not rows:
        raise TaskError(f"{recording.path}: no window has corners to follow")
    rows.sort(key=lambda row: row.t_us)
    return RecordingEvaluation(rows, [*notes, *_failures(rows)])


def _failures(rows: Sequence[Row]) -> list[str]:
    """Return a note on each method most of whose flows are failures, with the usual reason."""
    notes = []
    for name in dict.fromkeys(row.method for row in rows):
        mine = [row for row in rows if row.method == name]
        failures = [row.failure for row in mine if row.failure]
        if len(failures) <= len(mine) / 2:
            continue
        reason = mode(re.sub(r"\d+(\.\d+)?", "n", failure) for failure in failures)
        note = f"{name}: {len(failures)} of {len(mine)} answers failed, mostly with {reason!r}"
        alone = mine[0].metric == CONTRAST_GAIN
        if reason == AT_BOUND:
            shorter = " or a shorter --window-ms" if alone else ""
            note += f"; a larger --search-px{shorter} helps"
        elif reason == UNDETERMINED:
            longer = "a longer --window-ms" if alone else "frames farther apart"
            note += f"; more motion helps: {longer}"
        notes.append(note)
    return notes


def _methods(
    recording: Recording,
    task: str,
    given: Sequence[str],
    frames: RecordedFrames | None,
    weights: Mapping[str, str] | None,
) -> tuple[str, ...]:
    spec = TASKS[task]
    specs = {name: spec.method(name) for name in given or spec.usual(weights or ())}
    for name in specs:
        check_method(task, name, weights, [recording.size])
    blind = {name for name in specs if frames is None and "light" in specs[name].needs}
    if given and blind:
        raise TaskError(
            f"{recording.path}: method {min(blind)!r} needs the image at the start of each window; "
            "give --frames"
        )
    if not given and all(method.role == "baseline" for method in specs.values()):
        raise TaskError(
            f"{recording.path}: {spec.title} needs a network; give --method our_flow_all_light, "
            "--weights eraft=FILE or --method package.module:function, or choose --task flow"
        )
    if given:
        return tuple(given)
    return tuple(name for name in specs if specs[name].on_recordings and name not in blind)


def _thresholds(
    recording: Recording,
    frames: RecordedFrames | None,
    given: float | None,
    task: str,
    notes: list[str],
) -> Thresholds:
    if given is not None:
        check_positive("threshold", given, TaskError)
        return Thresholds(given, given)
    stored = stored_thresholds(recording)
    needs = {"a threshold", "a change"} & {*TASKS[task].needs}
    if stored is not None and needs:
        on, off = stored
        values = f"threshold: {on:g}" if on == off else f"thresholds: ON {on:g}, OFF {off:g}"
        notes.append(f"{values}, from the file")
        return stored
    if frames is None or not needs:
        return stored or ANY_THRESHOLDS
    if "a change" in needs:
        worth, unexplained = worth_of_events(recording, frames)
        notes.append(
            f"an ON event is worth {worth.on:.3f} and an OFF event {worth.off:.3f} of log light, "
            f"fitted to the frames; {100 * unexplained:.0f} % of their change stays unexplained"
        )
        return worth
    try:
        fit = fit_recording(recording, frames)
    except TaskError as error:
        raise TaskError(f"{error}; or give --threshold") from None
    notes.append(
        f"thresholds: ON {fit.on}, OFF {fit.off} at a dark level of {fit.dark:g} of white, "
        f"fitted to the light at {fit.events} events; {100 * fit.unexplained:.0f} % of its "
        "change stays unexplained"
    )
    return fit.values
