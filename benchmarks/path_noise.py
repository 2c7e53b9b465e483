"""Compare `measure_noise` on path-traced light with the sensor's noise.

    python benchmarks/path_noise.py [SCENE ...]

A camera flies past a ball in a room under a lamp, and past another under the sky. Each scene is
path-traced at 48 px and 16 samples per pixel with four seeds, and at the same poses with 256 times
the samples, which is the truth. An ideal sensor of 48 px sees all of them. The script prints a
Markdown table, in events per pixel and second:

- log noise: estimated from a few pixels, and of the whole frames against the truth;
- events: of the sensor at 16 samples per pixel, and at the truth;
- false events: estimated, with their standard error, and measured: the difference between the two;
- estimated / measured;
- left: how many more events there are with 64 times the samples than with 256 times;
- lost: events that noise removes, where a pixel fires fewer than in the truth.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from eres_render import Noise, Renderer, Scene, continuous_stretch, load_scene, measure_noise
from eres_render.trajectory.frame_times import adaptive_times
from sensor import SensorModel, simulate

WIDTH, SPP, MORE = 48, 16, 256
C, DARK_SHARE = 0.2, 1e-3
DURATION_S, SPEED_MPS = 0.2, 1.2
DIFFUSE, MIRROR = '<bsdf type="diffuse"/>', '<bsdf type="conductor"/>'
GLOSSY = '<bsdf type="roughconductor"><float name="alpha" value="0.15"/></bsdf>'
TILES = """<bsdf type="diffuse"><texture type="checkerboard" name="reflectance">
  <transform name="to_uv"><scale value="16"/></transform></texture></bsdf>"""
SKY = '<emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>'
LAMP = """<shape type="rectangle" id="lamp"><transform name="to_world">
  <scale value="{0}"/><rotate x="1" angle="180"/><translate z="2.9"/></transform>
  <emitter type="area"><rgb name="radiance" value="{1}"/></emitter></shape>"""
LARGE_LAMP, SMALL_LAMP = LAMP.format(0.5, 10), LAMP.format(0.1, 250)
WALLS = "".join(
    f"""<shape type="rectangle"><transform name="to_world">
  <scale value="2"/>{place}<translate z="1"/></transform>{DIFFUSE}</shape>"""
    for place in (
        '<rotate x="1" angle="180"/><translate z="2"/>',
        '<rotate y="1" angle="90"/><translate x="-2"/>',
        '<rotate y="1" angle="-90"/><translate x="2"/>',
        '<rotate x="1" angle="-90"/><translate y="-2"/>',
        '<rotate x="1" angle="90"/><translate y="2"/>',
    )
)
# Ball, floor, light
SCENES = {
    "diffuse ball in a room": (DIFFUSE, TILES, LARGE_LAMP + WALLS),
    "mirror ball in a room": (MIRROR, TILES, LARGE_LAMP + WALLS),
    "glossy floor in a room": (DIFFUSE, GLOSSY, LARGE_LAMP + WALLS),
    "mirror ball under the sky": (MIRROR, TILES, SKY),
    "mirror ball under a small lamp": (MIRROR, TILES, SMALL_LAMP + WALLS),
}


@dataclass(frozen=True)
class Measured:
    """Log noise of whole frames, and the sensor's events per pixel and second."""

    log_noise: float
    events_hz: float
    true_events_hz: float
    left_hz: float
    lost_hz: float

    @property
    def false_events_hz(self) -> float:
        return self.events_hz - self.true_events_hz


def write_scene(folder: Path, name: str) -> Scene:
    """Write a scene of `SCENES` and the camera's path, and load them."""
    ball, floor, light = SCENES[name]
    xml = folder / "scene.xml"
    xml.write_text(
        f"""<scene version="3.0.0">
        <sensor type="perspective"><float name="fov" value="60"/></sensor>
        <shape type="rectangle"><transform name="to_world"><scale value="2"/></transform>
          {floor}</shape>
        <shape type="sphere"><point name="center" x="0" y="0.2" z="0.5"/>
          <float name="radius" value="0.4"/>{ball}</shape>{light}</scene>"""
    )
    poses = []
    for t_s in np.linspace(0, DURATION_S, 5):
        position = np.array([-0.1 + SPEED_MPS * t_s, -1.5, 1.3])
        ahead = np.array([0.0, 0.2, 0.5]) - position
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        turn = Rotation.from_matrix(np.column_stack([right, np.cross(ahead, right), ahead]))
        poses.append(" ".join(f"{x:.9f}" for x in (t_s, *position, *turn.as_quat())))
    (folder / "poses.txt").write_text("\n".join(poses) + "\n")
    return load_scene(xml, folder / "poses.txt")


def compare(
    scene: Scene, width: int, spp: int, more: int, seeds: int = 4
) -> tuple[Noise, Measured]:
    """Return the result of `measure_noise`, and what the sensor measures on whole frames.

    Parameters
    ----------
    more
        Factor on `spp` for the truth, a multiple of 64.
    seeds
        Number of renders at `spp` over which the sensor's figures are averaged.
    """
    renderer = Renderer(scene, width, spp, integrator="path")
    clip = continuous_stretch(scene)
    said = measure_noise(renderer, [clip], 0.5, C)

    t_s = adaptive_times(renderer.image_motion, clip.marks_s, 0.5)
    poses = renderer.trajectory.pose(t_s)
    dark = DARK_SHARE * renderer.white_level
    model = SensorModel(width=width, height=width, contrast_threshold=C, dark_level=dark)

    def counts(frames: np.ndarray) -> np.ndarray:
        events = simulate(frames, t_s, model)
        fired = np.zeros((width, width))
        np.add.at(fired, (events.y, events.x), 1)
        return fired / (t_s[-1] - t_s[0])

    noisy = [np.stack([renderer.frame(T, 1000 + k) for T in poses]) for k in range(seeds)]
    # Truth as a mean of renders with fewer samples, each with seeds that all its frames share.
    part = renderer.at(spp=16 * spp)
    truth, middle = np.zeros((len(poses), width, width)), np.zeros(0)
    for k in range(more // 16):
        truth += [part.frame(T, 2000 + k) for T in poses]
        if k + 1 == 64 // 16:
            middle = truth / (k + 1)
    truth /= more // 16
    true, each = counts(truth), np.stack([counts(frames) for frames in noisy])
    squares = [(np.log(frames + dark) - np.log(truth + dark)) ** 2 for frames in noisy]
    return said, Measured(
        log_noise=float(np.sqrt(np.mean(squares))),
        events_hz=each.mean(),
        true_events_hz=true.mean(),
        left_hz=counts(middle).mean() - true.mean(),
        lost_hz=np.maximum(true - each, 0).mean(),
    )


def main() -> None:
    print(
        "| scene | log noise, estimated | measured | events | in truth | false events, estimated "
        "| measured | estimated / measured | left | lost |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name in sys.argv[1:] or SCENES:
        with tempfile.TemporaryDirectory() as folder:
            said, measured = compare(write_scene(Path(folder), name), WIDTH, SPP, MORE)
        false, ratio = "unknown", ""
        if said.averages_out:
            false = f"{said.false_events_hz:.2f} ± {said.false_events_error_hz:.2f}"
            ratio = f"{said.false_events_hz / measured.false_events_hz:.2f}"
        print(
            f"| {name} | {said.log_noise:.3f} | {measured.log_noise:.3f} "
            f"| {measured.events_hz:.2f} | {measured.true_events_hz:.2f} "
            f"| {false} | {measured.false_events_hz:.2f} | {ratio} "
            f"| {measured.left_hz:.2f} | {measured.lost_hz:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
