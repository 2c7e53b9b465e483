"""Calibrate and study a camera on a motorized slider."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from tasks.cli import terminal
from tasks.cli.app import require, several
from tasks.events.overwriting import check_new

_RigFile = Annotated[Positional[Path], arg(metavar="RIG", help="rig.toml")]
_Recordings = Annotated[
    Positional[tuple[Path, ...]],
    several("RECORDINGS", "folders of recordings, one for each distance"),
]


def page(rig: _RigFile, out: Path, overwrite: bool = False) -> None:
    """Draw the page to print: a picture with ArUco markers around it.

    Writes OUT, and next to it page.png and page.json, which has the markers in meters. Print at
    100 %, and check the side of a marker against page.json.

    Parameters
    ----------
    out
        File to print, .pdf or .png.
    overwrite
        Replace existing files.
    """
    from eres_render.storage.atomic import write_text
    from tasks.rig import page as pages
    from tasks.rig.settings import read_rig

    settings = read_rig(rig).page
    pages.check_print(out)
    numbers, image = out.with_name(pages.FILE_NAME), out.with_name(pages.IMAGE_NAME)
    for file in {out, numbers, image}:
        check_new(file, overwrite)
    layout = pages.lay_out(settings)
    codes = pages.draw(layout, settings, rig.parent)
    for file in sorted({out, image}):
        pages.write_print(file, codes, layout, overwrite=overwrite)
    write_text(numbers, pages.json_text(layout), overwrite=overwrite)
    terminal.say(
        f"{out}: {layout.width_m * 100:.1f} x {layout.height_m * 100:.1f} cm, "
        f"{len(layout.markers_m)} markers of {layout.marker_m * 1e3:.2f} mm"
    )


def render(
    rig: _RigFile,
    out: Path,
    depth: float,
    images: int = 20,
    exposure: float = 0.001,
    spp: int = 16,
    max_displacement: float = 0.5,
    seed: int = 0,
) -> None:
    """Render the views of a virtual rig's camera on all strokes of its slider.

    Writes the folder of a recording: rig.toml, the page, slider.csv, frames of a frame camera with
    their exposures, truth.json, and the light. Simulate the events from the light with
    `eres simulate OUT/light/continuous --out OUT/events.h5`. The same command continues an
    interrupted render.

    Parameters
    ----------
    out
        Folder of the recording.
    depth
        Distance from the camera's center to the page in the middle of a stroke, meters.
    images
        Number of images of the frame camera, evenly spaced along the slider's travel. One more
        image is taken before the start.
    exposure
        Exposure time of the frame camera, seconds.
    spp
        Samples per pixel: 1, 4, 9, 16, ...
    max_displacement
        Largest motion in the image between two rendered frames, px.
    seed
        Seed of the rendered samples and of the image noise.
    """
    from tasks.events.frame_camera_options import FrameCameraOptions
    from tasks.rig.virtual import render_rig

    with terminal.progress() as on_progress:
        light = render_rig(
            rig,
            out,
            depth,
            images=images,
            frame_camera=FrameCameraOptions(exposure=exposure),
            spp=spp,
            max_displacement_px=max_displacement,
            seed=seed,
            on_progress=on_progress,
        )
    terminal.say(f"{light.folder}: {len(light)} frames")


def intrinsics(
    recordings: Annotated[
        Positional[tuple[Path, ...]],
        several("EVENTS...", "files of events, one for each view of the board"),
    ],
    out: Path,
    board: tuple[int, int],
    square: float,
    size: tuple[int, int] | None = None,
    overwrite: bool = False,
) -> None:
    """Calibrate a camera from recordings of a flashing chessboard.

    Show a flashing chessboard, such as a video on a screen. Record it from several sides, one file
    for each view, with tilts of 20 degrees or more. Keep the camera and the board still.

    Parameters
    ----------
    out
        Camera file to write, in OpenCV's YAML. Name it in rig.toml as camera_file.
    board
        Inner corners of the board along a row and along a column.
    square
        Side of a square, meters.
    size
        Width and height of the sensor, px, for files that do not store them.
    overwrite
        Replace an existing file.
    """
    from eres_render.calibration import write_camera
    from tasks.rig import intrinsics as lens

    require(recordings, "file of events")
    check_new(out, overwrite, *recordings)
    with terminal.progress() as on_progress:
        chessboard = lens.Board(*board, square)
        result = lens.intrinsics([*recordings], chessboard, size=size, on_progress=on_progress)
    camera, views = result.camera, f"{len(result.views)} of {len(recordings)} views"
    write_camera(out, camera, overwrite=overwrite)
    terminal.say(f"{out}: {views}, rms {result.rms_px:.2f} px")
    for name, sigma in result.sigmas.items():
        value = getattr(camera if name[0] in "fc" else camera.distortion, name, 0.0)
        terminal.say(f"{name}: {value:.4g} +- {sigma:.2g}")


def detect(
    recording: Annotated[
        Positional[Path], arg(metavar="RECORDING", help="folder of a recording of the rig")
    ],
    out: Path,
    source: Literal["frame", "hf", "ei"] = "hf",
    images: int = 20,
    max_speed: float = math.inf,
    threshold: float | None = None,
    blur: float = 0.0,
    refinement: Literal["none", "subpix", "contour", "apriltag"] | None = None,
    overwrite: bool = False,
) -> None:
    """Find the markers in images of a recording.

    Parameters
    ----------
    out
        File of corners, .parquet.
    source
        Source of the images: frame, the frame camera; hf, the high-pass filter on events alone; ei,
        the first frame plus all later events, for simulated events without noise.
    images
        Number of images, evenly spaced along the slider's travel.
    max_speed
        Leave out times at which the slider is faster, m/s.
    threshold
        Contrast threshold for ei, log units; by default the simulated sensor's.
    blur
        Standard deviation of the Gaussian blur of each image, px. With 2 px at a width of 1280 px,
        the latency of ei matches the photoreceptor's to 10 %. Corners are less exact, so use it
        only to measure the latency. A marker's cells must be several times wider than the blur.
    refinement
        OpenCV's corner refinement; contour by default. Images narrower than 640 px are enlarged
        four times.
    overwrite
        Replace an existing file.
    """
    from tasks.rig.markers import detect as find
    from tasks.rig.markers import write_detections
    from tasks.rig.recording import RigRecording, recorded_files

    check_new(out, overwrite, recording, *recorded_files(recording))
    with terminal.progress() as on_progress:
        detections = find(
            RigRecording(recording),
            source,
            images=images,
            max_speed_mps=max_speed,
            contrast_threshold=threshold,
            blur_px=blur,
            refinement=refinement,
            on_progress=on_progress,
        )
    write_detections(out, detections, overwrite=overwrite)
    t_us = detections.t_us.tolist()
    terminal.say(f"{out}: {len(t_us)} markers in {len({*t_us})} images")


def solve(
    recordings: _Recordings,
    out: Path,
    corners: str = "corners.parquet",
    latency: bool = False,
    scale: bool = False,
    corner_bias: bool = False,
    max_rms: float = 2.0,
    overwrite: bool = False,
) -> None:
    """Solve the camera's pose on the slider from the markers, for each recording.

    Estimates eight numbers: the camera's rotation, its position at the slider's 0, and the
    direction of travel. OUT also has their covariance. Fails if the corners do not determine all
    eight, or contradict each other. For a virtual recording, prints the errors against the truth,
    which is read only after OUT is written.

    Parameters
    ----------
    out
        File of the calibration, .json.
    corners
        Name of the file from `eres rig detect` in each recording's folder.
    latency
        Estimate the latency of the images; needs images in both directions of travel.
    scale
        Estimate the scale of the slider's encoder.
    corner_bias
        Estimate how far corners appear shifted away from the middle of their markers, px. Negative
        values are toward the middle, as in images of log intensity.
    max_rms
        Fail if the root mean square of the residuals is larger, px.
    overwrite
        Replace an existing file.
    """
    from eres_render.storage.atomic import write_text
    from tasks.rig.bundle import CORNER_BIAS, LATENCY, SCALE
    from tasks.rig.calibration import RigCalibration, compare, read_truth, solve_recording
    from tasks.rig.markers import read_detections
    from tasks.rig.page import json_text
    from tasks.rig.recording import RigRecording, recorded_files

    require(recordings, "recording")
    for folder in recordings:
        check_new(out, overwrite, folder / corners, *recorded_files(folder))
    asked = {LATENCY: latency, SCALE: scale, CORNER_BIAS: corner_bias}
    unknowns = tuple(name for name, is_asked in asked.items() if is_asked)
    opened = [RigRecording(folder) for folder in recordings]
    solved = [
        solve_recording(recording, read_detections(recording.folder / corners), unknowns, max_rms)
        for recording in opened
    ]
    write_text(out, json_text(RigCalibration(recordings=tuple(solved))), overwrite=overwrite)
    table = terminal.Table("recording", "markers", "rms", "latency", "scale", "corner bias")
    for result in solved:
        markers = f"{result.inliers} of {result.markers} in {result.images} images"
        delay, factor = f"{result.latency_ms:.3f} ms", f"{result.pose.scale:.5f}"
        rms, bias = (f"{px:.3f} px" for px in (result.rms_px, result.corner_bias_px))
        table.add_row(Path(result.recording).name, markers, rms, delay, factor, bias)
    terminal.show(table)
    for recording, result in zip(opened, solved, strict=True):
        if (truth := read_truth(recording)) is not None:
            errors = compare(result.pose.on(recording.camera), truth, result.x_m)
            terminal.say(
                f"{recording.folder.name}, against the truth: position {errors.position_mm:.3f} "
                f"mm, turn {1e3 * errors.turn_deg:.1f} mdeg, image {errors.image_px:.4f} px, flow "
                f"{errors.flow_px:.4f} px in 6 mm"
            )


def crop(recordings: _Recordings, calibration: Path, out: Path, overwrite: bool = False) -> None:
    """Crop the events of recordings to the field that all of them show.

    Writes a folder for each recording: events.h5, crop.json, slider.csv, the page, and for each
    millisecond the pose (TUM) and the homography from the page to the crop.

    Parameters
    ----------
    calibration
        File from `eres rig solve` for all these recordings.
    out
        Folder for the crops.
    overwrite
        Replace existing files.
    """
    from tasks.rig import crop as crops
    from tasks.rig.calibration import read_rig_calibration
    from tasks.rig.recording import RigRecording

    require(recordings, "recording")
    opened = [RigRecording(folder) for folder in recordings]
    solved = read_rig_calibration(calibration)
    with terminal.progress() as on_progress:
        folders = crops.crop(opened, solved, out, overwrite=overwrite, on_progress=on_progress)
    for folder in folders:
        box = crops.read_crop(folder).box
        terminal.say(f"{folder}: {box.width}x{box.height} px from ({box.left}, {box.top})")


def evaluate(
    crops: Annotated[
        Positional[tuple[Path, ...]],
        several("CROPS", "folders of `eres rig crop`, one for each print"),
    ],
    out: Path,
    tasks: tuple[Literal["flow", "video", "tracking"], ...] = ("flow", "video", "tracking"),
    places: int = 10,
    travel: float = 0.006,
    threshold: float | None = None,
    cutoff: float | None = None,
    initial_sigma_mm: float = 5.0,
    seed: int = 0,
    overwrite: bool = False,
) -> None:
    """Score the methods of flow, video and tracking on the crops of a rig.

    The truth comes from the solved poses at the encoder's times; the sensor's delay is not removed.
    OUT is the folder of a run: `eres claims OUT` judges the paper's claim about its slider on these
    recordings, and `eres report OUT` draws their scores. Speeds are in m/s. Crops whose widths
    differ by less than 10 % count as one distance, and speeds within 10 % as one speed. At each
    speed, only places and corners that all distances share are scored.

    Parameters
    ----------
    out
        Folder of the run, with rows.parquet, study.json and environment.json.
    tasks
        Tasks to score; tracking needs a camera without distortion.
    places
        Number of places, evenly spaced along the travel that all recordings of a print share. Every
        pass of the carriage is scored. Intervals need 6 places.
    travel
        Travel of the slider in a window around a place, meters.
    threshold
        Contrast threshold, log units; by default the simulated sensor's.
    cutoff
        Cutoff of the photoreceptor, Hz, as `eres fit --crop --motion` estimates it; by default the
        simulated sensor's. It names the light in the report and changes no score.
    initial_sigma_mm
        Standard deviation of the initial error of each control position in tracking, mm.
    seed
        Seed of the initial errors in flow and tracking.
    overwrite
        Replace an existing file.
    """
    from collections import Counter
    from dataclasses import asdict
    from statistics import median

    from tasks.metric import MIN_SAMPLES_FOR_INTERVAL
    from tasks.rig.evaluate import RigEvaluation, evaluate_rig
    from tasks.row import write_rows
    from tasks.study.run.run_folder import check_recorded, write_recorded

    require(crops, "crop")
    file = out / "rows.parquet"
    check_new(file, overwrite)
    check_recorded(out)
    left_out: dict[str, Any] = dict.fromkeys({"flow", "video", "tracking"} - {*tasks}, ())
    settings = RigEvaluation(
        places=places,
        travel_m=travel,
        contrast_threshold=threshold,
        cutoff_hz=cutoff,
        initial_sigma_mm=initial_sigma_mm,
        seed=seed,
        **left_out,
    )
    with terminal.progress() as on_progress:
        rows = evaluate_rig(crops, settings, on_progress=on_progress)
    check_new(file, overwrite)  # again: one may have appeared meanwhile
    file.unlink(missing_ok=True)  # rows that are there are of the study beside them
    write_recorded(out, crops, asdict(settings))
    write_rows(file, rows)
    groups: dict[tuple[str, ...], list[float]] = {}
    for row in rows:
        key = row.task, row.method, row.variant, str(row.width), f"{row.speed:g}", row.metric
        groups.setdefault(key, []).append(row.value)
    table = terminal.Table("task", "method", "variant", "width", "m/s", "metric", "median")
    for cells, values in sorted(groups.items()):
        table.add_row(*cells, f"{median(values):.3g}")
    terminal.show(table)
    for scene in dict.fromkeys(row.scene for row in rows):
        scored = {(row.task, row.sample) for row in rows if row.scene == scene}
        count, needed = min(Counter(task for task, _ in scored).values()), MIN_SAMPLES_FOR_INTERVAL
        hint = f"; intervals need {needed}: use more --places or longer strokes"
        few = hint if count < needed else ""
        terminal.say(f"{scene}: {count} of {places} places at each speed{few}")
    terminal.say(f"{file}: {len(rows)} rows")
