"""Poses as text in TUM's format: one line `t x y z qx qy qz qw` for each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eres_render.errors import TrajectoryError

Float64 = NDArray[np.float64]


def tum_text(t_s: Float64, T_world_cam: Float64) -> str:
    """Return the TUM lines `t x y z qx qy qz qw` of (N,) times and (N, 4, 4) poses."""
    xyz = T_world_cam[:, :3, 3]
    xyzw = Rotation.from_matrix(T_world_cam[:, :3, :3]).as_quat()
    rows = np.column_stack([t_s, xyz, xyzw])
    lines = (" ".join(repr(float(value)) for value in row) for row in rows)
    return "# t_s x_m y_m z_m qx qy qz qw (T_world_cam)\n" + "\n".join(lines) + "\n"


def read_tum(path: Path) -> tuple[Float64, Float64]:
    """Read a TUM file into (N,) times in seconds and (N, 4, 4) poses T_world_cam.

    Raises
    ------
    TrajectoryError
        If the file is missing or no text, a line does not hold 8 numbers with a quaternion of
        length 1 to 1e-3 (what is nearer is normalised), or times do not increase.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise TrajectoryError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"{path}: not a text file: {error.reason}") from error
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            row = [float(word) for word in line.split()]
        except ValueError:
            row = []
        if len(row) != 8 or not np.isfinite(row).all():
            raise TrajectoryError(
                f"{path}: line {number}: found {line!r}, expected 8 numbers t x y z qx qy qz qw"
            )
        if abs(np.linalg.norm(row[4:]) - 1) > 1e-3:
            raise TrajectoryError(
                f"{path}: line {number}: found a quaternion of length "
                f"{np.linalg.norm(row[4:]):.4g}, expected 1"
            )
        if rows and not row[0] > rows[-1][0]:
            raise TrajectoryError(
                f"{path}: line {number}: found time {row[0]!r} after {rows[-1][0]!r}, expected "
                "increasing times"
            )
        rows.append(row)
    if not rows:
        raise TrajectoryError(f"{path}: found no pose, expected lines t x y z qx qy qz qw")
    table = np.array(rows)
    T = np.tile(np.eye(4), (len(table), 1, 1))
    T[:, :3, 3] = table[:, 1:4]
    T[:, :3, :3] = Rotation.from_quat(table[:, 4:]).as_matrix()
    return table[:, 0], T
