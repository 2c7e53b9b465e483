"""Intrinsics of an event camera from recordings of a flashing chessboard.

A board that flashes on a screen causes events without motion. The high-pass filter, without decay
per event, turns the events of each recording into images of the board. The inner corners in several
such views give the camera (Zhang, "A Flexible New Technique for Camera Calibration", PAMI 2000;
OpenCV's `calibrateCamera`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from eres_render import Camera, Distortion
from eres_render.errors import check_positive
from eres_render.progress import Progress, silent
from sensor.formats import read_events, read_header
from tasks.errors import RigError
from tasks.methods.high_pass_filter import HighPassFilter
from tasks.rig.bundle import inverse_of
from tasks.rig.markers import gray_codes
from tasks.rig.recording import span_us
from tasks.video import ImageTaker

Float64 = NDArray[np.float64]

_CUTOFF_HZ = 0.5
_IMAGES = 9  # of the filter in each recording
_ENLARGED = 4
_MIN_VIEWS = 3
_MAX_SIGMA = 0.05  # of the focal length
_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")


@dataclass(frozen=True, slots=True)
class Board:
    """A chessboard: its inner corners along a row and along a column, and the side of a square."""

    columns: int
    rows: int
    square_m: float

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3:
            raise RigError(f"board: {self.columns}x{self.rows} inner corners are fewer than 3x3")
        check_positive("square", self.square_m, RigError, "a positive number of meters")

    def points_m(self) -> NDArray[np.float32]:
        """Return the inner corners, (N, 3) m, row by row."""
        numbers = np.mgrid[: self.columns, : self.rows, :1].T.reshape(-1, 3)
        return (self.square_m * numbers).astype(np.float32)


@dataclass(frozen=True, eq=False, slots=True)
class Intrinsics:
    """A calibrated camera, with standard deviations of fx, fy, cx, cy, k1, k2, p1, p2 by name."""

    camera: Camera
    sigmas: dict[str, float]
    rms_px: float
    views: tuple[Path, ...]


def board_images(path: Path, size: tuple[int, int] | None) -> Iterator[NDArray[np.uint8]]:
    """Yield gray images of a flashing board: the sum of the filter's images, then each image."""
    parts = list(read_events(path, size=size))
    hp = HighPassFilter(parts[0].width, parts[0].height, 1.0, _CUTOFF_HZ, 0.0)
    wanted_us = np.linspace(*span_us(path, parts), _IMAGES + 1)[1:].astype(np.int64).tolist()
    taker = ImageTaker(hp, wanted_us)
    images = [image for part in parts for _, image in taker.take(part)]
    yield from map(gray_codes, (np.sum(images, axis=0), *images))


def find_board(gray: NDArray[np.uint8], board: Board) -> Float64 | None:
    """Return the inner corners of a chessboard, (N, 2) px row by row; None if it is not found.

    (0, 0) is the corner of the first pixel.
    """
    large = cv2.resize(gray, None, fx=_ENLARGED, fy=_ENLARGED, interpolation=cv2.INTER_CUBIC)
    shape = board.columns, board.rows
    visible, points = cv2.findChessboardCornersSB(large, shape, flags=cv2.CALIB_CB_ACCURACY)
    return (points.reshape(-1, 2).astype(np.float64) + 0.5) / _ENLARGED if visible else None


def calibrate(
    views_px: list[Float64], board: Board, width: int, height: int
) -> tuple[Camera, dict[str, float], float]:
    """Return camera, sigmas and rms_px of `Intrinsics` from (N, 2) inner corners in each view."""
    if len(views_px) < _MIN_VIEWS:
        raise RigError(
            f"intrinsics: found the board in {len(views_px)} files, expected at least {_MIN_VIEWS}"
        )
    points = [board.points_m()] * len(views_px)
    # OpenCV puts (0, 0) at the center of the first pixel.
    pixels = [(view - 0.5).astype(np.float32) for view in views_px]
    try:
        rms_px, K, lens, turns, places = cv2.calibrateCamera(
            points, pixels, (width, height), np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3
        )
    except cv2.error as error:
        raise RigError(
            f"intrinsics: OpenCV could not calibrate from these views ({error.err}); tilt the "
            "board more, and differently in each view"
        ) from error
    corners_m = board.points_m().astype(np.float64)
    derivatives = [
        np.asarray(cv2.projectPoints(corners_m, turn, place, K, lens)[1], np.float64)
        for turn, place in zip(turns, places, strict=True)
    ]
    sigmas = _sigmas(derivatives, rms_px)
    if not sigmas[0] < _MAX_SIGMA * K[0, 0]:
        raise RigError(
            f"intrinsics: the focal length is uncertain: {K[0, 0]:.4g} +- {sigmas[0]:.2g} px; tilt "
            "the board more, and differently in each view"
        )
    bent = Distortion(*lens.ravel()[:4].tolist())
    camera = Camera(
        width, height, fx=K[0, 0], fy=K[1, 1], cx=K[0, 2] + 0.5, cy=K[1, 2] + 0.5, distortion=bent
    )
    return camera, dict(zip(_NAMES, sigmas.tolist(), strict=True)), float(rms_px)


def _sigmas(derivatives: list[Float64], rms_px: float) -> Float64:
    """Return the standard deviations of `_NAMES`; inf if the views do not determine them.

    OpenCV's own come from a truncated inverse, and are smallest where the views determine least.
    `cv2.projectPoints` gives the derivatives of a view, (2 N, 15): by turn, place, camera and lens.
    """
    intrinsic = len(_NAMES)
    of_views = np.concatenate([view[:, 6 : 6 + intrinsic] for view in derivatives])
    jacobian = np.hstack([of_views, block_diag(*(view[:, :6] for view in derivatives))])
    length = np.linalg.norm(jacobian, axis=0)
    if not np.all(length > 0):
        return np.full(intrinsic, np.inf)
    singular, _, half = inverse_of(jacobian, length)
    if not singular[-1] > 1e-12 * singular[0]:
        return np.full(intrinsic, np.inf)
    count, unknowns = jacobian.shape
    variance = rms_px**2 * (count / 2) / max(count - unknowns, 1)
    sigmas: Float64 = math.sqrt(variance) * np.linalg.norm(half, axis=0)
    return sigmas[:intrinsic]


def intrinsics(
    paths: list[Path],
    board: Board,
    *,
    size: tuple[int, int] | None = None,
    on_progress: Progress = silent,
) -> Intrinsics:
    """Calibrate a camera from recordings of a flashing board, one for each view.

    `size` is the sensor's (width, height), for files that do not store it.
    """
    views_px: dict[Path, Float64] = {}
    sizes = set()
    for k, path in enumerate(paths):
        sizes.add(read_header(path).with_size(size).size)
        if len(sizes) > 1:
            raise RigError(f"{path}: the recordings have different sensor sizes: {sorted(sizes)}")
        boards = (find_board(gray, board) for gray in board_images(path, size))
        view_px = next((corners_px for corners_px in boards if corners_px is not None), None)
        if view_px is not None:
            views_px[path] = view_px
        on_progress("looking for the board", k + 1, len(paths))
    return Intrinsics(*calibrate([*views_px.values()], board, *sizes.pop()), tuple(views_px))
