"""Previews for the report: a frame and films of each sensor's events, in the image center."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.study.results.previews import FILM_PICTURES
from tasks.study.run.jobs import Job
from tasks.study.run.pictures import central_crop, drawn_over, film, png

_GAMMA = 2.2


def preview_files(
    job: Job,
    frames: Sequence[NDArray[np.float32]],
    polarity_sums: Mapping[tuple[int, float], NDArray[np.int16]],
) -> dict[str, bytes]:
    """Draw a job's previews; all show the same part of the scene.

    Parameters
    ----------
    job
        The job.
    frames
        (H, W) radiance at the end of each picture of a film, in units of white.
    polarity_sums
        (`FILM_PICTURES`, h, w) sums in the center of the image at the first speed, by width and
        cutoff.

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

    grounds = [
        np.repeat(
            (central_crop(np.clip(frame, 0, 1)) ** (1 / _GAMMA) * 255).astype(np.uint8)[..., None],
            *(3, 2),
        )
        for frame in frames
    ]
    caption = "radiance at the window's end"
    add("frame", job.render.resolution, "inf", caption, "png", png(grounds[-1]))
    for (width, cutoff_hz), sums in polarity_sums.items():
        pictures = [drawn_over(grounds[i], sums[i]) for i in range(FILM_PICTURES)]
        add("events", width, f"{cutoff_hz:g}", f"{width} px", "webp", film(pictures))
    files[f"{scene}.json"] = json.dumps(index, indent=1).encode()
    return files
