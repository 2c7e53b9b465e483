"""`Manifest`: the contents of manifest.json of a radiance sequence."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eres_render.camera import Camera
from eres_render.distortion import Distortion
from eres_render.errors import SequenceError
from eres_render.scene.scene import Scene
from eres_render.storage.atomic import write_text
from eres_render.storage.settings_reader import read_json, read_typed

FORMAT_VERSION = 2
RENDER_VERSION = 7
"""Raise it when the same settings give other frames: no sequence then mixes old and new ones."""


@dataclass(frozen=True, slots=True)
class Manifest:
    """The contents of manifest.json: everything that decides the frames, and the white level.

    `scene_source` is the argument of `load_scene`; a path inside the sequence's folder is relative
    to it. `light_digest` changes with the surfaces and the light. `t_offset_us` is time 0 on the
    clock of the given poses. `intrinsics` are fx, fy, cx and cy, px; None for square pixels about
    the center without a lens. `plane` is the normal of the scene's plane and its distance from the
    origin along it; empty without a plane, None in older files. `render_version` is the version of
    the code that rendered the frames.
    """

    version: int
    complete: bool
    scene: str
    scene_source: str
    scene_digest: str
    light_digest: str
    clip: int
    width: int
    height: int
    fov_rad: float
    t_s: tuple[float, ...]
    window_s: tuple[float, float]
    white_level: float
    spp: int
    seed: int
    max_displacement_px: float
    integrator: str
    variant: str
    mitsuba: str
    t_offset_us: int = 0
    intrinsics: tuple[float, float, float, float] | None = None
    distortion: Distortion | None = None
    objects: tuple[str, ...] = ()
    plane: tuple[float, ...] | None = None
    render_version: int = 6  # of files that do not say

    def __post_init__(self) -> None:
        steps = np.diff(self.t_s)
        if len(self.t_s) < 2 or not np.all(steps > 0):
            where = int(np.argmin(steps)) if len(steps) else 0
            raise SequenceError(
                f"t_s: found {list(self.t_s[where : where + 2])} at frame {where}, expected at "
                "least two strictly increasing times"
            )
        if not self.white_level > 0:
            raise SequenceError(f"white_level: found {self.white_level}, expected above 0")
        if not self.t_s[0] <= self.window_s[0] < self.window_s[1] <= self.t_s[-1]:
            raise SequenceError(
                f"window_s: found {self.window_s}, expected a stretch within the frames' times "
                f"{self.t_s[0]} to {self.t_s[-1]} s"
            )
        _ = self.camera  # refuses values that no camera has

    @property
    def camera(self) -> Camera:
        """The camera that took the frames."""
        if self.intrinsics is None:
            return Camera(self.width, self.height, self.fov_rad, distortion=self.distortion)
        fx, fy, cx, cy = self.intrinsics
        size, lens = (self.width, self.height), self.distortion
        return Camera(*size, self.fov_rad, fx=fx, fy=fy, cx=cx, cy=cy, distortion=lens)


def plane_values(scene: Scene) -> tuple[float, ...]:
    """Return the plane that a scene's camera sees as in a manifest; nothing if there is none."""
    return () if scene.plane is None else (*scene.plane.normal, scene.plane.offset_m)


def read_manifest(folder: Path) -> Manifest:
    """Read and check the manifest of a sequence folder."""
    path = folder / "manifest.json"
    table = read_json(dict[str, Any], path, SequenceError)
    version = table.get("version")
    if isinstance(version, int) and version != FORMAT_VERSION:  # its fields differ
        what_to_do = "update eres to read it" if version > FORMAT_VERSION else "render it again"
        raise SequenceError(
            f"{path}: version: found {version}, expected {FORMAT_VERSION}; {what_to_do}"
        )
    return read_typed(Manifest, table, path, SequenceError)


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write the manifest into a sequence folder."""
    table = dataclasses.asdict(manifest)
    for name in ("t_offset_us", "intrinsics", "distortion", "objects"):
        if not table[name]:
            del table[name]
    write_text(folder / "manifest.json", json.dumps(table, indent=1) + "\n")
