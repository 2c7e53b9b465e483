"""Ground truth in the same DSEC file as the events."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import hdf5plugin
import numpy as np

from eres_render import GroundTruth, RadianceSequence, ground_truth, window_times
from sensor import SensorModel
from sensor.errors import reading
from sensor.formats.hdf5_file import Storage, writable
from tasks.errors import TaskError

AddTo = Callable[[Path], None]

_COMPRESSED = {"shuffle": True, "fletcher32": True, **hdf5plugin.Zstd(clevel=1)}


def truth_to_add(
    sequence: RadianceSequence, model: SensorModel, speed: float, step_s: float
) -> AddTo:
    """Return a function that adds ground truth to a DSEC file of events.

    The group `truth` has times `t_us` (T,) on the events' clock, `step_s` of the sequence apart;
    `T_world_cam` (T, 4, 4); `depth` (T, H, W) in m; `flow` (T - 1, H, W, 2) in px to the next time,
    with `flow_valid` and `flow_occluded`; `K` (3, 3); and the `distortion` (5,) of a lens, k1, k2,
    p1, p2, k3. With N moving objects it also has `instances` (T, H, W), k for object k and 0 for
    the still world, and `T_world_object` (N, T, 4, 4) with the attribute `names`. All are for the
    view of the sensor, to within half a pixel of the frames.
    """
    if 0 < step_s < 1e-6 * speed:
        step = f"{1e6 * step_s / speed:g} us at speed {speed:g}"
        raise TaskError(f"truth: found a step of {step}, expected at least 1 us")
    truth = ground_truth(sequence)
    size = model.width, model.height
    times_s = window_times(sequence, step_s)
    if len(times_s) > 2 and times_s[-1] - times_s[-2] < 1e-6 * speed:
        times_s = np.delete(times_s, -2)

    def add(path: Path) -> None:
        with writable(path, new=False) as (file, storage):
            group = file.create_group("truth")
            group["t_us"] = sequence.t_offset_us + np.round(times_s / speed * 1e6).astype(np.int64)
            group["T_world_cam"] = truth.trajectory.pose(times_s)
            camera = truth.camera(*size)
            group["K"] = camera.K
            if camera.distortion is not None:
                group["distortion"] = astuple(camera.distortion)
            steps = pairwise([*times_s, None])
            images = (_images(truth, t_s, next_s, size) for t_s, next_s in steps)
            for k, by_name in enumerate(storage.each(images)):
                for name, image in by_name.items():
                    if name not in group:
                        shape = len(times_s) - name.startswith("flow"), *image.shape
                        chunks = 1, *image.shape
                        group.create_dataset(name, shape, image.dtype, chunks=chunks, **_COMPRESSED)
                    group[name][k] = image
            if truth.objects:
                group["T_world_object"] = [object.pose(times_s) for object in truth.objects]
                group["T_world_object"].attrs["names"] = [object.name for object in truth.objects]

    return add


def _images(
    truth: GroundTruth, t_s: float, next_s: float | None, size: tuple[int, int]
) -> dict[str, np.ndarray]:
    """Return the images at a time by name, with the flow to the next one if there is one."""
    images: dict[str, np.ndarray] = {"depth": truth.depth(t_s, *size)}
    if truth.objects:
        images["instances"] = truth.instances(t_s, *size)
    if next_s is not None:
        flow = truth.flow(t_s, next_s, *size)
        images |= {"flow": flow.flow_px, "flow_valid": flow.valid, "flow_occluded": flow.occluded}
    return images


COPIED = ("truth", "imu")
"""Groups of a DSEC file that can be copied to another; each has times `t_us`."""


def groups_to_copy(source: Path, names: Sequence[str], shift_us: int = 0) -> AddTo:
    """Return a function that copies groups to a DSEC file and adds `shift_us` to their times."""

    def add(path: Path) -> None:
        with h5py.File(source) as old, writable(path, new=False) as (file, storage):
            for name in names:
                with reading(f"{source}: {name}"):
                    _copy(old[name], file, name, storage)
                    if shift_us:
                        file[f"{name}/t_us"][...] += shift_us

    return add


def _copy(old: Any, parent: h5py.Group, name: str | bytes, storage: Storage) -> None:
    """Copy a group or a dataset by the chunks that are stored, in bounded memory."""
    new: Any
    if isinstance(old, h5py.Group):
        new = parent.create_group(name)
        for child in old:
            _copy(old[child], new, child, storage)
    else:
        kind, space, how = old.id.get_type(), old.id.get_space(), old.id.get_create_plist()
        encoded = name.encode() if isinstance(name, str) else name
        new = h5py.Dataset(h5py.h5d.create(parent.id, encoded, kind, space, how))
        if old.shape is not None:
            for part in storage.each(_stored_chunks(old) if old.chunks else [...]):
                new[part] = old[part]
    for key, value in old.attrs.items():
        new.attrs[key] = value


def _stored_chunks(dataset: Any) -> list[tuple[slice, ...]]:
    """Return where the chunks are that a file has; the others would be read as zeros."""
    chunks: list[tuple[slice, ...]] = []

    def add(chunk: Any) -> None:
        sides = zip(chunk.chunk_offset, dataset.chunks, strict=True)
        chunks.append(tuple(slice(start, start + side) for start, side in sides))

    dataset.id.chunk_iter(add)
    return chunks
