"""The command that scores methods: on a simulated sensor, or on a recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from rich.table import Column
from tyro.conf import OmitArgPrefixes, Positional, arg
from tyro.extras import literal_type_from_choices

import eres_render
from tasks.cli import terminal
from tasks.cli.app import AsJson, WeightsFiles
from tasks.cli.camera_options import NO_OPTIONS, CameraOptions
from tasks.errors import TaskError
from tasks.events.reading import AS_STORED, ReadOptions
from tasks.recording.options import NO_FRAMES, USUAL_FLOW, FlowOptions, FrameOptions
from tasks.registry import TASKS
from tasks.row import Row

_SUMMARIES = " ".join(f"{name}: {spec.summary}." for name, spec in TASKS.items())


def evaluate(
    source: Annotated[
        Positional[Path],
        arg(metavar="SOURCE", help="folder of a clip or continuous sequence, or file of events"),
    ],
    task: Annotated[str, arg(constructor=literal_type_from_choices(TASKS), help=_SUMMARIES)],
    method: Annotated[tuple[str, ...], arg(help_behavior_hint="")] = (),
    speed: Annotated[float | None, arg(help_behavior_hint="(default: 1.0)")] = None,
    weights: WeightsFiles = (),
    format: str | None = None,
    camera: OmitArgPrefixes[CameraOptions] = NO_OPTIONS,
    reading: OmitArgPrefixes[ReadOptions] = AS_STORED,
    frames: OmitArgPrefixes[FrameOptions] = NO_FRAMES,
    flow: OmitArgPrefixes[FlowOptions] = USUAL_FLOW,
    as_json: AsJson = False,
) -> None:
    """Score methods on a simulated sensor or on a recording.

    The sensor sees one rendered sequence; by default it is plain and 346 px wide. The first line
    printed is what the simulation assumes.

    A recording is a file of events of any format. Its images are compared with the frames. Its
    optical flow is searched from zero, and scored by the distance from corners tracked in the
    frames or, without frames, by how much it sharpens the events. Of the camera options only
    --threshold applies to a recording; by default it is that of the file, or fitted to the frames
    if a method uses it.

    Parameters
    ----------
    method
        Names (`eres methods` lists them), or your own functions as package.module:function. By
        default all methods of the task that can run, except diagnostics and networks without
        --weights.
    speed
        Factor on the speed of the rendered sequence.
    weights
        Files of networks' weights as METHOD=FILE, or a FILE for the one method that needs weights.
    format
        Format of a file of events, as for `eres info`.
    """
    from tasks.methods.networks import named_weights
    from tasks.recording.evaluate import evaluate_recording
    from tasks.recording.recording import open_recording

    files = named_weights(weights, method or TASKS[task].networks)
    if source.is_file():
        given = {**camera.given} | ({} if speed is None else {"speed": speed})
        threshold = given.pop("threshold", None)
        if given:
            options = ", ".join(f"--{name.replace('_', '-')} {given[name]}" for name in given)
            raise TaskError(f"{source}: is a recording; {options} needs a rendered sequence")
        shift_us, opened = frames.shift_us, frames.open_frames()
        recording = open_recording(source, format=format, reading=reading)
        with terminal.progress() as on_progress:
            evaluation = evaluate_recording(
                recording,
                task,
                frames=opened,
                methods=method,
                shift_us=shift_us,
                contrast_threshold=threshold,
                flow=flow,
                weights=files,
                on_progress=on_progress,
            )
        if as_json:
            terminal.show_json({"notes": evaluation.notes, "rows": evaluation.rows})
            return
        _print_scores(evaluation.rows, "method", "metric")
        rate = f"{recording.event_rate_hz / 1e6:.3g} M events/s in the recording"
        terminal.say(*evaluation.notes, rate)
        return
    if not source.exists():
        raise TaskError(f"{source}: no such file of events or folder of a sequence")
    if (format, reading, frames, flow) != (None, AS_STORED, NO_FRAMES, USUAL_FLOW):
        raise TaskError(f"{source}: is a folder; --format, frame and flow options need a recording")
    from tasks.evaluation.sequence import evaluate_sequence

    sequence = eres_render.open_sequence(source)
    chosen = camera.camera(sequence.width, sequence.height, usual_width=346)
    assumes = chosen.assumptions(**camera.light)
    if not as_json:
        terminal.say(assumes)
    with terminal.progress() as on_progress:
        rows = evaluate_sequence(
            sequence,
            task,
            methods=method,
            camera=chosen,
            **camera.light,
            speed=1.0 if speed is None else speed,
            weights=files,
            on_progress=on_progress,
        )
    if as_json:
        terminal.show_json({"assumes": assumes, "rows": rows})
        return
    _print_scores(rows, "method", "variant", "metric")
    lost = f", of which the bus lost {100 * rows[0].dropped:.3g} %" if chosen.bus else ""
    terminal.say(f"{rows[0].event_rate_hz / 1e6:.3g} M events/s in the window{lost}")


def _print_scores(rows: Sequence[Row], *fields: str) -> None:
    """Print the median of each group of rows with equal fields."""
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(getattr(row, field) for field in fields), []).append(row)
    heads = [Column(field, no_wrap=True) for field in fields[:-1]]
    table = terminal.Table(*heads, "median", "metric", "scores", "failed", pad_edge=False)
    for (*names, metric), scored in groups.items():
        median = float(np.median([row.value for row in scored]))
        failed = sum(bool(row.failure) for row in scored)
        table.add_row(*names, f"{median:.3f}", metric, str(len(scored)), str(failed))
    terminal.show(table)
