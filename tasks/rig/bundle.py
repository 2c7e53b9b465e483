"""Bundle adjustment of a camera on a slider, from the corners of known markers.

The camera does not turn; its position is

    p(x) = origin + scale * x * direction,

with the slider's position x. That is eight parameters: the camera's rotation (3), its position at
x = 0 (3), and the direction of travel (2). The pose of the slider's base (6) and the rotation of
the camera on its carriage (3) would be nine, one too many: turning the base about the direction of
travel and the camera back by the same angle changes no image.

Three more can be unknown. Events are late, so an image at time t shows where the slider was at
t - latency: latency and position cannot be told apart if the slider moves one way only. The scale
of the encoder may be off. And dark markers look smaller in images of log intensity: each corner is
displaced by `corner_bias_px` away from the middle of its marker, or toward it if negative.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import OptimizeResult, least_squares
from scipy.spatial.transform import Rotation

from eres_render import Camera, RenderError
from tasks.errors import RigError
from tasks.rig.slider import Float64, Slider

PARAMETERS = (
    *("turn_x_rad", "turn_y_rad", "turn_z_rad"),
    *("origin_x_m", "origin_y_m", "origin_z_m"),
    *("direction_1_rad", "direction_2_rad"),
)
LATENCY, SCALE, CORNER_BIAS = "latency_ms", "scale", "corner_bias_px"

_MIN_POSITIONS, _MIN_MARKERS = 3, 6
_OUTLIER = 4.0  # robust standard deviations of the residuals of all corners
_MIN_SIGMA_PX = 0.05  # lower limit of that standard deviation
_MIN_INLIERS = 0.5
_ROUNDS = 10
_MAX_STEPS = 200
_WORST_CONDITION = 1e-6  # smallest singular value of the scaled Jacobian, over the largest
_MIN_SPEED = 0.2  # fraction of the highest speed above which an image counts as moving
_MIN_SHARE = 0.1  # fraction of the moving images, in each direction


@dataclass(frozen=True, eq=False, slots=True)
class Corners:
    """Corners of M markers in images: (M,) times on the readings' clock, and (M, 4, 2) positions.

    `page_m` runs to the right and down from the page's top left, `image_px` from the corner of the
    first pixel.
    """

    t_us: Float64
    page_m: Float64
    image_px: Float64

    def of(self, chosen: NDArray[np.bool_]) -> Corners:
        """Return the markers chosen by a mask, (M,)."""
        return Corners(self.t_us[chosen], self.page_m[chosen], self.image_px[chosen])


@dataclass(frozen=True, eq=False, slots=True)
class RigPose:
    """A camera, and where it is for each position of its slider.

    The world is the page: x to the right, y down, z into the page, and the origin at its top left
    corner. `origin_m` is the camera's position at the slider's 0, and `direction` is a unit vector.
    """

    camera: Camera
    R_world_cam: Float64
    origin_m: Float64
    direction: Float64
    scale: float = 1.0

    def at(self, x_m: ArrayLike) -> Float64:
        """Return T_world_cam, (..., 4, 4), at the positions (...) of the slider, m."""
        x = np.asarray(x_m, dtype=np.float64)
        T = np.zeros((*x.shape, 4, 4))
        T[..., :3, :3], T[..., 3, 3] = self.R_world_cam, 1.0
        T[..., :3, 3] = self.origin_m + self.scale * x[..., None] * self.direction
        return T

    def project(self, points_m: Float64, x_m: ArrayLike) -> Float64:
        """Return the pixels, (..., N, 2), of points of the page at slider positions, (...)."""
        world = np.concatenate([points_m, np.zeros_like(points_m[..., :1])], axis=-1)
        return self.camera.project((world - self.at(x_m)[..., None, :3, 3]) @ self.R_world_cam)

    def on_page(self, points_px: Float64, x_m: float) -> Float64:
        """Return the points of the page, (..., 2) m, that the camera sees at pixels, (..., 2)."""
        position = self.at(x_m)[:3, 3]
        rays = self.camera.rays(points_px) @ self.R_world_cam.T
        return position[:2] - rays[..., :2] * (position[2] / rays[..., 2:])


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Solution:
    """A solved rig of P parameters; `inliers`, (M,), tells which markers were used.

    The covariance, (P, P), is of turns about the camera's axes, rad, the origin, m, and turns of
    the direction of travel, rad; the names of other unknowns state their units. It assumes that
    corners are independent and as noisy as the residuals.
    """

    pose: RigPose
    latency_ms: float
    corner_bias_px: float
    names: tuple[str, ...]
    covariance: Float64
    rms_px: float
    inliers: NDArray[np.bool_]


def solve(
    corners: Corners, slider: Slider, camera: Camera, unknowns: tuple[str, ...] = ()
) -> Solution:
    """Find the camera's pose, direction of travel and `unknowns` by least squares in the image.

    `unknowns` are some of `LATENCY`, `SCALE` and `CORNER_BIAS`. After each fit, markers are left
    out if a corner's distance is more than four times the robust root mean square distance.
    """
    _check_enough(corners, slider)
    x_m = slider.position_m(corners.t_us)
    # From the first reading: steps of the search are far below a microsecond.
    origin_us = slider.t_us[0]
    corners = replace(corners, t_us=corners.t_us - origin_us)
    slider = replace(slider, t_us=slider.t_us - origin_us)
    model = _Model(slider, unknowns, _first_guess(corners, x_m, camera))
    inliers = np.ones(len(corners.t_us), bool)
    values = np.array([float(name == SCALE) for name in PARAMETERS + unknowns])
    for _ in range(_ROUNDS):
        used = corners.of(inliers)
        if LATENCY in unknowns:
            _check_both_directions(slider, used)
        values = model.fit(used, values).x
        off_px = np.linalg.norm(model.residuals(corners, values), axis=-1)
        # The median length of a vector of two standard normal components is 1.1774.
        sigma_px = max(float(np.median(off_px[inliers])) / 1.1774, _MIN_SIGMA_PX)
        near = off_px.max(axis=1) < _OUTLIER * sigma_px * np.sqrt(2)
        if near.mean() < _MIN_INLIERS:
            raise RigError(
                f"solve: only {np.sum(near)} of {len(near)} markers fit the solution, less than "
                "half; check the page and the camera"
            )
        if np.array_equal(near, inliers):
            break
        inliers = near
    used = corners.of(inliers)
    _check_enough(used, slider)
    # Derivatives by central differences: those by forward ones are too coarse for the covariance.
    return model.solution(inliers, model.fit(used, values, "3-point"))


def _check_enough(corners: Corners, slider: Slider) -> None:
    positions, markers = len(np.unique(slider.position_m(corners.t_us))), len(corners.t_us)
    if positions < _MIN_POSITIONS or markers < _MIN_MARKERS:
        raise RigError(
            f"solve: found {markers} markers at {positions} positions of the slider, expected at "
            f"least {_MIN_MARKERS} markers at {_MIN_POSITIONS} positions"
        )


def _check_both_directions(slider: Slider, corners: Corners) -> None:
    """Refuse to estimate a latency from motion in one direction only."""
    speed = slider.speed_mps(np.unique(corners.t_us))
    fast = abs(speed) > _MIN_SPEED * abs(speed).max(initial=0.0)
    forth, back = int(np.sum(fast & (speed > 0))), int(np.sum(fast & (speed < 0)))
    if min(forth, back) < max(1, _MIN_SHARE * (forth + back)):
        raise RigError(
            f"solve: --latency needs images in both directions of travel; found {forth} on the way "
            f"there and {back} on the way back"
        )


def _first_guess(corners: Corners, x_m: Float64, camera: Camera) -> RigPose:
    """Return a rough pose: the images' mean rotation, and the line that best fits it."""
    world = np.concatenate([corners.page_m, np.zeros_like(corners.page_m[..., :1])], axis=-1)
    rays = camera.rays(corners.image_px)
    times, counts = np.unique(corners.t_us, return_counts=True)
    rotations = []
    for t_us in times[counts >= np.median(counts)]:
        points, ends = (array[corners.t_us == t_us].reshape(-1, 3) for array in (world, rays))
        _, turn, _ = cv2.solvePnP(
            points, np.ascontiguousarray(ends[:, :2]), np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
        rotations.append(cv2.Rodrigues(turn)[0].T)
    R = Rotation.from_matrix(rotations).mean().as_matrix()
    # A point lies on its ray r: r x (point - origin - x * direction) = 0, linear in both unknowns.
    r = (rays @ R.T).reshape(-1, 3)
    cross = np.cross(r[:, None], np.eye(3)).swapaxes(1, 2)
    x = np.repeat(x_m, 4)[:, None, None]
    lines = np.concatenate([cross, x * cross], axis=2).reshape(-1, 6)
    points = (cross @ world.reshape(-1, 3, 1)).ravel()
    origin, direction = np.linalg.lstsq(lines, points, rcond=None)[0].reshape(2, 3)
    return RigPose(camera, R, origin, direction / np.linalg.norm(direction))


def inverse_of(jacobian: Float64, length: Float64) -> tuple[Float64, Float64, Float64]:
    """Return what gives the covariance of a fit, from its Jacobian with columns of length 1.

    For a Jacobian, (M, P), with columns of positive `length`, (P,), these are singular values,
    (P,), right singular vectors, (P, P), and `half`: half.T @ half is the covariance for residuals
    of variance 1.
    """
    _, singular, directions = np.linalg.svd(jacobian / length, full_matrices=False)
    with np.errstate(divide="ignore", invalid="ignore"):  # the caller refuses a singular one
        return singular, directions, directions / singular[:, None] / length


@dataclass(frozen=True, eq=False, slots=True)
class _Model:
    """Residuals as a function of the parameters, which are relative to a first guess."""

    slider: Slider
    unknowns: tuple[str, ...]
    guess: RigPose

    def pose(self, values: Float64) -> RigPose:
        # Two small turns of the direction, about the two axes perpendicular to it.
        across = np.linalg.svd(self.guess.direction[None])[2][1:]
        direction = self.guess.direction + values[6:8] @ across
        return RigPose(
            self.guess.camera,
            self.guess.R_world_cam @ Rotation.from_rotvec(values[:3]).as_matrix(),
            self.guess.origin_m + values[3:6],
            direction / np.linalg.norm(direction),
            self._extra(values).get(SCALE, 1.0),
        )

    def residuals(self, corners: Corners, values: Float64) -> Float64:
        """Return seen minus predicted corners, (M, 4, 2) px."""
        extra = self._extra(values)
        t_us = corners.t_us - 1e3 * extra.get(LATENCY, 0.0)
        x_m = np.interp(t_us, self.slider.t_us, self.slider.x_m)
        predicted = self.pose(values).project(corners.page_m, x_m)
        if bias_px := extra.get(CORNER_BIAS, 0.0):
            outward = predicted - predicted.mean(axis=1, keepdims=True)
            length = np.linalg.norm(outward, axis=-1, keepdims=True)
            predicted = predicted + bias_px * outward / length
        return corners.image_px - predicted

    def fit(self, corners: Corners, values: Float64, jac: str = "2-point") -> OptimizeResult:
        """Find the parameters with the smallest sum of squared residuals."""
        try:
            fitted = least_squares(
                lambda at: self.residuals(corners, at).ravel(),
                values,
                jac=jac,
                x_scale="jac",
                max_nfev=_MAX_STEPS,
            )
        except RenderError:  # the page is behind the camera
            raise RigError("solve: the fit put the page behind the camera; check both") from None
        if not fitted.success:
            raise RigError(f"solve: the fit did not converge: {fitted.message}")
        return fitted

    def solution(self, inliers: NDArray[np.bool_], fitted: OptimizeResult) -> Solution:
        """Return the solution with its covariance."""
        names = PARAMETERS + self.unknowns
        singular, directions, half = inverse_of(fitted.jac, np.linalg.norm(fitted.jac, axis=0))
        condition = singular[-1] / singular[0]
        if condition < _WORST_CONDITION:
            raise RigError(
                f"solve: the corners do not determine {names[int(np.argmax(abs(directions[-1])))]} "
                f"(ratio of singular values {condition:.1g}, limit {_WORST_CONDITION:g})"
            )
        squares, count = 2 * fitted.cost, fitted.fun.size
        extra = self._extra(fitted.x)
        return Solution(
            pose=self.pose(fitted.x),
            latency_ms=extra.get(LATENCY, 0.0),
            corner_bias_px=extra.get(CORNER_BIAS, 0.0),
            names=names,
            covariance=squares / max(count - len(names), 1) * half.T @ half,
            rms_px=math.sqrt(squares / (count / 2)),
            inliers=inliers,
        )

    def _extra(self, values: Float64) -> dict[str, float]:
        return dict(zip(self.unknowns, values[len(PARAMETERS) :].tolist(), strict=True))
