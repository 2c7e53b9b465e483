"""The field that all cameras of a rig see: one box of whole pixels for each recording.

A nearer camera sees less of the page, at more pixels per meter. The field is the part of the
nearest camera's view that all others see too. It moves along with the slider, as the cameras do; in
the image of each camera it is a fixed box. Events are not moved: the rotations of the cameras
relative to each other remain in the homographies. The light that a crop saw are views of its page
from the solved poses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import astuple, dataclass, replace
from pathlib import Path

import numpy as np

from eres_render import Camera, Distortion
from eres_render.progress import Progress, silent
from eres_render.storage.atomic import clear_unfinished, make_folder, write_text
from eres_render.storage.settings_reader import read_json
from eres_render.trajectory.tum import tum_text
from sensor import Events
from sensor.formats import read_events, write_events
from tasks.errors import RigError
from tasks.events.overwriting import check_new
from tasks.footage import Footage
from tasks.rig import page as pages
from tasks.rig.bundle import RigPose
from tasks.rig.calibration import RigCalibration, StoredPose
from tasks.rig.recording import RigRecording, span_us
from tasks.rig.settings import RIG_FILE
from tasks.rig.slider import SLIDER_FILE, Float64, Slider, read_slider, slider_text

CROP_FILE = "crop.json"
EVENTS_NAME = "events.h5"

_ALONG_SIDE = 65  # points of a side, which a lens bends
_POSITIONS = 33  # positions of the slider at which fields are compared
_MAX_ROLL_DEG = 20  # beyond, hardly any upright box fits into the rolled one
_POSES_US = 1000  # time between two written poses and homographies
_STEP_PX = 0.5  # motion between two frames of the light
_STEP_US = 100.0  # time between two positions of which the motion is known
_MAX_STEPS = 1000
_NEAR_M = 1e-4  # on both sides of a position of the slider, for the motion there


@dataclass(frozen=True, slots=True)
class Box:
    """Pixels [left, right) x [top, bottom) of an image."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def width(self) -> int:
        """Width, px."""
        return self.right - self.left

    @property
    def height(self) -> int:
        """Height, px."""
        return self.bottom - self.top

    def sides(self) -> Float64:
        """Return points along the sides, (4, N, 2) px, clockwise from the top left."""
        (a, b), (c, d) = (self.left, self.top), (self.right, self.bottom)
        starts = np.array([[a, b], [c, b], [c, d], [a, d]], dtype=np.float64)
        return np.linspace(starts, np.roll(starts, -1, axis=0), _ALONG_SIDE, axis=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cropped:
    """The content of crop.json: a recording cut to `box`, its part of the common field.

    Intrinsics are in px from the corner of the crop's first pixel; `lens` is OpenCV's k1, k2, p1,
    p2, k3. The images from which the rig was solved were late by `latency_ms`, which the poses
    exclude.
    """

    scene: str
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    lens: tuple[float, float, float, float, float]
    box: Box
    pose: StoredPose
    latency_ms: float

    def __post_init__(self) -> None:
        self.view()

    def view(self) -> RigPose:
        """Return the camera of the crop with its pose."""
        lens, size = Distortion(*self.lens), (self.width, self.height)
        camera = Camera(*size, fx=self.fx, fy=self.fy, cx=self.cx, cy=self.cy, distortion=lens)
        return self.pose.on(camera)


def common_boxes(poses: list[RigPose], x_m: tuple[float, float]) -> list[Box]:
    """Return each camera's box of the common field, over a range of positions of the slider."""
    depths = [abs(pose.at(np.mean(x_m))[2, 3]) / pose.camera.fx for pose in poses]
    nearest = poses[int(np.argmin(depths))]
    for pose in poses:
        right = nearest.R_world_cam[:, :2].T @ pose.R_world_cam[:, 0]
        roll_deg = math.degrees(math.atan2(right[1], right[0]))
        if _MAX_ROLL_DEG < abs(roll_deg) < 180 - _MAX_ROLL_DEG:
            raise RigError(
                f"crop: a camera is rolled by {roll_deg:.0f} degrees relative to the nearest "
                f"camera; the limit is {_MAX_ROLL_DEG} degrees from upright or upside down"
            )
    positions = np.linspace(*x_m, _POSITIONS).tolist()
    boxes = [Box(0, 0, pose.camera.width, pose.camera.height) for pose in poses]
    field = boxes[poses.index(nearest)]
    for pose, whole in zip(poses, boxes, strict=True):
        for x in positions:
            field = _inside(field, nearest.project(pose.on_page(whole.sides(), x), x))
    for k, pose in enumerate(poses):
        for x in positions:
            boxes[k] = _inside(boxes[k], pose.project(nearest.on_page(field.sides(), x), x))
    return boxes


def _inside(box: Box, sides_px: Float64) -> Box:
    """Return the part of a box within four bent sides, (4, N, 2) clockwise from any corner."""
    # A camera may be upside down, so the corner at its top left is looked for.
    first = int(np.argmin(sides_px[:, 0].sum(axis=1)))
    top, right, bottom, left = np.roll(sides_px, -first, axis=0)
    part = Box(
        max(box.left, int(np.ceil(left[:, 0].max() - 1e-6))),
        max(box.top, int(np.ceil(top[:, 1].max() - 1e-6))),
        min(box.right, int(np.floor(right[:, 0].min() + 1e-6))),
        min(box.bottom, int(np.floor(bottom[:, 1].min() + 1e-6))),
    )
    if part.width < 1 or part.height < 1:
        raise RigError("crop: no part of the page stays visible to all cameras; reduce the travel")
    return part


def homography(pose: RigPose, x_m: float) -> Float64:
    """Return the matrix (3, 3) from (x, y, 1) on the page, m, to homogeneous pixels.

    Its last entry is 1. With a lens, the pixels are as in a pinhole camera with the same `K`.
    """
    R_cam_world, position_m = pose.R_world_cam.T, pose.at(x_m)[:3, 3]
    H = pose.camera.K @ np.column_stack([R_cam_world[:, :2], -R_cam_world @ position_m])
    return H / H[2, 2]


def crop(
    recordings: list[RigRecording],
    calibration: RigCalibration,
    out: Path,
    *,
    overwrite: bool = False,
    on_progress: Progress = silent,
) -> list[Path]:
    """Cut recordings to the field that all of them show, each to a folder of its name in `out`.

    A folder has events.h5, crop.json, slider.csv, the page, and for every millisecond a line in
    poses.txt (TUM, T_world_cam) and in homographies.csv (from the page to the crop).
    """
    solved = [calibration.of(recording) for recording in recordings]
    folders = [out / recording.folder.resolve().name for recording in recordings]
    if len(set(folders)) < len(folders):
        raise RigError("crop: two recordings have the same folder name; rename one folder")
    if any(recording.page != recordings[0].page for recording in recordings):
        raise RigError("crop: the recordings show different pages; crop each page separately")
    x_m = max(solution.x_m[0] for solution in solved), min(solution.x_m[1] for solution in solved)
    if not x_m[0] < x_m[1]:
        raise RigError("crop: the recordings share no range of slider positions")
    both = zip(solved, recordings, strict=True)
    boxes = common_boxes([solution.pose.on(recording.camera) for solution, recording in both], x_m)
    for folder in folders:
        if (folder / RIG_FILE).exists():
            raise RigError(f"{folder}: contains a recording; choose another --out")
        clear_unfinished(folder)
        check_new(folder / CROP_FILE, overwrite)
    for file in out.glob(f"*/{CROP_FILE}"):
        if file.parent not in folders:
            raise RigError(f"{file.parent}: is a crop of another recording; choose another --out")
    for folder in folders:  # the field may be another one
        (folder / CROP_FILE).unlink(missing_ok=True)
    for k, (recording, box) in enumerate(zip(recordings, boxes, strict=True)):
        camera = recording.camera.cropped(box.left, box.top, box.width, box.height)
        cropped = Cropped(
            scene=recording.settings.page.picture,
            **{name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")},
            lens=astuple(camera.distortion or Distortion()),
            box=box,
            pose=solved[k].pose,
            latency_ms=solved[k].latency_ms,
        )
        _write(folders[k], recording, cropped)
        on_progress("cropping", k + 1, len(recordings))
    return folders


def _write(folder: Path, recording: RigRecording, cropped: Cropped) -> None:
    """Write a crop; crop.json is written last and marks it as complete."""
    make_folder(folder)
    page = recording.page
    codes = pages.read_page_image(recording.folder / pages.IMAGE_NAME, page)
    write_text(folder / pages.FILE_NAME, pages.json_text(page))
    pages.write_print(folder / pages.IMAGE_NAME, codes, page)
    write_text(folder / SLIDER_FILE, slider_text(recording.slider))
    _write_poses(folder, recording.slider, cropped)
    write_events(folder / EVENTS_NAME, _cut(recording.events(), cropped.box))
    write_text(folder / CROP_FILE, pages.json_text(cropped))


def _cut(parts: Iterator[Events], box: Box) -> Iterator[Events]:
    """Yield the events in a box, which is then the whole sensor."""
    for part in parts:
        model = part.model and replace(part.model, width=box.width, height=box.height)
        inside = (part.x >= box.left) & (part.x < box.right)
        part = part.where(inside & (part.y >= box.top) & (part.y < box.bottom))
        x, y = part.x - np.uint16(box.left), part.y - np.uint16(box.top)
        yield Events(part.t_us, x, y, part.p, box.width, box.height, model)


def _write_poses(folder: Path, slider: Slider, cropped: Cropped) -> None:
    pose = cropped.view()
    t_us = np.arange(np.ceil(slider.t_us[0]), slider.t_us[-1], _POSES_US)
    x_m = slider.position_m(t_us)
    write_text(folder / "poses.txt", tum_text(1e-6 * t_us, pose.at(x_m)))
    lines = ["t_us," + ",".join(f"h{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))]
    for t, x in zip(t_us.tolist(), x_m.tolist(), strict=True):
        lines.append(f"{t:.0f}," + ",".join(map(repr, homography(pose, x).ravel().tolist())))
    write_text(folder / "homographies.csv", "\n".join(lines) + "\n")


def read_crop(folder: Path) -> Cropped:
    """Read crop.json."""
    return read_json(Cropped, folder / CROP_FILE, RigError)


def light_of_crop(folder: Path) -> Footage:
    """Return the light of a crop during its fastest motion, in steps of half a pixel."""
    pose, slider = read_crop(folder).view(), read_slider(folder / SLIDER_FILE)
    view = pages.page_views(pose, *pages.read_print(folder))
    first_us, last_us = span_us(folder / EVENTS_NAME, read_events(folder / EVENTS_NAME))
    t_us = np.arange(max(first_us, slider.t_us[0]), min(last_us, slider.t_us[-1]), _STEP_US)
    if len(t_us) < 2:
        raise RigError(f"{folder}: the events and the slider's readings do not overlap in time")
    x_m = slider.position_m(t_us)
    # Of points in view: a lens compresses the way of one that leaves the middle of the image.
    at_m = pose.on_page(pose.camera.grid(3), float(x_m.mean()))
    ends_px = pose.project(at_m, x_m.mean() + np.array([-_NEAR_M, _NEAR_M]))
    px_per_m = float(np.linalg.norm(ends_px[1] - ends_px[0], axis=1).max()) / (2 * _NEAR_M)
    way = np.abs(np.diff(x_m)).cumsum() * px_per_m / _STEP_PX
    steps = int(way[-1])
    if steps < 2:
        raise RigError(f"{folder}: the image moves only {_STEP_PX * way[-1]:.2g} px in all")
    knots_us = np.interp(np.arange(steps + 1), np.concatenate([[0.0], way]), t_us)
    length = min(_MAX_STEPS, steps)
    start = int(np.argmin(knots_us[length:] - knots_us[:-length]))
    chosen_us = knots_us[start : start + length + 1]
    positions_m = slider.position_m(chosen_us).tolist()
    offset_us = int(chosen_us[0])
    return Footage(
        path=folder,
        t_s=1e-6 * (chosen_us - offset_us),
        t_offset_us=offset_us,
        height=pose.camera.height,
        width=pose.camera.width,
        encoding="linear",
        white_level=1.0,
        frames=lambda: (view(x).astype(np.float32) for x in positions_m),
    )
