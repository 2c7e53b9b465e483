"""Ground truth on disk: depth and flow as float EXR, flow also as DSEC's PNG, objects, poses."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eres_render.errors import RenderError
from eres_render.progress import Progress, silent
from eres_render.sequence.ground_truth import Flow, GroundTruth
from eres_render.sequence.sequence import RadianceSequence
from eres_render.storage.atomic import clear_unfinished, make_folder, write_bytes, write_text
from eres_render.storage.exr import write_channels
from eres_render.trajectory.tum import tum_text

_PNG_ZERO, _PNG_PER_PX = 1 << 15, 128
_MIN_STEP = 1e-3  # of the others; a shorter last one comes of a rounded step
_NUMBER = re.compile(r"\d{6,}", re.ASCII)
_OBJECT = re.compile(r"\d{3}_[\w-]+")

Float64 = NDArray[np.float64]


def write_truth(
    truth: GroundTruth,
    out_dir: str | Path,
    t_s: ArrayLike,
    width: int,
    height: int | None = None,
    *,
    flow_png: bool = False,
    overwrite: bool = False,
    on_progress: Progress = silent,
) -> list[Path]:
    """Write the ground truth at some times, and the flow from each to the next.

    The files are

    - `camera.json`: camera matrix K, size, and the distortion of a lens,
    - `poses.txt`: TUM, on the clock of the given poses, if there are any,
    - `depth/000000.exr`, ...: float channel Z, meters,
    - `flow/000000.exr`, ...: float channels u and v, px; valid and occluded, 0 or 1,
    - `flow/000000.png`, ...: on request, as in the DSEC dataset,
    - if objects move, `instances/000000.png`, ...: 8 bits, the number of the object at each pixel,
      0 for the still world; and `objects/001_NAME.txt`, ...: poses T_world_object (TUM).

    If a file cannot be written, all are removed. `camera.json` is written last and marks the truth
    as complete.

    Parameters
    ----------
    truth
        The ground truth to write.
    out_dir
        Folder of the files, created if it does not exist.
    t_s
        (T,) increasing times on the path, seconds.
    width, height
        Size of the images, px; see `GroundTruth.camera`.
    flow_png
        Also write flow as DSEC's PNG.
    overwrite
        Replace ground truth in the folder; other files stay.
    on_progress
        Called after each time.

    Returns
    -------
    files
        All files written.

    Raises
    ------
    RenderError
        If times do not increase, the folder holds ground truth or a sequence or cannot be written,
        or a flow does not fit into a PNG.

    Examples
    --------
    After `eres render carpet --resolution 128 --spp 4 --samples 1 --out clips`:

    >>> from pathlib import Path
    >>> from eres_render import ground_truth, open_sequence, write_truth
    >>> truth = ground_truth(open_sequence("clips/clip_000"))
    >>> files = write_truth(truth, Path("truth"), [0.25, 0.3], width=64)
    >>> sorted(str(file.relative_to("truth")) for file in files)
    ['camera.json', 'depth/000000.exr', 'depth/000001.exr', 'flow/000000.exr', 'poses.txt']
    """
    for name, side in (("width", width), ("height", height)):
        if side is not None and side < 1:
            raise RenderError(f"{name}: found {side}, expected at least 1 px")
    times, camera = np.asarray(t_s, dtype=np.float64), truth.camera(width, height)
    if times.ndim != 1 or not len(times) or not np.all(np.diff(times) > 0):  # NaN is not
        raise RenderError(f"t_s: found {times.tolist()}, expected one or more increasing times")
    path = truth.trajectory  # times that it does not have are refused before anything is deleted
    poses = tum_text(times, path.pose(times), path.t_offset_us)
    of_objects = [
        tum_text(times, body.pose(times), path.t_offset_us, "T_world_object")
        for body in truth.objects
    ]
    out_dir = Path(out_dir)
    _make_room(out_dir, overwrite)
    inside = ["depth", "flow", *(["instances", "objects"] if truth.objects else [])]
    folders = [out_dir, *(out_dir / name for name in inside)]
    new_folders = [folder for folder in folders if not folder.is_dir()]
    files: list[Path] = []

    def write(name: str, to_file: Callable[[Path], object]) -> None:
        if (out_dir / name).exists():
            raise RenderError(f"{out_dir / name}: appeared meanwhile and is kept")
        to_file(out_dir / name)
        files.append(out_dir / name)

    try:
        for folder in folders:
            make_folder(folder)
        write("poses.txt", lambda file: write_text(file, poses))
        for k, (body, text) in enumerate(zip(truth.objects, of_objects, strict=True), start=1):
            write(f"objects/{k:03d}_{body.name}.txt", partial(write_text, text=text))
        for i, (t_0, t_1) in enumerate(pairwise([*times, None])):
            depth = truth.depth(t_0, width, height)
            write(f"depth/{i:06d}.exr", partial(_write_exr, channels={"Z": depth}))
            if truth.objects:
                instances = truth.instances(t_0, width, height)
                write(f"instances/{i:06d}.png", partial(_write_png, pixels=instances))
            if t_1 is not None:
                flow = truth.flow(t_0, t_1, width, height)
                u, v = np.moveaxis(flow.flow_px, 2, 0)
                channels = {"u": u, "v": v, "valid": flow.valid, "occluded": flow.occluded}
                write(f"flow/{i:06d}.exr", partial(_write_exr, channels=channels))
                if flow_png:
                    write(f"flow/{i:06d}.png", partial(write_flow_png, flow=flow))
            on_progress("ground truth", i + 1, len(times))
        sides = {"width": camera.width, "height": camera.height, "K": camera.K.tolist()}
        if camera.distortion is not None:
            sides["distortion"] = asdict(camera.distortion)
        write("camera.json", lambda file: write_text(file, json.dumps(sides, indent=1) + "\n"))
    except BaseException:
        for file in files:
            file.unlink(missing_ok=True)
        for folder in reversed(new_folders):
            with suppress(OSError):  # it was not made, or holds other files
                folder.rmdir()
        raise
    return files


def _make_room(folder: Path, overwrite: bool) -> None:
    """Refuse a folder that holds a sequence or ground truth, or remove the ground truth."""
    if (folder / "manifest.json").exists():
        raise RenderError(
            f"{folder}: holds a sequence, whose poses.txt would be replaced; choose another folder"
        )
    clear_unfinished(folder)
    kinds = ("depth/*.exr", "flow/*.exr", "flow/*.png", "instances/*.png")
    numbered = [file for kind in kinds for file in folder.glob(kind)]
    old = [file for file in numbered if _NUMBER.fullmatch(file.stem)]
    old += [file for file in folder.glob("objects/*.txt") if _OBJECT.fullmatch(file.stem)]
    old += [file for name in ("camera.json", "poses.txt") if (file := folder / name).exists()]
    if old and not overwrite:
        raise RenderError(
            f"{folder}: has ground truth already, {len(old)} files such as {old[0].name}; add "
            "--overwrite to replace them, or choose another folder"
        )
    # camera.json first: it is written last, and marks the truth as complete.
    for file in sorted(old, key=lambda file: file.name != "camera.json"):
        try:
            file.unlink()
        except OSError as error:
            raise RenderError(f"{file}: cannot be removed: {error.strerror}") from error


def window_times(sequence: RadianceSequence, step_s: float) -> Float64:
    """Return times from the start of a sequence's window to its end, both included.

    Parameters
    ----------
    sequence
        The sequence of the window.
    step_s
        Time between them, s.

    Returns
    -------
    t_s
        (T,) times on the path, s; the last step may be shorter, or longer by up to a thousandth.

    Raises
    ------
    RenderError
        If `step_s` is less than a microsecond.

    Examples
    --------
    After `eres render carpet --resolution 128 --spp 4 --samples 1 --out clips`:

    >>> from eres_render import open_sequence, window_times
    >>> window_times(open_sequence("clips/clip_000"), 0.025)
    array([0.25 , 0.275, 0.3  ])
    """
    if not 1e-6 <= step_s < math.inf:
        raise RenderError(f"step_s: found {step_s:g} s, expected at least 1e-06, a microsecond")
    start_s, end_s = sequence.window_s
    steps = max(1, math.ceil((end_s - start_s) / step_s - _MIN_STEP))
    t_s = start_s + step_s * np.arange(steps + 1, dtype=np.float64)
    t_s[-1] = end_s
    return t_s


def write_flow_png(path: Path, flow: Flow) -> None:
    """Write a flow as a 16-bit RGB PNG `(u * 128 + 2^15, v * 128 + 2^15, valid)`, as DSEC does."""
    code = np.round(flow.flow_px * _PNG_PER_PX) + _PNG_ZERO
    code = np.where(flow.valid[..., None], code, 0)
    if code.min() < 0 or code.max() > np.iinfo(np.uint16).max:
        raise RenderError(f"{path}: found a flow of 256 px or more, which does not fit into a PNG")
    rgb = np.dstack([code, flow.valid]).astype(np.uint16)
    _write_png(path, rgb[..., ::-1])  # OpenCV's order is blue, green, red


def _write_png(path: Path, pixels: NDArray[np.unsignedinteger]) -> None:
    import cv2

    good, data = cv2.imencode(".png", pixels)
    if not good:
        raise RenderError(f"{path}: the PNG encoder failed")
    write_bytes(path, data.tobytes())


def _write_exr(path: Path, channels: Mapping[str, NDArray[np.generic]]) -> None:
    planes = {name: np.ascontiguousarray(c, dtype=np.float32) for name, c in channels.items()}
    write_channels(path, planes)
