"""Pictures for the report: a frame, and each sensor's events in the center of the image."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.study.run.jobs import Job
from tasks.study.run.pictures import BRIGHTER, DARKER, NONE, central_crop, png

PREVIEW_S = 0.01  # events of the window's last 10 ms make a picture
_GAMMA = 2.2


def preview_files(
    job: Job,
    keyframe: NDArray[np.float32],
    polarity_sums: Mapping[tuple[int, float], NDArray[np.int64]],
) -> dict[str, bytes]:
    """Draw a job's pictures; all show the same part of the scene.

    Parameters
    ----------
    job
        The job.
    keyframe
        (H, W) radiance at the window's end, in units of white.
    polarity_sums
        (h, w) sums over the window's last 10 ms at the first speed, by width and cutoff.

    Returns
    -------
    Files by name: PNG pictures and, last, `SCENE.json`, which describes them.
    """
    scene, speed = job.scene.name, job.simulate.speeds[0]
    files: dict[str, bytes] = {}
    index: list[dict[str, Any]] = []

    def add(picture: NDArray[np.uint8], entry: dict[str, Any]) -> None:
        file = "_".join([scene, entry["kind"], str(entry["width"]), str(entry["cutoff_hz"])])
        files[f"{file}.png"] = png(picture)
        index.append({"file": f"{file}.png", "scene": scene, "speed": speed, **entry})

    light = central_crop(np.clip(keyframe, 0, 1) ** (1 / _GAMMA) * 255).astype(np.uint8)
    add(
        np.repeat(light[..., None], 3, axis=2),
        {
            "kind": "frame",
            "width": job.render.resolution,
            "cutoff_hz": "inf",
            "caption": "radiance at the window's end",
        },
    )
    for (width, cutoff_hz), total in polarity_sums.items():
        colors = np.array([DARKER, NONE, BRIGHTER], np.uint8)
        caption = f"{width} px, last {PREVIEW_S * 1e3:g} ms"
        add(
            colors[np.sign(central_crop(total)) + 1],
            {"kind": "events", "width": width, "cutoff_hz": f"{cutoff_hz:g}", "caption": caption},
        )
    files[f"{scene}.json"] = json.dumps(index, indent=1).encode()
    return files
