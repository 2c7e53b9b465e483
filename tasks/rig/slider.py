"""`Slider`: the positions of a slider's carriage, from its encoder."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eres_render.errors import reading
from tasks.errors import RigError
from tasks.rig.settings import SliderSettings

Float64 = NDArray[np.float64]

SLIDER_FILE = "slider.csv"

_COLUMNS = ("t_us", "x_m")
_MAX_GAP = 20.0  # times the median time between two readings, while the carriage moves
_STEP_US = 500  # time between two readings of the virtual encoder
_MOVES = 0.05  # fraction of the highest speed below which the carriage is at rest


@dataclass(frozen=True, eq=False, slots=True)
class Slider:
    """Readings of an encoder, 2 or more at increasing times; between them the speed is constant."""

    t_us: Float64
    x_m: Float64

    def __post_init__(self) -> None:
        if len(self.t_us) < 2:
            raise RigError(f"slider: found {len(self.t_us)} readings, expected at least 2")
        finite = np.isfinite(self.t_us) & np.isfinite(self.x_m)
        wrong = np.flatnonzero(~finite | ~(np.diff(self.t_us, prepend=-np.inf) > 0))
        if wrong.size:
            raise RigError(
                f"slider: reading {wrong[0] + 1}: found {self.x_m[wrong[0]]:g} m at "
                f"{self.t_us[wrong[0]]:g} us, expected finite numbers and increasing times"
            )

    def position_m(self, t_us: ArrayLike) -> Float64:
        """Return the position at the times (...), m."""
        t = np.asarray(t_us, dtype=np.float64)
        if t.size and not (t.min() >= self.t_us[0] and t.max() <= self.t_us[-1]):
            raise RigError(
                f"slider: the readings, from {self.t_us[0]:.0f} to {self.t_us[-1]:.0f} us, do not "
                f"cover {t.min():.0f} to {t.max():.0f} us; check that both clocks agree"
            )
        return np.interp(t, self.t_us, self.x_m)

    def speed_mps(self, t_us: ArrayLike) -> Float64:
        """Return the velocity along the slider at the times (...), m/s."""
        t = np.asarray(t_us, dtype=np.float64)
        k = np.clip(np.searchsorted(self.t_us, t, side="right") - 1, 0, len(self.t_us) - 2)
        return 1e6 * (np.diff(self.x_m) / np.diff(self.t_us))[k]

    def check_gaps(self) -> None:
        """Refuse readings that are missing while the carriage moves."""
        steps_us = np.diff(self.t_us)
        usual_us = float(np.median(steps_us))
        speeds = np.abs(np.diff(self.x_m)) / steps_us
        if not speeds.any():
            return
        moving_us = np.where(speeds > _MOVES * np.median(speeds[speeds > 0]), steps_us, 0.0)
        worst = int(np.argmax(moving_us))
        if moving_us[worst] > _MAX_GAP * usual_us:
            raise RigError(
                f"slider: no readings from {self.t_us[worst]:.0f} to {self.t_us[worst + 1]:.0f} us,"
                f" while the carriage moved; usually there is one every {usual_us:.0f} us"
            )

    def evenly_along(
        self, count: int, start_us: float, end_us: float, max_speed_mps: float = np.inf
    ) -> NDArray[np.int64]:
        """Return `count` times of motion, whole us, evenly spaced along the carriage's way."""
        inside = (self.t_us > start_us) & (self.t_us < end_us)
        t = np.concatenate([[start_us], self.t_us[inside], [end_us]])
        speed = np.abs(self.speed_mps(0.5 * (t[1:] + t[:-1])))
        speed = np.where(speed <= max_speed_mps, speed, 0.0)
        moved = np.where(speed > _MOVES * speed.max(), speed * np.diff(t), 0.0)
        way = np.concatenate([[0.0], np.cumsum(moved)])
        if not way[-1] > 0:
            raise RigError(
                f"slider: no motion from {start_us:.0f} to {end_us:.0f} us at up to "
                f"--max-speed {max_speed_mps:g}"
            )
        wanted = (np.arange(count) + 0.5) / count * way[-1]
        return np.round(np.interp(wanted, way, t)).astype(np.int64)


def read_slider(file: Path) -> Slider:
    """Read slider.csv: a line `t_us,x_m`, then one line for each reading."""
    with reading(file, "readings", RigError):
        slider = Slider(*read_columns(file, _COLUMNS).values())
        slider.check_gaps()
        return slider


def slider_text(slider: Slider) -> str:
    """Return readings as the content of slider.csv."""
    readings = zip(slider.t_us.tolist(), slider.x_m.tolist(), strict=True)
    lines = (f"{int(t) if t.is_integer() else t},{x!r}" for t, x in readings)
    return ",".join(_COLUMNS) + "\n" + "\n".join(lines) + "\n"


def read_columns(
    file: Path, names: tuple[str, ...], *, optional: tuple[str, ...] = ()
) -> dict[str, Float64]:
    """Read named columns of numbers from a CSV file."""
    with reading(file, "CSV", RigError), file.open(newline="", encoding="utf-8-sig") as opened:
        table = csv.DictReader(opened)
        columns = [name.strip() for name in table.fieldnames or ()]
        table.fieldnames = columns
        lines = list(table)
    names = (*names, *(name for name in optional if name in columns))
    for name in names:
        if name not in columns:
            raise RigError(f"{file}: has no column {name}; found {', '.join(columns) or 'none'}")
        for number, line in enumerate(lines, start=2):
            if not (line[name] or "").strip():
                raise RigError(f"{file}, line {number}: {name}: has no value")
    with reading(file, "numbers", RigError):
        return {name: np.array([line[name] for line in lines], np.float64) for name in names}


def strokes(settings: SliderSettings) -> Slider:
    """Return the motion of the virtual slider from 0 s and 0 m: there and back at each speed.

    It has a reading every 0.5 ms and at each change of the acceleration, at whole microseconds.
    """
    rest = settings.pause_s, 0.0
    pieces = []  # durations and accelerations
    for speed in settings.speeds_mps:
        ramp_s = speed / settings.acceleration_mps2
        even = settings.travel_m / speed - ramp_s, 0.0
        for push in (settings.acceleration_mps2, -settings.acceleration_mps2):
            pieces += [rest, (ramp_s, push), even, (ramp_s, -push)]
    durations, a = np.array([*pieces, rest]).T
    edges = np.concatenate([[0.0], np.cumsum(durations)])
    readings = np.arange(0.0, edges[-1], 1e-6 * _STEP_US)
    t_us = np.unique(np.round(1e6 * np.concatenate([readings, edges])))
    # Positions and velocities at the corners, then the parabola between them.
    steps = np.diff(edges)
    v = np.concatenate([[0.0], np.cumsum(a * steps)])
    x = np.concatenate([[0.0], np.cumsum(v[:-1] * steps + 0.5 * a * steps**2)])
    t_s = np.minimum(1e-6 * t_us, edges[-1])
    k = np.clip(np.searchsorted(edges, t_s, side="right") - 1, 0, len(a) - 1)
    after = t_s - edges[k]
    return Slider(t_us, x[k] + v[k] * after + 0.5 * a[k] * after**2)
