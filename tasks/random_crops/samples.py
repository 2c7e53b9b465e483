"""Samples for the two tasks, made from random crops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor.representations import voxel_grid
from tasks.methods.our_reconstruction import InputGrids
from tasks.random_crops.crop import Crop
from tasks.video import picture

Float32 = NDArray[np.float32]

EQUALIZATION = "global"  # an area of 160 px is a tile of the local equalization at 1280 px


class VideoSample(NamedTuple):
    """Inputs and targets of successive windows.

    Attributes
    ----------
    grids
        (windows, bins + 4, S, S) inputs of the network.
    pictures
        (windows, S, S) true image at the end of each window, as the scorer shows it: the brightness
        of a pixel is its rank in an area around the crop, in [0, 1].
    """

    grids: Float32
    pictures: Float32


class FlowExample(NamedTuple):
    """Inputs and truths of pairs of windows.

    Attributes
    ----------
    grids
        (pairs + 1, bins, S, S): a pair is a grid and the next one.
    flows
        (pairs, 2, S, S) px, from the start of the second window of a pair to its end.
    """

    grids: Float32
    flows: Float32


def video_sample(crop: Crop, bins: int, run_in: int, ranked_px: int) -> VideoSample:
    """Return a sample of video reconstruction.

    Parameters
    ----------
    run_in
        Number of windows at the start that are left out; their events still enter the sums.
    ranked_px
        Side of the area with the same middle in which pixels are ranked, px; the crop's or larger.
    """
    side_px = crop.events[0].width
    inputs = InputGrids(side_px, side_px, crop.contrast_threshold, bins)
    grids = [inputs.push(events) for events in crop.events]
    first = (ranked_px - side_px) // 2
    inside = slice(first, first + side_px)
    pictures = []
    for k in range(run_in + 1, len(crop.events) + 1):
        image = crop.log_image(k, ranked_px)
        pictures.append(picture(image, image.shape, EQUALIZATION)[inside, inside])
    return VideoSample(np.stack(grids[run_in:]), np.stack(pictures).astype(np.float32))


def flow_sample(crop: Crop, bins: int) -> FlowExample:
    """Return a sample of dense flow."""
    grids = [voxel_grid(events, bins, convention="eraft") for events in crop.events]
    flows = [crop.motion.flow(k, k + 1) for k in range(1, len(grids))]
    return FlowExample(np.stack(grids), np.stack(flows))
