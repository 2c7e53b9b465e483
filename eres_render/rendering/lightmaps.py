"""Bake the light of a scene into textures, so that a frame costs one ray per sample.

Surfaces are Lambertian and lamps do not move, so a surface point sends the same radiance
`reflectance * irradiance / pi` in every direction at all times. The irradiance is smooth: a coarse
lightmap holds it. Its product with the fine reflectance becomes the emission of the surface, and
the scene with these emitting surfaces looks the same to every camera.
"""

from __future__ import annotations

import logging
import shutil
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote, unquote

import cv2
import numpy as np
from numpy.typing import NDArray

from eres_render.errors import SceneError
from eres_render.progress import Progress, silent
from eres_render.rendering import irradiance as light
from eres_render.rendering.load import load_mi_scene
from eres_render.scene.scene import BAKE_VERSION, Scene
from eres_render.storage.atomic import clear_unfinished, make_folder, unfinished
from eres_render.storage.cache import cache_dir
from eres_render.storage.exr import read_attributes, read_luminance, write_luminance
from eres_render.storage.locks import locked

if TYPE_CHECKING:
    import mitsuba as mi

_log = logging.getLogger(__name__)

Float32 = NDArray[np.float32]

_DIGEST_ATTRIBUTE = "eresLightDigest"
_VERSION_ATTRIBUTE = "eresBakeVersion"
_VERSION_BEFORE = 3  # of lightmaps that do not say it
_COUNT_ATTRIBUTE = "eresLightmaps"


def bake_scene(
    scene: Scene, folder: str | Path | None = None, on_progress: Progress = silent
) -> list[Path]:
    """Write one lightmap for each surface.

    Parameters
    ----------
    scene
        Its `bake` settings give the size of the lightmaps' cells and the samples in each cell.
    folder
        Folder of the lightmaps; the scene's own folder by default.
    on_progress
        Called as samples are done.

    Returns
    -------
    files
        The lightmaps: half-float EXR, irradiance in W m^-2, rounded to 0.2 % rms.

    Raises
    ------
    BackendError
        If the selected variant is scalar.
    SceneError
        If the scene has no light or moving objects, or a surface cannot be baked.
    RenderError
        If a lightmap cannot be written.
    OSError
        If nothing can be written into the folder. This is checked before anything is baked.
    """
    folder = Path(folder) if folder else scene.folder
    make_folder(folder)
    together = folder / "lightmaps"
    clear_unfinished(folder, together.name)
    with unfinished(together, folder=True):
        pass  # where nothing can be written, say so before minutes of work
    settings = scene.settings.bake
    maps = light.irradiance_maps(scene, settings.cell_m, settings.spp, on_progress)
    state = {
        _DIGEST_ATTRIBUTE: scene.light_digest,
        _VERSION_ATTRIBUTE: str(BAKE_VERSION),
        _COUNT_ATTRIBUTE: str(len(maps)),
    }
    with unfinished(together, folder=True) as new:
        # An id may have a slash.
        written = [new / f"lightmap_{quote(shape_id, safe='')}.exr" for shape_id in maps]
        for path, irradiance in zip(written, maps.values(), strict=True):
            write_luminance(path, _rounded(irradiance), state)
        # All of them together, as a scene with some of its lightmaps cannot be rendered.
        return [path.replace(folder / path.name) for path in written]


def _rounded(irradiance: Float32) -> Float32:
    """Return values with 8 binary digits: a third less to store, and an error below the noise."""
    mantissa, exponent = np.frexp(irradiance)
    return np.ldexp(np.round(mantissa * 256) / 256, exponent).astype(np.float32, copy=False)


def lightmaps(scene: Scene, on_progress: Progress = silent) -> dict[str, Float32]:
    """Return the lightmaps of a scene: packaged, cached, or baked and cached now.

    Lightmaps of a different state of the scene are ignored. While another process bakes the scene,
    this process waits.

    Parameters
    ----------
    scene
        Scene to light.
    on_progress
        Called as samples are done, if the scene must be baked.

    Returns
    -------
    maps
        From shape id to (rows, columns) float32 irradiance, W m^-2.

    Raises
    ------
    BackendError
        If the scene must be baked and the selected variant is scalar.
    SceneError
        If the scene must be baked and cannot be; see `bake_scene`.
    """
    files = _lightmap_files(scene)
    if not files:
        cached = _cached_lightmaps(scene)
        with locked(cached.with_name(f"{cached.name}.lock")):
            files = _lightmap_files(scene) or _bake_into_cache(scene, on_progress)
    return {unquote(path.stem.removeprefix("lightmap_")): read_luminance(path) for path in files}


def _bake_into_cache(scene: Scene, on_progress: Progress) -> list[Path]:
    """Bake into a folder that gets its name when it is complete."""
    cached = _cached_lightmaps(scene)
    _log.info("no lightmaps match the current files of %s; baking them into %s", scene.name, cached)
    baked = cached.with_name(f"{cached.name}.unfinished")
    bake_scene(scene, baked, on_progress)
    shutil.rmtree(cached, ignore_errors=True)
    baked.rename(cached)
    return _lightmap_files(scene)


def has_lightmaps(scene: Scene) -> bool:
    """Return whether lightmaps of this state of the scene are packaged or cached."""
    return bool(_lightmap_files(scene))


def _lightmap_files(scene: Scene) -> list[Path]:
    """Return the files of the first folder with lightmaps of this state of the scene."""
    for folder in (scene.folder, _cached_lightmaps(scene)):
        files = [path for path in sorted(folder.glob("lightmap_*.exr")) if _is_of(path, scene)]
        # Another scene in the folder may have replaced some of them.
        count = str(len(files))
        if files and read_attributes(files[0]).get(_COUNT_ATTRIBUTE, count) == count:
            return files
    return []


def _is_of(file: Path, scene: Scene) -> bool:
    """Return whether a lightmap is of this state of the scene, baked by this code."""
    stored = read_attributes(file)
    version = stored.get(_VERSION_ATTRIBUTE, str(_VERSION_BEFORE))
    return (stored.get(_DIGEST_ATTRIBUTE), version) == (scene.light_digest, str(BAKE_VERSION))


def _cached_lightmaps(scene: Scene) -> Path:
    name = f"{scene.name}-{scene.light_digest[:16]}-v{BAKE_VERSION}"
    return cache_dir() / "lightmaps" / name


def baked_scene(scene: Scene, on_progress: Progress = silent) -> tuple[mi.Scene, set[str]]:
    """Load scene.xml with the light of every surface baked into its emission.

    Parameters
    ----------
    scene
        Scene to load.
    on_progress
        Called as samples are done, if the scene must be baked.

    Returns
    -------
    mi_scene
        Mitsuba's scene. Its surfaces reflect nothing, and emit what they would reflect.
    shape_ids
        Ids of these surfaces, each with a texture of radiance.

    Raises
    ------
    BackendError, SceneError
        As for `lightmaps`, or if a shape has no lightmap.
    """
    maps = lightmaps(scene, on_progress)
    emitters = {}
    mi_scene = load_mi_scene(scene)  # kept: its shapes must not outlive it
    for shape in light.bakeable_surfaces(mi_scene, scene):
        if shape.id() not in maps:
            raise SceneError(
                f"{scene.folder}: shape {shape.id()!r} has no lightmap, only {list(maps)} have; "
                "run eres bake again"
            )
        texels = light.reflectance(shape.bsdf(), scene)
        reflected, irradiance = _at_one_size(texels, maps[shape.id()])
        radiance = (irradiance * np.float32(1 / np.pi) * reflected).astype(np.float32, copy=False)
        # A resampled texture may ring below black; -0.0 is not one of the kernels' numbers.
        radiance = np.abs(np.maximum(radiance, 0, out=radiance), out=radiance)
        # Half-floats are as fine as the reflectance on disk, in half the memory.
        emitters[shape.id()] = light.glow_of(radiance, format="fp16")
    return load_mi_scene(scene, emitters), set(emitters)


def _at_one_size(image: Float32, cells: Float32) -> list[Float32]:
    """Return an image and a lightmap of one area at the same size, no smaller than either.

    An odd multiple of the image's size keeps its texel centers; any other size would blur it.
    """
    height, width = map(_size, image.shape, cells.shape)
    # OpenCV copies an image that has this size already.
    resized = (cv2.resize(texels, (width, height)) for texels in (image, cells))
    return [texels.astype(np.float32, copy=False) for texels in resized]


def _size(texels: int, cells: int) -> int:
    if texels == 1:  # uniform
        return cells
    times = -(-cells // texels)
    return texels * (times + 1 - times % 2)
