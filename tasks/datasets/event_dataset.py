"""`EventDataset`: windows of events as dicts of arrays, for `torch.utils.data.DataLoader`.

Torch is not imported. The dataset itself holds no open files, so it can be pickled and forked: each
process opens the files that it reads.
"""

from __future__ import annotations

import os
from bisect import bisect_right
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eres_render import RadianceSequence, open_sequence
from sensor import Events
from sensor.errors import reading
from sensor.formats import Header, dsec
from sensor.formats.dsec_reader import DsecReader
from sensor.optics import crop_to_aspect, integrate
from tasks.datasets.recordings import TARGETS, TRUTH, DatasetRecording, find_recordings
from tasks.errors import TaskError
from tasks.origin import shift_us

_MAX_OPEN = 64  # files and clips that a process keeps open

_AT_A_TIME = ("depth", "pose", "instances")  # truth at a time; the rest is over an interval

Item = dict[str, NDArray[Any]]


class EventDataset:
    """Windows of the events in a folder, with frames and ground truth.

    `len(dataset)` windows; `dataset[k]` is a dict of NumPy arrays for a sensor of H x W px:

    - `events`: what `transform` returns. Without one, `t_us`, `x`, `y` and `p` as in `Events`.
    - `window_us` (2,) int64: start and end on the clock of the events; `recording` () int64: number
      in `recordings`.
    - `frame` (H, W) float32: radiance as the sensor sees it, of the rendered frame nearest to the
      window's end, and its time `frame_us`. It comes from the clip in the folder from which the
      events were simulated.
    - `flow` (H, W, 2) float32, px, and `flow_valid` (H, W): from `flow_us[0]` to `flow_us[1]`, the
      interval of the ground truth that contains the window's center. A window outside all
      intervals gets the nearest interval, with no valid flow. The target `occlusion` is
      `flow_occluded` (H, W): whether something hides the point at the end of the interval.
    - `depth` (H, W), m, `pose` (4, 4), T_world_cam, and `instances` (H, W) uint8, k where moving
      object k is seen and 0 elsewhere: at `truth_us`, the time of the ground truth nearest to the
      window's end. With `pose` also the camera matrix `K` (3, 3), and `distortion` if the camera
      has a lens.

    Parameters
    ----------
    folder
        Folder with DSEC files from `eres simulate` at any depth. Frames need the rendered clips in
        the folder, all other targets need `eres simulate --truth`. The warm-up before a clip's
        window is left out.
    window_us
        Length of the windows, microseconds. They follow one another without a gap.
    window_events
        Number of events of a window, instead of a length. Without either, a window is an interval
        of the ground truth, and the flow is exactly the window's.
    targets
        Which of frame, flow, occlusion, depth, pose and instances to return; None for all stored
        targets. Every recording must have them, except for instances, which are 0 where nothing
        moves.
    transform
        Function from `Events` to an array, such as
        `functools.partial(sensor.representations.voxel_grid, bins=5)`. To use it in processes
        that are spawned, it must be picklable.

    Raises
    ------
    TaskError
        A recording is incomplete or lacks a target, two have sensors of different size, an argument
        is wrong, or no window fits into any recording.

    Examples
    --------
    A folder with one recording, in windows of 10 ms, as voxel grids:

    >>> from functools import partial
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from sensor import Events
    >>> from sensor.formats import write_events
    >>> from sensor.representations import voxel_grid
    >>> from tasks.datasets import EventDataset
    >>> t_us, pixel = np.arange(0, 100_000, 100), np.zeros(1000, np.uint16)
    >>> recording = Events(t_us, pixel, pixel, np.ones(1000, np.int8), width=32, height=24)
    >>> Path("recordings").mkdir()
    >>> write_events("recordings/one.h5", recording)
    1000
    >>> as_grid = partial(voxel_grid, bins=5)
    >>> dataset = EventDataset("recordings", window_us=10_000, transform=as_grid)
    >>> dataset
    EventDataset(9 windows of 1 recording, 32x24 px, targets: none)
    >>> item = dataset[3]
    >>> item["events"].shape, item["window_us"]
    ((5, 24, 32), array([30000, 40000]))
    """

    def __init__(
        self,
        folder: str | Path,
        *,
        window_us: int | None = None,
        window_events: int | None = None,
        targets: Sequence[str] | None = None,
        transform: Callable[[Events], NDArray[Any]] | None = None,
    ) -> None:
        if window_us is not None and window_events is not None:
            raise TaskError("give window_us or window_events, not both")
        for name, value in (("window_us", window_us), ("window_events", window_events)):
            if value is not None and (not isinstance(value, int | np.integer) or value < 1):
                raise TaskError(f"{name}: found {value!r}, expected a whole number of at least 1")
        self.recordings = find_recordings(Path(folder))
        self.targets = _checked_targets(self.recordings, targets)
        self.window_us, self.window_events = window_us, window_events
        self.transform = transform
        if window_us is None and window_events is None:
            _check_present(self.recordings, "flow", "give window_us or window_events")
        self._ends = list(
            accumulate(len(self._edges(recording)) - 1 for recording in self.recordings)
        )
        if self._ends[-1] == 0:
            raise TaskError(f"{folder}: every recording is shorter than a window")

    def __repr__(self) -> str:
        width, height = self.recordings[0].size_px
        files = len(self.recordings)
        return (
            f"EventDataset({len(self)} windows of {files} recording{'s' * (files > 1)}, "
            f"{width}x{height} px, targets: {', '.join(self.targets) or 'none'})"
        )

    def __len__(self) -> int:
        return self._ends[-1]

    def __getitem__(self, k: int) -> Item:
        if not -len(self) <= k < len(self):
            raise IndexError(f"window: found {k}, expected 0 to {len(self) - 1}")
        k %= len(self)
        number = bisect_right(self._ends, k)
        recording = self.recordings[number]
        reader: DsecReader = _opened(DsecReader, recording.path, _version(recording.path))
        k -= self._ends[number - 1] if number else 0
        first, stop = self._edges(recording)[k : k + 2]
        if self.window_events is None:
            events, window_us = reader.between(first, stop), (first, stop)
        else:
            events = reader.part(first, stop)
            window_us = int(events.t_us[0]), int(events.t_us[-1]) + 1
        columns = events.columns._asdict()
        item: Item = columns if self.transform is None else {"events": self.transform(events)}
        item["window_us"] = np.array(window_us)
        item["recording"] = np.array(number)
        if "frame" in self.targets:
            item |= _frame(recording, reader.header, window_us[1])
        with reading(recording.path, dsec.TITLE):
            return item | _truth(reader.file, recording, self.targets, window_us)

    def _edges(self, recording: DatasetRecording) -> Sequence[int]:
        """Return where the windows of a recording begin and end: times, or numbers of events."""
        if self.window_events is not None:
            first, stop = recording.window_events
            return range(first, stop + 1, self.window_events)
        if self.window_us is not None:
            start_us, end_us = recording.window_us
            return range(start_us, end_us + 1, self.window_us)
        return recording.truth_us


def _checked_targets(
    recordings: Sequence[DatasetRecording], targets: Sequence[str] | None
) -> tuple[str, ...]:
    if targets is None:
        stored = {name for recording in recordings for name in recording.targets}
        targets = [name for name in TARGETS if name in stored]
    targets = tuple(targets)
    for name in targets:
        if name not in TARGETS:
            raise TaskError(f"targets: found {name!r}, expected some of {', '.join(TARGETS)}")
        _check_present(recordings, name, "choose other targets")
    return targets


def _check_present(recordings: Sequence[DatasetRecording], target: str, advice: str) -> None:
    for recording in recordings:
        still = target == "instances" and "depth" in recording.targets
        if target not in recording.targets and not still:
            remedy = "simulate it again with --truth"
            if target == "frame":
                remedy = "put the rendered clip beside it"
            raise TaskError(f"{recording.path}: has no {target}; {remedy}, or {advice}")


@lru_cache(maxsize=_MAX_OPEN)
def _opened(kind: Callable[[Path], Any], path: Path, _: tuple[int, ...]) -> Any:
    return kind(path)


# After a fork, HDF5 would otherwise use files opened before it, with shared descriptors.
os.register_at_fork(after_in_child=_opened.cache_clear)


def _version(file: Path) -> tuple[int, ...]:
    """Return what differs once a file is written again, as it may be between two data sets."""
    try:
        status = file.stat()
    except OSError:
        return ()  # whoever opens it says why
    return status.st_ino, status.st_mtime_ns, status.st_size


def _frame(recording: DatasetRecording, header: Header, t_us: int) -> Item:
    """Return the frame nearest to a time, as the sensor sees it."""
    assert recording.clip is not None
    version = _version(recording.clip / "manifest.json")
    clip: RadianceSequence = _opened(open_sequence, recording.clip, version)
    speed = float(header.origin["speed"])
    times_us = clip.t_offset_us + np.round(1e6 * clip.t_s / speed).astype(int)
    times_us += shift_us(clip, header.origin, speed)
    k = int(np.argmin(np.abs(times_us - t_us)))
    width, height = recording.size_px
    rows, columns = crop_to_aspect(clip.height, clip.width, height, width)
    fill_factor = 1.0 if header.model is None else header.model.fill_factor
    frame = integrate(clip.frame(k)[rows, columns], height, width, fill_factor)
    return {"frame": frame.astype(np.float32), "frame_us": np.array(times_us[k])}


def _truth(
    file: Any, recording: DatasetRecording, targets: Sequence[str], window_us: tuple[int, int]
) -> Item:
    """Read the ground truth of a window."""
    wanted = [name for name in TRUTH if name in targets]
    if not wanted:
        return {}
    truth, times_us = file["truth"], np.array(recording.truth_us)
    item: Item = {}
    center_us = sum(window_us) // 2
    k = int(np.clip(np.searchsorted(times_us, center_us, "right") - 1, 0, len(times_us) - 2))
    if "flow" in wanted:
        inside = times_us[k] <= center_us < times_us[k + 1]
        item |= {"flow": truth["flow"][k], "flow_valid": truth["flow_valid"][k] & inside}
    if "occlusion" in wanted:
        item["flow_occluded"] = truth["flow_occluded"][k]
    if item:
        item["flow_us"] = times_us[k : k + 2]
    k = int(np.argmin(np.abs(times_us - window_us[1])))
    for name in wanted:
        if name in _AT_A_TIME:
            item["truth_us"] = np.array(times_us[k])
            if TRUTH[name] in truth:
                item[name] = truth[TRUTH[name]][k]
            else:  # nothing moves
                item[name] = np.zeros(truth["depth"].shape[1:], np.uint8)
    if "pose" in wanted:
        item["K"] = truth["K"][:]
        if "distortion" in truth:
            item["distortion"] = truth["distortion"][:]
    return item
