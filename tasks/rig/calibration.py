"""`RigCalibration`: the solutions of recordings, and the file that `eres rig solve` writes."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from eres_render import Camera, Distortion
from eres_render.errors import reading
from eres_render.storage.settings_reader import Vector3, read_json
from tasks.errors import RigError
from tasks.rig.bundle import Corners, RigPose, solve
from tasks.rig.markers import Detections
from tasks.rig.recording import RigRecording

TRUTH_NAME = "truth.json"

_GRID = 9  # points along each side of the image at which views are compared
_EDGE_PX = 2.0  # a corner is an intersection of lines, so it can lie this far outside the image
_WINDOW_M = 0.006  # travel of a window of flow, m


@dataclass(frozen=True, slots=True)
class StoredPose:
    """A `RigPose` as stored in JSON: the rows of the rotation, and positions in m."""

    R_world_cam: tuple[Vector3, Vector3, Vector3]
    origin_m: Vector3
    direction: Vector3
    scale: float

    def __post_init__(self) -> None:
        R = np.array(self.R_world_cam)
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0:
            raise RigError("R_world_cam: is not a rotation matrix")

    @classmethod
    def of(cls, pose: RigPose) -> StoredPose:
        """Store a pose."""
        x, y, z = map(tuple, pose.R_world_cam.tolist())
        origin_m, direction = (tuple(v.tolist()) for v in (pose.origin_m, pose.direction))
        return cls((x, y, z), origin_m, direction, pose.scale)

    def on(self, camera: Camera) -> RigPose:
        """Return the pose of a camera."""
        R, origin_m, direction = map(np.array, (self.R_world_cam, self.origin_m, self.direction))
        return RigPose(camera, R, origin_m, direction, self.scale)


@dataclass(frozen=True, slots=True, kw_only=True)
class SolvedRecording:
    """The solution of one recording; `source` is as in `Detections`.

    The pose is for the time of the encoder's reading, without the latency. `latency_ms` is how late
    the images are, including the offset of the slider's clock. `corner_bias_px` is positive away
    from the middle of a marker. `estimated` names the parameters in the order of the covariance.
    `x_m` is the range of the slider in the images used. `intrinsics` are fx, fy, cx, cy, k1, k2,
    p1, p2, k3; files of earlier versions have none.
    """

    recording: str
    source: str
    width: int
    height: int
    pose: StoredPose
    latency_ms: float
    corner_bias_px: float
    estimated: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]
    rms_px: float
    markers: int
    inliers: int
    images: int
    x_m: tuple[float, float]
    intrinsics: tuple[float, ...] = ()

    def check_camera(self, camera: Camera) -> None:
        """Refuse a camera that is not the calibrated one."""
        solved, recorded = (self.width, self.height, *self.intrinsics), _numbers_of(camera)
        for (name, theirs), ours in zip(recorded.items(), solved, strict=False):
            if not math.isclose(ours, theirs, rel_tol=1e-9, abs_tol=1e-12):
                raise RigError(
                    f"calibration: its camera has {name} = {ours:.6g}, but the recording's camera "
                    f"has {name} = {theirs:.6g}; run `eres rig solve` again"
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class RigCalibration:
    """The solutions of recordings, and the coordinate frame of their poses."""

    gauge: str = "page: x right, y down, z into the page, origin in its top left corner, meters"
    recordings: tuple[SolvedRecording, ...]

    def of(self, recording: RigRecording) -> SolvedRecording:
        """Return the solution of a recording."""
        wanted = str(recording.folder.resolve())
        for solved in self.recordings:
            if solved.recording == wanted:
                solved.check_camera(recording.camera)
                return solved
        raise RigError(f"calibration: does not include {wanted}; run `eres rig solve` with it too")


def solve_recording(
    recording: RigRecording, detections: Detections, unknowns: tuple[str, ...], max_rms_px: float
) -> SolvedRecording:
    """Solve a recording from the markers in it; refuse larger residuals than `max_rms_px`."""
    page, camera = recording.page, recording.camera
    t_us, numbers, corners_px = detections.t_us, detections.number, detections.corners_px
    outside_px = (corners_px - (camera.width, camera.height)).max(initial=0.0)
    if outside_px > _EDGE_PX or numbers.max(initial=0) >= len(page.markers_m):
        raise RigError(
            f"{recording.folder}: its corners are from another page or camera; detect them again"
        )
    corners = Corners(t_us.astype(np.float64), page.corners()[numbers], corners_px)
    with reading(recording.folder, "a recording", RigError):
        solution = solve(corners, recording.slider, camera, unknowns)
    if solution.rms_px > max_rms_px:
        raise RigError(
            f"{recording.folder}: solve: the root mean square residual is {solution.rms_px:.2f} px,"
            f" more than --max-rms {max_rms_px:g}; check the clocks, the page and the camera"
        )
    used_us = t_us[solution.inliers]
    x_m = recording.slider.position_m(used_us)
    return SolvedRecording(
        recording=str(recording.folder.resolve()),
        source=detections.source,
        width=camera.width,
        height=camera.height,
        pose=StoredPose.of(solution.pose),
        latency_ms=solution.latency_ms,
        corner_bias_px=solution.corner_bias_px,
        estimated=solution.names,
        covariance=tuple(tuple(row) for row in solution.covariance.tolist()),
        rms_px=solution.rms_px,
        markers=len(t_us),
        inliers=int(solution.inliers.sum()),
        images=len(np.unique(used_us)),
        x_m=(float(x_m.min()), float(x_m.max())),
        intrinsics=tuple(_numbers_of(camera).values())[2:],
    )


def _numbers_of(camera: Camera) -> dict[str, float]:
    """Return the size, focal lengths, principal point and lens of a camera, by name."""
    names = "width", "height", "fx", "fy", "cx", "cy"
    lens = asdict(camera.distortion or Distortion())
    return {name: getattr(camera, name) for name in names} | lens


def read_rig_calibration(path: Path) -> RigCalibration:
    """Read calibration.json."""
    return read_json(RigCalibration, path, RigError)


@dataclass(frozen=True, slots=True)
class Errors:
    """How far a solved rig is from the truth, as root mean squares over the views of its stroke.

    `turn_deg` is the angle between the rotations, `image_px` the distance between the two images of
    a point of the page, and `flow_px` the difference of the displacements over 6 mm of travel at a
    pixel.
    """

    position_mm: float
    turn_deg: float
    image_px: float
    flow_px: float


def compare(pose: RigPose, truth: RigPose, x_m: tuple[float, float]) -> Errors:
    """Compare two solutions of a rig over a range of positions of the slider."""
    grid_px = pose.camera.grid(_GRID)
    positions = np.linspace(*x_m, _GRID)
    apart_m = pose.at(positions)[:, :3, 3] - truth.at(positions)[:, :3, 3]
    image, flow = [], []
    for x in positions.tolist():
        solved_m, true_m = (each.on_page(grid_px, x) for each in (pose, truth))
        image.append(pose.project(true_m, x) - grid_px)
        flow.append(pose.project(solved_m, x + _WINDOW_M) - truth.project(true_m, x + _WINDOW_M))
    turned_rad = Rotation.from_matrix(pose.R_world_cam.T @ truth.R_world_cam).magnitude()
    return Errors(1e3 * _rms(apart_m), float(np.rad2deg(turned_rad)), _rms(image), _rms(flow))


def _rms(vectors: ArrayLike) -> float:
    """Return the root mean square length of vectors (..., N)."""
    return float(np.sqrt(np.mean(np.sum(np.square(np.asarray(vectors)), axis=-1))))


def read_truth(recording: RigRecording) -> RigPose | None:
    """Return the true pose of a virtual recording, or None for a real one."""
    file = recording.folder / TRUTH_NAME
    return read_json(StoredPose, file, RigError).on(recording.camera) if file.exists() else None
