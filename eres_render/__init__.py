"""Light: a scene and a camera path in, linear-radiance frames with exact times and poses out.

Importing this package does not load Mitsuba; making a `Renderer` does.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eres_render.camera import Camera, Plane, plane_homography
    from eres_render.distortion import Distortion
    from eres_render.errors import (
        BackendError,
        RenderError,
        SceneError,
        SequenceError,
        TrajectoryError,
    )
    from eres_render.rendering.renderer import Renderer
    from eres_render.scene.load import list_scenes, load_scene
    from eres_render.scene.scene import Scene
    from eres_render.sequence.clips import Clip, clips, continuous_stretch
    from eres_render.sequence.ground_truth import Flow, GroundTruth, ground_truth
    from eres_render.sequence.ground_truth_files import window_times, write_truth
    from eres_render.sequence.monte_carlo_noise import Noise, measure_noise
    from eres_render.sequence.render_clips import clip_in_progress, render_clip, render_scene
    from eres_render.sequence.sequence import RadianceSequence, open_sequence
    from eres_render.trajectory.generators import random_path, waypoint_loop
    from eres_render.trajectory.spline import Trajectory, path_through

# Names are imported on first use (PEP 562), so that the command line starts without SciPy and
# Numba.
_NAMES = {
    "camera": "Camera Plane plane_homography",
    "distortion": "Distortion",
    "errors": "BackendError RenderError SceneError SequenceError TrajectoryError",
    "rendering.renderer": "Renderer",
    "scene.load": "list_scenes load_scene",
    "scene.scene": "Scene",
    "sequence.clips": "Clip clips continuous_stretch",
    "sequence.ground_truth": "Flow GroundTruth ground_truth",
    "sequence.ground_truth_files": "window_times write_truth",
    "sequence.monte_carlo_noise": "Noise measure_noise",
    "sequence.render_clips": "clip_in_progress render_clip render_scene",
    "sequence.sequence": "RadianceSequence open_sequence",
    "trajectory.generators": "random_path waypoint_loop",
    "trajectory.spline": "Trajectory path_through",
}
_HOMES = {name: f"eres_render.{file}" for file, names in _NAMES.items() for name in names.split()}

__all__ = [
    "BackendError",
    "Camera",
    "Clip",
    "Distortion",
    "Flow",
    "GroundTruth",
    "Noise",
    "Plane",
    "RadianceSequence",
    "RenderError",
    "Renderer",
    "Scene",
    "SceneError",
    "SequenceError",
    "Trajectory",
    "TrajectoryError",
    "clip_in_progress",
    "clips",
    "continuous_stretch",
    "ground_truth",
    "list_scenes",
    "load_scene",
    "measure_noise",
    "open_sequence",
    "path_through",
    "plane_homography",
    "random_path",
    "render_clip",
    "render_scene",
    "waypoint_loop",
    "window_times",
    "write_truth",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_HOMES[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
