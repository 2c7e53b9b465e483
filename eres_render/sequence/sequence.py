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
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from eres_render.camera import Camera
from eres_render.cores import cores
from eres_render.errors import RenderError, SequenceError, reading
from eres_render.sequence.manifest import Manifest, read_manifest, write_manifest
from eres_render.storage.atomic import make_folder, remove_unfinished, write_text
from eres_render.storage.checksums import FILE_NAME, append_sum, read_sums, sha256, write_sums
from eres_render.storage.exr import Compression, read_luminance, write_channels
from eres_render.trajectory.spline import Trajectory
from eres_render.trajectory.tum import read_tum, tum_text

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
T = TypeVar("T")

_IMAGES = ".png", ".jpg", ".jpeg", ".tif", ".tiff"  # of footage; ours are .exr


@dataclass(slots=True)
class Rendered:
    """How many frames were rendered as they were read, and the wall-clock time of that."""

    frames: int = 0
    seconds: float = 0.0


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class RadianceSequence:
    """A complete sequence on disk; frames are read on demand.

    Iterating yields the frames in order, (H, W) float32 each, while all cores decode the following
    frames.

    Examples
    --------
    After `eres render carpet --resolution 128 --spp 4 --samples 1 --out clips`:

    >>> from eres_render import open_sequence
    >>> sequence = open_sequence("clips/clip_000")
    >>> sequence.manifest.scene, sequence.window_s
    ('carpet', (0.25, 0.3))
    >>> sequence.T_world_cam.shape == (len(sequence), 4, 4)
    True
    >>> all(frame.shape == (128, 128) for frame in sequence)
    True
    """

    folder: Path
    manifest: Manifest
    T_world_cam: Float64  # (T, 4, 4)
    trajectory: Trajectory  # of the whole path, on the time axis of the frames
    checksums: Mapping[str, str]  # SHA-256 of every frame, by path in the folder
    rendered: Rendered = dataclasses.field(default_factory=Rendered)  # none: all frames are on disk

    def __len__(self) -> int:
        return len(self.manifest.t_s)

    def __repr__(self) -> str:
        t_s = self.manifest.t_s
        return (
            f"RadianceSequence({len(self)} frames of {self.width}x{self.height} px, "
            f"{self.manifest.scene}, {t_s[0]:g}..{t_s[-1]:g} s, {str(self.folder)!r})"
        )

    def __iter__(self) -> Iterator[Float32]:
        return read_ahead(self.frame, range(len(self)))

    @property
    def t_s(self) -> Float64:
        """(T,) frame times, strictly increasing."""
        return np.array(self.manifest.t_s)

    @property
    def t_offset_us(self) -> int:
        """Time 0 on the clock of the given poses, microseconds; usually 0."""
        return self.manifest.t_offset_us

    @property
    def window_s(self) -> tuple[float, float]:
        """Start and end of the window that is evaluated; earlier frames are warm-up."""
        return self.manifest.window_s

    @property
    def is_continuous(self) -> bool:
        """Whether the sequence starts with the path, and the window is all of it."""
        return self.manifest.t_s[0] == 0 and self.window_s == (0, self.manifest.t_s[-1])

    @property
    def white_level(self) -> float:
        """Radiance of white, the same for all clips of a scene; see `Renderer.white_level`."""
        return self.manifest.white_level

    @property
    def scene_source(self) -> str:
        """The argument with which `load_scene` finds the scene, also a scene in the folder."""
        inside = self.folder / self.manifest.scene_source
        return str(inside) if inside.exists() else self.manifest.scene_source

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
            If the frame's file is missing, truncated or of a different size, has NaN, infinite or
            negative values, or has changed since it was rendered.
        IndexError
            If there is no frame i; negative numbers do not count from the end.
        """
        self._check_number(i)
        return _read_frame(self.folder, self.manifest, i, self.checksums)

    def _check_number(self, i: int) -> None:
        if not 0 <= i < len(self):
            raise IndexError(f"{self.folder}: frame: found {i}, expected 0 to {len(self) - 1}")


def read_ahead(
    read: Callable[[int], T],
    numbers: range,
    threads: int | None = None,
    most: int | None = None,
) -> Generator[T, None, None]:
    """Yield what a function returns for each number, while other threads call it for the next ones.

    Close it where an error may leave it unfinished. At most `most` values exist at a time, with the
    value in use; by default one more than `threads`.
    """
    threads = threads or cores()
    left, ahead = iter(numbers), deque[Future[T]]()
    with ThreadPoolExecutor(threads, "ahead") as pool:
        try:
            for _ in numbers:
                room = (most or threads + 1) - len(ahead)
                ahead += [pool.submit(read, k) for k in islice(left, room)]
                yield ahead.popleft().result()
        finally:
            pool.shutdown(cancel_futures=True)


def open_sequence(path: str | Path) -> RadianceSequence:
    """Open a sequence folder.

    Raises
    ------
    SequenceError
        If the manifest, the poses or a frame is missing, or they contradict each other. The content
        of frames is checked when they are read.

    Examples
    --------
    After `eres render carpet --resolution 128 --spp 4 --samples 1 --out clips`:

    >>> from eres_render import open_sequence
    >>> sequence = open_sequence("clips/clip_000")
    >>> sequence.frame(0).shape, float(sequence.t_s[-1])
    ((128, 128), 0.3)
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
                f"{folder}: found a folder of {len(inside)} sequences; give one sequence, such as "
                f"{inside[0]}"
            )
        if any(file.suffix.lower() in _IMAGES for file in folder.glob("*.*")):
            raise SequenceError(
                f"{folder}: found images, expected the folder of a rendered sequence; `eres "
                "simulate` turns footage into events"
            )
    manifest = read_manifest(folder)
    frames = [_frame_file(folder, i) for i in range(len(manifest.t_s))]
    missing = [file for file in frames if not file.is_file()]
    if missing:
        raise SequenceError(
            f"{missing[0]}: missing (frames missing: {len(missing)} of {len(frames)}); render the "
            "sequence again"
        )
    if not manifest.complete:
        raise SequenceError(f"{folder}: the render is unfinished; run it again to finish it")
    checksums = read_sums(folder)
    without = [i for i in range(len(frames)) if _frame_name(i) not in checksums]
    if without:
        raise SequenceError(f"{folder / FILE_NAME}: has no line for {_frame_name(without[0])}")
    return RadianceSequence(folder, manifest, *read_path(folder, manifest), checksums)


def read_path(folder: Path, manifest: Manifest) -> tuple[Float64, Trajectory]:
    """Read the poses of all frames, (T, 4, 4), and the whole path of the camera."""
    poses_file, path_file = folder / "poses.txt", folder / "path.txt"
    with reading(poses_file, "text", SequenceError):
        t_s, T_world_cam = read_tum(poses_file, manifest.t_offset_us)
    with reading(path_file, "text", SequenceError):
        controls = read_tum(path_file, manifest.t_offset_us)
        trajectory = Trajectory(*controls, manifest.t_offset_us)
    if not np.array_equal(t_s, manifest.t_s):
        raise SequenceError(
            f"{poses_file}: its {len(t_s)} poses have other times than the "
            f"{len(manifest.t_s)} frames in manifest.json"
        )
    if t_s[-1] > trajectory.duration_s + 1e-9 or not np.allclose(
        trajectory.pose(t_s), T_world_cam, rtol=0, atol=1e-9
    ):
        raise SequenceError(f"{path_file}: the path misses the poses of {poses_file}")
    return T_world_cam, trajectory


def is_complete(folder: Path, known: Mapping[str, object]) -> bool:
    """Return whether a sequence is complete; refuse a manifest that differs from `known`."""
    if not (folder / "manifest.json").exists():
        return False
    manifest = read_manifest(folder)
    for name, new in known.items():
        old = getattr(manifest, name)
        # Older files do not have the plane; scene_digest covers it.
        same = old == new or (name == "plane" and old is None)
        if not same and name not in ("complete", "scene_source"):
            change = "other frame times" if name == "t_s" else f"{name} {old!r}, not {new!r}"
            raise RenderError(
                f"{folder}: found a sequence with {change}; remove the folder, or choose another"
            )
    return manifest.complete


class SequenceWriter:
    """Writes a sequence frame by frame, or continues an unfinished sequence.

    A folder with a sequence of other settings is refused, never deleted. The writer sets
    `complete`. `checksums` has the SHA-256 of every frame so far, by path in the folder.
    """

    def __init__(
        self,
        folder: Path,
        manifest: Manifest,
        trajectory: Trajectory,
        compression: Compression = "zip",
    ) -> None:
        self.folder = folder
        self._compression: Compression = compression
        self.manifest = dataclasses.replace(manifest, complete=False)
        self._is_complete = False  # on disk
        exists = (folder / "manifest.json").exists()
        if exists:
            names = (field.name for field in dataclasses.fields(Manifest))
            known = {name: getattr(self.manifest, name) for name in names}
            self._is_complete = is_complete(folder, known)
        make_folder(folder / "frames")
        offset_us, t_s = manifest.t_offset_us, np.array(manifest.t_s)
        path = tum_text(trajectory.knots_s, trajectory.controls, offset_us)
        write_text(folder / "poses.txt", tum_text(t_s, trajectory.pose(t_s), offset_us))
        write_text(folder / "path.txt", path)
        self.checksums = read_sums(folder) if exists else {}  # of these settings
        write_sums(folder, self.checksums)  # without lines that a kill left unfinished
        if not self._is_complete:
            write_manifest(folder, self.manifest)

    def file(self, i: int) -> Path:
        """Return the file of frame i."""
        return _frame_file(self.folder, i)

    def read(self, i: int) -> Float32 | None:
        """Return frame i, (H, W); None if it is missing or cannot be read."""
        try:
            return _read_frame(self.folder, self.manifest, i, self.checksums)
        except SequenceError:
            return None

    def write(self, i: int, radiance: NDArray[np.float16]) -> None:
        """Write a frame of (H, W) linear radiance, whole or not at all."""
        file, name = self.file(i), _frame_name(i)
        if self._is_complete:  # others may read it until a frame turns out to be missing
            write_manifest(self.folder, self.manifest)
            self._is_complete = False
        write_channels(file, {"Y": radiance}, compression=self._compression)
        self.checksums[name] = sha256(file)
        append_sum(self.folder, name, self.checksums[name])

    def finish(self) -> None:
        """Mark the sequence as complete."""
        remove_unfinished(self.folder)  # of a killed render
        write_sums(self.folder, self.checksums)
        write_manifest(self.folder, dataclasses.replace(self.manifest, complete=True))


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
        intact = False  # `read_luminance` says why
    with reading(path, "OpenEXR", SequenceError):
        radiance = read_luminance(path, intact=intact)
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
            f"{path}: has changed since it was rendered (its SHA-256 differs from {FILE_NAME}); "
            "remove it and render again"
        )
    return radiance
