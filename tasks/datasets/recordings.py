"""The recordings in a folder: event files, and the clips from which they were simulated."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np

from eres_render import open_sequence
from sensor import EventFormatError
from sensor.errors import reading
from sensor.formats import FORMATS, dsec, read_events, read_header
from sensor.formats.dsec_reader import DsecReader
from sensor.formats.hdf5_file import check_stored
from tasks.errors import TaskError

TRUTH = {
    "flow": "flow",
    "occlusion": "flow_occluded",
    "depth": "depth",
    "pose": "T_world_cam",
    "instances": "instances",
}
"""Datasets in the group `truth` of a file, by the name of the target."""
TARGETS = ("frame", *TRUTH)

_DSEC = FORMATS["dsec"].suffixes
_OFTEN_OTHERS = (".txt", ".csv", ".npz")  # a README, times of images, a table
_ANY_SIZE = (1 << 16, 1 << 16)
_ORIGIN = ("scene", "clip", "frames_width", "frames_height")


@dataclass(frozen=True, slots=True)
class DatasetRecording:
    """An event file, its clip and its ground truth; no file stays open.

    Parameters
    ----------
    path
        DSEC file.
    window_us
        Start and end of the part to use, microseconds on the clock of the events: the window of the
        clip, or the whole file.
    window_events
        Numbers of the first event of the window and of the one after it.
    truth_us
        Times of the ground truth; empty if there is none.
    clip
        Folder of the frames; None if there is none.
    targets
        Names of the available targets. Without moving objects there are no `instances`.
    size_px
        Width and height of the sensor.
    """

    path: Path
    window_us: tuple[int, int]
    window_events: tuple[int, int]
    truth_us: tuple[int, ...]
    clip: Path | None
    targets: tuple[str, ...]
    size_px: tuple[int, int]


def find_recordings(folder: Path) -> list[DatasetRecording]:
    """Find the recordings in a folder and below it, except for hidden folders, sorted by path."""
    if not folder.is_dir():
        there = "a file" if folder.exists() else "no such folder"
        raise TaskError(f"{folder}: found {there}, expected a folder of recordings")
    clips = _find_clips(folder)
    found, used = [], set()
    for path in sorted(path for path in _below(folder, "*") if path.is_file()):
        if path.suffix == ".unfinished":
            raise TaskError(f"{path}: found an unfinished file; delete it, or make its file again")
        if path.suffix.lower() in _DSEC:
            recording = _open(path, clips)
            found.append(recording)
            used.add(recording.clip)
        elif _is_of_another_format(path, clips):
            raise TaskError(
                f"{path}: found a format without windows, expected DSEC's: eres convert {path} "
                f"{path.with_suffix('.h5')}"
            )
    if not found:
        raise TaskError(f"{folder}: found no files of events, expected {' or '.join(_DSEC)}")
    for clip in clips.values():
        if clip not in used:
            raise TaskError(
                f"{clip}: found a clip without events, expected a file of them: eres simulate "
                f"{clip} --out {clip}.h5"
            )
    return found


def _below(folder: Path, pattern: str) -> Iterator[Path]:
    """Yield the files and folders whose names match, except for those in hidden folders."""
    for path in folder.rglob(pattern):
        if not any(part.startswith(".") for part in path.relative_to(folder).parent.parts):
            yield path


def _is_of_another_format(path: Path, clips: dict[tuple[Any, ...], Path]) -> bool:
    suffix = path.suffix.lower()
    suffixes = {suffix for format in FORMATS.values() for suffix in format.suffixes}
    if suffix not in suffixes or any(clip in path.parents for clip in clips.values()):
        return False
    return suffix not in _OFTEN_OTHERS or _has_events(path)


def _has_events(path: Path) -> bool:
    """Return whether a text file or an archive of arrays holds events, as far as can be told."""
    if path.suffix.lower() == ".npz":
        try:
            with ZipFile(path) as archive:
                return "t_us.npy" in archive.namelist()
        except Exception:  # damaged
            return True
    for unit in (None, "us"):  # whole times may be in any unit
        with suppress(EventFormatError):
            size = None if read_header(path).width is not None else _ANY_SIZE
            return any(len(part) for part in read_events(path, size=size, time_unit=unit))
    return False


def _find_clips(folder: Path) -> dict[tuple[Any, ...], Path]:
    """Return the folders of clips by scene, number and size, as in the origin of an event file."""
    clips: dict[tuple[Any, ...], Path] = {}
    for file in sorted(_below(folder, "manifest.json")):
        clip = open_sequence(file.parent)  # raises if something is missing
        key = (clip.manifest.scene, clip.manifest.clip, clip.width, clip.height)
        if key in clips:
            raise TaskError(
                f"{file.parent}: found clip {key[1]} of {key[0]}, as in {clips[key]}; expected "
                "only one of them"
            )
        clips[key] = file.parent
    return clips


def _open(path: Path, clips: dict[tuple[Any, ...], Path]) -> DatasetRecording:
    origin = read_header(path).origin
    with DsecReader(path) as reader:
        if "window_start_us" in origin and "window_end_us" in origin:
            window_us = _window_us(path, origin["window_start_us"], origin["window_end_us"])
        else:
            last = len(reader) - 1
            window_us = 0, 0
            if last >= 0:
                first_us, last_us = (int(reader.part(k, k + 1).t_us[0]) for k in (0, last))
                window_us = first_us, last_us + 1
        with reading(path, dsec.TITLE):
            truth = reader.file.get("truth", {})
            times: tuple[int, ...] = ()
            if "t_us" in truth:
                check_stored(truth["t_us"])
                times = tuple(int(t_us) for t_us in truth["t_us"][:])
            targets = [name for name, place in TRUTH.items() if place in truth]
            shapes = {name: array.shape for name, array in truth.items()}
        first, stop = (reader.index_at(t_us) for t_us in window_us)
        size_px = reader.header.size
    if times:
        _check_truth(path, shapes, times, size_px)
    clip = clips.get(tuple(origin.get(name) for name in _ORIGIN))
    if clip is not None:
        targets.insert(0, "frame")
    return DatasetRecording(path, window_us, (first, stop), times, clip, tuple(targets), size_px)


def _window_us(path: Path, start: Any, end: Any) -> tuple[int, int]:
    try:
        return int(start), int(end)
    except (TypeError, ValueError):
        raise TaskError(
            f"{path}: found window_start_us = {start!r} and window_end_us = {end!r} in its origin, "
            "expected whole numbers"
        ) from None


def _check_truth(
    path: Path,
    shapes: dict[str, tuple[int, ...]],
    t_us: tuple[int, ...],
    size_px: tuple[int, int],
) -> None:
    """Refuse ground truth whose times do not ascend, or whose arrays do not fit them."""
    if any(after <= before for before, after in pairwise(t_us)):
        raise TaskError(f"{path}: truth/t_us: found times that do not ascend")
    if len(t_us) < 2:
        raise TaskError(f"{path}: truth/t_us: found one time, expected two or more")
    width, height = size_px
    for name, (steps, *shape) in {
        "flow": (1, height, width, 2),
        "flow_valid": (1, height, width),
        "flow_occluded": (1, height, width),
        "depth": (0, height, width),
        "instances": (0, height, width),
        "T_world_cam": (0, 4, 4),
    }.items():
        expected = (len(t_us) - steps, *shape)
        if shapes.get(name, expected) != expected:
            raise TaskError(
                f"{path}: truth/{name}: found shape {shapes[name]}, expected {expected} for "
                f"{len(t_us)} times of {width}x{height} px"
            )


def index_at(times_us: np.ndarray, t_us: int) -> int:
    """Return the index of the nearest time.

    Parameters
    ----------
    times_us
        (T,) times, sorted.
    """
    return int(np.argmin(np.abs(times_us - t_us)))
