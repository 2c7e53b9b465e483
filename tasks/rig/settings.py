"""`RigSettings`: the page, the slider and the camera of a rig, from rig.toml."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from eres_render import Camera, Distortion
from eres_render.calibration import read_camera
from eres_render.errors import check_positive
from eres_render.storage.settings_reader import Vector3, read_toml
from tasks.errors import RigError

RIG_FILE = "rig.toml"

INCH_M = 0.0254
_MIN_DPI, _MAX_DPI = 350.0, 4800.0
_OF_A_RECORDING = ("page.png", "page.json", "rig.toml", "slider.csv", "truth.json", "frames.csv")


def check_bounds(name: str, value: float, low: float, high: float = math.inf) -> None:
    """Refuse a number outside its bounds, which belong to the range."""
    if not low <= value <= high:
        limits = f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"
        raise RigError(f"{name}: found {value}, expected {limits}")


def _check_beside(field: str, name: str) -> None:
    """Refuse a file elsewhere than beside rig.toml, as a recording has a copy of both."""
    if Path(name).name != name or name in _OF_A_RECORDING:
        raise RigError(
            f"{field}: found {name!r}, expected the name of your own file beside rig.toml, other "
            f"than {', '.join(_OF_A_RECORDING)}"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PageSettings:
    """The print: a picture in the middle of a page, with markers around it.

    `picture` is a procedural picture (`tasks.rig.page.PICTURES`) with a `seed`, or the name of an
    image file beside rig.toml. `marker_m` is the side of a marker, and `marker_pitch_m` the
    distance from one marker to the next. `dictionary` is OpenCV's name of the markers' dictionary.
    """

    width_m: float
    height_m: float
    picture: str
    picture_width_m: float
    picture_height_m: float
    marker_m: float = 0.014
    marker_pitch_m: float = 0.026
    dictionary: str = "DICT_4X4_250"
    dpi: float = 360.0
    seed: int = 1

    def __post_init__(self) -> None:
        for name in ("width_m", "height_m", "marker_m", "dpi"):
            check_positive(name, getattr(self, name), RigError)
        dot_m = INCH_M / self.dpi
        check_bounds("dpi", self.dpi, _MIN_DPI, _MAX_DPI)
        check_bounds("picture_width_m", self.picture_width_m, dot_m, self.width_m)
        check_bounds("picture_height_m", self.picture_height_m, dot_m, self.height_m)
        check_bounds("marker_pitch_m", self.marker_pitch_m, 1.25 * self.marker_m)
        check_bounds("seed", self.seed, 0)
        _check_beside("picture", self.picture)


@dataclass(frozen=True, slots=True, kw_only=True)
class SliderSettings:
    """The strokes of the virtual slider: there and back, once at each speed.

    It rests for `pause_s` before each stroke and after the last. `direction` is in the page's axes
    (right, down, into the page), of any length.
    """

    travel_m: float
    speeds_mps: tuple[float, ...]
    acceleration_mps2: float = 20.0
    pause_s: float = 0.02
    direction: Vector3 = (1.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("travel_m", "acceleration_mps2", "pause_s"):
            check_positive(name, getattr(self, name), RigError)
        fastest = math.sqrt(self.travel_m * self.acceleration_mps2)
        if not self.speeds_mps or not all(0 < speed <= fastest for speed in self.speeds_mps):
            raise RigError(
                f"speeds_mps: found {self.speeds_mps}, expected speeds above 0 and up to "
                f"{fastest:.3g} m/s, the limit from acceleration_mps2 and travel_m"
            )
        if not math.hypot(*self.direction) > 0:
            raise RigError(f"direction: found {self.direction}, expected a vector other than zero")


@dataclass(frozen=True, slots=True, kw_only=True)
class RigCamera:
    """The intrinsics of the camera: either `fx` in px, or `pitch_um` and `focal_mm`.

    The principal point is in px from the corner of the first pixel, by default the middle; `fy` is
    `fx` by default. The distortion coefficients are as in OpenCV.
    """

    width: int
    height: int
    fx: float | None = None
    fy: float | None = None
    cx: float | None = None
    cy: float | None = None
    pitch_um: float | None = None
    focal_mm: float | None = None
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0

    def __post_init__(self) -> None:
        given = [name for name in ("fx", "pitch_um", "focal_mm") if getattr(self, name) is not None]
        if given not in (["fx"], ["pitch_um", "focal_mm"]):
            raise RigError("camera: give either fx, or both pitch_um and focal_mm")
        for name in given:
            check_positive(name, getattr(self, name), RigError)
        self.camera()

    def camera(self) -> Camera:
        """Return the camera."""
        fx = self.fx
        if self.pitch_um is not None and self.focal_mm is not None:
            fx = 1e3 * self.focal_mm / self.pitch_um
        lens = Distortion(self.k1, self.k2, self.p1, self.p2, self.k3)
        size = self.width, self.height
        return Camera(*size, fx=fx, fy=self.fy, cx=self.cx, cy=self.cy, distortion=lens)


@dataclass(frozen=True, slots=True, kw_only=True)
class MountSettings:
    """How the virtual camera is held.

    In the middle of a stroke it faces `middle_m`, from the page's top left corner, by default the
    page's middle. `turn_deg` is about its own axes (right, down, forward), from facing the page.
    """

    middle_m: tuple[float, float] | None = None
    turn_deg: Vector3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class RigSettings:
    """The content of rig.toml; only `eres rig render` needs `slider` and `mount`.

    In place of `camera`, `camera_file` names a YAML file in the same folder, from `eres rig
    intrinsics`, OpenCV or Kalibr.
    """

    page: PageSettings
    camera: RigCamera | None = None
    camera_file: str | None = None
    slider: SliderSettings | None = None
    mount: MountSettings = MountSettings()

    def __post_init__(self) -> None:
        if (self.camera is None) == (self.camera_file is None):
            raise RigError("give either camera or camera_file")
        if self.camera_file is not None:
            _check_beside("camera_file", self.camera_file)

    def camera_in(self, folder: Path) -> Camera:
        """Return the camera."""
        if self.camera_file is not None:
            return read_camera(folder / self.camera_file)
        assert self.camera is not None  # checked in __post_init__
        return self.camera.camera()


def read_rig(file: Path) -> RigSettings:
    """Read rig.toml."""
    return read_toml(RigSettings, file, RigError)
