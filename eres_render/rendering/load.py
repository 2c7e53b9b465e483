"""Load a scene into Mitsuba, in black and white."""

from __future__ import annotations

import functools
import logging
import re
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from eres_render.errors import SceneError, reading
from eres_render.scene.ply import check_faces
from eres_render.scene.scene import Scene
from eres_render.storage.exr import check_readable, read_half

if TYPE_CHECKING:
    import mitsuba as mi

_log = logging.getLogger(__name__)

# The start of a Mitsuba warning, and the rest of one about an attribute of a PLY file.
_WARNING = re.compile(r"^\d{4}-\d\d-\d\d [\d:]+ WARN +", re.MULTILINE)
_ATTRIBUTE = re.compile(r'^\[ply\.h:\d+\] .*attribute "(\w+)"')

# Of linear sRGB primaries (Rec. 709), as in Mitsuba's monochrome variants.
LUMINANCE = np.array([0.212671, 0.715160, 0.072169])


def load_mi_scene(
    scene: Scene, emitters: Mapping[str, Any] | None = None, without: Collection[str] = ()
) -> mi.Scene:
    """Load scene.xml for the selected variant, with every color turned into its luminance.

    The monochrome variants convert colors when they read a file; for the others this function does
    it. Shapes with an id in `emitters` emit light and lose their material, so that its images are
    not loaded.
    """
    import mitsuba as mi

    textures = scene.texture_files()
    for file in (*map(Path, textures.values()), *scene.files):
        if file.suffix.lower() == ".exr":
            check_readable(file)
        elif file.suffix.lower() == ".ply":
            check_faces(file)
    config = mi.parser.ParserConfig(str(mi.variant()))
    config.merge_meshes = False  # merging would lose the shapes' ids
    with files_of(scene), reading(scene.xml_file, "a Mitsuba scene", SceneError):
        state = mi.parser.parse_file(config, str(scene.xml_file), **textures)
        # Its cameras are unused, and Mitsuba would warn of their films.
        _drop(state.nodes[0], mi.ObjectType.Sensor, state)
        shapes = [node for node in state.nodes if node.type == mi.ObjectType.Shape]
        taken = {node.props.id() for node in shapes}
        for number, node in enumerate(shapes):
            if not node.props.id():  # lightmaps and errors go by it
                name = f"{node.props.plugin_name()}_{number}"
                while name in taken:
                    name += "_"
                node.props.set_id(name)
            if emitters and node.props.id() in emitters:
                node.props["glow"] = emitters[node.props.id()]
                _drop(node, mi.ObjectType.BSDF, state)
        _drop(state.nodes[0], mi.ObjectType.Shape, state, without)
        for node in state.nodes:
            if node.props.plugin_name() == "bitmap":
                if not emitters and node.props.get("filename") in textures.values():
                    _read_texture(node.props)
                exr = str(node.props.get("filename", "")).lower().endswith(".exr")
                if not exr and node.props.get("format", "auto") == "auto":
                    node.props["format"] = "variant"  # light as floats, not codes of 8 bits
        mi.parser.transform_all(config, state)
        with _warnings_of(scene):
            mi_scene = cast("mi.Scene", mi.parser.instantiate(config, state))
    if str(mi.variant()).endswith("_rgb"):
        _drop_color(mi_scene)
    return mi_scene


@contextmanager
def files_of(scene: Scene) -> Iterator[None]:
    """Let Mitsuba find the files that scene.xml names relative to its folder."""
    import mitsuba

    mi: Any = mitsuba  # its type stubs lack the file resolver
    everywhere = mi.file_resolver()
    with_folder = mi.FileResolver(everywhere)
    with_folder.prepend(str(scene.folder))
    mi.set_file_resolver(with_folder)
    try:
        yield
    finally:
        mi.set_file_resolver(everywhere)


def _drop(node: Any, kind: Any, state: Any, ids: Collection[str] | None = None) -> None:
    """Remove a node's children of a kind, so that Mitsuba never loads what only these use."""
    import mitsuba as mi

    for key in list(node.props.keys()):
        child = node.props[key]
        if isinstance(child, mi.Properties.ResolvedReference):
            target = state.nodes[child.index()]
            if target.type == kind and (ids is None or target.props.id() in ids):
                del node.props[key]


def _read_texture(props: Any) -> None:
    """Give a bitmap the texels of its file, which Mitsuba takes several times as long to read."""
    import mitsuba as mi

    texels = read_half(Path(props["filename"]))
    del props["filename"]
    props["bitmap"] = mi.Bitmap(texels[..., None])
    if props.get("format", "auto") == "auto":
        props["format"] = "fp16"  # as Mitsuba takes it from the file


@contextmanager
def _warnings_of(scene: Scene) -> Iterator[None]:
    """Log Mitsuba's warnings, except about mesh attributes that the scene does not use."""
    import mitsuba

    mi: Any = mitsuba  # its type stubs lack the logger
    logger = mi.logger()
    appenders = [logger.appender(i) for i in range(logger.appender_count())]
    with tempfile.NamedTemporaryFile("r", encoding="utf-8", errors="replace") as file:
        logger.clear_appenders()
        logger.add_appender(mi.StreamAppender(file.name))
        try:
            yield
        finally:
            logger.clear_appenders()  # which closes the file
            for appender in appenders:
                logger.add_appender(appender)
            # Perhaps in another encoding; the names are in ASCII.
            xml_files = scene.xml_file, *(file for file in scene.files if file.suffix == ".xml")
            named = "".join(xml.read_text(encoding="utf-8", errors="replace") for xml in xml_files)
            for text in _WARNING.split(file.read())[1:]:
                unused = _ATTRIBUTE.search(text)
                if unused is None or unused[1] in named:
                    _warn(scene.xml_file, " ".join(text.split()))


@functools.cache  # once per process, as a scene is loaded several times
def _warn(file: Path, text: str) -> None:
    _log.warning("%s: Mitsuba warns: %s", file, text)


def _drop_color(mi_scene: mi.Scene) -> None:
    import mitsuba as mi

    parameters = mi.traverse(mi_scene)
    for key in parameters.keys():  # noqa: SIM118 - not a mapping
        value = parameters[key]
        if isinstance(value, mi.Color3f):
            parameters[key] = mi.Color3f(float(np.asarray(value) @ LUMINANCE))
        elif key.endswith(".data") and np.ndim(value) == 3 and np.shape(value)[2] == 3:
            gray = np.asarray(value, np.float32) @ LUMINANCE.astype(np.float32)
            parameters[key] = mi.TensorXf(np.repeat(gray[:, :, None], 3, axis=2))
    parameters.update()
