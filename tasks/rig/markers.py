"""Corners of ArUco markers in gray images, to a fraction of a pixel.

OpenCV puts (0, 0) at the center of the first pixel. Here it is at the pixel's corner, so half a
pixel is added, except to the AprilTag refinement, which counts from the corner already.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from eres_render.errors import reading
from eres_render.storage.atomic import write_bytes
from sensor.growth import check_growth
from tasks.errors import RigError
from tasks.rig.page import markers

Float64 = NDArray[np.float64]
Source = Literal["frame", "hf", "ei"]
Refinement = Literal["none", "subpix", "contour", "apriltag"]

_METHODS = {
    "none": (cv2.aruco.CORNER_REFINE_NONE, 0.5),
    "subpix": (cv2.aruco.CORNER_REFINE_SUBPIX, 0.5),
    "contour": (cv2.aruco.CORNER_REFINE_CONTOUR, 0.5),
    "apriltag": (cv2.aruco.CORNER_REFINE_APRILTAG, 0.0),
}
"""OpenCV's method, and the shift that is added to its positions, px."""

_SMALL_PX = 640  # narrower images are enlarged, so that the markers' cells have enough pixels
_ENLARGED = 4
_PERCENTILES = (1.0, 99.0)  # black and white of a gray image


@dataclass(frozen=True, eq=False, slots=True)
class Detections:
    """Markers in images, M in all.

    Parameters
    ----------
    t_us
        (M,) int64, time of each marker's image, microseconds on the events' clock.
    number
        (M,) int64, the marker's number.
    corners_px
        (M, 4, 2) its corners, clockwise from its top left, px; (0, 0) is the corner of the image.
    score
        (M,) contrast of the marker: standard deviation of the gray codes within it, as a fraction
        of the largest possible.
    source
        Where the images are from: "frame" (a frame camera), "hf" (the high-pass filter) or "ei"
        (event integration).
    """

    t_us: NDArray[np.int64]
    number: NDArray[np.int64]
    corners_px: Float64
    score: Float64
    source: Source


@dataclass(frozen=True, slots=True)
class Detector:
    """How markers are found.

    Parameters
    ----------
    dictionary
        OpenCV's name of the dictionary.
    count
        Number of markers on the page; detections with this number or above are false.
    """

    dictionary: str
    count: int
    refinement: Refinement
    enlarged: int

    def find(self, gray: NDArray[np.uint8]) -> tuple[NDArray[np.int64], Float64, Float64]:
        """Find the markers in an image.

        Parameters
        ----------
        gray
            (H, W) codes.

        Returns
        -------
        number
            (M,) their numbers, ascending; a number seen twice is left out.
        corners_px
            (M, 4, 2) px, from the corner of the image.
        score
            (M,) as in `Detections`.
        """
        height, width = gray.shape
        large = gray
        if self.enlarged > 1:
            size = width * self.enlarged, height * self.enlarged
            large = np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_CUBIC), np.uint8)
        method, shift = _METHODS[self.refinement]
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = method
        finder = cv2.aruco.ArucoDetector(markers(self.dictionary), parameters)
        quads, numbers, _ = finder.detectMarkers(large)
        number = np.asarray([] if numbers is None else numbers, np.int64).ravel()
        corners = np.asarray(quads, np.float64).reshape(-1, 4, 2)
        known, counts = np.unique(number, return_counts=True)
        once = known[(counts == 1) & (known < self.count)]
        chosen = np.array([np.flatnonzero(number == k)[0] for k in once], np.intp)
        corners_px = (corners[chosen] + shift) / self.enlarged
        return once, corners_px, np.array([_contrast(gray, quad) for quad in corners_px])


def detector(
    dictionary: str, count: int, width: int, refinement: Refinement = "contour"
) -> Detector:
    """Return the detector for images of a given width.

    Corners are the intersections of lines fitted to the markers' sides. Images narrower than 640 px
    are enlarged four times.

    Parameters
    ----------
    width
        Width of the images, px.
    """
    return Detector(dictionary, count, refinement, _ENLARGED if width < _SMALL_PX else 1)


def gray_codes(image: Float64) -> NDArray[np.uint8]:
    """Stretch an image of any range to 8 bits, from its 1st percentile to its 99th."""
    black, white = np.percentile(image, _PERCENTILES)
    if not white > black:
        return np.zeros(image.shape, np.uint8)
    return np.round(255 * np.clip((image - black) / (white - black), 0, 1)).astype(np.uint8)


def _contrast(gray: NDArray[np.uint8], corners_px: Float64) -> float:
    low = np.clip(np.floor(corners_px.min(axis=0)), 0, None).astype(int)
    high = np.ceil(corners_px.max(axis=0)).astype(int)
    part = gray[low[1] : high[1], low[0] : high[0]]
    return float(part.std() / 127.5) if part.size else 0.0


def write_detections(path: Path, detections: Detections, *, overwrite: bool = True) -> None:
    """Write markers as Parquet, one row for each corner.

    The columns are t_us, id, corner (0 to 3), u_px, v_px, score and source.
    """
    import pyarrow as pa  # here, as it loads slowly
    import pyarrow.parquet as pq

    count = len(detections.t_us)
    table = pa.table(
        {
            "t_us": np.repeat(detections.t_us, 4),
            "id": np.repeat(detections.number, 4),
            "corner": np.tile(np.arange(4), count),
            "u_px": detections.corners_px[..., 0].ravel(),
            "v_px": detections.corners_px[..., 1].ravel(),
            "score": np.repeat(detections.score, 4),
            "source": pa.array([detections.source] * (4 * count), pa.string()),
        }
    )
    data = pa.BufferOutputStream()
    pq.write_table(table, data, compression="zstd")
    write_bytes(path, data.getvalue().to_pybytes(), overwrite=overwrite)


def read_detections(path: Path) -> Detections:
    """Read the markers that `write_detections` wrote."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = ["t_us", "id", "u_px", "v_px", "score", "source"]
    with reading(path, "a file of `eres rig detect`", RigError):
        data = path.read_bytes()
        file = pq.ParquetFile(pa.BufferReader(data))
        check_growth(8 * file.metadata.num_rows * file.metadata.num_columns, len(data))
        table = file.read(columns=names)
        t_us, numbers, u_px, v_px, scores, sources = (table[name].to_numpy() for name in names)
        return Detections(
            t_us=t_us[::4].astype(np.int64),
            number=numbers[::4].astype(np.int64),
            corners_px=np.stack([u_px, v_px], axis=-1).reshape(-1, 4, 2).astype(np.float64),
            score=scores[::4].astype(np.float64),
            source=sources[0],
        )
