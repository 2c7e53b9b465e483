"""The stretches of a camera path to render."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from eres_render.errors import RenderError
from eres_render.storage.json_values import use_python_numbers

if TYPE_CHECKING:
    from eres_render.scene.scene import Scene

WARM_UP_S = 6 * 2 / (2 * math.pi * 50)
"""How long a sensor sees a path before a window at least, s of the path: six time constants of a
50 Hz filter at twice the speed."""

_TIME_RESOLUTION_S = 1e-9
_MAX_CLIPS = 1_000_000
_MAX_S = 1e5  # finding the frame times of more takes hours


@dataclass(frozen=True, slots=True)
class Clip:
    """A stretch of a path: a warm-up of the sensor, then the window that is evaluated.

    Parameters
    ----------
    index
        Number of the sample along the path.
    t_start_s, t_window_start_s, t_window_end_s
        Times on the path, s, in this order; the window must not be empty.
    t_anchor_s
        A frame time between the start and the window. Frames step from it both ways, so the frames
        after it do not depend on the start. The first frame is then at the start or just before it.
        None is the start itself.

    Raises
    ------
    RenderError
        If times are negative or not in order, the window is empty, or the anchor is not after the
        start and up to the window.

    Examples
    --------
    >>> from eres_render import Clip
    >>> clip = Clip(0, t_start_s=0.0, t_window_start_s=0.25, t_window_end_s=0.3)
    >>> clip.marks_s
    (0.0, 0.25, 0.3)
    """

    index: int
    t_start_s: float
    t_window_start_s: float
    t_window_end_s: float
    t_anchor_s: float | None = None

    def __post_init__(self) -> None:
        use_python_numbers(self)
        if not 0 <= self.t_start_s <= self.t_window_start_s < self.t_window_end_s:
            raise RenderError(
                f"Clip {self.index}: found start {self.t_start_s}, window {self.t_window_start_s} "
                f"to {self.t_window_end_s} s, expected 0 <= start <= window start < window end"
            )
        anchor_s = self.t_anchor_s
        if anchor_s is not None and not self.t_start_s < anchor_s <= self.t_window_start_s:
            raise RenderError(
                f"Clip {self.index}: the anchor at {anchor_s} s is not between the start at "
                f"{self.t_start_s} s and the window at {self.t_window_start_s} s"
            )

    @property
    def anchor_s(self) -> float:
        """Where frame times are counted from, s: the anchor, or the start."""
        return self.t_start_s if self.t_anchor_s is None else self.t_anchor_s

    @property
    def marks_s(self) -> tuple[float, ...]:
        """The times from the anchor on that must be frame times exactly."""
        return tuple(sorted({self.anchor_s, self.t_window_start_s, self.t_window_end_s}))


def clips(
    scene: Scene,
    duration_s: float | None = None,
    *,
    every_s: float = 0.5,
    window_s: float = 0.05,
    warm_up_s: float = WARM_UP_S,
    anchor_s: float = WARM_UP_S,
    samples: int | None = None,
) -> list[Clip]:
    """Return one clip per sample. The window of sample k starts at (k + 1/2) * every_s.

    Parameters
    ----------
    scene
        The scene of the path.
    duration_s
        How much of the path to use, the whole by default.
    every_s
        Time from one window to the next, s.
    window_s
        Length of a window, s.
    warm_up_s
        Length of a warm-up, s; by default six time constants of a 50 Hz filter at twice the speed,
        `6 * 2 / (2 pi 50 Hz)`.
    anchor_s
        Time from the anchor of a longer warm-up to the window, s; see `Clip`. From the anchor on,
        frames are as with a warm-up of this length.
    samples
        Number of clips, from the start of the path; by default as many as fit.

    Returns
    -------
    clips
        In the order of time.

    Raises
    ------
    RenderError
        If `duration_s` is longer than the path, or a clip would not fit.

    Examples
    --------
    >>> from eres_render import clips, load_scene
    >>> every = clips(load_scene("carpet"))
    >>> len(every)
    20
    >>> every[1].t_window_start_s, every[1].t_window_end_s
    (0.75, 0.8)
    """
    duration_s = _checked_duration_s(scene, duration_s)
    if not every_s > 0 or not 0 < window_s <= 0.5 * every_s or not 0 <= warm_up_s <= 0.5 * every_s:
        raise RenderError(
            f"window_s, warm_up_s: found {window_s} and {warm_up_s} s, expected each to fit into "
            f"half of every_s = {every_s} s"
        )
    fitting = math.floor((duration_s - window_s) / every_s + 0.5 + 1e-9)
    if fitting > _MAX_CLIPS:
        raise RenderError(
            f"the path of {duration_s:g} s holds {fitting} clips, expected at most "
            f"{_MAX_CLIPS}; are the times of the poses in seconds?"
        )
    if fitting < 1:
        needed_s = 0.5 * every_s + window_s
        longer = f"--duration {needed_s:g} or more, or " if needed_s <= scene.duration_s else ""
        raise RenderError(
            f"no clip fits into {duration_s:g} s of path, expected at least {needed_s:g} s; give "
            f"{longer}--continuous for one sequence of the whole path"
        )
    count = fitting if samples is None else samples
    if not 1 <= count <= fitting:
        raise RenderError(f"samples: found {samples}, expected 1 to {fitting}")
    starts_s = [(k + 0.5) * every_s for k in range(count)]
    end_s = scene.duration_s  # which the last clip may pass by a rounding error
    is_anchored = warm_up_s > anchor_s + _TIME_RESOLUTION_S
    return [
        Clip(
            k,
            t_start_s=t - (warm_up_s if is_anchored else min(warm_up_s, anchor_s)),
            t_window_start_s=t,
            t_window_end_s=min(t + window_s, end_s),
            t_anchor_s=t - anchor_s if is_anchored else None,
        )
        for k, t in enumerate(starts_s)
    ]


def continuous_stretch(scene: Scene, duration_s: float | None = None) -> Clip:
    """Return the stretch from the path's start as one clip.

    Parameters
    ----------
    scene
        The scene of the path.
    duration_s
        How much of the path, the whole by default.

    Returns
    -------
    clip
        Without a warm-up.

    Raises
    ------
    RenderError
        If `duration_s` is longer than the path, or the stretch than a day.

    Examples
    --------
    >>> from eres_render import continuous_stretch, load_scene
    >>> continuous_stretch(load_scene("carpet"), duration_s=2.0).marks_s
    (0.0, 2.0)
    """
    duration_s = _checked_duration_s(scene, duration_s)
    if duration_s > _MAX_S:
        raise RenderError(
            f"the path of {duration_s:g} s is too long for one sequence, at most {_MAX_S:g} s; "
            "are the times of the poses in seconds?"
        )
    return Clip(0, 0.0, 0.0, duration_s)


def _checked_duration_s(scene: Scene, duration_s: float | None) -> float:
    path_s = scene.duration_s
    if duration_s is None:
        return path_s
    if not 0 < duration_s <= path_s:
        raise RenderError(f"duration_s: found {duration_s}, not within the {path_s} s of the path")
    return duration_s
