"""Measure flow and images on a public recording of a DAVIS240C: slider_depth.

    python benchmarks/recordings.py FOLDER

FOLDER has files of the event camera dataset of Mueggler et al. (IJRR 2017), whose license is the
authors': images.txt, images/, calib.txt and groundtruth.txt, and its events as events.txt or, as in
github.com/tub-rip/events_viz (slider_depth/), the first 50,000 of them as events_chunk.txt.

Flow has 28 features in each of the four pairs of frames that the excerpt covers. Its reference is
the tracks of corners from frame to frame. The slider gives another reference that needs no frame:
the camera moves along its x axis only, so no point moves along y once the distortion of the lens is
removed. The script prints how far tracks and flow depart from that, and flow with events on the
grid of pixels, where zero flow along an axis looks sharper than it is.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from process_times import times_now

from eres_render.progress import silent
from sensor.events import concatenate
from tasks.evaluation.settings import settings_of
from tasks.evaluation.source import score_stored
from tasks.events.reading import ReadOptions
from tasks.flow import flow_sample
from tasks.methods import load_method
from tasks.methods.contrast_maximization import off_grid
from tasks.recording.clock import estimate_shift
from tasks.recording.flow_windows import spread, track
from tasks.recording.frames import RecordedFrames, inside, open_frames
from tasks.recording.options import USUAL_FLOW, FlowOptions
from tasks.recording.recording import Recording, open_recording
from tasks.recording.source import sources
from tasks.recording.threshold import Thresholds, fit_recording
from tasks.recording.video import Calibration, read_calibration
from tasks.recording.worth import worth_of_events
from tasks.row import Row

SIZE = 240, 180
FLOW = ("contrast_maximization", "contrast_maximization_by_gradient", "photometric_flow")
IMAGES = ("event_integration", "no_events")
VIDEO = ("high_pass_filter", "blank")


def opened(folder: Path) -> tuple[Recording, RecordedFrames]:
    """Return the recording of a folder, and its frames on the clock of the events."""
    events = folder / "events.txt"
    if not events.exists():
        events = folder / "events_chunk.txt"
    recording = open_recording(events, reading=ReadOptions(size=SIZE))
    frames = open_frames(folder, time_unit="s", exposure_us=0, encoding="linear")
    shift = estimate_shift(recording, frames)
    assert shift is not None, "frames and events fit"
    print(f"{recording.count} events, {recording.event_rate_hz / 1e6:.3f} M events/s")
    print(
        f"frames {shift.shift_us / 1000:.1f} ms later than their stamps: events leave "
        f"{100 * shift.unexplained:.0f} % of their change unexplained, "
        f"{100 * shift.unexplained_before:.0f} % without the shift"
    )
    return recording, frames.later(shift.shift_us)


def scored(
    recording: Recording,
    task: str,
    methods: tuple[str, ...],
    frames: RecordedFrames,
    thresholds: Thresholds,
    options: FlowOptions = USUAL_FLOW,
) -> list[Row]:
    """Score methods with these thresholds, by the time of their windows or images."""
    settings = settings_of(task, methods)
    windows = sources(recording, task, settings, frames, thresholds, options, silent)
    rows = [row for source in windows for row in score_stored(task, source, settings)]
    return sorted(rows, key=lambda row: row.t_us)


def measure_images(recording: Recording, frames: RecordedFrames) -> float:
    """Print the scores of images; return the fitted threshold."""
    found = fit_recording(recording, frames)
    print(f"thresholds ON {found.on}, OFF {found.off}, from {found.events} events")
    worth, _ = worth_of_events(recording, frames)
    print(f"an ON event is worth {worth.on:.3f} between two frames, an OFF event {worth.off:.3f}")
    scores = scored(recording, "reconstruction", IMAGES, frames, worth)
    scores += scored(recording, "video", VIDEO, frames, found.values)
    for name in (*IMAGES, *VIDEO):
        values = [score.value for score in scores if score.method == name]
        print(f"{name:34}{' '.join(f'{value:6.2f}' for value in values[:12])}  dB")
    return found.values.mean


def measure_flow(
    recording: Recording, frames: RecordedFrames, C: float, options: FlowOptions
) -> None:
    """Print the distance of flow from the tracks, px per frame."""
    start = times_now()
    methods = (*FLOW, "initial_flow")
    scores = scored(recording, "flow", methods, frames, Thresholds(C, C), options)
    spent = times_now() - start
    for name in (*FLOW, "initial_flow"):
        values = np.array([score.value for score in scores if score.method == name])
        print(
            f"{name:34}{np.median(values):6.2f} px, mean {values.mean():.2f} px, "
            f"{len(values)} features of {options.patch_px} px"
        )
    print(f"{spent.cpu_s:.1f} s of CPU, {spent.system_s:.1f} s of it system")


def measure_slider(
    recording: Recording, frames: RecordedFrames, options: FlowOptions, lens: Path
) -> None:
    """Print how far tracks and flow depart from the motion of the slider, along y."""
    calibration = read_calibration(lens, SIZE)
    method = load_method("flow", FLOW[0])
    search_px = options.search_px or SIZE[0] / 16
    events = concatenate([part for part in recording.parts() if len(part)])
    tracked, flowed, on_grid, on_px = [], [], [], []
    for k in spread(inside(recording, frames), options.windows):
        found = track(frames.light(k), frames.light(k + 1), options.features)
        window_us = (int(frames.middle_us[k]), int(frames.middle_us[k + 1]))
        for start_px, flow_px in zip(found.centers_px, found.flow_px, strict=True):
            sample = flow_sample(
                events,
                *window_us,
                log_image=np.zeros(SIZE[::-1]),
                contrast_threshold=0.2,
                center_px=start_px,
                side_px=options.patch_px,
                initial=np.zeros(2),
                initial_sigma_px=search_px / 4,
            )
            gridded_px = method(sample).flow
            on_px.append(np.linalg.norm(gridded_px - flow_px))
            off_px = method(off_grid(sample)).flow
            for into, flow in (tracked, flow_px), (flowed, off_px), (on_grid, gridded_px):
                places = undistorted(np.stack([start_px, start_px + flow]), calibration)
                into.append(places[1, 1] - places[0, 1])
    named = ("tracks", tracked), (FLOW[0], flowed), ("the same, on the grid", on_grid)
    for name, values in named:
        print(f"{name:34}{np.median(np.abs(values)):6.2f} px along y, where the slider moves 0")
    print(f"{'the same, on the grid':34}{np.median(on_px):6.2f} px from the tracks")


def undistorted(points_px: np.ndarray, lens: Calibration) -> np.ndarray:
    """Return where a pinhole camera would see some points; centers are at integers + 0.5."""
    points = (points_px - 0.5).reshape(-1, 1, 2)
    return cv2.undistortPoints(points, lens.K, lens.distortion, P=lens.K).reshape(-1, 2) + 0.5


def main() -> None:
    """Run the measurements."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--patch-px", type=int, default=FlowOptions().patch_px)
    parser.add_argument("--features", type=int, default=28)
    given = parser.parse_args()
    options = FlowOptions(patch_px=given.patch_px, features=given.features)
    recording, frames = opened(given.folder)
    C = measure_images(recording, frames)
    measure_flow(recording, frames, C, options)
    if (given.folder / "calib.txt").exists():
        measure_slider(recording, frames, options, given.folder / "calib.txt")


if __name__ == "__main__":
    main()
