"""Light: a scene and a camera path in, linear-radiance frames with exact times and poses out.

Importing this package does not load Mitsuba; making a `Renderer` does.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eres_render.camera import Camera, Plane, plane_homography
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
    from eres_render.sequence.render_clips import render_clip, render_scene
    from eres_render.sequence.sequence import RadianceSequence, open_sequence
    from eres_render.trajectory.generators import random_path, waypoint_loop
    from eres_render.trajectory.spline import Trajectory, path_through

# Names are imported on first use (PEP 562), so that the command line starts without SciPy and
# Numba.
_HOMES = {
    "BackendError": "eres_render.errors",
    "Camera": "eres_render.camera",
    "Clip": "eres_render.sequence.clips",
    "Flow": "eres_render.sequence.ground_truth",
    "GroundTruth": "eres_render.sequence.ground_truth",
    "Noise": "eres_render.sequence.monte_carlo_noise",
    "Plane": "eres_render.camera",
    "RadianceSequence": "eres_render.sequence.sequence",
    "RenderError": "eres_render.errors",
    "Renderer": "eres_render.rendering.renderer",
    "Scene": "eres_render.scene.scene",
    "SceneError": "eres_render.errors",
    "SequenceError": "eres_render.errors",
    "Trajectory": "eres_render.trajectory.spline",
    "TrajectoryError": "eres_render.errors",
    "clips": "eres_render.sequence.clips",
    "continuous_stretch": "eres_render.sequence.clips",
    "ground_truth": "eres_render.sequence.ground_truth",
    "list_scenes": "eres_render.scene.load",
    "load_scene": "eres_render.scene.load",
    "measure_noise": "eres_render.sequence.monte_carlo_noise",
    "open_sequence": "eres_render.sequence.sequence",
    "path_through": "eres_render.trajectory.spline",
    "plane_homography": "eres_render.camera",
    "random_path": "eres_render.trajectory.generators",
    "render_clip": "eres_render.sequence.render_clips",
    "render_scene": "eres_render.sequence.render_clips",
    "waypoint_loop": "eres_render.trajectory.generators",
    "window_times": "eres_render.sequence.ground_truth_files",
    "write_truth": "eres_render.sequence.ground_truth_files",
}

__all__ = [
    "BackendError",
    "Camera",
    "Clip",
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
    found = getattr(import_module(_HOMES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
