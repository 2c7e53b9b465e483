"""Read and write calibrated cameras: Kalibr's camchain YAML and OpenCV's YAML.

Both count pixels from the center of the first pixel, `Camera` from its corner. So a principal point
in a file is half a pixel less than `cx` and `cy`.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable
from dataclasses import astuple
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from eres_render.camera import Camera
from eres_render.distortion import Distortion
from eres_render.errors import RenderError, reading
from eres_render.storage.atomic import write_text
from eres_render.storage.settings_reader import check_nesting, number

_FIRST_CENTER_PX = 0.5
_KALIBR_NAME = re.compile(r"cam\d+", re.ASCII)
# ROS's names of the models that OpenCV's coefficients cover; other lenses have other names.
_ROS_MODELS = ("plumb_bob", "rational_polynomial")


def read_camera(file: str | Path, name: str | None = None) -> Camera:
    """Read a camera from a file of Kalibr or OpenCV.

    Kalibr's model must be `pinhole`, with the distortion `radtan` or `none`. OpenCV's files have
    `camera_matrix`, `distortion_coefficients` (k1, k2, p1, p2, k3; further coefficients must be 0),
    `image_width` and `image_height`. ROS's files have the same fields.

    Parameters
    ----------
    file
        The YAML file.
    name
        The camera of Kalibr's chain, such as "cam1"; required if there are several.

    Returns
    -------
    The camera.

    Raises
    ------
    RenderError
        If the file cannot be read, a field is missing or wrong, or the lens model is not supported.
    """
    file = Path(file)
    with reading(file, "YAML", RenderError):
        return _read_camera(file, name)


def _read_camera(file: Path, name: str | None) -> Camera:
    table = _table(file)
    if "camera_matrix" in table:
        _check(name is None, file, "one camera without a name", repr(name))
        return _of_opencv(table, file)
    chain = [key for key in table if _KALIBR_NAME.fullmatch(str(key))]
    names = ", ".join(chain) or "neither camera_matrix nor cam0"
    _check(len(chain) > 0, file, names, "YAML of OpenCV or Kalibr")
    _check(name is not None or len(chain) == 1, file, names, "a choice (--camera-name)")
    chosen = chain[0] if name is None else name
    _check(chosen in chain, file, names, repr(chosen))
    return _of_kalibr(table[chosen], f"{file}: {chosen}")


def _check(holds: bool, where: Path | str, value: object, expected: str) -> None:
    if not holds:
        raise RenderError(f"{where}: found {value}, expected {expected}")


def write_camera(
    file: str | Path,
    camera: Camera,
    kind: Literal["opencv", "kalibr"] = "opencv",
    *,
    overwrite: bool = True,
) -> None:
    """Write a camera as OpenCV or Kalibr does.

    Parameters
    ----------
    file
        The YAML file.
    camera
        The camera.
    kind
        "opencv" for the fields of OpenCV's calibration with five coefficients, or "kalibr" for a
        chain with `cam0`, which has no k3.
    overwrite
        Whether to replace an existing file.

    Raises
    ------
    RenderError
        If the kind is unknown, `kind` is "kalibr" and k3 is not 0, or the file cannot be written.
    """
    file = Path(file)
    _check(kind in ("opencv", "kalibr"), "kind", repr(kind), "'opencv' or 'kalibr'")
    lens = camera.distortion or Distortion()
    center = camera.cx - _FIRST_CENTER_PX, camera.cy - _FIRST_CENTER_PX
    if kind == "opencv":
        K = (camera.fx, 0.0, center[0], 0.0, camera.fy, center[1], 0.0, 0.0, 1.0)
        text = (
            "%YAML:1.0\n---\n"
            f"image_width: {camera.width}\n"
            f"image_height: {camera.height}\n"
            f"camera_matrix: {_matrix(3, 3, K)}"
            f"distortion_coefficients: {_matrix(1, 5, astuple(lens))}"
        )
    else:
        expected = "0 for Kalibr's radtan, which has k1, k2, p1 and p2; write OpenCV's file"
        _check(lens.k3 == 0, file, f"k3 = {lens.k3}", expected)
        text = (
            "cam0:\n"
            "  camera_model: pinhole\n"
            f"  intrinsics: [{_listed((camera.fx, camera.fy, *center))}]\n"
            "  distortion_model: radtan\n"
            f"  distortion_coeffs: [{_listed(astuple(lens)[:4])}]\n"
            f"  resolution: [{camera.width}, {camera.height}]\n"
        )
    write_text(file, text, overwrite=overwrite)


class _Loader(yaml.SafeLoader):
    """Reads OpenCV's tags for matrices as plain tables."""


for _tag in ("opencv-matrix", "opencv-nd-matrix"):  # the other one is of vectors, since OpenCV 5
    _Loader.add_constructor(
        f"tag:yaml.org,2002:{_tag}", lambda loader, node: loader.construct_mapping(node, deep=True)
    )


def _table(file: Path) -> dict[str, Any]:
    text = file.read_text(encoding="utf-8")
    text = re.sub(r"\A%YAML:1\.\d\s*\n", "", text)  # as OpenCV writes it, which is not YAML
    loader = _Loader(text)
    root = loader.get_single_node()
    few = _with_aliases(root, len(text)) <= len(text)
    _check(few, file, "aliases (*) of more entries than the file has bytes", "fewer")
    table = loader.construct_document(root) if root is not None else None
    check_nesting(table)
    _check(isinstance(table, dict), file, type(table).__name__, "a table of fields")
    return dict(table or {})


def _with_aliases(root: yaml.Node | None, most: int) -> int:
    """Return the number of entries with those of aliases in their place, or one above `most`."""
    count, left = 0, [root]
    while left and count <= most:
        node = left.pop()
        count += 1
        if isinstance(node, yaml.SequenceNode):
            left += node.value
        elif isinstance(node, yaml.MappingNode):
            left += itertools.chain.from_iterable(node.value)
    return count


def _of_opencv(table: dict[str, Any], file: Path) -> Camera:
    model = table.get("distortion_model", _ROS_MODELS[0])
    _check(model in _ROS_MODELS, f"{file}: distortion_model", repr(model), " or ".join(_ROS_MODELS))
    # OpenCV's own program has a flag for fish-eyes beside the same fields.
    is_fisheye = bool(table.get("fisheye_model"))
    _check(not is_fisheye, f"{file}: fisheye_model", 1, f"0, for {_ROS_MODELS[0]}")
    K = np.reshape(_matrix_of(table, "camera_matrix", (9,), file), (3, 3))
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    expected = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
    is_plain = np.array_equal(K, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    _check(is_plain, f"{file}: camera_matrix", K.tolist(), expected)
    lens = _matrix_of(table, "distortion_coefficients", (4, 5, 8, 12, 14), file)
    expected = "zeros after k1, k2, p1, p2 and k3, since other models are not supported"
    _check(not any(lens[5:]), f"{file}: distortion_coefficients", lens, expected)
    width, height = (_side(table.get(name), name, file) for name in ("image_width", "image_height"))
    return _camera((width, height), [fx, fy, cx, cy], Distortion(*lens[:5]), file)


def _of_kalibr(table: Any, where: str) -> Camera:
    _check(isinstance(table, dict), where, repr(table), "a table of fields")
    for field, known in (("camera_model", ("pinhole",)), ("distortion_model", ("radtan", "none"))):
        value = table.get(field)
        _check(value in known, f"{where}.{field}", repr(value), " or ".join(known))
    plain = table["distortion_model"] == "none"
    field = f"{where}.distortion_coeffs"
    lens = _numbers(table.get("distortion_coeffs"), (0, 4) if plain else (4,), field)
    _check(not (plain and any(lens)), field, lens, "none")
    sides = table.get("resolution")
    is_size = isinstance(sides, list) and len(sides) == 2
    _check(is_size, f"{where}.resolution", repr(sides), "width and height")
    width, height = (_side(side, "resolution", where) for side in sides)
    pinhole = _numbers(table.get("intrinsics"), (4,), f"{where}.intrinsics")
    return _camera((width, height), pinhole, Distortion(*lens), where)


def _camera(
    size: tuple[int, int], pinhole: list[float], lens: Distortion, where: Path | str
) -> Camera:
    fx, fy, cx, cy = map(float, pinhole)
    half = _FIRST_CENTER_PX
    try:
        return Camera(*size, fx=fx, fy=fy, cx=cx + half, cy=cy + half, distortion=lens)
    except RenderError as error:
        raise RenderError(f"{where}: {error}") from error


def _matrix_of(
    table: dict[str, Any], field: str, counts: tuple[int, ...], file: Path
) -> list[float]:
    matrix: Any = table.get(field)
    _check(isinstance(matrix, dict), f"{file}: {field}", repr(matrix), "a matrix with data")
    return _numbers(matrix.get("data"), counts, f"{file}: {field}.data")


def _numbers(given: Any, counts: tuple[int, ...], where: str) -> list[float]:
    is_row = isinstance(given, list) and len(given) in counts
    # YAML reads 1e-5, without a point, as a string.
    values = [number(value) for value in given] if is_row else [math.nan]
    expected = f"{' or '.join(map(str, counts))} numbers"
    _check(all(map(math.isfinite, values)), where, repr(given), expected)
    return values


def _side(side: Any, field: str, where: Path | str) -> int:
    is_side = type(side) is int and side > 0
    _check(is_side, f"{where}: {field}", repr(side), "a number of pixels")
    return side


def _matrix(rows: int, columns: int, values: Iterable[float]) -> str:
    return (
        f"!!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n"
        f"   data: [ {_listed(values)} ]\n"
    )


def _listed(values: Iterable[float]) -> str:
    """Return numbers with all digits and a point, without which YAML reads 1e-05 as a string."""
    texts = (repr(float(value)) for value in values)
    return ", ".join(text if "." in text else text.replace("e", ".0e") for text in texts)
