"""Previews for the report: a frame and films of each sensor's events, in the image center."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eres_render.cores import cores
from sensor import Events, SensorModel
from sensor.optics import crop_to_aspect
from tasks.study.results.asked import SensorId, lux_of
from tasks.study.results.previews import FILM_PICTURES, FILM_S
from tasks.study.run.jobs import Job
from tasks.study.run.pictures import central_area, central_crop, film_strip, png

_GAMMA = 2.2


@dataclass(frozen=True, slots=True)
class Film:
    """Events of a sensor in the center of the frames.

    Parameters
    ----------
    sums : (`FILM_PICTURES`, side, side) int16
        Sums of polarities of the sensor's central pixels.
    part_px
        Side of the part of a frame that these pixels see, px.
    """

    sums: NDArray[np.int16]
    part_px: int

    @classmethod
    def of(cls, sensor: SensorModel, frame_height: int, frame_width: int) -> Film:
        """Return a film without events.

        Parameters
        ----------
        frame_height, frame_width
            Size of the frames, px; sensors of all shapes show the same part, if they see it.
        """
        sees = crop_to_aspect(frame_height, frame_width, sensor.height, sensor.width)[1]
        scale = sensor.width / (sees.stop - sees.start)
        *_, part = central_area(frame_height, frame_width)
        side = max(2, min(round(part * scale), sensor.height, sensor.width))
        return cls(np.zeros((FILM_PICTURES, side, side), np.int16), round(side / scale))

    def add(self, events: Events, end_us: int) -> None:
        """Add events.

        Parameters
        ----------
        events
            Events of the whole sensor; those outside of the film's time do not count.
        """
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
    """Draw a job's previews.

    Parameters
    ----------
    frames
        (H, W) radiance at the end of each picture of a film, in units of white.
    """
    scene, speed = job.scene.name, job.simulate.speeds[0]
    files: dict[str, bytes] = {}
    index: list[dict[str, Any]] = []

    def add(kind: str, sensor: SensorId, light: float, caption: str, end: str, data: bytes) -> None:
        cutoff_hz = repr(float(light)).removesuffix(".0")  # JSON has no inf
        number = f"_{len(files)}" if sensor.name else ""  # a name may have any characters
        file = f"{scene}_{kind}_{sensor.width}_{cutoff_hz}{number}.{end}"
        files[file] = data
        entry = {"file": file, "scene": scene, "speed": speed, "kind": kind}
        entry |= {"width": sensor.width, "sensor": sensor.name}
        entry |= {"cutoff_hz": cutoff_hz, "illuminance_lux": lux_of(light)}
        index.append({**entry, "caption": caption})

    last = central_crop(np.clip(frames[-1], 0, 1)) ** (1 / _GAMMA) * 255
    gray = np.repeat(last.astype(np.uint8)[..., None], 3, axis=2)
    whole = SensorId(job.render.resolution)
    add("frame", whole, math.inf, "radiance at the window's end", "png", png(gray))

    def drawn(film: Film) -> bytes:
        lights = [_seen(frame, film.part_px, film.sums.shape[1]) for frame in frames]
        return film_strip(np.stack(lights), film.sums)

    with ThreadPoolExecutor(cores()) as pool:
        strips = list(pool.map(drawn, films.values()))
    for (sensor, light), data in zip(films, strips, strict=True):
        add("events", sensor, light, sensor.label, "webp", data)
    files[f"{scene}.json"] = json.dumps(index, indent=1).encode()
    return files


def _seen(frame: NDArray[np.float32], part_px: int, side: int) -> NDArray[np.float32]:
    """Return the center of a frame as a sensor of `side` px there sees it, tone-mapped."""
    top, left = (frame.shape[0] - part_px) // 2, (frame.shape[1] - part_px) // 2
    center = np.clip(frame[top : top + part_px, left : left + part_px], 0, 1)
    image = cv2.resize(center, (side, side), interpolation=cv2.INTER_AREA)
    return (image ** (1 / _GAMMA)).astype(np.float32)
