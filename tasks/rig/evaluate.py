"""Scores of the methods on crops of a rig: flow, video and tracking.

The truth comes from the solved poses, at the time of the encoder's readings. It does not include
the sensor's delay, which is part of what is scored.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from eres_render.errors import check_positive
from eres_render.progress import Progress, silent
from sensor.events import concatenate
from sensor.formats import read_events, read_header
from tasks.errors import RigError
from tasks.evaluation.settings import Flow, TaskSettings, Tracking, Video, check_methods
from tasks.evaluation.source import ALL, check_needs, score_stored
from tasks.flow import INITIAL_SIGMA_PX
from tasks.rig.cells import in_cells
from tasks.rig.crop import CROP_FILE, EVENTS_NAME, Cropped, read_crop
from tasks.rig.prints import Print, prints_of
from tasks.rig.recording import thresholds_of
from tasks.rig.settings import check_bounds
from tasks.rig.source import MAX_ITEMS, CropSource
from tasks.row import Row
from tasks.tracking import PATH_S

_MAX_EVENTS = 200_000  # of a path, with those of the delay after it


@dataclass(frozen=True, slots=True, kw_only=True)
class RigEvaluation:
    """What is scored on each crop: windows wherever the carriage passes a place at constant speed.

    Places are evenly spaced along the part of the travel that all recordings of a print share.
    `initial_sigma_px` is the standard deviation of each component of the initial flow's error, px
    at a width of 1280 px; `initial_sigma_mm` is the error of the initial path's control positions.
    By default, C in log units and the cutoff are the simulated sensor's, and the cutoff of recorded
    events is inf. The rows store the cutoff; no score depends on it.
    """

    places: int = 10
    travel_m: float = 0.006
    flow: tuple[str, ...] = ("contrast_maximization", "photometric_flow", "initial_flow")
    video: tuple[str, ...] = ("high_pass_filter", "blank")
    tracking: tuple[str, ...] = ("photometric_tracking", "initial_path")
    features: int = 20
    initial_sigma_px: float = INITIAL_SIGMA_PX
    initial_sigma_mm: float = 5.0
    contrast_threshold: float | None = None
    cutoff_hz: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        positive = "places", "features", "travel_m", "initial_sigma_mm", "initial_sigma_px"
        for name in (*positive, "cutoff_hz", "contrast_threshold"):
            if (value := getattr(self, name)) is not None:
                check_positive(name, value, RigError)
        check_bounds("seed", self.seed, 0)

    def tasks(self) -> dict[str, TaskSettings]:
        """Return the settings of each task."""
        sigmas_mm = (self.initial_sigma_mm,)
        tracking = Tracking(methods=self.tracking, sigmas_mm=sigmas_mm, seed=self.seed)
        delay_us = tracking.delay_us
        events = int(_MAX_EVENTS / (1 + 1e-6 * delay_us / PATH_S))
        return {
            "flow": Flow(
                methods=self.flow,
                features=self.features,
                native_patch=True,
                initial_sigma_px=self.initial_sigma_px,
                seed=self.seed,
            ),
            "tracking": replace(tracking, max_events=events, max_delay_us=delay_us),
            "video": Video(methods=self.video),
        }


def evaluate_rig(
    folders: Sequence[Path],
    settings: RigEvaluation,
    *,
    tasks: Mapping[str, TaskSettings] | None = None,
    on_progress: Progress = silent,
) -> list[Row]:
    """Score methods on all crops of a rig; `tasks` has the settings of further tasks, by name.

    In the rows, `speed` and `speed_m_s` are in m/s, `width` is the crop's, `scene` is the picture,
    and an unknown `cutoff_hz` is inf. Widths, speeds and samples are grouped by `in_cells`.
    """
    every = {**settings.tasks(), **(tasks or {})}
    every = {task: given for task, given in every.items() if given.methods}
    for task in every:
        check_needs(task, folders[0], "a crop", ALL)
    paths = {path.resolve(): path for folder in folders for path in crops_in(folder)}  # each once
    crops = {path: read_crop(path) for path in paths.values()}
    for size in {(cropped.width, cropped.height) for cropped in crops.values()}:
        check_methods(every, [size])
    prints = prints_of(crops, settings.places, settings.travel_m)
    rows_of_crops: list[list[Row]] = []
    for k, (folder, cropped) in enumerate(crops.items()):
        source = _load(folder, cropped, prints[cropped.scene], settings)
        rows: list[Row] = []
        for n, window in enumerate(source.windows):
            rows += rows_of(replace(source, windows=[window]), every)
            on_progress("evaluating", k + (n + 1) / len(source.windows), len(crops))
        rows_of_crops.append(rows + rows_of(source, every, continuous=True))
    if not any(rows_of_crops):
        raise RigError(
            "crops: nothing to score; either there is no task, or the picture has no corners, or "
            "the windows are too close to the ends of the slider's readings for tracking"
        )
    return in_cells(rows_of_crops, dict.fromkeys(every, MAX_ITEMS))


def rows_of(
    source: CropSource, tasks: Mapping[str, TaskSettings], *, continuous: bool = False
) -> list[Row]:
    """Score tasks on windows of a crop: those of a continuous stretch, or the others."""
    return [
        row
        for task, settings in tasks.items()
        if any(each.continuous_s for each in settings.plan()) == continuous
        if continuous or source.covers(settings)
        for row in score_stored(task, source, settings)
    ]


def crops_in(folder: Path) -> list[Path]:
    """Return the folders of the crops that `eres rig crop` wrote."""
    if not (files := sorted(folder.glob(f"*/{CROP_FILE}"))):
        raise RigError(f"{folder}: has no crops; give the output folder of `eres rig crop`")
    return [file.parent for file in files]


def _load(folder: Path, cropped: Cropped, printed: Print, settings: RigEvaluation) -> CropSource:
    """Return all windows of constant speed at the places of the print, in the order of starts."""
    if settings.tracking and any(cropped.lens):
        raise RigError(
            f"{folder / CROP_FILE}: lens: tracking supports no distortion; use --tasks flow video"
        )
    file, way = folder / EVENTS_NAME, printed.ways[folder]
    model = read_header(file).model
    C, _ = thresholds_of(file, settings.contrast_threshold)
    windows = way.windows(printed.places_m, settings.travel_m)
    if not windows:
        seconds = 1e-6 * (way.last_us - way.first_us)
        raise RigError(
            f"{file}: at none of {len(printed.places_m)} places does the slider travel "
            f"{1e3 * settings.travel_m:g} mm at constant speed within {seconds:.3g} s; "
            "increase --places, or reduce --travel"
        )
    return CropSource(
        name=str(folder),
        contrast_threshold=C,
        cutoff_hz=settings.cutoff_hz or (math.inf if model is None else model.cutoff_hz),
        scene=cropped.scene,
        way=way,
        printed=printed,
        events=concatenate(list(read_events(file))),
        windows=windows,
    )
