"""Image reconstruction from events alone, without a keyframe.

A method takes in the events of one sensor in order, and returns its image at any time. Events alone
do not tell the absolute level, so the protocol is that of Rebecq et al., "High Speed and High
Dynamic Range Video with an Event Camera" (PAMI 2019): the histograms of prediction and truth are
equalized locally before they are compared. The choices that this leaves:

- Images are compared at the resolution of the truth, for every sensor: a prediction is first
  enlarged bicubically, in log intensity.
- Both become intensity, stretched so that the 1st percentile is black and the 99th is white.
- Local equalization uses 8 x 8 tiles, is interpolated between their centers, and is not clipped.
  Pixels of one level share the mean of their ranks, so a uniform image becomes mid-gray.

For comparison: with a truth of uniform histogram, a mid-gray image scores 10.79 dB, and an
unrelated image of uniform histogram 7.78 dB.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eres_render import RadianceSequence
from sensor import Events
from sensor.compiling import compiler
from tasks.errors import TaskError

Float64 = NDArray[np.float64]

PERCENTILES = (1.0, 99.0)  # of an image's intensity: black and white
_DIM = 1e-9  # white, relative to the brightest pixel
# Tiles per side, levels, and the largest share of a level over its uniform share (0: no limit).
# "clahe" has the defaults of the public benchmark EVREAL, which uses OpenCV.
EQUALIZATIONS = {"global": (1, 4096, 0.0), "local": (8, 4096, 0.0), "clahe": (8, 256, 2.0)}


class VideoMethod(Protocol):
    """Turns the events of one sensor into images.

    A method is made from the sensor's width, height and contrast threshold.
    """

    def push(self, events: Events) -> None:
        """Take in the next events, in order; the images do not depend on how the stream is cut."""

    def image(self, t_us: int) -> Float64:
        """Return log intensity, (height, width), up to a constant, from the events before t_us."""


class ImageTaker:
    """Takes a method's images at given times from a stream of events that comes in batches.

    An image at time t includes the events before t. It is due when an event at t or later arrives,
    or when the stream ends.

    Parameters
    ----------
    method
        The method.
    times_us
        Times of the images, ascending.
    """

    def __init__(self, method: VideoMethod, times_us: Iterable[int]) -> None:
        self._method = method
        self._due = list(times_us)

    def take(self, events: Events) -> Iterator[tuple[int, Float64]]:
        """Pass the events on to the method, and yield each image that is due; iterate to the end.

        Parameters
        ----------
        events
            The next events.

        Yields
        ------
        Time and image. Use the image before the next one: it may be the method's state, and there
        may be many.
        """
        while self._due and len(events) and events.t_us[-1] >= self._due[0]:
            before = int(np.searchsorted(events.t_us, self._due[0]))
            self._method.push(events[:before])
            events = events[before:]
            yield self._take()
        self._method.push(events)

    def rest(self) -> Iterator[tuple[int, Float64]]:
        """Yield the times and images that are left after the last event."""
        while self._due:
            yield self._take()

    def _take(self) -> tuple[int, Float64]:
        t_us = self._due.pop(0)
        return t_us, self._method.image(t_us)


def log_light(sequence: RadianceSequence, t_s: float, dark_level: float) -> Float64:
    """Return log intensity at any time of a sequence, linear in time between its frames.

    Parameters
    ----------
    sequence
        The sequence.
    t_s
        The time, seconds of the sequence.
    dark_level
        Added to the radiance before the logarithm.

    Returns
    -------
    (H, W) float64.

    Raises
    ------
    TaskError
        The sequence has no frames at that time.
    """
    times = sequence.t_s
    if not times[0] <= t_s <= times[-1]:
        raise TaskError(f"the frames cover {times[0]:g} to {times[-1]:g} s, but not {t_s:g} s")
    after = int(np.searchsorted(times, t_s))
    later = np.log(sequence.frame(after).astype(np.float64) + dark_level)
    if times[after] == t_s:
        return later
    earlier = np.log(sequence.frame(after - 1).astype(np.float64) + dark_level)
    share = (t_s - times[after - 1]) / (times[after] - times[after - 1])
    return earlier + share * (later - earlier)


def picture(
    log_image: NDArray[np.floating], shape: tuple[int, int], equalization: str = "local"
) -> Float64:
    """Enlarge, stretch and equalize a log intensity for comparison.

    Parameters
    ----------
    log_image
        (h, w), up to a constant.
    shape
        (H, W) of the truth.
    equalization
        "none", "global", "local" or "clahe" (local, with limited contrast).

    Returns
    -------
    (H, W) in [0, 1].

    Raises
    ------
    TaskError
        There is no such equalization, or the image has values that are not finite.
    """
    import cv2

    if equalization != "none" and equalization not in EQUALIZATIONS:
        expected = ", ".join(("none", *EQUALIZATIONS))
        raise TaskError(f"equalization: found {equalization!r}, expected one of {expected}")
    enlarged = np.asarray(log_image, np.float64)
    if not np.all(np.isfinite(enlarged)):
        raise TaskError("image: found values that are not finite")
    if enlarged.shape != shape:
        enlarged = np.asarray(cv2.resize(enlarged, shape[::-1], interpolation=cv2.INTER_CUBIC))
    intensity = np.exp(enlarged - enlarged.max())
    black, white = np.percentile(intensity, PERCENTILES)
    if white < _DIM:  # next to some hot pixels: the others would have no levels left
        level = np.percentile(enlarged, PERCENTILES[1])
        intensity = np.exp(np.minimum(enlarged - level, 1.0))  # above white all are the same
        black, white = np.percentile(intensity, PERCENTILES)
    if not white > black:
        stretched = np.full(shape, 0.5)
    else:
        stretched = np.clip((intensity - black) / (white - black), 0.0, 1.0)
    if equalization == "none":
        return stretched
    return equalize(stretched, *EQUALIZATIONS[equalization])


@compiler()
def equalize(image: Float64, tiles: int, levels: int, clip: float) -> Float64:
    """Map each pixel to its rank among its neighbors, 0 to 1.

    Ranks are those within a tile, interpolated between the centers of the four tiles around a
    pixel.

    Parameters
    ----------
    image
        (H, W) float64 in [0, 1].
    tiles
        Tiles per side; fewer in images in which they would have less than 2 px.
    levels
        Number of gray levels.
    clip
        Largest share of a level in a tile, times the number of levels; the excess is spread over
        all levels, as in contrast limited adaptive histogram equalization (Zuiderveld 1994). 0 for
        no limit.

    Returns
    -------
    (H, W) in [0, 1].
    """
    height, width = image.shape
    tiles = max(1, min(tiles, height // 2, width // 2))  # all ranks of a single pixel are the same
    rank = np.zeros((tiles, tiles, levels))
    for j in range(tiles):
        top, bottom = j * height // tiles, (j + 1) * height // tiles
        for i in range(tiles):
            left, right = i * width // tiles, (i + 1) * width // tiles
            share = rank[j, i]
            for y in range(top, bottom):
                for x in range(left, right):
                    share[min(int(image[y, x] * levels), levels - 1)] += 1.0
            share /= (bottom - top) * (right - left)
            if clip > 0.0:
                excess = 0.0
                for level in range(levels):
                    excess += max(share[level] - clip / levels, 0.0)
                for level in range(levels):
                    share[level] = min(share[level], clip / levels) + excess / levels
            below = 0.0
            for level in range(levels):
                here = share[level]
                share[level] = below + 0.5 * here
                below += here
    equal = np.empty((height, width))
    for y in range(height):
        row = min(max((y + 0.5) * tiles / height - 0.5, 0.0), tiles - 1.0)
        j0 = int(row)
        j1, fy = min(j0 + 1, tiles - 1), row - j0
        for x in range(width):
            column = min(max((x + 0.5) * tiles / width - 0.5, 0.0), tiles - 1.0)
            i0 = int(column)
            i1, fx = min(i0 + 1, tiles - 1), column - i0
            level = min(int(image[y, x] * levels), levels - 1)
            above = (1.0 - fx) * rank[j0, i0, level] + fx * rank[j0, i1, level]
            under = (1.0 - fx) * rank[j1, i0, level] + fx * rank[j1, i1, level]
            equal[y, x] = (1.0 - fy) * above + fy * under
    return equal
