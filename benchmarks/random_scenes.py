"""Count the frames of random scenes, as `eres dataset` renders them at 346 x 260 px for 1 s.

Run: python benchmarks/random_scenes.py [COUNT]
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path

import numpy as np

from eres_render import Renderer, load_scene
from eres_render.random_scenes.random_scene import write_random_scene
from eres_render.trajectory.frame_times import paced_times
from sensor import plain_camera
from tasks.generation.settings import DatasetSettings


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    settings = DatasetSettings(
        seed=0, seconds=1.0, sensor=plain_camera(346, 260), cutoffs_hz=(math.inf, 200.0, 50.0)
    )
    marks_s = 0.0, settings.warm_up_s, settings.warm_up_s + settings.seconds
    frames = []
    for k in range(count):
        with tempfile.TemporaryDirectory() as folder:
            write_random_scene(Path(folder), [settings.seed, k], marks_s[-1], 346)
            scene = load_scene(folder)
            camera = scene.camera(346, 260)
            renderer = Renderer(scene, spp=1, integrator="emission", camera=camera)
            t_s = paced_times(renderer.image_motion, marks_s, settings.max_displacement_px)
        frames.append(len(t_s))
    print(f"frames: mean {np.mean(frames):.0f}, from {min(frames)} to {max(frames)}")


if __name__ == "__main__":
    main()
