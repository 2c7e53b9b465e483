"""Ground truth beside the events, in the same DSEC file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import h5py
import hdf5plugin
import numpy as np

from eres_render import RadianceSequence, ground_truth, window_times
from sensor import SensorModel
from sensor.formats import find_format
from tasks.errors import TaskError


@contextmanager
def with_truth(
    out: Path,
    sequence: RadianceSequence,
    model: SensorModel,
    speed: float,
    step_s: float,
    format: str | None,
) -> Iterator[Path]:
    """Give a path to write the events to; afterwards add the truth, and only then name it `out`.

    The file's group `truth` holds, at times `t_us` (T,) from the start of the sequence's window to
    its end, `step_s` of the sequence's time apart: `T_world_cam` (T, 4, 4), `depth` (T, H, W) in
    metres, `flow` (T - 1, H, W, 2) in px from each time to the next with `flow_valid`
    (T - 1, H, W), and the camera matrix `K` (3, 3). They are of what the sensor sees, which is
    `sensor.optics.middle` of the frames, to within half a pixel of them.

    Raises
    ------
    TaskError
        The format is not DSEC's.
    """
    if find_format(out, format).name != "dsec":
        raise TaskError(f"{out}: truth has a place in DSEC's format (.h5) alone")
    truth = ground_truth(sequence)
    size = model.width, model.height
    times_s = window_times(sequence, step_s)
    unfinished = out.with_name(f".{out.stem}.{os.getpid()}.unfinished.h5")
    try:
        yield unfinished
        images = {"shuffle": True, "fletcher32": True, **hdf5plugin.Zstd(clevel=1)}
        with h5py.File(unfinished, "r+") as file:
            group = file.create_group("truth")
            group["t_us"] = np.round(times_s / speed * 1e6).astype(np.int64)
            group["T_world_cam"] = truth.trajectory.pose(times_s)
            group["K"] = truth.camera(*size).K
            depth = np.stack([truth.depth(t_s, *size) for t_s in times_s])
            group.create_dataset("depth", data=depth, chunks=(1, *depth.shape[1:]), **images)
            flows = [truth.flow(*times, *size) for times in pairwise(times_s)]
            flow = np.stack([f.flow_px for f in flows])
            group.create_dataset("flow", data=flow, chunks=(1, *flow.shape[1:]), **images)
            valid = np.stack([f.valid for f in flows])
            group.create_dataset("flow_valid", data=valid, chunks=(1, *valid.shape[1:]), **images)
        os.replace(unfinished, out)
    finally:
        unfinished.unlink(missing_ok=True)
