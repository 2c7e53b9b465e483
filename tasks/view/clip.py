"""Rendered clips and footage as pictures: frames, true depth and true optical flow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.Image import Resampling
from scipy.ndimage import maximum_filter

from eres_render import GroundTruth, RadianceSequence, ground_truth
from sensor.optics import crop_to_aspect
from tasks.footage import Footage
from tasks.view.drawing import Picture, depth_colors, flow_colors, resized, tone_mapped
from tasks.view.layout import Panel

_SAMPLES = 5  # times at which the scale of depth or flow is measured
_FLOW_STEP_S = 1e-3
_TRUTH_WIDTH = 640  # px; a ray is cast for every pixel


class TimedFrames:
    """Frames of a rendered clip or of footage, by time on the clock of events.

    For the events, the scene moved `speed` times as fast. `shift_us` is how far they were shifted
    since.
    """

    def __init__(self, frames: RadianceSequence | Footage, speed: float, shift_us: int = 0) -> None:
        self.path = frames.path if isinstance(frames, Footage) else frames.folder
        self._frames = frames
        self._stream: Iterator[NDArray[np.float32]] = iter(())  # of footage
        self._next = len(frames)
        self._speed = speed
        self._times_s = frames.t_s
        self._offset_us = frames.t_offset_us + shift_us
        # Of events that see a frame.
        self._times_us = np.ceil(frames.t_s / speed * 1e6).astype(int) + self._offset_us
        self._read = lru_cache(maxsize=1)(self._shown)

    def _shown(self, i: int) -> Picture:
        """Return frame i; footage is read in order, and an earlier frame starts again."""
        if isinstance(self._frames, RadianceSequence):
            return tone_mapped(self._frames.frame(i), self._frames.white_level)
        if i < self._next:
            self._stream, self._next = iter(self._frames), 0
        skipped, self._next = i - self._next, i + 1
        return tone_mapped(next(islice(self._stream, skipped, None)), self._frames.white_level)

    def path_s(self, t_us: int) -> float:
        """Return the time on the clip's path, s, from its first frame to its last."""
        t_s = (t_us - self._offset_us) * 1e-6 * self._speed
        return float(np.clip(t_s, *self._times_s[[0, -1]]))

    def span_us(self) -> tuple[int, int]:
        """Return the times of the first and the last frame on the clock of the events, us."""
        first_us, last_us = np.round(self._times_s[[0, -1]] / self._speed * 1e6).astype(int)
        return self._offset_us + int(first_us), self._offset_us + int(last_us)

    def times_us(self, start_us: int, end_us: int) -> list[int]:
        """Return the ascending times from which frames are shown, from the frame at the start."""
        first = self._index_at(start_us)
        last = max(first + 1, int(np.searchsorted(self._times_us, end_us)))
        return self._times_us[first:last].tolist()

    def at(self, t_us: int) -> Picture:
        """Return the last frame up to a time, or the first one, as gray levels."""
        return self._read(self._index_at(t_us))

    def _index_at(self, t_us: int) -> int:
        return max(0, int(np.searchsorted(self._times_us, t_us, side="right")) - 1)

    def seen_by(self, width: int, height: int, t_us: int) -> Picture:
        """Return what a sensor of a given size, px, sees at a time: (height, width, 3)."""
        frame = self.at(t_us)
        rows, columns = crop_to_aspect(frame.shape[0], frame.shape[1], height, width)
        how = Resampling.BOX if width < frame.shape[1] else Resampling.BILINEAR
        return np.asarray(Image.fromarray(frame[rows, columns]).resize((width, height), how))


class ClipFrames(TimedFrames):
    """The frames of a rendered clip."""

    def __init__(self, sequence: RadianceSequence, speed: float = 1.0, shift_us: int = 0) -> None:
        super().__init__(sequence, speed, shift_us)
        self.sequence = sequence


@dataclass(frozen=True, slots=True)
class FrameSource:
    """The frames of a clip."""

    frames: ClipFrames

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the frames, px."""
        return self.frames.sequence.width, self.frames.sequence.height

    def panels(self, times_us: Sequence[int]) -> Iterator[Panel]:
        """Yield a panel for each of the ascending times, us on the clock of the events."""
        title = f"{self.frames.sequence.manifest.scene}, frames"
        for t_us in times_us:
            detail = f"{self.frames.path_s(t_us):.3f} s of the path"
            yield Panel(self.frames.at(t_us), title, detail)


@dataclass(frozen=True, slots=True)
class _TruthSource:
    frames: ClipFrames
    truth: GroundTruth

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures, px."""
        sequence = self.frames.sequence
        width = min(sequence.width, _TRUTH_WIDTH)
        return width, round(width * sequence.height / sequence.width)


class DepthSource(_TruthSource):
    """The true depth of a clip."""

    def depth(self, t_us: int) -> NDArray[np.float32]:
        """Return the (H, W) z-depth at a time, m; inf where nothing is seen."""
        return self.truth.depth(self.frames.path_s(t_us), *self.size)

    def panels(self, times_us: Sequence[int]) -> Iterator[Panel]:
        """Yield a panel for each of the ascending times, us on the clock of the events."""
        some = np.concatenate([self.depth(t_us) for t_us in _some(times_us)])
        finite = some[np.isfinite(some)]
        near_m, far_m = np.percentile(finite, (0.5, 99.5)) if finite.size else (1.0, 1.0)
        width, height = self.size
        scale = 1 / np.linspace(1 / far_m, 1 / near_m, 256, dtype=np.float32)
        colors = depth_colors(scale[None], near_m, far_m)
        legend = resized(colors, max(1, width // 3), max(3, height // 40))
        for t_us in times_us:
            picture = depth_colors(self.depth(t_us), near_m, far_m)
            _inlay(picture, legend)
            yield Panel(picture, "true depth", f"{far_m:.3g} m (dark) to {near_m:.3g} m (bright)")


class FlowSource(_TruthSource):
    """The true optical flow of a clip."""

    def flow(self, t_us: int) -> NDArray[np.float32]:
        """Return the (H, W, 2) motion at a time, px of the frames per second of the path."""
        sequence, t_s = self.frames.sequence, self.frames.path_s(t_us)
        # Ahead if possible; objects may have no path beyond the first and the last frame.
        first_s, last_s = sequence.t_s[[0, -1]].tolist()
        ahead_s, back_s = (min(_FLOW_STEP_S, room) for room in (last_s - t_s, t_s - first_s))
        step_s = ahead_s if ahead_s >= back_s else -back_s
        flow = self.truth.flow(t_s, t_s + step_s, *self.size).flow_px
        return (flow * (sequence.width / self.size[0] / step_s)).astype(np.float32)

    def panels(self, times_us: Sequence[int]) -> Iterator[Panel]:
        """Yield a panel for each of the ascending times, us on the clock of the events."""
        some = np.concatenate([self.flow(t_us) for t_us in _some(times_us)])
        longest = float(np.percentile(np.hypot(some[..., 0], some[..., 1]), 99)) or 1.0
        side = max(1, min(self.size) // 5)
        y, x = np.mgrid[-1 : 1 : side * 1j, -1 : 1 : side * 1j]
        wheel = flow_colors(np.dstack([x, y]), 1)
        for t_us in times_us:
            picture = flow_colors(self.flow(t_us), longest)
            _inlay(picture, wheel, x**2 + y**2 <= 1)
            yield Panel(picture, "true optical flow", f"rim of the wheel: {longest:.3g} px/s")


ClipSource = FrameSource | DepthSource | FlowSource
Show = Literal["frames", "depth", "flow"]


def clip_source(frames: ClipFrames, show: Show) -> ClipSource:
    """Return what to draw of a clip."""
    if show == "frames":
        return FrameSource(frames)
    truth = ground_truth(frames.sequence)
    return DepthSource(frames, truth) if show == "depth" else FlowSource(frames, truth)


def _some(times_us: Sequence[int]) -> list[int]:
    """Return a few evenly spaced times."""
    at = np.linspace(0, len(times_us) - 1, min(_SAMPLES, len(times_us)))
    return [times_us[i] for i in np.round(at).astype(int)]


def _inlay(picture: Picture, legend: Picture, shape: NDArray[np.bool_] | None = None) -> None:
    """Put a legend with a black edge into the lower left corner, if there is room."""
    height, width = legend.shape[:2]
    edge = max(2, picture.shape[0] // 200)
    if height + 4 * edge > picture.shape[0] or width + 4 * edge > picture.shape[1]:
        return
    inside = np.full((height, width), True) if shape is None else shape
    corner = picture[-height - 4 * edge : -2 * edge, 2 * edge : width + 4 * edge]
    corner[maximum_filter(np.pad(inside, edge), 2 * edge + 1)] = 0
    corner[edge:-edge, edge:-edge][inside] = legend[inside]
