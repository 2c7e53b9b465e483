"""Scores of the methods on crops of a rig: flow, video and tracking.

The truth comes from the solved poses, at the time of the encoder's readings. It does not include
the sensor's delay, which is part of what is scored.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eres_render import Camera, Plane
from eres_render.errors import check_positive
from eres_render.progress import Progress, silent
from sensor import Events
from sensor.events import concatenate
from sensor.formats import read_events, read_header
from sensor.levels import DARK_FRACTION
from tasks.errors import RigError
from tasks.evaluation.answers import ask, ask_each, flow_answer, image_answer, path_answer
from tasks.evaluation.settings import Tracking
from tasks.flow import (
    INITIAL_SIGMA_PX,
    flow_sample,
    initial_sigma_px,
    patch_px,
    rnepe_px,
)
from tasks.methods import load_method
from tasks.psnr import psnr_db
from tasks.rig.bundle import RigPose
from tasks.rig.cells import in_cells
from tasks.rig.crop import EVENTS_NAME, FILE_NAME, Cropped, read_crop
from tasks.rig.page_view import page_view
from tasks.rig.places import Way, Window
from tasks.rig.prints import Print, are_inside, prints_of
from tasks.row import Row
from tasks.tracking import failure_of, path_at, perturbed, position_error_mm, tracking_sample
from tasks.variants import NATIVE_PATCH, sigma_variant
from tasks.video import ImageTaker, picture

Float64 = NDArray[np.float64]

PLANE = Plane(normal=(0.0, 0.0, -1.0), offset_m=0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class RigEvaluation:
    """What is scored on each crop.

    Parameters
    ----------
    places
        Number of places, evenly spaced along the part of the travel that all recordings of a print
        share. There is a window wherever the carriage passes one at constant speed.
    travel_m
        Travel of the slider in a window, m.
    initial_sigma_px
        Error of the initial flow: standard deviation of each component, px at a width of 1280 px.
    initial_sigma_mm
        Error of the initial path's control positions, mm.
    contrast_threshold
        C, log units; by default that of the file of events, if it was simulated.
    cutoff_hz
        Cutoff of the photoreceptor that the rows store, Hz; by default that of the file of events,
        if it was simulated, and inf otherwise. No score depends on it.
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
        for name in positive:
            check_positive(name, getattr(self, name), RigError)
        for name in ("cutoff_hz", "contrast_threshold"):
            if getattr(self, name) is not None:
                check_positive(name, getattr(self, name), RigError)
        if not self.seed >= 0:
            raise RigError(f"seed: found {self.seed}, expected at least 0")


@dataclass(frozen=True, eq=False, slots=True)
class _Crop:
    """A crop in memory."""

    cropped: Cropped
    way: Way
    printed: Print
    events: Events
    contrast_threshold: float
    cutoff_hz: float
    camera: Camera = field(init=False)
    pose: RigPose = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "camera", self.cropped.camera())
        object.__setattr__(self, "pose", self.cropped.pose.pose())


def evaluate_rig(
    folders: Sequence[Path], settings: RigEvaluation, *, on_progress: Progress = silent
) -> list[Row]:
    """Score methods on all crops of a rig.

    Returns
    -------
    rows
        `speed` and `speed_m_s` are in m/s, `width` is that of the crop, `scene` is the picture, and
        `cutoff_hz` is inf if it is not known. Widths, speeds and samples are grouped by `in_cells`.
    """
    if not folders:
        raise RigError("crops: found no folder, expected those of `eres rig crop`")
    found_in = {one.resolve(): one for folder in folders for one in crops_in(folder)}
    crops = {one: read_crop(one) for one in found_in.values()}  # each once
    prints = prints_of(crops, settings.places, settings.travel_m)
    found: list[list[Row]] = []
    for k, (folder, cropped) in enumerate(crops.items()):
        crop = _load(folder, cropped, prints[cropped.scene], settings)
        try:
            windows = _windows(crop, settings.travel_m)
        except RigError as error:
            raise RigError(f"{folder}: {error}") from None
        rows: list[Row] = []
        for n, window in enumerate(windows):
            rows += _flow_rows(crop, window, settings)
            rows += _tracking_rows(crop, window, settings)
            on_progress("evaluating", k + (n + 1) / len(windows), len(crops))
        rows += _video_rows(crop, windows, settings)
        found.append(rows)
    if not any(found):
        raise RigError(
            "crops: found nothing to score: no task, no corners in the picture, or windows too "
            "close to the ends of the slider's readings for tracking"
        )
    return in_cells(found, {"flow": settings.features})


def crops_in(folder: Path) -> list[Path]:
    """Return the folders of the crops that `eres rig crop` wrote."""
    found = sorted(file.parent for file in folder.glob(f"*/{FILE_NAME}"))
    if not found:
        raise RigError(f"{folder}: found no crop, expected those of `eres rig crop`")
    return found


def _load(folder: Path, cropped: Cropped, printed: Print, settings: RigEvaluation) -> _Crop:
    if settings.tracking and any(cropped.lens):
        raise RigError(
            f"{folder / FILE_NAME}: lens: found {cropped.lens}, expected a pinhole for tracking; "
            "score --tasks flow video"
        )
    file = folder / EVENTS_NAME
    model = read_header(file).model
    C = settings.contrast_threshold
    if C is None:
        if model is None:
            raise RigError(f"{file}: found no contrast threshold, expected --threshold C")
        C = model.contrast_threshold
    return _Crop(
        cropped,
        printed.ways[folder],
        printed,
        concatenate(list(read_events(file))),
        C,
        settings.cutoff_hz or (math.inf if model is None else model.cutoff_hz),
    )


def _windows(crop: _Crop, travel_m: float) -> list[Window]:
    """Return windows of constant speed at the places of the print, in the order of their starts."""
    found = crop.way.windows(crop.printed.places_m, travel_m)
    if not found:
        seconds = 1e-6 * (crop.way.last_us - crop.way.first_us)
        raise RigError(
            f"{EVENTS_NAME}: found no window of constant speed in {seconds:.3g} s at "
            f"{len(crop.printed.places_m)} places, expected some of {1e3 * travel_m:g} mm of "
            "travel; give more places, or less travel"
        )
    return found


def _log_view(crop: _Crop, x_m: float) -> Float64:
    return np.log(
        page_view(crop.camera, crop.pose, x_m, crop.printed.page, crop.printed.light)
        + DARK_FRACTION
    )


def _row(
    crop: _Crop,
    window: Window,
    task: str,
    method: str,
    metric: str,
    value: float,
    *,
    variant: str = "",
    item: int = 0,
    failure: str = "",
) -> Row:
    count = len(crop.events.between(window.start_us, window.end_us))
    return Row(
        scene=crop.cropped.scene,
        task=task,
        method=method,
        width=crop.camera.width,
        cutoff_hz=crop.cutoff_hz,
        contrast_threshold=crop.contrast_threshold,
        speed=round(window.encoder_mps * crop.pose.scale, 4),
        sample=window.place,
        metric=metric,
        value=value,
        event_rate_hz=1e6 * count / (window.end_us - window.start_us),
        variant=variant,
        item=item,
        failure=failure,
    )


def _features(crop: _Crop, window: Window, count: int) -> tuple[NDArray[np.intp], Float64, Float64]:
    """Return corners of the print that stay in the crop, and their displacements in the window.

    Returns
    -------
    numbers, centers_px, flow_px
        (N,) numbers of the corners, the same in all crops, (N, 2) px, and (N, 2) px.
    """
    points_m = crop.printed.corners_m(window.place)[:count]
    start_px, end_px = crop.pose.project(crop.camera, points_m, window.x_m)
    kept = are_inside(crop.camera, start_px) & are_inside(crop.camera, end_px)
    return np.flatnonzero(kept), start_px[kept], (end_px - start_px)[kept]


def _flow_rows(crop: _Crop, window: Window, settings: RigEvaluation) -> Iterator[Row]:
    if not settings.flow:
        return
    width = crop.camera.width
    numbers, centers_px, flow_px = _features(crop, window, settings.features)
    sigma_px = initial_sigma_px(width, settings.initial_sigma_px)
    rng = np.random.default_rng([settings.seed, window.place, window.back])
    initial_px = flow_px + sigma_px * rng.standard_normal((settings.features, 2))[numbers]
    log_image = _log_view(crop, window.x_m[0])
    sides = {patch_px(width): [""]}
    sides.setdefault(patch_px(width, native=True), []).append(NATIVE_PATCH)
    for side_px, variants in sides.items():
        for k, number in enumerate(numbers.tolist()):
            sample = flow_sample(
                crop.events,
                window.start_us,
                window.end_us,
                log_image=log_image,
                contrast_threshold=crop.contrast_threshold,
                center_px=centers_px[k],
                side_px=side_px,
                initial=initial_px[k],
                initial_sigma_px=sigma_px,
            )
            for name in settings.flow:
                answer, _ = ask("flow", name, load_method("flow", name), sample)
                estimate = flow_answer("flow", name, answer, sample.initial)
                error_px = rnepe_px(estimate.flow, flow_px[k], width)
                for variant in variants:
                    yield _row(
                        *(crop, window, "flow", name, "rnepe_px", error_px),
                        variant=variant,
                        item=window.visit * settings.features + number,
                        failure=estimate.failure,
                    )


def _tracking_rows(crop: _Crop, window: Window, settings: RigEvaluation) -> Iterator[Row]:
    if not settings.tracking:
        return

    def pose(t_s: Float64) -> Float64:
        return crop.pose.at(crop.way.slider.position_m(window.start_us + 1e6 * t_s))

    margin_us = 20_000  # a path lasts 14 ms, and has a control pose before it and one after it
    slider_us, delay_us = crop.way.slider.t_us, Tracking(methods=settings.tracking).delay_us
    needed_us = margin_us + delay_us
    if window.start_us - margin_us < slider_us[0] or window.start_us + needed_us > slider_us[-1]:
        return
    truth = path_at(pose, 0.0)
    sigma_m = 1e-3 * settings.initial_sigma_mm
    sample = tracking_sample(
        crop.events,
        window.start_us,
        log_image=_log_view(crop, window.x_m[0]),
        contrast_threshold=crop.contrast_threshold,
        camera=crop.camera,
        plane=PLANE,
        T_0=pose(np.zeros(1))[0],
        initial=perturbed(truth, sigma_m, [settings.seed, window.place, window.back]),
        initial_sigma_m=sigma_m,
        max_events=200_000,
        max_delay_us=delay_us,
    )
    initial_mm = position_error_mm(sample.initial, pose, 0.0, truth.duration_s)
    for name in settings.tracking:
        answer, _ = ask("tracking", name, load_method("tracking", name), sample)
        estimate = path_answer(name, sample, answer)
        error_mm = position_error_mm(estimate.path, pose, 0.0, truth.duration_s)
        yield _row(
            *(crop, window, "tracking", name, "position_error_mm", error_mm),
            variant=sigma_variant(settings.initial_sigma_mm),
            item=window.visit,
            failure=failure_of(estimate, sample.initial, error_mm, initial_mm),
        )


def _video_rows(crop: _Crop, windows: list[Window], settings: RigEvaluation) -> Iterator[Row]:
    size = crop.camera.width, crop.camera.height
    blank = np.zeros(size[::-1])
    truths = [picture(_log_view(crop, window.x_m[1]), size[::-1]) for window in windows]
    for name in settings.video:
        method, _ = ask("video", name, load_method("video", name), *size, crop.contrast_threshold)
        taker = ImageTaker(method, [window.end_us for window in windows])
        asked = chain(
            ask_each("video", name, taker.take, crop.events), ask_each("video", name, taker.rest)
        )
        answers = (taken[1] for taken, _ in asked if taken is not None)
        for window, truth, answer in zip(windows, truths, answers, strict=True):
            log_image, failure = image_answer("video", name, answer, blank)
            value = psnr_db(picture(log_image, size[::-1]), truth)
            at = crop, window, "video", name, "psnr_db"
            yield _row(*at, value, item=window.visit, failure=failure)
