"""The virtual rig: the page in Mitsuba, seen from a camera on a slider."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eres_render import Camera, RadianceSequence, load_scene, render_scene
from eres_render.calibration import write_camera
from eres_render.errors import check_positive
from eres_render.progress import Progress, silent
from eres_render.sequence.manifest import read_manifest
from eres_render.storage.atomic import make_folder, write_bytes, write_text
from eres_render.storage.exr import write_luminance
from eres_render.trajectory.tum import tum_text
from tasks.errors import RigError
from tasks.events.frame_camera import developed, exposed
from tasks.events.frame_camera_options import FrameCameraOptions
from tasks.exposures import FILE_NAME, Exposure, write_exposures
from tasks.rig import page as pages
from tasks.rig.bundle import RigPose
from tasks.rig.calibration import TRUTH_NAME, StoredPose
from tasks.rig.recording import FRAMES_FOLDER
from tasks.rig.settings import RIG_FILE, RigSettings, SliderSettings, check_bounds, read_rig
from tasks.rig.slider import SLIDER_FILE, Slider, slider_text, strokes

LIGHT_FOLDER = "light"

_MARGIN = 1.2  # size of the wall over what the camera sees of it
_MIN_EXPOSURE_S = 2e-6  # start, middle and end are whole microseconds

# With numbers to fill in. The wall is 0.1 mm behind the page, and reflects 0.6 of what paper does.
_XML = (Path(__file__).parent / "page_scene.xml").read_text(encoding="utf-8")
_TOML = """title = "A page on a wall, in front of a camera on a slider"
license = "CC0-1.0"
length_unit = "m"
radiance_unit = "W m^-2 sr^-1"

[plane]
point_m = [{half_w}, {half_h}, 0.0]
normal = [0.0, 0.0, -1.0]
half_width_m = {wall}

[camera]
fov_deg = {fov_deg}

[path]
kind = "tum"
file = "camera.txt"
min_clearance_m = 0.01
"""


def true_pose(
    settings: RigSettings, slider: SliderSettings, page: pages.Page, camera: Camera, depth_m: float
) -> RigPose:
    """Return the camera's pose: its axis meets the mount's point in the middle of a stroke.

    `depth_m` is the camera's distance from the page there.
    """
    mount = settings.mount
    turn = Rotation.from_euler("XYZ", mount.turn_deg, degrees=True).as_matrix()
    x, y = mount.middle_m or (0.5 * page.width_m, 0.5 * page.height_m)
    axis = turn[:, 2]
    if not axis[2] > 0:
        raise RigError(f"mount.turn_deg: {mount.turn_deg} turns the camera away from the page")
    middle = np.array([x, y, 0.0]) - depth_m / axis[2] * axis
    direction = np.array(slider.direction) / np.linalg.norm(slider.direction)
    return RigPose(camera, turn, middle - 0.5 * slider.travel_m * direction, direction)


def render_rig(
    rig_file: Path,
    out: Path,
    depth_m: float,
    *,
    images: int = 20,
    frame_camera: FrameCameraOptions,
    spp: int = 16,
    max_displacement_px: float = 0.5,
    seed: int = 0,
    on_progress: Progress = silent,
) -> RadianceSequence:
    """Render what the camera of a virtual rig sees on all strokes, as the folder of a recording.

    The events are not in it: `eres simulate DIR/light/continuous --out DIR/events.h5` adds them.
    `depth_m` is the camera's distance from the page in the middle of a stroke. `images` are along
    the way, in addition to an image before the start; white in them is the white level of the
    light.
    """
    settings = read_rig(rig_file)
    if settings.slider is None:
        raise RigError(f"{rig_file}: slider: is missing; it describes the strokes to render")
    check_positive("depth", depth_m, RigError, "a positive number of meters")
    check_bounds("images", images, 0)
    _check_images(out, images)
    frame_camera.check()
    # The first image is taken at rest.
    check_bounds("exposure", frame_camera.exposure, _MIN_EXPOSURE_S, settings.slider.pause_s)
    page = pages.lay_out(settings.page)
    codes = pages.draw(page, settings.page, rig_file.parent)
    slider = strokes(settings.slider)
    camera = settings.camera_in(rig_file.parent)
    pose = true_pose(settings, settings.slider, page, camera, depth_m)
    facts = {
        pages.FILE_NAME: pages.json_text(page),
        SLIDER_FILE: slider_text(slider),
        TRUTH_NAME: pages.json_text(StoredPose.of(pose)),
    }
    _check_same(out, facts)
    _check_light(out, page, codes, camera)
    write_text(out / RIG_FILE, rig_file.read_text(encoding="utf-8"))
    if out.resolve() != rig_file.parent.resolve():
        if settings.camera_file is not None:
            write_camera(out / settings.camera_file, camera)
        if (picture := rig_file.parent / settings.page.picture).is_file():
            write_bytes(out / picture.name, picture.read_bytes())
    pages.write_print(out / pages.IMAGE_NAME, codes, page)
    for name, text in facts.items():
        write_text(out / name, text)
    write_page_scene(out / "scene", page, codes, slider, pose)
    light = render_scene(
        load_scene(out / "scene"),
        out / LIGHT_FOLDER,
        camera=camera,
        spp=spp,
        seed=seed,
        integrator="emission",
        max_displacement_px=max_displacement_px,
        continuous=True,
        on_progress=on_progress,
    )[0]
    _write_frames(out, light, slider, images, frame_camera, seed)
    return light


def _check_images(out: Path, images: int) -> None:
    """Refuse a folder with images of an earlier render that would stay among the new ones."""
    earlier = sorted((out / FRAMES_FOLDER).glob(f"{'[0-9]' * 6}.png"))
    if earlier and (last := int(earlier[-1].stem)) > images:
        raise RigError(
            f"{earlier[-1]}: is from an earlier render; give --images >= {last}, or another --out"
        )


def _check_same(out: Path, facts: dict[str, str]) -> None:
    """Refuse the folder of another recording, whose light and events would get a false truth."""
    virtual = (out / TRUTH_NAME).exists()
    real = [] if virtual else [*out.glob(FILE_NAME), *out.glob("events.*")]
    if real:
        raise RigError(f"{real[0]}: belongs to a real recording; choose another --out")
    for name, text in facts.items():
        old = out / name
        if old.read_bytes() != text.encode() if old.exists() else virtual:
            raise RigError(f"{old}: was made for another rig or depth; choose another --out")


def _check_light(out: Path, page: pages.Page, codes: NDArray[np.uint8], camera: Camera) -> None:
    """Check that light that was rendered before is of this camera and picture."""
    image = out / pages.IMAGE_NAME
    for manifest in (out / LIGHT_FOLDER).glob("*/manifest.json"):
        same = image.exists() and np.array_equal(pages.read_page_image(image, page), codes)
        if read_manifest(manifest.parent).camera != camera or not same:
            raise RigError(f"{manifest}: is from another camera or picture; choose another --out")


def write_page_scene(
    folder: Path, page: pages.Page, codes: NDArray[np.uint8], slider: Slider, pose: RigPose
) -> None:
    """Write the page on its wall, and the camera's path, for `load_scene`."""
    make_folder(folder)
    middle = np.array([0.5 * page.width_m, 0.5 * page.height_m])
    ends_m = slider.x_m.min(), slider.x_m.max()
    view_m = np.array([pose.on_page(pose.camera.grid(2), x) for x in ends_m])
    wall = _MARGIN * max(float(np.abs(view_m - middle).max()), page.width_m, page.height_m)
    upward = pages.reflectance(codes)[::-1]  # a rectangle's v runs up, from the texture's first row
    write_luminance(folder / "page.exr", np.ascontiguousarray(upward, np.float32))
    fov_deg = np.rad2deg(pose.camera.fov_rad)
    facts = {"half_w": middle[0], "half_h": middle[1], "wall": wall, "fov_deg": fov_deg}
    facts = {name: repr(float(value)) for name, value in facts.items()}
    write_text(folder / "scene.xml", _XML.format(**facts))
    write_text(folder / "scene.toml", _TOML.format(**facts))
    write_text(folder / "camera.txt", tum_text(1e-6 * slider.t_us, pose.at(slider.x_m)))


def _write_frames(
    out: Path,
    light: RadianceSequence,
    slider: Slider,
    images: int,
    options: FrameCameraOptions,
    seed: int,
) -> None:
    """Write images of a frame camera: one at rest before the start, the others along the way."""
    first_us, last_us = 1e6 * light.t_s[0], 1e6 * light.t_s[-1]
    half_us = round(0.5e6 * options.exposure)
    middles_us = slider.evenly_along(images, first_us + 2 * half_us, last_us - 2 * half_us)
    rng = np.random.default_rng(seed)
    frames = []
    for k, t_us in enumerate([half_us, *middles_us.tolist()]):
        frame = Exposure(t_us - half_us, t_us + half_us, f"{FRAMES_FOLDER}/{k:06d}.png")
        radiance = exposed(light, 1e-6 * frame.start_us, 1e-6 * frame.end_us)
        codes = developed(radiance / light.white_level, options, rng)
        write_bytes(out / frame.file, cv2.imencode(".png", codes)[1].tobytes())
        frames.append(frame)
    write_exposures(out, frames)
