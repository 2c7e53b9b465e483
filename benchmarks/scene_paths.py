"""Measure the image motion along the scenes' camera paths: its speed, and its evenness.

    python benchmarks/scene_paths.py [SCENE ...]

It follows points on a 9 x 9 grid of the image, in pixels of a 1280-pixel view, and prints a
Markdown table:

- distance: of surfaces along the camera's axis, median over image and path, and its range;
- image motion: mean speed over the image and 24 moments of the path;
- departure from even motion: the error of methods that assume constant flow. In the 50 ms window of
  every clip, the distance of each point half-way through it from the middle of its two ends: mean
  over the image, then median and largest over the clips.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from eres_render import Renderer, clips, list_scenes, load_scene

_WIDTH = 1280
_GRID = 9
_MOMENTS, _APART_S = 24, 1e-4


def follow(renderer: Renderer, times_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Return the later places of points of the first image, (T, N, 2) px, and depths (N,), m."""
    camera, poses = renderer.camera, renderer.trajectory.pose(times_s)
    points = camera.grid(_GRID)
    depth = 1 / renderer.inverse_depth(poses[0], points)
    world = poses[0, :3, 3] + depth[:, None] * (camera.rays(points) @ poses[0, :3, :3].T)
    moved = [camera.project((world - T[:3, 3]) @ T[:3, :3]) for T in poses]
    return np.array(moved), depth


def main() -> None:
    print("| scene | distance | image motion | departure from even motion |")
    print("|---|---|---|---|")
    for name in sys.argv[1:] or list_scenes():
        scene = load_scene(name)
        renderer = Renderer(scene, _WIDTH, 1)
        speeds, depths, departures = [], [], []
        for t_s in (np.arange(_MOMENTS) + 0.5) * scene.duration_s / _MOMENTS:
            (first, second), depth = follow(renderer, np.array([t_s, t_s + _APART_S]))
            speeds.append(np.linalg.norm(second - first, axis=1).mean() / _APART_S)
            depths.append(depth)
        for clip in clips(scene):
            window_s = np.linspace(clip.t_window_start_s, clip.t_window_end_s, 3)
            (start, middle, end), _ = follow(renderer, window_s)
            departures.append(np.linalg.norm(middle - 0.5 * (start + end), axis=1).mean())
        print(
            f"| {name} | {np.median(depths):.2f} m ({np.min(depths):.2f} to {np.max(depths):.2f}) "
            f"| {np.mean(speeds):.0f} px/s "
            f"| {np.median(departures):.2f} px, at most {np.max(departures):.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
