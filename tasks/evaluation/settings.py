"""Settings of the tasks: a frozen dataclass for each, and `Evaluate` for all of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, Self

from eres_render.errors import suggestion
from eres_render.storage.json_values import use_python_numbers
from eres_render.storage.settings_reader import formerly
from sensor.model import SensorModel
from tasks.errors import TaskError
from tasks.methods import check_method
from tasks.methods.e2vid import WINDOW_US
from tasks.methods.networks import check_kept, network
from tasks.registry import TASKS, load

MAY_BE_ZERO = {"may be zero": True}
"""Metadata of a field whose numbers may be 0; numbers of other fields must be positive."""

Equalization = Literal["none", "global", "local", "clahe"]

_MAX_IMAGES = 1_000_000  # that one stretch of video scores
_WINDOW_S = 1e-6 * WINDOW_US
"""Default length of the windows of E2VID, seconds of the path."""

# Core seconds, compared at 1280 px, as in `tasks.registry.Cost`.
_RECONSTRUCTION_S = 0.08  # to make and score an image of event integration
_PICTURE_SCORE_S = 0.03  # to equalize and score an image of a video
_FARTHER = 2.0  # times as long as from the nearest of the study's starts, from each of the others


def share_of_1280(width: int, height: int) -> float:
    """Return the share of 1280 x 1280 px of a sensor, or of a patch: its side follows the width."""
    return width * height / 1280**2


def unlike_two_poles(model: SensorModel) -> str | None:
    """Return in what a photoreceptor differs from the one that the oracles of video know."""
    if math.isinf(model.cutoff_hz):
        return None
    if model.photoreceptor != "two_pole":
        return f"the photoreceptor {model.photoreceptor!r}"
    return None if model.cutoff_reference is None else "a cutoff that follows the light"


class Stretches(NamedTuple):
    """Stretches of a path on which a study scores a task, by default around its samples.

    `continuous_s` is run-in and length of one stretch from the start of the path, instead. A
    stretch also covers `windows_before` windows before the scored window, which lasts `window_s` of
    the path, or as in the study if 0. `speeds` are factors on the base speed, in place of the
    study's; `scenes` are names, all by default.
    """

    continuous_s: tuple[float, ...] = ()
    speeds: tuple[float, ...] = ()
    scenes: tuple[str, ...] = ()
    windows_before: int = 0
    window_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskSettings:
    """Settings that every task has.

    Parameters
    ----------
    methods
        Names, or "package.module:function"; none to leave the task out.
    """

    methods: tuple[str, ...] = ()

    @property
    def weights(self) -> Mapping[str, str] | None:
        """Files of weights by the names of the methods that need them; see `NetworkSettings`."""
        return None

    def plan(self) -> Mapping[Stretches, Self]:
        """Return the stretches that a study scores, each with the settings for it."""
        return {Stretches(): self}

    def score_s(self, width: int, height: int) -> float:
        """Estimate how long it takes to score one sensor at base speed.

        Parameters
        ----------
        width, height
            Of the sensor, px.

        Returns
        -------
        Seconds of one core.
        """
        return 0.0

    def trial(self, methods: tuple[str, ...], window_s: float) -> Self:
        """Return settings with the least work that shows whether methods work.

        Parameters
        ----------
        methods
            Their names.
        window_s
            Length of the scored window, seconds.

        Returns
        -------
        The same settings with these methods and one sample.
        """
        return replace(self, methods=methods)


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkSettings(TaskSettings):
    """Settings of a task with methods that need weights: their files by the methods' names."""

    weights: dict[str, str] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reconstruction(TaskSettings):
    """Image reconstruction, at the end of each clip's window.

    Parameters
    ----------
    methods
        By name, or "package.module:function".
    upsampling
        How event integration upsamples to the frames' resolution: "nearest", "bilinear" or
        "bicubic".
    """

    methods: tuple[str, ...] = ("event_integration", "no_events")
    upsampling: Literal["nearest", "bilinear", "bicubic"] = "bicubic"

    def score_s(self, width: int, height: int) -> float:
        """As `TaskSettings.score_s`."""
        return _RECONSTRUCTION_S * len(self.methods)


@dataclass(frozen=True, slots=True, kw_only=True)
class Flow(TaskSettings):
    """Optical flow of patches, over each clip's window.

    Parameters
    ----------
    methods
        By name, or "package.module:function".
    features
        Patches in each clip.
    native_patch
        Also score patches of 61 px of the sensor, whatever its width.
    initial_sigma_px
        Error of the initial flow: standard deviation of each component, px of a 1280 px sensor.
        Searches end at 4 times this.
    fast_methods, fast_speed, fast_scenes
        Methods to evaluate also at one much higher speed, that speed as a factor on the base speed,
        and the scenes for it; by default all scenes.
    seed
        Seed of the initial flows.
    """

    methods: tuple[str, ...] = ("photometric_flow", "contrast_maximization", "initial_flow")
    features: int = 20
    native_patch: bool = False
    initial_sigma_px: float = 3.0
    fast_methods: tuple[str, ...] = ()
    fast_speed: float = 10.0
    fast_scenes: tuple[str, ...] = ()
    seed: int = field(default=0, metadata=MAY_BE_ZERO)

    def plan(self) -> Mapping[Stretches, Self]:
        usual = replace(self, fast_methods=())
        fast = Stretches(speeds=(self.fast_speed,), scenes=self.fast_scenes)
        return {Stretches(): usual, fast: replace(usual, methods=self.fast_methods)}

    def score_s(self, width: int, height: int) -> float:
        """As `TaskSettings.score_s`."""
        patches = self.features * (1 + self.native_patch)
        one_s = sum(TASKS["flow"].cost(method).answer_s for method in self.methods)
        return one_s * share_of_1280(width, width) * patches  # their sides follow the width

    def trial(self, methods: tuple[str, ...], window_s: float) -> Self:
        """As `TaskSettings.trial`."""
        return replace(self, methods=methods, features=1, native_patch=False, fast_methods=())


@dataclass(frozen=True, slots=True, kw_only=True)
class DenseFlow(NetworkSettings):
    """Optical flow of all pixels over each clip's window, from its events and earlier ones.

    Parameters
    ----------
    methods
        By name, or "package.module:function".
    features
        Features in each clip, at which the flow is scored.
    initial_sigma_px
        Error of the initial flow: standard deviation of each component, px of a 1280 px sensor.
    seed
        Seed of the initial flows.
    """

    methods: tuple[str, ...] = ()
    features: int = 20
    initial_sigma_px: float = field(default=3.0, metadata=MAY_BE_ZERO)
    seed: int = field(default=0, metadata=MAY_BE_ZERO)

    def plan(self) -> Mapping[Stretches, Self]:
        return {Stretches(windows_before=1): self}

    def score_s(self, width: int, height: int) -> float:
        """As `TaskSettings.score_s`."""
        one_s = sum(TASKS["dense_flow"].cost(method).answer_s for method in self.methods)
        return one_s * share_of_1280(width, height)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracking(TaskSettings):
    """Camera pose tracking over the first milliseconds of each clip's window, on planar scenes.

    Parameters
    ----------
    methods
        By name, or "package.module:function".
    sigmas_mm
        Errors of the initial path: standard deviations of each component of the control positions.
        Each is a variant of the task.
    max_events
        Largest number of events that a method gets from the path's 14 ms, if they come as often
        until the largest delay has passed; they are from random pixels.
    max_delay_us
        Largest delay of events, for methods that estimate it: the sample has events up to this long
        after the end of the path.
    seed
        Seed of the initial paths and of the choice of pixels.
    tracking_window_s
        Length of the window, seconds of the path, if the study's is too short: the path and the
        largest delay must fit at every speed. None for the study's.
    starts
        Initial paths of each sample, drawn one by one; each is an item. None for one.
    """

    methods: tuple[str, ...] = ("photometric_tracking", "initial_path")
    sigmas_mm: tuple[float, ...] = (10.0,)
    max_events: int = 100_000
    max_delay_us: int = field(default=10_000, metadata=MAY_BE_ZERO)
    seed: int = field(default=0, metadata=MAY_BE_ZERO)
    tracking_window_s: float | None = None
    starts: int | None = None

    def __post_init__(self) -> None:
        if len({f"{sigma:g}" for sigma in self.sigmas_mm}) < len(self.sigmas_mm):
            raise TaskError(f"tracking.sigmas_mm: found {self.sigmas_mm}, expected no duplicates")

    def plan(self) -> Mapping[Stretches, Self]:
        return {Stretches(window_s=self.tracking_window_s or 0.0): self}

    @property
    def delay_us(self) -> int:
        """Largest delay that some of the methods estimate, which needs events after the path."""
        estimated = any(TASKS["tracking"].method(name).delay for name in self.methods)
        return self.max_delay_us if estimated else 0

    def score_s(self, width: int, height: int) -> float:
        """As `TaskSettings.score_s`."""
        starts = (self.starts or 1) * (1 + _FARTHER * (len(self.sigmas_mm) - 1))
        costs = (TASKS["tracking"].cost(method) for method in self.methods)
        return sum((cost.path_s + cost.event_s * self.max_events) * starts for cost in costs)

    def trial(self, methods: tuple[str, ...], window_s: float) -> Self:
        """As `TaskSettings.trial`."""
        return replace(self, methods=methods, sigmas_mm=self.sigmas_mm[:1], starts=None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Video(NetworkSettings):
    """Image reconstruction by methods with a state, on one continuous stretch.

    Parameters
    ----------
    methods
        By name, or "package.module:class".
    scenes
        Names of the scenes; all by default.
    duration_s, run_in_s
        Length of the stretch from the start of the path, and of its first part, which is not
        scored, seconds.
    every_s
        Time between scored images, seconds of the path.
    equalization
        Equalization of the histograms of prediction and truth: "none", "global",
        "local" or "clahe" (local, with limited contrast).
    other_equalizations
        Further equalizations to score the same images with, each a variant of the task.
    e2vid_window_s
        Length of the windows of E2VID and FireNet, seconds of the path; None for windows near
        0.025 s that divide the time between images evenly.
    e2vid_events_per_px
        Number of events per pixel in such a window, instead of a length.
    """

    methods: tuple[str, ...] = ()
    scenes: tuple[str, ...] = ()
    duration_s: float = 2.0
    run_in_s: float = field(default=0.5, metadata=MAY_BE_ZERO)
    every_s: float = 0.05
    equalization: Equalization = field(default="local", metadata=formerly("equalisation"))
    other_equalizations: tuple[Equalization, ...] | None = None
    e2vid_window_s: float | None = None
    e2vid_events_per_px: float | None = None

    def __post_init__(self) -> None:
        if self.e2vid_window_s is not None and self.e2vid_events_per_px is not None:
            raise TaskError("give e2vid_window_s or e2vid_events_per_px, not both")
        scored_s = self.duration_s - self.run_in_s
        if self.every_s > 0 and not 0.5 < scored_s / self.every_s <= _MAX_IMAGES:
            raise TaskError(
                f"every_s: found {self.every_s:g} s, which must give 1 to {_MAX_IMAGES} images "
                f"between run_in_s = {self.run_in_s:g} and duration_s = {self.duration_s:g}"
            )

    def plan(self) -> Mapping[Stretches, Self]:
        return {Stretches((self.run_in_s, self.duration_s), scenes=self.scenes): self}

    @property
    def images(self) -> int:
        """Number of images that are scored, evenly spread and the last at the end."""
        return round((self.duration_s - self.run_in_s) / self.every_s)

    def score_s(self, width: int, height: int) -> float:
        """As `TaskSettings.score_s`."""
        methods_s = 0.0
        for method in self.methods:
            cost = TASKS["video"].cost(method)
            window_s = (has_windows_of_e2vid(method) and self.e2vid_window_s) or _WINDOW_S
            methods_s += self.images * cost.answer_s + cost.window_s * self.duration_s / window_s
        pictures = self.images * len(self.methods) * (1 + len(self.other_equalizations or ()))
        return methods_s * share_of_1280(width, height) + pictures * _PICTURE_SCORE_S

    def trial(self, methods: tuple[str, ...], window_s: float) -> Self:
        """As `TaskSettings.trial`."""
        return replace(self, methods=methods, run_in_s=0.0, duration_s=window_s, every_s=window_s)


def has_windows_of_e2vid(method: str) -> bool:
    """Return whether the settings of E2VID's windows are for a method of video: it and FireNet."""
    return TASKS["video"].method(method).place == TASKS["video"].method("e2vid").place


def settings_of(
    task: str, methods: tuple[str, ...], weights: Mapping[str, str] | None = None
) -> TaskSettings:
    """Return the usual settings of a task, with methods and their weights."""
    options = {"weights": dict(weights)} if weights else {}
    return load(TASKS[task].settings)(methods=methods, **options)


class Evaluate(Mapping[str, TaskSettings]):
    """Settings of every task in the registry, by name. A task without methods is left out.

    Parameters
    ----------
    tasks
        Settings of some tasks; the others have their defaults.

    Raises
    ------
    TaskError
        A task is not in the registry.
    """

    def __init__(self, **tasks: TaskSettings) -> None:
        for task, settings in tasks.items():
            if task not in TASKS:
                raise TaskError(f"evaluate.{task}: unknown; {suggestion(task, TASKS)}")
            use_python_numbers(settings)
        self._given = tasks

    def __getitem__(self, task: str) -> TaskSettings:
        return self._given.get(task) or load(TASKS[task].settings)()

    def __iter__(self) -> Iterator[str]:
        return iter(TASKS)

    def __len__(self) -> int:
        return len(TASKS)


def check_methods(
    evaluate: Mapping[str, TaskSettings], sizes: Iterable[tuple[int, int]] = ()
) -> None:
    """Check that all methods exist and can run, before anything is rendered.

    `sizes` has width and height of every sensor, px, once for each light and speed.
    """
    sizes = list(sizes)
    needed: dict[str, int] = {}
    for task, settings in evaluate.items():
        for planned in settings.plan().values():
            for name in planned.methods:
                check_method(task, name, planned.weights, sizes)
                if name in TASKS[task].networks:
                    loaded = network(task, name, planned.weights)
                    needed[name] = sum(loaded.kept_bytes(*size) for size in sizes)
    check_kept({name: size for name, size in needed.items() if size}, len(sizes))
