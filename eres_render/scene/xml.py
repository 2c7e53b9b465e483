"""Read the camera and the names of other files from a Mitsuba scene file, without Mitsuba."""

from __future__ import annotations

import logging
import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

from eres_render.errors import SceneError, reading

_log = logging.getLogger(__name__)

_MAX_NESTED = 100  # Mitsuba's parser ends the process at thousands
_MAX_CHARACTERS = 1 << 16
_MAX_FILES = 20_000  # files that include others twice reach it soon
_USUAL = {"film width": 768, "film height": 576, "sampler sample_count": 4}  # Mitsuba's own
_FULL_FRAME_MM = math.hypot(36.0, 24.0)


class Film(NamedTuple):
    """Size of the images that a scene file asks for, px, and the samples per pixel."""

    width: int
    height: int
    spp: int


@dataclass(frozen=True, eq=False, slots=True)
class SceneXml:
    """A scene file; `files` are all that it names, `cameras` have values in place of parameters."""

    file: Path
    files: tuple[Path, ...]
    cameras: tuple[Element, ...]
    shape_ids: frozenset[str]

    def camera(self) -> tuple[float, Film]:
        """Return the horizontal field of view of the camera, radians, and its film."""
        if len(self.cameras) != 1:
            raise SceneError(
                f"{self.file}: found {len(self.cameras)} cameras (<sensor>), expected exactly one"
            )
        camera = self.cameras[0]
        if (kind := camera.get("type")) != "perspective":
            raise SceneError(f"{self.file}: camera: found type {kind!r}, expected 'perspective'")
        for element in camera:
            shifted = element.get("name", "").startswith("principal_point_offset")
            if shifted and element.get("value") not in ("0", "0.0"):
                _log.warning(
                    "%s: camera: %s is ignored, as only the field of view is read; give a "
                    "calibrated camera with --camera",
                    self.file,
                    element.get("name"),
                )
        try:
            film = _film(camera)
            return _fov_rad(camera, film.width / film.height), film
        except ValueError as error:
            raise SceneError(f"{self.file}: camera: {error}") from error


def read_scene_xml(file: Path, given: Collection[str] = ()) -> SceneXml:
    """Read a scene file and its includes; files that `given` parameters name may be missing."""
    reader = _Reader(file, given)
    elements = list(reader.elements(file))
    cameras = tuple(element for element in elements if element.tag == "sensor")
    shape_ids = frozenset(e.attrib["id"] for e in elements if e.tag == "shape" and "id" in e.attrib)
    return SceneXml(file, tuple(reader.files), cameras, shape_ids)


def _parsed(file: Path) -> Element:
    """Return the root of an XML file that is not nested too deep for Mitsuba's parser."""
    depth, opened = 0, list[Element]()
    with file.open("rb") as data:
        for event, element in ElementTree.iterparse(data, ("start", "end")):
            depth += 1 if event == "start" else -1
            opened = opened or [element]
            if depth > _MAX_NESTED:
                raise RecursionError
    return opened[0]


def canonical_xml(file: Path) -> str:
    """Return the content of an XML file without comments and layout, attributes sorted."""
    return ElementTree.canonicalize(from_file=file, strip_text=True)


@dataclass(slots=True)
class _Reader:
    """Walk through scene files in the order of Mitsuba, and collect parameters and folders."""

    top: Path
    given: Collection[str]
    files: list[Path] = field(default_factory=list)
    folders: list[Path] = field(default_factory=list)
    parameters: dict[str, str] = field(default_factory=dict)
    open: list[Path] = field(default_factory=list)  # each included by the one before it

    def elements(self, file: Path) -> Iterator[Element]:
        if file.resolve() in self.open:
            raise SceneError(f"{self.open[-1]}: includes {file}, which includes it")
        if len(self.files) > _MAX_FILES:
            raise SceneError(f"{file}: up to here the scene names more than {_MAX_FILES} files")
        self.open.append(file.resolve())
        with reading(file, "XML", SceneError):
            root = _parsed(file)
        for element in root.iter():
            for key, value in element.attrib.items():
                element.set(key, self._filled_in(value))
            name, value = element.get("name", ""), element.get("value", "")
            if element.tag == "default":
                self.parameters.setdefault(name, value)
            elif element.tag == "path":
                beside = file.parent / value
                self.folders.insert(0, beside if beside.is_dir() else self.top.parent / value)
            elif element.tag == "include":
                if "$" in (name := element.get("filename", "")):
                    raise SceneError(f"{file}: includes {name!r}, whose parameter has no value")
                yield from self.elements(self._find(name, file))
            elif element.tag == "string" and name == "filename":
                self._find(value, file)
            elif "filename" in element.attrib:
                self._find(element.attrib["filename"], file)
            yield element
        self.open.pop()

    def _filled_in(self, value: str) -> str:
        """Fill in `$parameter`s that are not given; as in Mitsuba, the longest name wins."""
        names = sorted({*self.given, *self.parameters}, key=len, reverse=True)
        if not names:
            return value
        parameter = re.compile(rf"\$({'|'.join(map(re.escape, names))})")
        if sum(len(self._value(m[1], m[0])) for m in parameter.finditer(value)) > _MAX_CHARACTERS:
            raise SceneError(
                f"{self.open[-1]}: found {value[:60]!r}, expected at most {_MAX_CHARACTERS} "
                "characters once its parameters are filled in"
            )
        return parameter.sub(lambda m: self._value(m[1], m[0]), value)

    def _value(self, name: str, unchanged: str) -> str:
        return unchanged if name in self.given else self.parameters.get(name, unchanged)

    def _find(self, name: str, named_in: Path) -> Path:
        if "$" in name:
            return named_in
        for folder in (*self.folders, self.top.parent):
            if (path := folder / name).is_file():
                self.files.append(path)
                return path
        raise SceneError(f"{named_in}: names {name!r}, but {self.top.parent / name} is missing")


def _film(camera: Element) -> Film:
    """Return the film of a camera, with the samples per pixel of its sampler."""
    given = {
        f"{of} {element.get('name')}": element.get("value", "")
        for of in ("film", "sampler")
        for element in camera.iterfind(f"{of}/integer")
    }
    values = (
        _number(name, given.get(name, str(usual)), math.inf, "a positive whole number", int)
        for name, usual in _USUAL.items()
    )
    return Film(*map(int, values))


def _fov_rad(camera: Element, aspect: float) -> float:
    """Return the horizontal field of view of a camera, as Mitsuba's `perspective` computes it."""
    values = {e.get("name", ""): e.get("value", "") for e in camera}
    axis = values.get("fov_axis", values.get("fovAxis", "x"))
    if "fov" in values:
        fov_deg = _number("fov", values["fov"], 180.0, "between 0 and 180 degrees")
        half = math.tan(0.5 * math.radians(fov_deg))
    else:
        name = "focalLength" if "focalLength" in values else "focal_length"
        length_mm = values.get(name, "50mm").removesuffix("mm")
        half = 0.5 * _FULL_FRAME_MM / _number(name, length_mm, math.inf, "a positive number of mm")
        axis = "diagonal"
    if axis == "smaller":
        axis = "y" if aspect > 1 else "x"
    elif axis == "larger":
        axis = "x" if aspect > 1 else "y"
    if axis not in ("x", "y", "diagonal"):
        raise ValueError(f"fov_axis: found {axis!r}, expected x, y, diagonal, smaller or larger")
    if axis == "y":
        half *= aspect
    elif axis == "diagonal":
        half /= math.hypot(1.0, 1.0 / aspect)
    return 2.0 * math.atan(half)


def _number(
    name: str, text: str, below: float, expected: str, kind: Callable[[str], float] = float
) -> float:
    """Return the value of a field, a number above 0 and below a limit."""
    try:
        value = kind(text)
    except ValueError:
        value = math.nan
    if not 0 < value < below:
        raise ValueError(f"{name}: found {text!r}, expected {expected}")
    return value
