"""Previews for the report: a frame and films of each sensor's events, in the image center."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eres_render.cores import cores
from sensor import Events, SensorModel
from tasks.study.results.previews import FILM_PICTURES, FILM_S
from tasks.study.run.jobs import Job
from tasks.study.run.pictures import central_area, central_crop, film, png

_GAMMA = 2.2

Sums = NDArray[np.int16]
"""(`FILM_PICTURES`, side, side) sums of polarities in the center of a sensor."""


def no_events(sensor: SensorModel) -> Sums:
    """Return the sums of a film without events."""
    *_, side = central_area(sensor.height, sensor.width)
    return np.zeros((FILM_PICTURES, side, side), np.int16)


def add_events(sums: Sums, events: Events, end_us: int) -> None:
    """Add events to the sums of a film.

    Parameters
    ----------
    sums
        The sums, changed in place.
    events
        Events of the whole sensor; those outside of the film's time do not count.
    end_us
        End of the film, in the time of the events.
    """
    start_us = end_us - round(FILM_S * 1e6)
    last = events.between(start_us, end_us)
    top, left, side = central_area(events.height, events.width)
    y, x = last.y.astype(np.int64) - top, last.x.astype(np.int64) - left
    inside = (y >= 0) & (y < side) & (x >= 0) & (x < side)
    picture = (last.t_us[inside] - start_us) * FILM_PICTURES // (end_us - start_us)
    np.add.at(sums, (picture, y[inside], x[inside]), last.p[inside])


def preview_files(
    job: Job,
    frames: Sequence[NDArray[np.float32]],
    sums: Mapping[tuple[int, float], Sums],
) -> dict[str, bytes]:
    """Draw a job's previews; all show the same part of the scene.

    Parameters
    ----------
    job
        The job.
    frames
        (H, W) radiance at the end of each picture of a film, in units of white.
    sums
        Sums of the films at the first speed, by width and cutoff.

    Returns
    -------
    Files by name: a PNG picture, WebP films and, last, `SCENE.json`, which describes them.
    """
    scene, speed = job.scene.name, job.simulate.speeds[0]
    files: dict[str, bytes] = {}
    index: list[dict[str, Any]] = []

    def add(kind: str, width: int, cutoff_hz: str, caption: str, end: str, data: bytes) -> None:
        file = f"{scene}_{kind}_{width}_{cutoff_hz}.{end}"
        files[file] = data
        entry = {"file": file, "scene": scene, "speed": speed, "kind": kind, "width": width}
        index.append({**entry, "cutoff_hz": cutoff_hz, "caption": caption})

    last = central_crop(np.clip(frames[-1], 0, 1)) ** (1 / _GAMMA) * 255
    gray = np.repeat(last.astype(np.uint8)[..., None], 3, axis=2)
    add("frame", job.render.resolution, "inf", "radiance at the window's end", "png", png(gray))

    def drawn(of_one: Sums) -> bytes:
        return film(np.stack([_seen(frame, of_one.shape[1]) for frame in frames]), of_one)

    with ThreadPoolExecutor(cores()) as pool:
        films = list(pool.map(drawn, sums.values()))
    for (width, cutoff_hz), data in zip(sums, films, strict=True):
        add("events", width, f"{cutoff_hz:g}", f"{width} px", "webp", data)
    files[f"{scene}.json"] = json.dumps(index, indent=1).encode()
    return files


def _seen(frame: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    """Return the center of a frame as a sensor of `side` px there sees it, tone-mapped."""
    top, left, size = central_area(*frame.shape)
    center = np.clip(frame[top : top + size, left : left + size], 0, 1)
    seen = cv2.resize(center, (side, side), interpolation=cv2.INTER_AREA)
    return (seen ** (1 / _GAMMA)).astype(np.float32)
