"""Highlights of a scene for the report: a frame, films of each sensor's events, and scaling
statistics, which show why finer sensors fire faster, with L_t.

All pictures show the image center.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from io import BytesIO
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from eres_render import RadianceSequence
from eres_render.cores import cores
from sensor import Events, SensorModel
from sensor.optics import crop_to_aspect
from sensor.statistics import (
    IntervalHistogram,
    SlopesBySize,
    fit_power_law,
    log_bin_edges_us,
    log_slope,
    slopes_by_pixel_size,
)
from tasks.evaluation.reference import ReferenceFrames
from tasks.evaluation.sensor_setting import Setting
from tasks.study.results.asked import CutoffInLux, SensorId, lux_of
from tasks.study.results.previews import FILM_PICTURES, FILM_S
from tasks.study.results.scaling import FIT_PX, Intervals, Scaling, Slopes
from tasks.study.run.jobs import Job, QueuedJob

BRIGHTER, DARKER, NONE = (38, 84, 168), (196, 66, 38), (247, 247, 245)  # RGB
MAX_FILM_BYTES = 192_000
_GRAYS = (32, 16, 8, 4, 2, 1)  # levels of the frames in a film; the first that fits is used
_CONTRAST = 0.6  # of the frames in a film: 1 is from black to `NONE`
_GAMMA = 2.2
_SIDE_PX = 320
_VIEW = 0.25  # of the image's width, around its center; at most its height
_SATURATED = 0.99  # quantile of |L_t| that is drawn in full color
_ROWS_USED = 320  # about, of each sensor, evenly spread, for the times between events
_BIN_EDGES_US = log_bin_edges_us()


class Highlights:
    """Collects the highlights of a job's scene from the events of its sensors.

    Of each sensor, only the first photoreceptor and contrast threshold count: films at the first
    speed, intervals between events at the lowest and highest. Of sensors with the same pixels,
    whose buses may differ, only the first is used.
    """

    def __init__(self, queued: QueuedJob, settings: list[Setting]) -> None:
        self._queued, self._first = queued, settings[0].model
        render, speeds = queued.job.render, queued.job.simulate.speeds
        size = render.height_at(render.resolution), render.resolution
        pixels = {replace(s, name="", readout=None): s for s in reversed(settings)}
        shown = [s for s in settings if s in {*pixels.values()}]
        used = {(*_sensor_of(s), s.speed): s for s in reversed(shown)}.values()
        settings = [s for s in shown if s in used]
        self._films = {s: Film(s.model, *size) for s in settings if s.speed == speeds[0]}
        self._histograms = {
            s: interval_histogram(s.model, (s.start_us, s.end_us))
            for s in settings
            if s.speed in (min(speeds), max(speeds))
        }

    def push(self, setting: Setting, events: Events) -> None:
        """Add the next events of one sensor."""
        if histogram := self._histograms.get(setting):
            histogram.add(events)
        if film := self._films.get(setting):
            film.add(events, setting.end_us)

    def result(self, reference: ReferenceFrames, sequence: RadianceSequence) -> dict[str, bytes]:
        """Return the highlights, after the last event, as files by path in the run's folder."""
        job = self._queued.job
        ago_s = FILM_S * job.simulate.speeds[0] * np.arange(FILM_PICTURES)[::-1] / FILM_PICTURES
        shown = np.searchsorted(sequence.t_s, sequence.window_s[1] - ago_s)
        white = np.float32(np.exp(reference.log_white(self._first)))
        frames = [sequence.frame(int(i)) / white for i in shown]
        previews = preview_files(job, frames, {_sensor_of(s): f for s, f in self._films.items()})
        histograms = {(*_sensor_of(s), s.speed): h for s, h in self._histograms.items()}
        dark_level = self._first.dark_level or 0.0
        scaling, slope = measure_scaling(reference.sequence, dark_level, histograms)
        scaling = replace(scaling, job=self._queued.key)
        return {
            **{f"previews/{name}": data for name, data in previews.items()},
            **{f"scaling/{name}": data for name, data in scaling_files(scaling, slope).items()},
        }


def _sensor_of(setting: Setting) -> tuple[SensorId, float]:
    """Return sensor and light; in lux, a profile may give a sensor another cutoff in this light."""
    lux, sensor = setting.illuminance_lux, SensorId(setting.model.width, setting.name)
    return sensor, CutoffInLux(lux) if lux else setting.model.cutoff_hz


class Film:
    """Events of a sensor in the center of the frames.

    `sums` (`FILM_PICTURES`, side, side) are the sums of polarities of the sensor's central pixels,
    and `part_px` is the side of the part of a frame that they see.
    """

    def __init__(self, sensor: SensorModel, frame_height: int, frame_width: int) -> None:
        sees = crop_to_aspect(frame_height, frame_width, sensor.height, sensor.width)[1]
        scale = sensor.width / (sees.stop - sees.start)
        *_, part = central_area(frame_height, frame_width)
        side = max(2, min(round(part * scale), sensor.height, sensor.width))
        self.sums = np.zeros((FILM_PICTURES, side, side), np.int16)
        self.part_px = round(side / scale)

    def add(self, events: Events, end_us: int) -> None:
        """Add events of the whole sensor; events outside of the film's time do not count."""
        start_us, side = end_us - round(FILM_S * 1e6), self.sums.shape[1]
        last = events.between(start_us, end_us)
        top, left = (events.height - side) // 2, (events.width - side) // 2
        y, x = last.y.astype(np.int64) - top, last.x.astype(np.int64) - left
        inside = (y >= 0) & (y < side) & (x >= 0) & (x < side)
        picture = (last.t_us[inside] - start_us) * FILM_PICTURES // (end_us - start_us)
        np.add.at(self.sums, (picture, y[inside], x[inside]), last.p[inside])


def preview_files(
    job: Job, frames: Sequence[NDArray[np.float32]], films: Mapping[tuple[SensorId, float], Film]
) -> dict[str, bytes]:
    """Draw previews; frames are (H, W), in units of white, at the end of each picture of a film."""
    scene, speed = job.scene.name, job.simulate.speeds[0]

    def drawn(film: Film) -> bytes:
        lights = [_seen(frame, film.part_px, film.sums.shape[1]) for frame in frames]
        return film_strip(np.stack(lights), film.sums)

    last = central_crop(np.clip(frames[-1], 0, 1)) ** (1 / _GAMMA) * 255
    gray = cv2.cvtColor(last.astype(np.uint8), cv2.COLOR_GRAY2BGR)
    frame = cv2.imencode(".png", gray)[1].tobytes()
    whole = SensorId(job.render.resolution)
    pictures = [("frame", whole, math.inf, "radiance at the window's end", "png", frame)]
    with ThreadPoolExecutor(cores()) as pool:
        for (sensor, light), data in zip(films, pool.map(drawn, films.values()), strict=True):
            pictures.append(("events", sensor, light, sensor.label, "webp", data))
    files: dict[str, bytes] = {}
    index: list[dict[str, Any]] = []
    for kind, sensor, light, caption, end, data in pictures:
        cutoff_hz = repr(float(light)).removesuffix(".0")  # JSON has no inf
        number = f"_{len(files)}" if sensor.name else ""  # a name may have any characters
        file = f"{scene}_{kind}_{sensor.width}_{cutoff_hz}{number}.{end}"
        files[file] = data
        entry = {"file": file, "scene": scene, "speed": speed, "kind": kind}
        entry |= {"width": sensor.width, "sensor": sensor.name}
        entry |= {"cutoff_hz": cutoff_hz, "illuminance_lux": lux_of(light)}
        index.append({**entry, "caption": caption})
    files[f"{scene}.json"] = json.dumps(index, indent=1).encode()
    return files


def _seen(frame: NDArray[np.float32], part_px: int, side: int) -> NDArray[np.float32]:
    """Return the center of a frame as a sensor of `side` px there sees it, tone-mapped."""
    top, left = (frame.shape[0] - part_px) // 2, (frame.shape[1] - part_px) // 2
    center = np.clip(frame[top : top + part_px, left : left + part_px], 0, 1)
    image = cv2.resize(center, (side, side), interpolation=cv2.INTER_AREA)
    return (image ** (1 / _GAMMA)).astype(np.float32)


def scaling_files(scaling: Scaling, slope: NDArray[np.float64]) -> dict[str, bytes]:
    """Return the files of a scene; `slope` is L_t, (H, W), 1/s."""
    strength = np.clip(slope / max(np.quantile(np.abs(slope), _SATURATED), 1e-9), -1, 1)
    picture = Image.fromarray(np.round(127 * central_crop(strength) + 127).astype(np.uint8))
    ramp = np.arange(-127, 128)[:, None] / 127
    color = np.where(ramp > 0, BRIGHTER, DARKER)
    palette = np.array(NONE) + np.abs(ramp) * (color - np.array(NONE))
    picture.putpalette(palette.round().astype(np.uint8).tobytes())
    file = BytesIO()
    picture.save(file, "PNG", optimize=True)
    numbers = asdict(scaling)
    for histogram in numbers["intervals"]:
        histogram["cutoff_hz"] = repr(histogram["cutoff_hz"])  # JSON has no inf
    return {
        f"{scaling.scene}.png": file.getvalue(),
        f"{scaling.scene}.json": json.dumps(numbers).encode(),
    }


def central_area(height: int, width: int) -> tuple[int, int, int]:
    """Return first row, first column and side of the center of an image, px."""
    side = max(2, min(round(width * _VIEW), height))
    return (height - side) // 2, (width - side) // 2, side


def central_crop(image: NDArray) -> NDArray:
    """Return the center of an image, enlarged to a preview by nearest neighbors."""
    y, x, side = central_area(*image.shape)
    k = (np.arange(_SIDE_PX) * side) // _SIDE_PX
    return image[y + k[:, None], x + k]


def film_strip(lights: NDArray[np.float32], sums: NDArray[np.int16]) -> bytes:
    """Draw the events of a film over its frames, side by side in a lossless WebP file.

    Both are (N, side, side). Frames are in [0, 1], with the most gray levels that keep the file
    within `MAX_FILM_BYTES`, or one level. Positive sums of polarities are blue, negative sums red.
    """
    colors = np.array([DARKER, NONE, BRIGHTER], np.uint8)[np.sign(sums) + 1]
    for levels in _GRAYS:
        dark = np.round((1 - lights) * (levels - 1)) / max(levels - 1, 1)
        pale = np.round(np.array(NONE) * (1 - _CONTRAST * dark[..., None])).astype(np.uint8)
        drawn = np.where(sums[..., None] != 0, colors, pale)
        file = BytesIO()
        Image.fromarray(np.concatenate(drawn, axis=1)).save(file, "WEBP", lossless=True, quality=50)
        if file.tell() <= MAX_FILM_BYTES:
            break
    return file.getvalue()


def interval_histogram(sensor: SensorModel, window_us: tuple[int, int]) -> IntervalHistogram:
    """Return an empty histogram of the times between events of a sensor."""
    every_row = max(1, sensor.height // _ROWS_USED)
    return IntervalHistogram(sensor.width, sensor.height, _BIN_EDGES_US, window_us, every_row)


def measure_scaling(
    sequence: RadianceSequence,
    dark_level: float,
    histograms: Mapping[tuple[SensorId, float, float], IntervalHistogram],
) -> tuple[Scaling, NDArray[np.float64]]:
    """Measure the slopes at the end of a clip, and add the histograms of its events.

    Histograms are by sensor, light as in `light_of`, and speed; `dark_level` is in the frames' unit
    of radiance. The second result is L_t between the last two frames, (H, W), 1/s.
    """
    before, after = (sequence.frame(len(sequence) - k).astype(np.float64) for k in (2, 1))
    dt_s = float(sequence.t_s[-1] - sequence.t_s[-2])
    slopes = slopes_by_pixel_size(before, after, dt_s, dark_level)
    scaling = Scaling(
        scene=sequence.manifest.scene,
        clip=sequence.manifest.clip,
        sizes_px=tuple(slopes.sizes_px.tolist()),
        everywhere=_slopes(slopes, slopes.everywhere, np.ones(len(slopes.everywhere))),
        edges=_slopes(slopes, slopes.edges, slopes.edge_weights),
        edges_us=tuple(_BIN_EDGES_US.tolist()),
        intervals=tuple(
            Intervals(
                width=sensor.width,
                cutoff_hz=float(light),
                speed=speed,
                counts=tuple(h.counts.tolist()),
                shorter=h.shorter,
                longer=h.longer,
                illuminance_lux=lux_of(light),
                sensor=sensor.name,
            )
            for (sensor, light, speed), h in histograms.items()
        ),
    )
    return scaling, log_slope(before, after, dt_s, dark_level)


def _slopes(
    slopes: SlopesBySize, blocks: NDArray[np.float64], weights: NDArray[np.number]
) -> Slopes:
    if not blocks.any():
        return Slopes((0.0,) * len(slopes.sizes_px), None)
    fitted = slopes.sizes_px <= FIT_PX
    law = fit_power_law(slopes.sizes_px[fitted], blocks[:, fitted], weights)
    return Slopes(tuple(np.average(blocks, axis=0, weights=weights).tolist()), law)
