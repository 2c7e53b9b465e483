"""How well the virtual rig is solved: truth against estimate, from frames and from events.

    python benchmarks/rig.py OUT [346:0.436:0.2 1280:0.436:still ...]

Each setting is the width of the camera (346 for a DAVIS346, 1280 for a Prophesee Gen4, both with an
8 mm lens), the depth in meters, and the travel in meters, or "still" for 20 images of a camera that
stands still for each, without events. A fourth part is the refinement of corners, such as
1280:0.236:still:subpix. OUT keeps the renders, so a second run takes seconds. The sensor for images
of the high-pass filter has a cutoff of 200 Hz, a threshold mismatch of 0.03, a leak of 0.1 Hz and
0.1 % hot pixels; that for event integration has the cutoff alone. At 640 px and more, images of
event integration are also taken with a blur of 2 px, for the latency.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from eres_render import RadianceSequence, Renderer, load_scene, open_sequence
from sensor import EventCamera
from tasks.events.frame_camera import developed
from tasks.events.frame_camera_options import FrameCameraOptions
from tasks.events.simulation import SimulationOptions, simulate_sequence
from tasks.exposures import Exposure, write_exposures
from tasks.rig.bundle import CORNER_BIAS, LATENCY, RigPose
from tasks.rig.calibration import StoredPose, compare, read_truth, solve_recording
from tasks.rig.markers import Refinement, detect
from tasks.rig.page import PAPER, draw, json_text, lay_out, write_print
from tasks.rig.recording import RigRecording
from tasks.rig.settings import read_rig
from tasks.rig.slider import slider_text, strokes
from tasks.rig.virtual import render_rig, true_pose, write_page_scene

CUTOFF_HZ = 200.0
CLEAN = EventCamera(cutoff_hz=CUTOFF_HZ)
NOISY = replace(
    CLEAN, threshold_mismatch=0.03, leak_hz=0.1, hot_pixel_fraction=0.001, hot_pixel_hz=20.0
)
CAMERAS = {
    346: "width = 346, height = 260, pitch_um = 18.5, focal_mm = 8.0",
    1280: "width = 1280, height = 720, pitch_um = 4.86, focal_mm = 8.0",
}
RIG = """
camera = {{{camera}}}

[page]
width_m = 0.44
height_m = 0.29
picture = "pebbles"
picture_width_m = 0.12
picture_height_m = 0.0675

[slider]
travel_m = {travel}
speeds_mps = [0.2]
direction = [1.0, 0.01, -0.008]

[mount]
turn_deg = [0.5, -0.7, 0.4]
"""
DEFAULT = ("346:0.236:0.1", "346:0.436:0.2", "1280:0.236:still", "1280:0.436:still")
IMAGES = 20
FINE_PX = 640  # width from which one sample a pixel is enough, and edges need blur for the latency
BLUR_PX = 2.0
ALL = (LATENCY, CORNER_BIAS)
# Source of the images, sensor of the events, blur in px, and what is unknown besides the poses.
STILL_SOURCES = (("frame", "", 0.0, ()), ("frame", "", 0.0, (CORNER_BIAS,)))
SOURCES = (
    ("frame", "noisy", 0.0, ()),
    ("hf", "noisy", 0.0, ()),
    ("hf", "noisy", 0.0, ALL),
    ("ei", "clean", 0.0, ALL),
)
FINE_SOURCES = (*SOURCES, ("ei", "clean", BLUR_PX, ALL))


def light_of(out: Path, width: int, depth_m: float, travel_m: float) -> RadianceSequence:
    """Render a recording, unless it is there."""
    done = out / "light" / "continuous"
    if (out / "truth.json").exists() and (out / "frames.csv").exists():
        return open_sequence(done)
    out.mkdir(parents=True, exist_ok=True)
    settings = out.with_suffix(".toml")
    settings.write_text(RIG.format(camera=CAMERAS[width], travel=travel_m))
    return render_rig(
        *(settings, out, depth_m),
        images=IMAGES,
        frame_camera=FrameCameraOptions(exposure=0.001),
        spp=4 if width < FINE_PX else 1,
        max_displacement_px=0.5 if width < FINE_PX else 1.0,
    )


def events_of(folder: Path, light: RadianceSequence) -> None:
    """Simulate the two sensors, unless that is done."""
    for name, camera in (("noisy", NOISY), ("clean", CLEAN)):
        events = folder / f"{name}.h5"
        if not events.exists():
            model = camera.on(light.width, light.height).model(white=light.white_level)
            simulate_sequence(light, model, events, SimulationOptions(seed=1))


def recording_of(folder: Path, sensor: str) -> RigRecording:
    """Open a recording with the events of one of the two sensors."""
    (folder / "events.h5").unlink(missing_ok=True)
    (folder / "events.h5").symlink_to(folder.resolve() / f"{sensor}.h5")
    return RigRecording(folder)


def stills_of(out: Path, width: int, depth_m: float) -> None:
    """Render images at 20 places of a stroke of 0.2 m, as a recording without events."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "frames").mkdir(exist_ok=True)
    (out / "rig.toml").write_text(RIG.format(camera=CAMERAS[width], travel=0.2))
    settings = read_rig(out / "rig.toml")
    assert settings.slider is not None
    page, slider = lay_out(settings.page), strokes(settings.slider)
    codes = draw(page, settings.page, out)
    camera = settings.camera_in(out)
    pose = true_pose(settings, settings.slider, page, camera, depth_m)
    write_print(out / "page.png", codes, page)
    (out / "page.json").write_text(json_text(page))
    (out / "slider.csv").write_text(slider_text(slider))
    (out / "truth.json").write_text(json_text(StoredPose.of(pose)))
    write_page_scene(out / "scene", page, codes, slider, pose)
    renderer = Renderer(load_scene(out / "scene"), integrator="emission", camera=camera)
    rng = np.random.default_rng(0)
    frames = []
    for k, t_us in enumerate(slider.evenly_along(IMAGES, 0.0, slider.t_us[-1]).tolist()):
        light = renderer.frame(pose.at(slider.position_m(t_us)))
        frames.append(Exposure(t_us, t_us, f"frames/{k:06d}.png"))
        image = developed(light.astype(np.float64) / PAPER, FrameCameraOptions(), rng)
        cv2.imwrite(str(out / frames[-1].file), image)
    write_exposures(out, frames)


def main(out: Path, settings: list[str]) -> None:
    """Print one line for each setting and source."""
    from process_times import times_now  # here: the tests load this file from elsewhere

    print(
        "camera depth  source blur unknowns                    found  rms px  image px  flow px"
        "  pos mm  latency ms  detect CPU s  solve CPU s"
        "  system s: detect  solve"
    )
    for setting in settings:
        width, depth_m = (float(part) for part in setting.split(":")[:2])
        travel, *others = setting.split(":")[2:]
        refinement = cast(Refinement, others[0]) if others else None
        folder = out / "rig_{}_{}_{}".format(*setting.split(":"))
        if travel == "still":
            stills_of(folder, int(width), depth_m)
            sources = STILL_SOURCES
        else:
            events_of(folder, light_of(folder, int(width), depth_m, float(travel)))
            sources = SOURCES if width < FINE_PX else FINE_SOURCES
        for source, sensor, blur_px, unknowns in sources:
            recording = recording_of(folder, sensor) if sensor else RigRecording(folder)
            start = times_now()
            found = detect(recording, source, images=IMAGES, blur_px=blur_px, refinement=refinement)
            detected = times_now()
            solved = solve_recording(recording, found, unknowns, math.inf)
            detecting, solving = detected - start, times_now() - detected
            truth = read_truth(recording)
            assert truth is not None
            errors = compare(solved.pose.on(recording.camera), truth, solved.x_m)
            in_view = visible(recording, truth, sorted(set(found.t_us.tolist())))
            extra = ",".join(solved.estimated[8:]) or "-"
            print(
                f"{width:5.0f} {100 * depth_m:4.1f} cm {source:>6} {blur_px:4.0f} {extra:<25} "
                f"{len(found.t_us):4d}/{in_view:<4d} {solved.rms_px:5.2f} {errors.image_px:8.3f} "
                f"{errors.flow_px:9.4f} {errors.position_mm:8.2f} {solved.latency_ms:9.2f} "
                f"{detecting.cpu_s:12.1f} {solving.cpu_s:12.1f} "
                f"{detecting.system_s:17.1f} {solving.system_s:6.1f}",
                flush=True,
            )


def visible(recording: RigRecording, truth: RigPose, times_us: list[int]) -> int:
    """Return how many markers are wholly in view in all images, from those at some times."""
    page, camera = recording.page, recording.camera
    corners = page.corners()
    x_m = recording.slider.position_m(np.array(times_us, float))
    total = 0
    for x in x_m.tolist():
        px = truth.project(corners.reshape(-1, 2), x).reshape(-1, 4, 2)
        inside = (px > 0) & (px < (camera.width, camera.height))
        total += int(np.all(inside, axis=(1, 2)).sum())
    return total * IMAGES // max(len(times_us), 1)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or list(DEFAULT))
