"""The field that all cameras of a rig see: one box of whole pixels for each recording.

A nearer camera sees less of the page, at more pixels per meter. The field is the part of the
nearest camera's view that all others see too. It moves along with the slider, as the cameras do; in
the image of each camera it is a fixed box. Events are not moved: the rotations of the cameras
relative to each other remain in the homographies.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import astuple, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eres_render import Camera, Distortion
from eres_render.progress import Progress, silent
from eres_render.storage.atomic import clear_unfinished, make_folder, write_text
from eres_render.storage.settings_reader import read_json
from eres_render.trajectory.tum import tum_text
from sensor import Events
from sensor.formats import read_events, write_events
from tasks.errors import RigError
from tasks.events.overwriting import check_new
from tasks.rig import page as page_files
from tasks.rig import settings as rig_files
from tasks.rig import slider as slider_files
from tasks.rig.bundle import RigPose
from tasks.rig.calibration import RigCalibration, StoredPose, on_page
from tasks.rig.page import read_page_image, write_print
from tasks.rig.recording import RigRecording
from tasks.rig.slider import Slider

Float64 = NDArray[np.float64]

FILE_NAME = "crop.json"
EVENTS_NAME = "events.h5"

_ALONG_SIDE = 65  # points of a side, which a lens bends
_POSITIONS = 33  # positions of the slider at which fields are compared
_MAX_ROLL_DEG = 20  # beyond, hardly any upright box fits into the rolled one
_POSES_US = 1000  # time between two written poses and homographies


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

    def corners(self) -> Float64:
        """Return the corners, (4, 2) px, clockwise from the top left."""
        (a, b), (c, d) = (self.left, self.top), (self.right, self.bottom)
        return np.array([[a, b], [c, b], [c, d], [a, d]], dtype=np.float64)

    def sides(self) -> Float64:
        """Return points along the sides, (4, N, 2) px, clockwise from the top left."""
        starts = self.corners()
        ends = np.roll(starts, -1, axis=0)
        return np.linspace(starts, ends, _ALONG_SIDE, axis=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cropped:
    """The content of crop.json: a recording cut to the common field.

    Parameters
    ----------
    width, height, fx, fy, cx, cy
        Size and intrinsics of the crop, px, (0, 0) at the corner of its first pixel.
    lens
        Distortion coefficients k1, k2, p1, p2 and k3 of OpenCV's model.
    box
        Where the crop is in the camera's image.
    latency_ms
        Latency of the images from which the rig was solved. The poses do not include it.
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
        self.camera()

    def camera(self) -> Camera:
        """Return the camera of the crop."""
        lens, size = Distortion(*self.lens), (self.width, self.height)
        return Camera(*size, fx=self.fx, fy=self.fy, cx=self.cx, cy=self.cy, distortion=lens)


def common_boxes(
    cameras: list[Camera], poses: list[RigPose], x_m: tuple[float, float]
) -> list[Box]:
    """Return the box of the common field for each camera.

    Parameters
    ----------
    x_m
        Smallest and largest position of the slider, m.
    """
    both = list(zip(cameras, poses, strict=True))
    depths = [abs(pose.at(np.mean(x_m))[2, 3]) / camera.fx for camera, pose in both]
    nearest = int(np.argmin(depths))
    for pose in poses:
        right = poses[nearest].R_world_cam[:, :2].T @ pose.R_world_cam[:, 0]
        roll_deg = math.degrees(math.atan2(right[1], right[0]))
        if _MAX_ROLL_DEG < abs(roll_deg) < 180 - _MAX_ROLL_DEG:
            raise RigError(
                f"crop: a camera is rolled by {roll_deg:.0f} degrees relative to the nearest "
                f"camera; the limit is {_MAX_ROLL_DEG} degrees from upright or upside down"
            )
    positions = np.linspace(*x_m, _POSITIONS).tolist()
    boxes = [Box(0, 0, camera.width, camera.height) for camera in cameras]
    field = boxes[nearest]
    for (camera, pose), whole in zip(both, boxes, strict=True):
        for x in positions:
            sides_m = on_page(pose, camera, whole.sides(), x)
            field = _inside(field, poses[nearest].project(cameras[nearest], sides_m, x))
    for k, (camera, pose) in enumerate(both):
        for x in positions:
            sides_m = on_page(poses[nearest], cameras[nearest], field.sides(), x)
            boxes[k] = _inside(boxes[k], pose.project(camera, sides_m, x))
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


def homography(camera: Camera, pose: RigPose, x_m: float) -> Float64:
    """Return the matrix (3, 3) from (x, y, 1) on the page, m, to homogeneous pixels.

    Parameters
    ----------
    camera
        The camera. With a lens, the pixels are those of a pinhole with the same `K`.
    x_m
        Position of the slider, m.

    Returns
    -------
    H
        (3, 3), with last entry 1.
    """
    T = pose.at(x_m)
    R_cam_world = T[:3, :3].T
    columns = np.column_stack([R_cam_world[:, :2], -R_cam_world @ T[:3, 3]])
    H = camera.K @ columns
    return H / H[2, 2]


def crop(
    recordings: list[RigRecording],
    calibration: RigCalibration,
    out: Path,
    *,
    overwrite: bool = False,
    on_progress: Progress = silent,
) -> list[Path]:
    """Cut recordings to the field that all of them show.

    Writes one folder for each recording, with the same name: events.h5; crop.json (the box, the
    camera of the crop and its pose); poses.txt (TUM, T_world_cam) and homographies.csv (from the
    page to the crop) every millisecond; slider.csv; and the page.
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
    cameras = [recording.camera for recording in recordings]
    boxes = common_boxes(cameras, [solution.pose.pose() for solution in solved], x_m)
    for folder in folders:
        if (folder / rig_files.FILE_NAME).exists():
            raise RigError(f"{folder}: contains a recording; choose another --out")
        clear_unfinished(folder)
        check_new(folder / FILE_NAME, overwrite)
    for file in out.glob(f"*/{FILE_NAME}"):
        if file.parent not in folders:
            raise RigError(f"{file.parent}: is a crop of another recording; choose another --out")
    for folder in folders:  # the field may be another one
        (folder / FILE_NAME).unlink(missing_ok=True)
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
    codes = read_page_image(recording.folder / page_files.IMAGE_NAME, page)
    page_files.write_page(folder / page_files.FILE_NAME, page)
    write_print(folder / page_files.IMAGE_NAME, codes, page)
    slider_files.write_slider(folder / slider_files.FILE_NAME, recording.slider)
    _write_poses(folder, recording.slider, cropped)
    write_events(folder / EVENTS_NAME, _cut(recording.events(), cropped.box))
    page_files.write_json(folder / FILE_NAME, cropped)


def _cut(parts: Iterator[Events], box: Box) -> Iterator[Events]:
    """Yield the events in a box, which is then the whole sensor."""
    for part in parts:
        model = part.model
        if model is not None:
            model = replace(model, width=box.width, height=box.height)
        inside = (part.x >= box.left) & (part.x < box.right)
        part = part.where(inside & (part.y >= box.top) & (part.y < box.bottom))
        x, y = part.x - np.uint16(box.left), part.y - np.uint16(box.top)
        yield Events(part.t_us, x, y, part.p, box.width, box.height, model)


def _write_poses(folder: Path, slider: Slider, cropped: Cropped) -> None:
    pose, camera = cropped.pose.pose(), cropped.camera()
    t_us = np.arange(np.ceil(slider.t_us[0]), slider.t_us[-1], _POSES_US)
    x_m = slider.position_m(t_us)
    write_text(folder / "poses.txt", tum_text(1e-6 * t_us, pose.at(x_m)))
    lines = ["t_us," + ",".join(f"h{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))]
    for t, x in zip(t_us.tolist(), x_m.tolist(), strict=True):
        values = homography(camera, pose, x).ravel().tolist()
        lines.append(f"{t:.0f}," + ",".join(map(repr, values)))
    write_text(folder / "homographies.csv", "\n".join(lines) + "\n")


def read_crop(folder: Path) -> Cropped:
    """Read crop.json."""
    return read_json(Cropped, folder / FILE_NAME, RigError)


def span_of_events(folder: Path) -> tuple[int, int]:
    """Return the times of the first and the last event of a crop, us."""
    file = folder / EVENTS_NAME
    ends = [int(part.t_us[k]) for part in read_events(file) if len(part) for k in (0, -1)]
    if not ends:
        raise RigError(f"{file}: has no events")
    return ends[0], ends[-1]
