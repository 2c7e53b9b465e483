"""`RadianceSequence`: linear radiance frames of a moving camera, on disk.

A folder holds

- `manifest.json`: times and settings; it is marked complete once all frames are written,
- `frames/000000.exr`, ...: half-float OpenEXR, channel Y, with their `SHA256SUMS`,
- `poses.txt`: the pose of every frame (TUM),
- `path.txt`: the control poses of the camera's path (TUM), each at the time of its knot.

Times count from the path's start. In the two files of poses they are on the clock of the poses that
define the path, `t_offset_us` later, with all digits.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eres_render.camera import Camera
from eres_render.cores import cores
from eres_render.errors import RenderError, SequenceError, TrajectoryError
from eres_render.sequence.manifest import Manifest, read_manifest, write_manifest
from eres_render.storage.atomic import write_text
from eres_render.storage.checksums import FILE_NAME, append_sum, read_sums, sha256, write_sums
from eres_render.storage.exr import read_luminance, write_luminance
from eres_render.trajectory.spline import Trajectory
from eres_render.trajectory.tum import read_tum, tum_text

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class RadianceSequence:
    """A complete sequence on disk; frames are read on demand.

    Iterating yields the frames in order, (H, W) float32 each; all cores decode the next ones.
    """

    folder: Path
    manifest: Manifest
    T_world_cam: Float64  # (T, 4, 4)
    trajectory: Trajectory  # of the whole path, on the time of the frames
    checksums: Mapping[str, str]  # SHA-256 of every frame, by path in the folder

    def __len__(self) -> int:
        return len(self.manifest.t_s)

    def __iter__(self) -> Iterator[NDArray[np.float32]]:
        at_once = cores()
        with ThreadPoolExecutor(at_once, thread_name_prefix="exr") as readers:
            ahead = deque(readers.submit(self.frame, i) for i in range(min(at_once, len(self))))
            for i in range(len(self)):
                frame = ahead.popleft().result()
                if i + at_once < len(self):
                    ahead.append(readers.submit(self.frame, i + at_once))
                yield frame

    @property
    def t_s(self) -> Float64:
        """(T,) frame times, strictly increasing."""
        return np.array(self.manifest.t_s)

    @property
    def t_offset_us(self) -> int:
        """Time 0 on the clock of the poses that define the path, microseconds; mostly 0."""
        return self.manifest.t_offset_us

    @property
    def window_s(self) -> tuple[float, float]:
        """Start and end of the window that is evaluated; frames before it are warm-up."""
        return self.manifest.window_s

    @property
    def is_continuous(self) -> bool:
        """Whether the window is the whole sequence, without a warm-up."""
        return self.window_s == (self.manifest.t_s[0], self.manifest.t_s[-1])

    @property
    def white_level(self) -> float:
        """Radiance of white, the same for all clips of a scene; see `Renderer.white_level`."""
        return self.manifest.white_level

    @property
    def width(self) -> int:
        """Width of the frames, px."""
        return self.manifest.width

    @property
    def height(self) -> int:
        """Height of the frames, px."""
        return self.manifest.height

    @property
    def camera(self) -> Camera:
        """The camera that took the frames."""
        return self.manifest.camera

    def frame(self, i: int) -> NDArray[np.float32]:
        """Read frame i: (H, W) float32 linear radiance, finite and not negative.

        Raises
        ------
        SequenceError
            If the frame's file is missing, truncated or of another size, holds NaN, infinite or
            negative values, or has changed since it was rendered.
        """
        if not 0 <= i < len(self):
            raise IndexError(f"frame {i} of a sequence of {len(self)}")
        return _read_frame(self.folder, self.manifest, i, self.checksums)


def open_sequence(path: str | Path) -> RadianceSequence:
    """Open a sequence folder.

    Raises
    ------
    SequenceError
        If the manifest, the poses or a frame is missing, or they contradict each other. Frames are
        checked when they are read.
    """
    folder = Path(path)
    if folder.is_file():
        raise SequenceError(
            f"{folder}: found a file, expected the folder of a rendered sequence, such as "
            "clip_000 of `eres render`"
        )
    if not (folder / "manifest.json").exists():
        inside = sorted(file.parent for file in folder.glob("*/manifest.json"))
        if inside:
            raise SequenceError(
                f"{folder}: found a folder of sequences, expected one of them: give {inside[0]}"
                f"{f' or another of {len(inside)}' if len(inside) > 1 else ''}"
            )
    manifest = read_manifest(folder)
    frames = [_frame_file(folder, i) for i in range(len(manifest.t_s))]
    missing = [file for file in frames if not file.is_file()]
    if missing:
        raise SequenceError(
            f"{missing[0]}: missing, with {len(missing)} of {len(frames)} frames; render again to "
            "make them"
        )
    if not manifest.complete:
        raise SequenceError(f"{folder}: the render is unfinished; render again to finish it")
    checksums = read_sums(folder)
    without = [i for i in range(len(frames)) if _frame_name(i) not in checksums]
    if without:
        raise SequenceError(f"{folder / FILE_NAME}: found no line for {_frame_name(without[0])}")
    poses_file, path_file = folder / "poses.txt", folder / "path.txt"
    try:
        t_s, T_world_cam = read_tum(poses_file, manifest.t_offset_us)
        controls = read_tum(path_file, manifest.t_offset_us)
        trajectory = Trajectory(*controls, manifest.t_offset_us)
    except TrajectoryError as error:
        raise SequenceError(str(error)) from error
    if not np.array_equal(t_s, manifest.t_s):
        raise SequenceError(
            f"{poses_file}: found {len(t_s)} poses whose times are not those of the "
            f"{len(manifest.t_s)} frames in manifest.json"
        )
    if t_s[-1] > trajectory.duration_s or not np.allclose(
        trajectory.pose(t_s), T_world_cam, rtol=0, atol=1e-9
    ):
        raise SequenceError(f"{path_file}: found a path that does not pass through {poses_file}")
    return RadianceSequence(folder, manifest, T_world_cam, trajectory, checksums)


class SequenceWriter:
    """Writes a sequence frame by frame, or continues an unfinished one.

    Parameters
    ----------
    folder
        Of the sequence; made if it does not exist.
    manifest
        Of the sequence; the writer sets its `complete`.
    trajectory
        The camera's path, on the time of the frames.

    Raises
    ------
    RenderError
        If the folder cannot be written, or holds a sequence with other settings, which is never
        deleted.
    """

    def __init__(self, folder: Path, manifest: Manifest, trajectory: Trajectory) -> None:
        self.folder = folder
        self.manifest = dataclasses.replace(manifest, complete=False)
        if (folder / "manifest.json").exists():
            self._check_same(read_manifest(folder))
        try:
            (folder / "frames").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RenderError(f"{folder}: cannot be written: {error.strerror}") from error
        offset_us, t_s = manifest.t_offset_us, np.array(manifest.t_s)
        path = tum_text(trajectory.knots_s, trajectory.controls, offset_us)
        write_text(folder / "poses.txt", tum_text(t_s, trajectory.pose(t_s), offset_us))
        write_text(folder / "path.txt", path)
        self._checksums = read_sums(folder)
        write_sums(folder, self._checksums)  # without lines that a kill left unfinished
        write_manifest(folder, self.manifest)

    def _check_same(self, found: Manifest) -> None:
        """Refuse a manifest of other frames; the place of the scene does not matter."""
        for field in dataclasses.fields(Manifest):
            old, new = getattr(found, field.name), getattr(self.manifest, field.name)
            if field.name in ("complete", "scene_source") or old == new:
                continue
            change = (
                "other frame times" if field.name == "t_s" else f"{field.name} {old!r}, not {new!r}"
            )
            raise RenderError(
                f"{self.folder}: found a sequence with {change}; remove it, or render elsewhere"
            )

    def missing(self) -> list[int]:
        """Return the numbers of the frames that are missing or cannot be read."""
        with ThreadPoolExecutor(cores(), thread_name_prefix="exr") as readers:
            holds = list(readers.map(self._holds, range(len(self.manifest.t_s))))
        return [i for i, held in enumerate(holds) if not held]

    def _holds(self, i: int) -> bool:
        try:
            _read_frame(self.folder, self.manifest, i, self._checksums)
        except SequenceError:
            return False
        return True

    def write(self, i: int, radiance: NDArray[np.floating]) -> None:
        """Write a frame, whole or not at all.

        Parameters
        ----------
        i
            Number of the frame.
        radiance
            (H, W) linear radiance.
        """
        file, name = _frame_file(self.folder, i), _frame_name(i)
        write_luminance(file, radiance)
        self._checksums[name] = sha256(file)
        append_sum(self.folder, name, self._checksums[name])

    def finish(self) -> RadianceSequence:
        """Mark the sequence as complete, and return it."""
        for leftover in (self.folder / "frames").glob(".*.unfinished"):  # of a killed render
            leftover.unlink(missing_ok=True)
        write_sums(self.folder, self._checksums)
        write_manifest(self.folder, dataclasses.replace(self.manifest, complete=True))
        return open_sequence(self.folder)


def _frame_name(i: int) -> str:
    return f"frames/{i:06d}.exr"


def _frame_file(folder: Path, i: int) -> Path:
    return folder / _frame_name(i)


def _read_frame(
    folder: Path, manifest: Manifest, i: int, checksums: Mapping[str, str]
) -> NDArray[np.float32]:
    path = _frame_file(folder, i)
    try:
        intact = sha256(path) == checksums.get(_frame_name(i))
    except OSError:
        intact = False  # reading it says why
    try:
        radiance = read_luminance(path, intact=intact)
    except RenderError as error:
        raise SequenceError(str(error)) from error
    if radiance.shape != (manifest.height, manifest.width):
        raise SequenceError(
            f"{path}: found {radiance.shape[1]}x{radiance.shape[0]} pixels, expected "
            f"{manifest.width}x{manifest.height}"
        )
    # Fast path: one pass each for the smallest and the largest value; NaN shows in both.
    if not (radiance.min() >= 0 and radiance.max() < np.inf):
        good = np.isfinite(radiance) & (radiance >= 0)
        y, x = np.argwhere(~good)[0]
        raise SequenceError(
            f"{path}: found {radiance[y, x]} at pixel ({x}, {y}), and {np.sum(~good)} bad values "
            "in all, expected finite radiance >= 0"
        )
    if not intact:
        raise SequenceError(
            f"{path}: found other bytes than were rendered, by its SHA-256 in {FILE_NAME}; remove "
            "it and render again"
        )
    return radiance
