"""The recordings in a folder: event files, and the clips from which they were simulated."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from zipfile import ZipFile

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

    `window_us` is the window of the clip, or the whole file, on the clock of the events;
    `window_events` are the numbers of its first event and of the next event after it. Without
    moving objects, `targets` lacks `instances`. `size_px` is (width, height).
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
    clips = _find_clips(folder)
    recordings = []
    for path in sorted(path for path in _below(folder, "*") if path.is_file()):
        if path.suffix == ".unfinished":
            raise TaskError(f"{path}: is unfinished; delete it, or create the file again")
        if path.suffix.lower() in _DSEC:
            recordings.append(_open(path, clips))
        elif _is_of_another_format(path, clips):
            raise TaskError(
                f"{path}: has no index of times; run `eres convert {path} "
                f"{path.with_suffix('.h5')}`, then move {path.name} elsewhere"
            )
    if not recordings:
        raise TaskError(
            f"{folder}: no such folder, or it holds no files of events ({', '.join(_DSEC)})"
        )
    used = {recording.clip for recording in recordings}
    if unused := [clip for clip in clips.values() if clip not in used]:
        clip = unused[0]
        raise TaskError(f"{clip}: has no events; run `eres simulate {clip} --out {clip}.h5`")
    first = recordings[0]
    for recording in recordings:
        if recording.size_px != first.size_px:
            ours, theirs = ("{}x{} px".format(*each.size_px) for each in (recording, first))
            raise TaskError(f"{recording.path}: found {ours}, expected {theirs} as in {first.path}")
    return recordings


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
            raise TaskError(f"{file.parent}: is the same clip as {clips[key]}; remove one")
        clips[key] = file.parent
    return clips


def _open(path: Path, clips: dict[tuple[Any, ...], Path]) -> DatasetRecording:
    origin = read_header(path).origin
    with DsecReader(path) as reader:
        window_us = 0, 0
        if "window_start_us" in origin and "window_end_us" in origin:
            with reading(path):
                window_us = int(origin["window_start_us"]), int(origin["window_end_us"])
        elif count := len(reader):
            first_us, last_us = (int(reader.part(k, k + 1).t_us[0]) for k in (0, count - 1))
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


def _check_truth(
    path: Path, shapes: dict[str, tuple[int, ...]], t_us: tuple[int, ...], size_px: tuple[int, int]
) -> None:
    """Refuse ground truth whose times do not ascend, or whose arrays do not fit them."""
    if len(t_us) < 2 or any(after <= before for before, after in pairwise(t_us)):
        raise TaskError(f"{path}: truth/t_us: expected two or more ascending times")
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
            raise TaskError(f"{path}: truth/{name}: found shape {shapes[name]}, not {expected}")
