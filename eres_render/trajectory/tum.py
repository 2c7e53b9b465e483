"""Poses as text in TUM's format: one line `t x y z qx qy qz qw` for each."""

from __future__ import annotations

import math
from decimal import Context, Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eres_render.errors import TrajectoryError, reading

Float64 = NDArray[np.float64]

_MAX_TIME_S = 4 * 10**12  # microseconds must fit into 62 bits
_EXACT = Context(prec=1000)  # digits, more than a float64 has


def tum_text(
    t_s: Float64, T_world_cam: Float64, t_offset_us: int = 0, what: str = "T_world_cam"
) -> str:
    """Return (N, 4, 4) poses as TUM text; `read_tum` returns their times, s, to the last bit."""
    xyz = T_world_cam[:, :3, 3]
    xyzw = Rotation.from_matrix(T_world_cam[:, :3, :3]).as_quat()
    rows = np.column_stack([t_s, xyz, xyzw])
    lines = (
        " ".join([_later(t, t_offset_us), *(repr(float(value)) for value in row)])
        for t, *row in rows
    )
    return f"# t_s x_m y_m z_m qx qy qz qw ({what})\n" + "\n".join(lines) + "\n"


def _later(t_s: float, t_offset_us: int) -> str:
    """Return a time plus an offset as text, exactly."""
    text = repr(float(t_s))
    if not t_offset_us:
        return text
    return f"{_EXACT.add(Decimal(text), _EXACT.scaleb(Decimal(t_offset_us), -6)):f}"


def _earlier(times: list[Decimal], t_offset_us: int) -> Float64:
    """Return times less an offset that is subtracted before they become float64."""
    offset_s = _EXACT.scaleb(Decimal(t_offset_us), -6)
    return np.array([float(_EXACT.subtract(time, offset_s)) for time in times])


def read_tum(path: Path, t_offset_us: int = 0) -> tuple[Float64, Float64]:
    """Read a TUM file: (N,) times, s, and (N, 4, 4) poses."""
    times, poses = _read(path)
    return _earlier(times, t_offset_us), poses


def read_tum_from_start(path: Path) -> tuple[int, Float64, Float64]:
    """Return a TUM file's first time, rounded to microseconds, and `read_tum` with that offset."""
    times, poses = _read(path)
    t_offset_us = round(_EXACT.scaleb(times[0], 6))
    return t_offset_us, _earlier(times, t_offset_us), poses


def _read(path: Path) -> tuple[list[Decimal], Float64]:
    """Read a TUM file into exact times and (N, 4, 4) poses."""
    with reading(path, "text", TrajectoryError):
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    times: list[Decimal] = []
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            row = [float(word) for word in line.split()]
        except ValueError:
            row = []
        wrong = ""
        if len(row) != 8 or not np.isfinite(row).all():
            wrong = f"found {line!r}, expected 8 numbers t x y z qx qy qz qw"
        elif abs(math.hypot(*row[4:]) - 1) > 1e-3:
            wrong = f"found a quaternion of length {math.hypot(*row[4:]):.4g}, expected 1"
        elif abs(row[0]) >= _MAX_TIME_S:
            wrong = f"found time {row[0]!r}, expected less than {_MAX_TIME_S} s from 0"
            wrong += "; are the times of the poses in seconds?"
        elif times and not Decimal(line.split()[0]) > times[-1]:
            wrong = f"found time {row[0]!r} after {rows[-1][0]!r}, expected increasing times"
        if wrong:
            raise TrajectoryError(f"{path}: line {number}: {wrong}")
        times.append(Decimal(line.split()[0]))
        rows.append(row)
    if not rows:
        raise TrajectoryError(f"{path}: found no pose, expected lines t x y z qx qy qz qw")
    table = np.array(rows)
    T = np.tile(np.eye(4), (len(table), 1, 1))
    T[:, :3, 3] = table[:, 1:4]
    T[:, :3, :3] = Rotation.from_quat(table[:, 4:]).as_matrix()
    return times, T
