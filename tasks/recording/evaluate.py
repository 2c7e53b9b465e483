"""Score methods of one task on a recording."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from eres_render.errors import check_positive
from eres_render.progress import Progress, silent
from tasks.errors import TaskError
from tasks.methods import check_method
from tasks.methods.contrast_maximization import AT_BOUND, UNDETERMINED
from tasks.recording.clock import on_one_clock
from tasks.recording.dense_flow import score_dense_flow
from tasks.recording.flow import score_flow
from tasks.recording.frames import Frames
from tasks.recording.images import score_reconstruction, score_video
from tasks.recording.options import USUAL_FLOW, FlowOptions
from tasks.recording.recording import Recording
from tasks.recording.score import CONTRAST_GAIN, RecordingScore
from tasks.recording.threshold import (
    ANY_THRESHOLDS,
    Thresholds,
    fit_recording,
    stored_thresholds,
)
from tasks.recording.window_length import with_motion
from tasks.recording.worth import worth_of_events
from tasks.registry import TASKS

_NEEDED = {  # data that a recording does not have, by task
    "tracking": "a plane, the poses and the camera, which a recording does not have",
}
_FLOW = ("flow", "dense_flow")


@dataclass(frozen=True, slots=True)
class RecordingEvaluation:
    """Scores on a recording, with the assumptions and estimates behind them.

    Parameters
    ----------
    scores
        One for each method, window or image, and feature.
    notes
        Sentences about the frames, their clock and the thresholds.
    """

    scores: list[RecordingScore]
    notes: list[str] = field(default_factory=list)


def evaluate_recording(
    recording: Recording,
    task: str,
    *,
    frames: Frames | None = None,
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
        "flow" or "dense_flow"; with frames also "reconstruction" and "video".
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
        Windows and patches of flow.
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
    if task in _NEEDED:
        raise TaskError(f"{recording.path}: {TASKS[task].title} needs {_NEEDED[task]}")
    if frames is None and task not in _FLOW:
        raise TaskError(
            f"{recording.path}: {TASKS[task].title} is scored against frames, expected --frames; "
            "`eres video` makes images without"
        )
    if task not in _FLOW and flow != USUAL_FLOW:
        raise TaskError(
            f"{recording.path}: found options of windows or patches for {TASKS[task].title}, "
            "expected them only for flow"
        )
    names = _methods(recording, task, methods, frames, weights)
    notes: list[str] = []
    if frames is not None:
        frames = on_one_clock(recording, frames, shift_us, notes)
    elif task in _FLOW:
        before = task == "dense_flow"
        flow = with_motion(recording, flow, notes, with_before=before, on_progress=on_progress)
    if task == "dense_flow":
        found = score_dense_flow(recording, frames, names, weights, flow, on_progress)
        return RecordingEvaluation(found, notes)
    used = any("threshold" in TASKS[task].method(name).needs for name in names)
    seen = frames if used else None
    thresholds = _thresholds(recording, seen, contrast_threshold, task, notes)
    if task == "flow":
        found = score_flow(recording, frames, names, thresholds.mean, flow, on_progress)
        notes += _failures(found)
    elif frames is None:
        raise AssertionError("images are scored against frames")
    elif task == "video":
        found = score_video(
            recording, frames, names, thresholds.mean, weights=weights, on_progress=on_progress
        )
    else:
        found = score_reconstruction(recording, frames, names, thresholds, on_progress)
    return RecordingEvaluation(found, notes)


def _failures(scores: Sequence[RecordingScore]) -> list[str]:
    """Return a note on each method most of whose flows are failures, with the usual reason."""
    notes = []
    for name in dict.fromkeys(score.method for score in scores):
        mine = [one for one in scores if one.method == name]
        failures = [one.failure for one in mine if one.failure]
        reasons = Counter(re.sub(r"\d+(\.\d+)?", "n", failure) for failure in failures)
        if len(failures) > len(mine) / 2:
            reason = reasons.most_common(1)[0][0]
            said = f"{name}: {len(failures)} of {len(mine)} answers failed, mostly with {reason!r}"
            alone = mine[0].metric == CONTRAST_GAIN
            if reason == AT_BOUND:
                shorter = " or a shorter --window-ms" if alone else ""
                said += f"; a larger --search-px{shorter} helps"
            elif reason == UNDETERMINED:
                longer = "a longer --window-ms" if alone else "frames farther apart"
                said += f"; more motion helps: {longer}"
            notes.append(said)
    return notes


def _methods(
    recording: Recording,
    task: str,
    given: Sequence[str],
    frames: Frames | None,
    weights: Mapping[str, str] | None,
) -> tuple[str, ...]:
    spec = TASKS[task]
    names = tuple(given) or spec.usual(weights or ())
    for name in names:
        check_method(task, name, weights, [recording.size])
        if spec.method(name).role == "diagnostic":
            raise TaskError(
                f"{recording.path}: method {name!r} needs the true light, which a recording does "
                "not have"
            )
    for name in given:
        if frames is None and "light" in spec.method(name).needs:
            raise TaskError(
                f"{recording.path}: method {name!r} needs the image at the start of each window, "
                "expected --frames"
            )
    if given:
        return tuple(given)
    if task == "dense_flow" and not set(spec.networks) & set(names):
        raise TaskError(
            f"{recording.path}: {spec.title} needs a network, expected --method "
            "our_flow_all_light, --weights eraft=FILE or --method package.module:function; "
            "--task flow needs none"
        )
    found = {name: spec.method(name) for name in names}
    return tuple(
        name
        for name, method in found.items()
        if method.on_recordings and (frames is not None or "light" not in method.needs)
    )


def _thresholds(
    recording: Recording,
    frames: Frames | None,
    given: float | None,
    task: str,
    notes: list[str],
) -> Thresholds:
    if given is not None:
        check_positive("threshold", given, TaskError)
        return Thresholds(given, given)
    stored = stored_thresholds(recording)
    if stored is not None:
        on, off = stored
        said = f"threshold: {on:g}" if on == off else f"thresholds: ON {on:g}, OFF {off:g}"
        notes.append(f"{said}, from the file")
        return stored
    if frames is None:
        return ANY_THRESHOLDS
    if task == "reconstruction":
        worth, unexplained = worth_of_events(recording, frames)
        notes.append(
            f"an ON event is worth {worth.on:.3f}, an OFF event {worth.off:.3f} between two "
            f"frames, fitted to them; {100 * unexplained:.0f} % of their change stays unexplained"
        )
        return worth
    try:
        found = fit_recording(recording, frames)
    except TaskError as error:
        raise TaskError(f"{error}; or give --threshold") from None
    notes.append(
        f"thresholds: ON {found.on}, OFF {found.off} at a dark level of {found.dark:g} of white, "
        f"fitted to the light at {found.events} events; {100 * found.unexplained:.0f} % of its "
        "change stays unexplained"
    )
    return found.values
