"""Scores of the methods on crops of a rig: flow, video and tracking.

The truth comes from the solved poses, at the time of the encoder's readings. It does not include
the sensor's delay, which is part of what is scored.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
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
    MARGIN_PX,
    REFERENCE_WIDTH_PX,
    corners,
    flow_sample,
    initial_sigma_px,
    patch_px,
    rnepe_px,
)
from tasks.methods import load_method
from tasks.psnr import psnr_db
from tasks.rig import page as page_files
from tasks.rig import slider as slider_files
from tasks.rig.bundle import RigPose
from tasks.rig.calibration import on_page
from tasks.rig.cells import in_cells
from tasks.rig.crop import EVENTS_NAME, FILE_NAME, Cropped, read_crop
from tasks.rig.page import Page, read_page_image, reflectance
from tasks.rig.page_view import page_view
from tasks.rig.slider import Slider
from tasks.row import Row
from tasks.tracking import failure_of, path_at, perturbed, position_error_mm, tracking_sample
from tasks.variants import NATIVE_PATCH, sigma_variant
from tasks.video import ImageTaker, picture

Float64 = NDArray[np.float64]

PLANE = Plane(normal=(0.0, 0.0, -1.0), offset_m=0.0)

_EVEN = 1e-3  # largest deviation from constant speed within a window, as a fraction of the travel
_ROUNDS = 3  # to find the window of a travel; readings of an encoder are in steps


@dataclass(frozen=True, slots=True, kw_only=True)
class RigEvaluation:
    """What is scored on each crop.

    Parameters
    ----------
    windows
        Number of windows on each crop, evenly spaced along the slider's travel; those without
        constant speed are left out.
    travel_m
        Travel of the slider in a window, m.
    flow, video, tracking
        Names of the methods of each task, or "package.module:function".
    features
        Largest number of patches in each window, all in the picture.
    initial_sigma_px
        Error of the initial flow: standard deviation of each component, px at a width of 1280 px.
    initial_sigma_mm
        Error of the initial path's control positions, mm.
    contrast_threshold
        C, log units; by default that of the file of events, if it was simulated.
    cutoff_hz
        Cutoff of the photoreceptor that the rows store, Hz; by default that of the file of events,
        if it was simulated, and inf otherwise. No score depends on it.
    seed
        Seed of the initial errors.
    """

    windows: int = 10
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
        positive = "windows", "features", "travel_m", "initial_sigma_mm", "initial_sigma_px"
        for name in positive:
            check_positive(name, getattr(self, name), RigError)
        for name in ("cutoff_hz", "contrast_threshold"):
            if getattr(self, name) is not None:
                check_positive(name, getattr(self, name), RigError)
        if not self.seed >= 0:
            raise RigError(f"seed: found {self.seed}, expected at least 0")


@dataclass(frozen=True, slots=True)
class _Window:
    """A time window of constant speed."""

    number: int
    place: int  # number of the place on the page, which windows there and back share
    start_us: int
    end_us: int
    x_m: tuple[float, float]  # the encoder's reading at the start and the end

    @property
    def encoder_mps(self) -> float:
        """Speed by the encoder, whose scale `eres rig solve --scale` finds."""
        return 1e6 * abs(self.x_m[1] - self.x_m[0]) / (self.end_us - self.start_us)


@dataclass(frozen=True, eq=False, slots=True)
class _Crop:
    """A crop in memory."""

    cropped: Cropped
    slider: Slider
    page: Page
    light: Float64  # (H, W) reflectance of the page
    events: Events
    contrast_threshold: float
    cutoff_hz: float
    camera: Camera = field(init=False)
    pose: RigPose = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "camera", self.cropped.camera())
        object.__setattr__(self, "pose", self.cropped.pose.pose())

    def settings_of_encoder(self, settings: RigEvaluation) -> RigEvaluation:
        """Return the settings with the travel of a window by the encoder."""
        return replace(settings, travel_m=settings.travel_m / self.pose.scale)


def evaluate_rig(
    folders: Sequence[Path], settings: RigEvaluation, *, on_progress: Progress = silent
) -> list[Row]:
    """Score methods on all crops of a rig.

    Parameters
    ----------
    folders
        Folders that `eres rig crop` wrote, such as one for each print.
    settings
        What is scored.
    on_progress
        Called after each window.

    Returns
    -------
    rows
        `speed` and `speed_m_s` are in m/s, `width` is that of the crop, `scene` is the picture, and
        `cutoff_hz` is inf if it is not known. Widths, speeds and samples are grouped by `in_cells`.

    Raises
    ------
    RigError
        If there are no crops, the contrast threshold is not known, no window has constant speed,
        no speed is common to all distances, there is nothing to score, or a camera has lens
        distortion and tracking is scored.
    """
    if not folders:
        raise RigError("crops: found no folder, expected those of `eres rig crop`")
    crops = [one for folder in folders for one in crops_in(folder)]
    nearest = _nearest([read_crop(one) for one in crops])
    found: list[list[Row]] = []
    for k, one in enumerate(crops):
        crop = _load(one, settings)
        try:
            windows = _windows(crop.slider, crop.events, crop.settings_of_encoder(settings))
        except RigError as error:
            raise RigError(f"{one}: {error}") from None
        rows: list[Row] = []
        for n, window in enumerate(windows):
            rows += _flow_rows(crop, nearest[crop.cropped.scene], window, settings)
            rows += _tracking_rows(crop, window, settings)
            on_progress("evaluating", k + (n + 1) / len(windows), len(crops))
        rows += _video_rows(crop, windows, settings)
        found.append(rows)
    if not any(found):
        raise RigError(
            "crops: found nothing to score: no task, no corners in the picture, or windows too "
            "close to the ends of the slider's readings for tracking"
        )
    return in_cells(found)


def crops_in(folder: Path) -> list[Path]:
    """Return the folders of the crops that `eres rig crop` wrote.

    Raises
    ------
    RigError
        If there is none.
    """
    found = sorted(file.parent for file in folder.glob(f"*/{FILE_NAME}"))
    if not found:
        raise RigError(f"{folder}: found no crop, expected those of `eres rig crop`")
    return found


def _load(folder: Path, settings: RigEvaluation) -> _Crop:
    cropped = read_crop(folder)
    if settings.tracking and any(cropped.lens):
        raise RigError(
            f"{folder / FILE_NAME}: lens: found {cropped.lens}, expected a pinhole for tracking; "
            "score --tasks flow video"
        )
    page = page_files.read_page(folder / page_files.FILE_NAME)
    file = folder / EVENTS_NAME
    model = read_header(file).model
    C = settings.contrast_threshold
    if C is None:
        if model is None:
            raise RigError(f"{file}: found no contrast threshold, expected --threshold C")
        C = model.contrast_threshold
    return _Crop(
        cropped,
        slider_files.read_slider(folder / slider_files.FILE_NAME),
        page,
        reflectance(read_page_image(folder / page_files.IMAGE_NAME, page)),
        concatenate(list(read_events(file))),
        C,
        settings.cutoff_hz or (math.inf if model is None else model.cutoff_hz),
    )


def _windows(slider: Slider, events: Events, settings: RigEvaluation) -> list[_Window]:
    """Return windows of constant speed, evenly spaced along the slider's travel."""
    if not len(events):
        raise RigError(f"{EVENTS_NAME}: found no events, expected some")
    first_us, last_us = int(events.t_us[0]), int(events.t_us[-1])
    first_us, last_us = max(first_us, int(slider.t_us[0])), min(last_us, int(slider.t_us[-1]))
    middles_us = slider.evenly_along(settings.windows, first_us, last_us)
    found: list[_Window] = []
    for t_us in middles_us.tolist():
        half_us = _half_us(slider, t_us, settings.travel_m)
        start_us, end_us = t_us - half_us, t_us + half_us
        if half_us == 0 or start_us < first_us or end_us > last_us:
            continue
        x = slider.position_m(np.linspace(start_us, end_us, 5))
        moved_m = abs(x[-1] - x[0])
        if np.max(np.abs(x - np.linspace(x[0], x[-1], 5))) < _EVEN * moved_m:
            found.append(_Window(len(found), 0, start_us, end_us, (float(x[0]), float(x[-1]))))
    if not found:
        raise RigError(
            f"{EVENTS_NAME}: found no window of constant speed among {settings.windows} in "
            f"{1e-6 * (last_us - first_us):.3g} s, expected some of {1e3 * settings.travel_m:g} mm "
            "of travel; give more windows, or less travel"
        )
    return _at_places(found, settings.travel_m)


def _half_us(slider: Slider, t_us: int, travel_m: float) -> int:
    """Return half the time of a travel around a time, us; 0 at rest or outside the readings."""
    speed = abs(float(slider.speed_mps(t_us)))
    if speed == 0:  # at the end of a stroke
        return 0
    half_us = 0.5e6 * travel_m / speed
    for _ in range(_ROUNDS):
        if t_us - half_us < slider.t_us[0] or t_us + half_us > slider.t_us[-1]:
            return 0
        start_m, end_m = slider.position_m([t_us - half_us, t_us + half_us]).tolist()
        if start_m == end_m:  # there and back
            return 0
        half_us *= travel_m / abs(end_m - start_m)
    return round(half_us)


def _at_places(windows: list[_Window], travel_m: float) -> list[_Window]:
    """Return the windows with the numbers of their places, less than a travel long each.

    Scores at one place are alike, as they are of the same part of the page.
    """
    middles = {one.number: 0.5 * sum(one.x_m) for one in windows}
    places: dict[int, int] = {}
    count, begin_m = 0, -math.inf
    for number in sorted(middles, key=lambda k: middles[k]):
        if middles[number] - begin_m >= travel_m:
            count, begin_m = count + 1, middles[number]
        places[number] = count - 1
    return [replace(one, place=places[one.number]) for one in windows]


def _log_view(crop: _Crop, x_m: float) -> Float64:
    return np.log(page_view(crop.camera, crop.pose, x_m, crop.page, crop.light) + DARK_FRACTION)


def _row(
    crop: _Crop,
    window: _Window,
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


def _nearest(crops: Sequence[Cropped]) -> dict[str, Cropped]:
    """Return the crop of each picture that resolves it best."""
    found: dict[str, Cropped] = {}
    for one in crops:
        best = found.setdefault(one.scene, one)
        if one.width > best.width:  # of the field that all of them show
            found[one.scene] = one
    return found


def _features(
    crop: _Crop, nearest: Cropped, window: _Window, count: int
) -> tuple[Float64, Float64]:
    """Return corners of the picture that stay in the crop, (N, 2) px, and their displacements.

    They are corners of the nearest view, so that every distance has the same ones.
    """
    camera, pose = nearest.camera(), nearest.pose.pose()
    view = page_view(camera, pose, window.x_m[0], crop.page, crop.light)
    found_px = corners(view, MARGIN_PX * camera.width / REFERENCE_WIDTH_PX)
    points_m = on_page(pose, camera, found_px, window.x_m[0])
    camera, pose = crop.camera, crop.pose
    centers_px = pose.project(camera, points_m, window.x_m[0])
    moved_px = pose.project(camera, points_m, window.x_m[1])
    left, top, right, bottom = crop.page.picture_m
    x, y = points_m.T
    kept = (x > left) & (x < right) & (y > top) & (y < bottom)
    for at_px in (centers_px, moved_px):
        kept &= np.all((at_px > 0) & (at_px < (camera.width, camera.height)), axis=1)
    return centers_px[kept][:count], (moved_px - centers_px)[kept][:count]


def _flow_rows(
    crop: _Crop, nearest: Cropped, window: _Window, settings: RigEvaluation
) -> Iterator[Row]:
    if not settings.flow:
        return
    width = crop.camera.width
    centers_px, flow_px = _features(crop, nearest, window, settings.features)
    sigma_px = initial_sigma_px(width, settings.initial_sigma_px)
    rng = np.random.default_rng([settings.seed, window.number])
    initial_px = flow_px + sigma_px * rng.standard_normal((settings.features, 2))[: len(flow_px)]
    log_image = _log_view(crop, window.x_m[0])
    sides = {patch_px(width): [""]}
    sides.setdefault(patch_px(width, native=True), []).append(NATIVE_PATCH)
    for side_px, variants in sides.items():
        for item in range(len(centers_px)):
            sample = flow_sample(
                crop.events,
                window.start_us,
                window.end_us,
                log_image=log_image,
                contrast_threshold=crop.contrast_threshold,
                center_px=centers_px[item],
                side_px=side_px,
                initial=initial_px[item],
                initial_sigma_px=sigma_px,
            )
            for name in settings.flow:
                answer, _ = ask("flow", name, load_method("flow", name), sample)
                estimate = flow_answer("flow", name, answer, sample.initial)
                error_px = rnepe_px(estimate.flow, flow_px[item], width)
                for variant in variants:
                    yield _row(
                        *(crop, window, "flow", name, "rnepe_px", error_px),
                        variant=variant,
                        item=window.number * settings.features + item,
                        failure=estimate.failure,
                    )


def _tracking_rows(crop: _Crop, window: _Window, settings: RigEvaluation) -> Iterator[Row]:
    if not settings.tracking:
        return

    def pose(t_s: Float64) -> Float64:
        return crop.pose.at(crop.slider.position_m(window.start_us + 1e6 * t_s))

    margin_us = 20_000  # a path lasts 14 ms, and has a control pose before it and one after it
    slider_us, delay_us = crop.slider.t_us, Tracking(methods=settings.tracking).delay_us
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
        initial=perturbed(truth, sigma_m, [settings.seed, window.number]),
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
            item=window.number,
            failure=failure_of(estimate, sample.initial, error_mm, initial_mm),
        )


def _video_rows(crop: _Crop, windows: list[_Window], settings: RigEvaluation) -> Iterator[Row]:
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
            yield _row(*at, value, item=window.number, failure=failure)
