"""Pictures of what each sensor saw, for the report: events over the middle of the image."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.study.run.highlights import PREVIEW_S, Exhibit
from tasks.study.run.jobs import Part
from tasks.study.run.pictures import BRIGHTER, DARKER, NONE, middle, png

_GAMMA = 2.2


def preview_files(part: Part, exhibit: Exhibit) -> dict[str, bytes]:
    """A part's pictures and, last, `SCENE.json`, which describes them, by file name.

    One shows the radiance at the window's end; one for each width and cutoff shows the sum of
    polarities in the window's last 10 ms at the first speed. All show the same part of the scene.
    """
    scene, speed = part.scene.name, part.simulate.speeds[0]
    files: dict[str, bytes] = {}
    index: list[dict[str, Any]] = []

    def add(picture: NDArray[np.uint8], entry: dict[str, Any]) -> None:
        file = "_".join([scene, entry["kind"], str(entry["width"]), str(entry["cutoff_hz"])])
        files[f"{file}.png"] = png(picture)
        index.append({"file": f"{file}.png", "scene": scene, "speed": speed, **entry})

    light = middle(np.clip(exhibit.keyframe, 0, 1) ** (1 / _GAMMA) * 255).astype(np.uint8)
    add(
        np.repeat(light[..., None], 3, axis=2),
        {
            "kind": "frame",
            "width": part.render.resolution,
            "cutoff_hz": "inf",
            "caption": "radiance at the window's end",
        },
    )
    for (width, cutoff_hz), total in exhibit.previews.items():
        colours = np.array([DARKER, NONE, BRIGHTER], np.uint8)
        caption = f"{width} px, last {PREVIEW_S * 1e3:g} ms"
        add(
            colours[np.sign(middle(total)) + 1],
            {"kind": "events", "width": width, "cutoff_hz": f"{cutoff_hz:g}", "caption": caption},
        )
    files[f"{scene}.json"] = json.dumps(index, indent=1).encode()
    return files
