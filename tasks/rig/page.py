"""`Page`: a printed picture with ArUco markers around it, and what a camera sees of it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from eres_render.errors import check_positive, reading
from eres_render.scene.texture_recipes import TextureRecipe
from eres_render.storage.atomic import new_file
from eres_render.storage.settings_reader import read_json
from sensor.encoding import from_srgb, to_srgb
from tasks.errors import RigError
from tasks.rig.bundle import RigPose
from tasks.rig.settings import INCH_M, PageSettings

Float64 = NDArray[np.float64]

FILE_NAME = "page.json"
IMAGE_NAME = "page.png"
PAPER = 0.8  # reflectance where nothing is printed
INK = 0.04  # reflectance of black ink

# Procedural pictures: a texture, and how many times larger its scene is than the print.
PICTURES = {
    "forest": ("forest", 20.0),
    "pebbles": ("stones", 10.0),
    "split_rocks": ("split_rocks", 10.0),
}

_BORDER_CELLS = 1  # black cells around a marker's code
_MAX_SIDE = 32_766  # dots, of images that OpenCV warps
_MAX_SUPERSAMPLES = 4  # of a pixel that sees the page, along each side
_WHITE = 0.25  # smallest white margin around a marker, as a fraction of its side


@dataclass(frozen=True, slots=True)
class Page:
    """The size of a page, and where its markers and its picture are.

    Positions are from the page's top left corner, x to the right and y down. `dot_m` is the side of
    a printed dot, a pixel of the page's image. `picture_m` has left, top, right and bottom,
    `markers_m` left and top of each marker, in the order of the numbers in OpenCV's `dictionary`.
    """

    width_m: float
    height_m: float
    dictionary: str
    dot_m: float
    picture_m: tuple[float, float, float, float]
    markers_m: tuple[tuple[float, float], ...]
    marker_m: float

    def __post_init__(self) -> None:
        for name in ("width_m", "height_m", "dot_m", "marker_m"):
            check_positive(name, getattr(self, name), RigError)
        markers(self.dictionary)

    def corners(self) -> Float64:
        """Return the corners of the M markers, (M, 4, 2) m: clockwise from the top left."""
        unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        return np.array(self.markers_m)[:, None] + self.marker_m * unit


def markers(dictionary: str) -> cv2.aruco.Dictionary:
    """Return OpenCV's dictionary of markers of a given name."""
    number = getattr(cv2.aruco, dictionary, None) if dictionary.startswith("DICT_") else None
    if number is None:
        raise RigError(f"dictionary: OpenCV has no {dictionary!r}; use DICT_4X4_250, for example")
    return cv2.aruco.getPredefinedDictionary(number)


def lay_out(settings: PageSettings) -> Page:
    """Place the picture in the middle of a page, and markers around it, all on whole dots.

    A marker's cells are whole dots, so its side differs from the settings by up to half a dot per
    cell.
    """
    dictionary = markers(settings.dictionary)
    dot_m = INCH_M / settings.dpi
    cells = dictionary.markerSize + 2 * _BORDER_CELLS
    longest = max(settings.width_m, settings.height_m) / dot_m
    if not longest <= _MAX_SIDE:
        raise RigError(
            f"page: its longer side has {longest:.6g} dots (limit {_MAX_SIDE}); reduce dpi or size"
        )
    width, height = _dots(settings.width_m, dot_m), _dots(settings.height_m, dot_m)
    side = cells * max(1, _dots(settings.marker_m / cells, dot_m))
    pitch = max(_dots(settings.marker_pitch_m, dot_m), round((1 + _WHITE) * side))
    picture_w = _dots(settings.picture_width_m, dot_m)
    picture_h = _dots(settings.picture_height_m, dot_m)
    left, top = (width - picture_w) // 2, (height - picture_h) // 2
    right, bottom = left + picture_w, top + picture_h
    white = round(_WHITE * side)
    # Rows above and below the picture start next to it, so that a near camera sees them too.
    columns = _centered(white, width - white, side, pitch)
    above = np.arange(top - white - side, white - 1, -pitch)[::-1]
    below = np.arange(bottom + white, height - side - white + 1, pitch)
    rows = [(y, columns) for y in (*above, *below)]
    outside = columns[(columns + side + white <= left) | (columns >= right + white)]
    rows += [(y, outside) for y in _centered(top, bottom, side, pitch)]
    places = [(int(x), int(y)) for y, xs in sorted(rows, key=lambda row: row[0]) for x in xs]
    available = len(dictionary.bytesList)
    if not 0 < len(places) <= available:
        raise RigError(
            f"page: has room for {len(places)} markers, expected 1 to {available}, the number in "
            f"{settings.dictionary}; change marker_pitch_m"
        )
    return Page(
        width_m=width * dot_m,
        height_m=height * dot_m,
        dictionary=settings.dictionary,
        dot_m=dot_m,
        picture_m=(left * dot_m, top * dot_m, right * dot_m, bottom * dot_m),
        markers_m=tuple((x * dot_m, y * dot_m) for x, y in places),
        marker_m=side * dot_m,
    )


def _dots(length_m: float, dot_m: float) -> int:
    return round(length_m / dot_m)


def _centered(low: int, high: int, side: int, pitch: int) -> NDArray[np.intp]:
    """Return the starts of as many markers as fit between two positions, centered."""
    count = max((high - low - side) // pitch + 1, 0)
    start = (low + high - (count - 1) * pitch - side) // 2
    return start + pitch * np.arange(count)


def draw(page: Page, settings: PageSettings, folder: Path) -> NDArray[np.uint8]:
    """Draw a page for the printer: (H, W) 8-bit sRGB codes of its reflectance over the paper's."""
    image = np.ones((_dots(page.height_m, page.dot_m), _dots(page.width_m, page.dot_m)), np.float32)
    left, top, right, bottom = (_dots(edge, page.dot_m) for edge in page.picture_m)
    shape = bottom - top, right - left
    image[top:bottom, left:right] = _picture(settings, folder, shape, page.dot_m)
    side = _dots(page.marker_m, page.dot_m)
    dictionary = markers(page.dictionary)
    for number, place in enumerate(page.markers_m):
        x, y = (_dots(edge, page.dot_m) for edge in place)
        code = cv2.aruco.generateImageMarker(dictionary, number, side, borderBits=_BORDER_CELLS)
        image[y : y + side, x : x + side] = np.where(code > 0, 1.0, INK / PAPER)
    return np.round(255 * to_srgb(image)).astype(np.uint8)


def _picture(
    settings: PageSettings, folder: Path, shape: tuple[int, int], dot_m: float
) -> NDArray[np.float32]:
    """Return a linear picture that is 1 at its 99.9th percentile and above."""
    if settings.picture in PICTURES:
        kind, magnification = PICTURES[settings.picture]
        light = TextureRecipe(kind, shape[1], magnification * dot_m, settings.seed, shape[0]).make()
    else:
        file = folder / settings.picture
        if not file.is_file():
            raise RigError(f"{file}: no such image; built-in pictures are {', '.join(PICTURES)}")
        codes = linear(read_gray(file))
        light = cv2.resize(codes, shape[::-1], interpolation=cv2.INTER_AREA).astype(np.float32)
    return np.clip(light / max(float(np.percentile(light, 99.9)), 1e-6), INK / PAPER, 1.0)


def linear(codes: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the linear values of 8-bit sRGB codes, 0 to 1."""
    return from_srgb(np.arange(256) / 255.0).astype(np.float64, copy=False)[codes]


def reflectance(codes: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the reflectance of a page from its image."""
    return PAPER * linear(codes)


def check_print(path: Path) -> None:
    """Refuse the name of a print that is neither .png nor .pdf."""
    if path.suffix not in (".pdf", ".png"):
        raise RigError(f"{path}: expected a name that ends in .pdf or .png")


def write_print(
    path: Path, image: NDArray[np.uint8], page: Page, *, overwrite: bool = True
) -> None:
    """Write a page's image, as `draw` returns it, as PNG or PDF at its printed size."""
    dpi = INCH_M / page.dot_m
    with new_file(path, overwrite=overwrite) as new:
        Image.fromarray(image).save(new, path.suffix[1:], dpi=(dpi, dpi), quality=98)


def json_text(table: Any) -> str:
    """Return the fields of a dataclass as JSON."""
    return json.dumps(asdict(table), indent=1) + "\n"


def read_page(path: Path) -> Page:
    """Read page.json."""
    return read_json(Page, path, RigError)


def read_page_image(path: Path, page: Page) -> NDArray[np.uint8]:
    """Read the image of a page, as `draw` returns it."""
    return read_gray(path, (_dots(page.width_m, page.dot_m), _dots(page.height_m, page.dot_m)))


def read_print(folder: Path) -> tuple[Page, Float64]:
    """Read the page in a folder, and its reflectance, (H, W)."""
    page = read_page(folder / FILE_NAME)
    return page, reflectance(read_page_image(folder / IMAGE_NAME, page))


def read_gray(path: Path, size: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """Read the gray codes of an image, (H, W), which must have the width and height `size`."""
    with reading(path, "an image", RigError):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise RigError(f"{path}: cannot be read as an image")
    height, width = image.shape
    if size is not None and size != (width, height):
        raise RigError(f"{path}: found {width}x{height} px, expected {size[0]}x{size[1]}")
    return np.asarray(image, np.uint8)


def page_views(pose: RigPose, page: Page, light: Float64) -> Callable[[float], Float64]:
    """Return a function from the slider's position, m, to the reflectance that the camera sees.

    It is averaged over the pixels, (H, W). Outside the page it is as white as paper.
    """
    camera = pose.camera

    @cache
    def in_blocks(dots: int) -> NDArray[np.float32]:
        rows, columns = (size // dots * dots for size in light.shape)
        blocks = light[:rows, :columns].reshape(rows // dots, dots, columns // dots, dots)
        return blocks.mean(axis=(1, 3)).astype(np.float32)

    def view(x_m: float) -> Float64:
        corner = pose.on_page(np.array([[0.0, 0.0], [1.0, 0.0]]), x_m)
        dots = float(np.linalg.norm(corner[1] - corner[0])) / page.dot_m  # across a pixel
        shrink = max(1, int(dots / 2))
        times = min(_MAX_SUPERSAMPLES, max(1, math.ceil(dots / shrink)))
        steps = (np.arange(times) + 0.5) / times
        columns_px = (np.arange(camera.width)[:, None] + steps).ravel()
        rows_px = (np.arange(camera.height)[:, None] + steps).ravel()
        points_px = np.stack(np.meshgrid(columns_px, rows_px), axis=-1)
        # From meters to dots; the center of the first dot is (0, 0).
        at = pose.on_page(points_px, x_m) / (shrink * page.dot_m) - 0.5
        x, y = np.moveaxis(at.astype(np.float32), -1, 0)
        outside = cv2.BORDER_CONSTANT, PAPER
        image = cv2.remap(in_blocks(shrink), x, y, cv2.INTER_LINEAR, None, *outside)
        shape = camera.height, times, camera.width, times
        return np.asarray(image, np.float64).reshape(shape).mean(axis=(1, 3))

    return view
