"""Settings of the tasks: one frozen dataclass for each, and `Evaluate` for all of them."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Literal, Self

from eres_render.storage.settings_reader import formerly
from tasks.methods import check_method


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskSettings:
    """Settings that every task has.

    Parameters
    ----------
    methods
        Names, or "package.module:function"; none to leave the task out.
    """

    methods: tuple[str, ...] = ()

    def score_s(self, width: int) -> float:
        """Estimate how long it takes to score one sensor at base speed, in seconds of one core."""
        return 0.0

    def trial(self, methods: tuple[str, ...], window_s: float) -> Self:
        """Return the least work that shows whether methods work.

        Parameters
        ----------
        methods
            Their names.
        window_s
            Length of the scored window.

        Returns
        -------
        The same settings with these methods and one sample.
        """
        return replace(self, methods=methods)


def _share(width: int) -> float:
    """Return a sensor's share of the pixels at 1280 px; scoring time is in proportion to it."""
    return width**2 / 1280**2


@dataclass(frozen=True, slots=True, kw_only=True)
class Reconstruction(TaskSettings):
    """Image reconstruction, at the end of each clip's window.

    Parameters
    ----------
    methods
        By name, or "package.module:function".
    upsampling
        How event integration brings events to the frames' resolution: "nearest", "bilinear" or
        "bicubic".
    """

    methods: tuple[str, ...] = ("event_integration", "no_events")
    upsampling: Literal["nearest", "bilinear", "bicubic"] = "bicubic"

    def score_s(self, width: int) -> float:
        return 0.01 * _share(width) * len(self.methods)


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
        Also try patches of 61 px of the sensor, whatever its width.
    initial_sigma_px
        Error of the initial flow: standard deviation of each component, px of a 1280 px sensor.
    fast_methods, fast_speed, fast_scenes
        Methods to evaluate also at one much higher speed, and on which scenes; all by default.
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
    seed: int = 0

    def score_s(self, width: int) -> float:
        patches = self.features * (1 + self.native_patch)
        return 0.0235 * _share(width) * len(self.methods) * patches

    def trial(self, methods: tuple[str, ...], window_s: float) -> Self:
        """As `TaskSettings.trial`."""
        return replace(self, methods=methods, features=1, native_patch=False, fast_methods=())


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracking(TaskSettings):
    """Camera pose tracking over the first milliseconds of each clip's window, on planar scenes.

    Parameters
    ----------
    methods
        By name, or "package.module:function".
    sigmas_mm
        Errors of the initial path: standard deviation of each component of the control points.
        Each is a variant of the task.
    max_events
        Largest number of events that a method gets from the path's 14 ms, of random pixels.
    max_delay_us
        Largest delay of events, for methods that estimate it: they also get events after the end of
        the path.
    seed
        Seed of the initial paths and of the choice of pixels.
    """

    methods: tuple[str, ...] = ("photometric_tracking", "initial_path")
    sigmas_mm: tuple[float, ...] = (10.0,)
    max_events: int = 100_000
    max_delay_us: int = 10_000
    seed: int = 0

    def score_s(self, width: int) -> float:
        us_per_event = 7  # of the most that a method gets, at any width
        return 1e-6 * us_per_event * self.max_events * len(self.methods) * len(self.sigmas_mm)

    def trial(self, methods: tuple[str, ...], window_s: float) -> Self:
        """As `TaskSettings.trial`."""
        return replace(self, methods=methods, sigmas_mm=self.sigmas_mm[:1])


@dataclass(frozen=True, slots=True, kw_only=True)
class Video(TaskSettings):
    """Image reconstruction with a state that lasts, on one continuous stretch.

    Parameters
    ----------
    methods
        By name, or "package.module:class".
    scenes
        Names of the scenes; all by default.
    duration_s, run_in_s
        Length of the stretch from the start of the path, and of its first part that is not scored,
        seconds.
    every_s
        Time between scored images, seconds of the path.
    equalization
        Equalization of the histograms of prediction and truth: "none", "global",
        "local" or "clahe" (local, with limited contrast).
    """

    methods: tuple[str, ...] = ()
    scenes: tuple[str, ...] = ()
    duration_s: float = 2.0
    run_in_s: float = 0.5
    every_s: float = 0.05
    equalization: Literal["none", "global", "local", "clahe"] = field(
        default="local", metadata=formerly("equalisation")
    )

    def score_s(self, width: int) -> float:
        images = round((self.duration_s - self.run_in_s) / self.every_s)
        return 0.4 * _share(width) * len(self.methods) * images

    def trial(self, methods: tuple[str, ...], window_s: float) -> Self:
        """As `TaskSettings.trial`."""
        return replace(self, methods=methods, every_s=window_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluate:
    """The tasks. One without methods is left out."""

    reconstruction: Reconstruction = field(default_factory=Reconstruction)
    flow: Flow = field(default_factory=Flow)
    tracking: Tracking = field(default_factory=Tracking)
    video: Video = field(default_factory=Video)

    @property
    def tasks(self) -> dict[str, TaskSettings]:
        """Settings of each task, by its name."""
        return {task.name: getattr(self, task.name) for task in fields(self)}


def methods_of(evaluate: Evaluate) -> dict[str, tuple[str, ...]]:
    """Return the names of the methods of each task, those for the fast samples included."""
    return {
        task: (*settings.methods, *getattr(settings, "fast_methods", ()))
        for task, settings in evaluate.tasks.items()
    }


def check_methods(evaluate: Evaluate) -> None:
    """Check before any rendering that all methods exist.

    Raises
    ------
    TaskError
        A method does not exist, or is for another task.
    """
    for task, names in methods_of(evaluate).items():
        for name in names:
            check_method(task, name)


NO_TASKS = Evaluate(
    **{task.name: replace(getattr(Evaluate(), task.name), methods=()) for task in fields(Evaluate)}
)
