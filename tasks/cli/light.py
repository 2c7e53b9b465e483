"""Light: baking, rendering, ground truth, convergence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import OmitArgPrefixes, Positional, arg

import eres_render
from tasks.cli import terminal
from tasks.cli.app import ScenePath, SequenceFolder
from tasks.events.frame_camera_options import USUAL_CAMERA, FrameCameraOptions


def bake(
    scene: Annotated[Positional[str], arg(metavar="SCENE", help="name or folder of a scene")],
) -> None:
    """Bake a scene's lightmaps into its folder.

    Writes them next to scene.xml. Without them, the first render bakes into the cache. Baking needs
    LLVM or a GPU; a machine without either can use the lightmaps in the folder.
    """
    from eres_render.rendering.backend import select_variant
    from eres_render.rendering.lightmaps import bake_scene

    loaded = eres_render.load_scene(scene)
    select_variant()
    with terminal.progress() as on_progress:
        files = bake_scene(loaded, on_progress=on_progress)
    terminal.say(*map(str, files))


@dataclass(frozen=True, kw_only=True)
class View:
    """Size of the frames and lens; by default that of a Mitsuba .xml, or else 1280 x 1280 px.

    Parameters
    ----------
    resolution
        Side of square frames, px.
    width
        Width of frames of any shape, px; give the height too. The horizontal field of view is that
        of the scene.
    height
        Height of frames of any shape, px; give the width too.
    camera
        Calibrated camera that replaces the scene's: a YAML file of Kalibr (pinhole with radtan or
        none), OpenCV or ROS, with the size of the frames, focal lengths, principal point and lens.
        A lens needs LLVM or a GPU.
    camera_name
        Camera of a Kalibr file with several: cam0, cam1, ...
    """

    resolution: int | None = None
    width: int | None = None
    height: int | None = None
    camera: Path | None = None
    camera_name: str | None = None

    def camera_of(self, scene: eres_render.Scene) -> eres_render.Camera:
        """Return the camera of the file, or that of the scene with these sides."""
        names = "resolution", "width", "height", "camera"
        given = [f"--{name}" for name in names if getattr(self, name) is not None]
        if given not in ([], ["--resolution"], ["--width", "--height"], ["--camera"]):
            known = "--resolution, or --width and --height, or --camera"
            text = f"found {' and '.join(given)}, expected {known}"
            raise eres_render.RenderError(f"size of the frames: {text}")
        if self.camera is not None:
            from eres_render.calibration import read_camera

            return read_camera(self.camera, self.camera_name)
        if self.camera_name is not None:
            raise eres_render.RenderError(f"--camera-name {self.camera_name} needs --camera")
        if not given and scene.film is not None:
            return scene.camera(scene.film.width, scene.film.height)
        width = self.width if self.resolution is None else self.resolution
        return scene.camera(1280 if width is None else width, self.height)


OF_THE_SCENE = View()


def render(
    scene: ScenePath,
    out: Path,
    spp: int | None = None,
    max_displacement: float = 0.5,
    duration: float | None = None,
    samples: int | None = None,
    continuous: bool = False,
    trajectory: Path | None = None,
    integrator: Literal["baked", "baked-full", "path", "emission"] | None = None,
    seed: int = 0,
    warm_up: float | None = None,
    dry_run: bool = False,
    view: OmitArgPrefixes[View] = OF_THE_SCENE,
) -> None:
    """Render HDR frames along a camera path.

    Writes clips, one for every 0.5 s of the path, or one continuous sequence. A clip is a warm-up
    for the sensor and then a 50 ms window. Each is a folder: half-float OpenEXR frames of linear
    radiance, manifest.json, and poses in TUM's format. After an interruption the same command
    continues with the first missing frame.

    Parameters
    ----------
    out
        Folder for the clips.
    spp
        Samples per pixel: 1, 4, 9, 16, ...; by default those of a Mitsuba .xml, rounded up, or
        else 16.
    max_displacement
        Largest motion in the image between two frames, px.
    duration
        Length of the path to render, seconds; the whole path by default.
    samples
        Number of clips, from the start; all by default.
    continuous
        Render one sequence from the start to the duration, instead of clips.
    trajectory
        Poses (camera to world) in TUM's format, which replace the scene's path. The camera passes
        through them at their times. A Mitsuba .xml needs them.
    integrator
        How to compute light. baked: once, for Lambertian scenes. baked-full: the same light with a
        ray for every sample, many times slower. path: path tracing in every frame, with noise.
        emission: only the light that surfaces emit. By default path if objects move, emission if
        nothing reflects light, baked if possible, else path.
    seed
        Seed of the pixel sampler, the same for every frame.
    warm_up
        Length of a clip before its window, seconds; by default 0.0382, six time constants of a
        50 Hz filter at twice the speed. Dense flow needs 0.05 more. A longer one adds frames and
        changes none.
    dry_run
        Only print how many frames there are, and how much time and disk space they take.
    """
    loaded = eres_render.load_scene(scene, trajectory)
    if spp is None:
        spp = math.ceil(math.sqrt(loaded.film.spp)) ** 2 if loaded.film else 16
    with terminal.progress() as on_progress:
        sequences = eres_render.render_scene(
            loaded,
            out,
            camera=view.camera_of(loaded),
            spp=spp,
            seed=seed,
            integrator=integrator,
            duration_s=duration,
            max_displacement_px=max_displacement,
            samples=samples,
            continuous=continuous,
            warm_up_s=warm_up,
            dry_run=dry_run,
            on_progress=on_progress,
        )
    for sequence in sequences:
        terminal.say(f"{sequence.folder}: {len(sequence)} frames")


def stereo(scene: ScenePath, out: Path, baseline: float, trajectory: Path | None = None) -> None:
    """Write the path of a second camera on the same rig.

    The second camera is to the right of the scene's. Give the path to `eres render --trajectory` to
    render what it sees.

    Parameters
    ----------
    out
        File for the poses, in TUM's format.
    baseline
        Distance of the two cameras, meters; negative for a camera to the left.
    trajectory
        Poses in TUM's format in place of the scene's path.
    """
    from eres_render.storage.atomic import write_text
    from eres_render.trajectory.rig import second_camera, to_the_right
    from eres_render.trajectory.tum import tum_text
    from tasks.errors import TaskError

    if out.exists():
        raise TaskError(f"{out}: already exists; choose another name")
    if not math.isfinite(baseline):
        raise TaskError(f"--baseline: found {baseline:g} m, expected a finite distance")
    loaded = eres_render.load_scene(scene, trajectory)
    path = loaded.trajectory()
    # Refused if longer than one can render.
    end_s = eres_render.continuous_stretch(loaded).t_window_end_s
    t_s, poses = second_camera(path, to_the_right(baseline), end_s)
    write_text(out, tum_text(t_s, poses, path.t_offset_us))
    terminal.say(f"{out}: {len(t_s)} poses")


def truth(
    sequence: SequenceFolder,
    out: Path,
    width: int = 346,
    height: int | None = None,
    step: float = 0.05,
    flow_png: bool = False,
    overwrite: bool = False,
) -> None:
    """Write ground truth: depth, flow, visibility, objects, poses.

    Depth is along the camera's axis, in meters (EXR channel Z). Flow is in pixels, from each time
    to the next (EXR channels u, v, valid, occluded). If objects move, masks hold the number of the
    object at each pixel. Times run from the start of the window to its end.

    Parameters
    ----------
    out
        Folder to write into.
    width
        Width of the images, px; use that of the sensor.
    height
        Height of the images, px, for a sensor of another aspect ratio, which sees the center of the
        frames. By default the images show all of the frames.
    step
        Time from one image to the next, seconds. The last step may be shorter, to end with the
        window.
    flow_png
        Write the flow as 16-bit PNG too, as in the DSEC dataset.
    overwrite
        Replace ground truth in the folder.
    """
    opened = eres_render.open_sequence(sequence)
    exact, times_s = eres_render.ground_truth(opened), eres_render.window_times(opened, step)
    how = {"flow_png": flow_png, "overwrite": overwrite}
    with terminal.progress() as on_progress:
        files = eres_render.write_truth(
            exact, out, times_s, width, height, **how, on_progress=on_progress
        )
    terminal.say(f"{out}: {len(files)} files, {len(times_s)} times")


def images(
    sequence: SequenceFolder,
    out: Path,
    rate: float = 30.0,
    speed: float = 1.0,
    seed: int = 0,
    camera: OmitArgPrefixes[FrameCameraOptions] = USUAL_CAMERA,
) -> None:
    """Take images with a frame camera along a sequence.

    Writes 8-bit gray PNG files. An image is the mean of the rendered light over its exposure, with
    noise, encoded as sRGB; white is the sequence's white. frames.csv has the start and end of each
    exposure on the events' clock, as --frames of other commands reads them. Rate and exposure are
    in the events' time too.

    Parameters
    ----------
    out
        Folder for the images.
    rate
        Images per second.
    speed
        Factor by which the scene moves faster than in the frames, as in `eres simulate`.
    seed
        Seed of the noise.
    """
    from tasks.events.frame_camera import write_images

    clip = eres_render.open_sequence(sequence)
    with terminal.progress() as on_progress:
        count = write_images(
            clip, out, rate, camera, speed=speed, seed=seed, on_progress=on_progress
        )
    terminal.say(f"{out}: {count} images")


def convergence(
    scene: ScenePath, resolution: int = 1280, duration: float = 0.01, trajectory: Path | None = None
) -> None:
    """Show how many samples and frames are enough for a scene.

    Renders one stretch in the middle of the path with more and more samples per pixel, and with
    less and less motion per frame: once with the same random numbers in all frames, once with fresh
    ones. Prints the number of events of an ideal sensor at the frames' resolution, and the PSNR of
    event integration against the finest frames. Takes minutes at 1280 px on 2 cores.

    Parameters
    ----------
    resolution
        Side of frames and sensor, px.
    duration
        Length of the stretch, seconds.
    trajectory
        Poses in TUM's format in place of the scene's path.
    """
    from tasks.evaluation.convergence import converge

    table = terminal.Table("samples", "motion", "seeds", "frames", "events", "", "PSNR")
    finest: int | None = None
    loaded = eres_render.load_scene(scene, trajectory)
    with terminal.progress() as on_progress:
        outcomes = converge(
            loaded, resolution=resolution, duration_s=duration, on_progress=on_progress
        )
        for outcome in outcomes:
            setting, finest = outcome.setting, finest or outcome.events
            table.add_row(
                f"{setting.spp} spp",
                f"{setting.max_displacement_px:g} px",
                "fresh" if setting.fresh_seeds else "common",
                str(outcome.frames),
                str(outcome.events),
                f"{100 * (outcome.events / finest - 1):+.1f} %" if finest else "",
                f"{outcome.psnr_db:.2f} dB",
            )
    terminal.show(table)
