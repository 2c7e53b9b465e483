"""Light: a scene and a camera path in, linear-radiance frames with exact times and poses out.

Importing this package does not load Mitsuba; making a `Renderer` does.
"""

from eres_render.camera import Camera, Plane, plane_homography
from eres_render.errors import (
    BackendError,
    RenderError,
    SceneError,
    SequenceError,
    TrajectoryError,
)
from eres_render.rendering.renderer import Renderer
from eres_render.scene.scene import Scene, list_scenes, load_scene
from eres_render.sequence.clips import Clip, clips, continuous_stretch
from eres_render.sequence.ground_truth import Flow, GroundTruth, ground_truth
from eres_render.sequence.ground_truth_files import window_times, write_truth
from eres_render.sequence.monte_carlo_noise import Noise, measure_noise
from eres_render.sequence.render_clips import render_clip, render_scene
from eres_render.sequence.sequence import RadianceSequence, open_sequence
from eres_render.trajectory.generators import random_path, waypoint_loop
from eres_render.trajectory.spline import Trajectory, path_through

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
