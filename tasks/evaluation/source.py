"""What scorers know of the scene behind the events: `Source`, whatever the events come from."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from eres_render import Camera, Plane, Trajectory
from sensor import Events
from tasks.errors import TaskError
from tasks.evaluation.scorers.base import Score, Scorer
from tasks.evaluation.settings import DenseFlow, Flow, TaskSettings, Tracking, Video
from tasks.flow import Features, initial_sigma_px, patch_px, rnepe_px
from tasks.methods.true_video import TrueLight
from tasks.registry import NATIVE_PATCH, TASKS, load
from tasks.row import Row

Float64 = NDArray[np.float64]

ALL = frozenset({"frames", "poses", "a plane", "a threshold", "a change"})
"""What tasks need, see `TaskSpec.needs`."""


@dataclass(frozen=True, slots=True)
class Window:
    """A scored window, [start_us, end_us), in the time of the events."""

    start_us: int
    end_us: int

    @property
    def seconds(self) -> float:
        """Length of the window."""
        return (self.end_us - self.start_us) * 1e-6

    @property
    def before_us(self) -> int:
        """Start of the window before, of the same length."""
        return 2 * self.start_us - self.end_us


@dataclass(frozen=True, slots=True, kw_only=True)
class FlowPoints:
    """Points at which flow is scored, where searches start, and what answers are compared with.

    Searches at the (N, 2) centers start from the (N, 2) `initial_px`, with a standard deviation of
    `sigma_px` per component. `metric` names the score, and `value` scores a flow at the point of an
    index. `sides` has variants of the task by the side of their patches, px; `items` has the number
    of each point in rows.
    """

    metric: str
    centers_px: Float64
    initial_px: Float64
    sigma_px: float
    sides: Mapping[int, Sequence[str]]
    value: Callable[[int, Float64], float]
    items: Sequence[int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Images:
    """Images of a video: numbers by their times in us, the time between them, and the truth.

    `step_us` is in the time of the scene, None for a single image. `truth` gets the number of an
    image and the equalization.
    """

    numbers: Mapping[int, int]
    step_us: float | None
    truth: Callable[[int, str], Float64]


class Polarities:
    """Sums of a window's polarities, in which OFF events have a weight."""

    def __init__(self, size: tuple[int, int], window: Window, off_weight: float) -> None:
        self._window, self._off_weight = window, off_weight
        # Of all events and, unless they count like ON events, of OFF events.
        self._sums = np.zeros((1 if off_weight == 1 else 2, *size[::-1]), np.int64)

    def push(self, events: Events) -> None:
        window = events.between(self._window.start_us, self._window.end_us)
        if len(window):
            self._sums[0] += window.polarity_sum()
            for of_off in self._sums[1:]:
                of_off += window.where(window.p < 0).polarity_sum()

    def total(self) -> Float64:
        return np.asarray(self._sums[0] + (self._off_weight - 1) * self._sums[1:].sum(axis=0))


class Source:
    """Events in a window, and what is known of the scene behind them.

    A scorer asks only for what its task lists in `TaskSpec.needs`; a source implements what it has.

    Attributes
    ----------
    name
        Name of its file or folder, for errors.
    window
        The scored window.
    size
        Width and height of the sensor, px.
    contrast_threshold
        C, log units.
    off_weight
        What an OFF event is worth, in units of C.
    speed
        Factor by which the scene moves faster than it was rendered.
    search_from
        Where searches start.
    parts
        Reads the events, if they are stored.
    log_image
        (h, w) log light at the window's start on the sensor's grid, NaN if unknown.
    log_start, log_end, log_white
        (H, W) log light at the window's start and end, as images are compared; log light of white.
    points
        Points at which flow is scored.
    images
        Images of a video.
    path
        The true path from the window's start on.
    pose
        (N, 4, 4) poses at (N,) seconds after the window's start.
    camera, plane
        The camera, of the sensor's size, and the plane that it sees.
    seeds
        Seeds of the initial path's errors, and of the choice of pixels.
    columns
        What the row of a score says of the source: scene, cutoff_hz, speed, sample, ..
    """

    name: str
    window: Window
    size: tuple[int, int]
    contrast_threshold: float
    off_weight: float = 1.0
    speed: float = 1.0
    search_from: Literal["truth", "zero"] = "truth"
    parts: Callable[[], Iterator[Events]]
    log_image: Callable[[], Float64]
    log_start: Callable[[], Float64]
    log_end: Callable[[], Float64]
    log_white: Callable[[], float]
    points: Callable[[Flow | DenseFlow], FlowPoints]
    images: Callable[[Video], Images]
    path: Callable[[Tracking], Trajectory]
    pose: Callable[[Float64], Float64]
    camera: Callable[[], Camera]
    plane: Callable[[], Plane | None]
    seeds: Callable[[Tracking], tuple[int | list[int], int]]
    columns: Callable[[Score], dict[str, Any]]

    def before_us(self) -> int:
        """Return the start of the window before, whose events the source has, too."""
        return self.window.before_us

    def changes(self) -> Polarities:
        """Return an empty sum of the window's events as changes of log intensity, in units of C."""
        return Polarities(self.size, self.window, self.off_weight)

    def true_light(self, method: str) -> TrueLight:
        """Return the light behind the events, for diagnostics of video."""
        raise TaskError(f"{self.name}: method {method!r} needs a rendered sequence")


def true_points(features: Features, task: Flow | DenseFlow, items: Sequence[int]) -> FlowPoints:
    """Return points whose true flow is known; searches start near it."""
    width = features.width
    sides = {patch_px(width): [""]}
    if isinstance(task, Flow) and task.native_patch:  # at 1280 px both are the same
        sides.setdefault(patch_px(width, native=True), []).append(NATIVE_PATCH)
    return FlowPoints(
        metric="rnepe_px",
        centers_px=features.centers_px,
        initial_px=features.initial_flow_px(task.initial_sigma_px),
        sigma_px=initial_sigma_px(width, task.initial_sigma_px),
        sides=sides,
        value=lambda k, flow_px: rnepe_px(flow_px, features.flow_px[k], width),
        items=items,
    )


def check_needs(task: str, where: object, kind: str, has: frozenset[str]) -> None:
    """Raise if a kind of source, such as "a recording", lacks what a task needs."""
    spec = TASKS[task]
    if lacking := [name for name in spec.needs if name not in has]:
        raise TaskError(
            f"{where}: {spec.title} needs {' and '.join(lacking)}, which {kind} does not have"
        )


def row_of(
    task: str, source: Source, score: Score, event_rate_hz: float, dropped: float = 0.0
) -> Row:
    """Return a score as a row."""
    names = "method", "value", "variant", "item", "failure"
    values = {name: getattr(score, name) for name in names} | source.columns(score)
    values.setdefault("event_rate_hz", event_rate_hz)
    return Row(
        task=task,
        width=source.size[0],
        contrast_threshold=source.contrast_threshold,
        metric=score.metric or TASKS[task].metric.name,
        dropped=dropped,
        **values,
    )


def score_stored(task: str, source: Source, settings: TaskSettings) -> list[Row]:
    """Score the methods of a task on stored events."""
    scorer: Scorer = load(TASKS[task].scorer)(source, settings)
    window = source.window
    count = 0
    for events in source.parts():
        scorer.push(events)
        count += len(events.between(window.start_us, window.end_us))
    return [row_of(task, source, score, count / window.seconds) for score in scorer.scores()]
