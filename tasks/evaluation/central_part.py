"""The central part of frames that a sensor of another shape sees, as a sequence of its own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from eres_render import GroundTruth, RadianceSequence
from sensor.optics import crop_to_aspect


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class _CentralPart(RadianceSequence):
    """A sequence that crops the frames of another, which may still be rendering."""

    whole: RadianceSequence
    rows: slice
    columns: slice

    def __iter__(self) -> Iterator[NDArray[np.float32]]:
        return (frame[self.rows, self.columns] for frame in self.whole)

    def frame(self, i: int) -> NDArray[np.float32]:
        """Read frame i: (H, W) float32 linear radiance."""
        return self.whole.frame(i)[self.rows, self.columns]


def central_part(
    sequence: RadianceSequence, truth: GroundTruth, width: int, height: int
) -> tuple[RadianceSequence, GroundTruth]:
    """Return the largest central part of a sequence with the shape of a sensor, and its truth.

    Parameters
    ----------
    width, height
        Size of the sensor, px.

    Returns
    -------
    sequence, truth
        The frames cropped to what the sensor sees, and the ground truth of the cropped camera; the
        arguments themselves if the sensor sees all.
    """
    whole = sequence.camera
    if height == round(width * whole.height / whole.width):  # its pixels may not be quite square
        return sequence, truth
    rows, columns = crop_to_aspect(whole.height, whole.width, height, width)
    size = columns.stop - columns.start, rows.stop - rows.start
    camera = whole.cropped(columns.start, rows.start, *size)
    manifest = replace(
        sequence.manifest,
        width=camera.width,
        height=camera.height,
        fov_rad=camera.fov_rad,
        intrinsics=(camera.fx, camera.fy, camera.cx, camera.cy),
    )
    values = {f.name: getattr(sequence, f.name) for f in fields(RadianceSequence)}
    values["manifest"] = manifest
    part = _CentralPart(**values, whole=sequence, rows=rows, columns=columns)
    return part, truth.of_camera(camera)
