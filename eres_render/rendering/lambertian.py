"""Tell whether the light of a surface can be baked into a texture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eres_render.rendering.load import LUMINANCE

if TYPE_CHECKING:
    import mitsuba as mi

_PROBES = 1 << 12  # points of a surface at which its UV coordinates are tried
_UV_TOLERANCE = 1e-3  # of the surface's size, or of the UV square
_LINES = 64  # rows, and columns, of an image in which a clear step is looked for first
_CLEAR = 1e-2  # reflectance


def surfaces(mi_scene: mi.Scene) -> list[mi.Shape]:
    """Return the shapes that reflect light: all but lamps without a material of their own."""
    return [
        shape for shape in mi_scene.shapes() if not (shape.is_emitter() and _is_black(shape.bsdf()))
    ]


def _is_black(bsdf: mi.BSDF) -> bool:
    """Return whether a material is the one that Mitsuba gives to lamps: it reflects nothing."""
    import mitsuba as mi

    if bsdf.class_name() != "SmoothDiffuse":
        return False
    parameters = mi.traverse(bsdf)
    values = [parameters[key] for key in parameters.keys() if "reflectance" in key]  # noqa: SIM118
    return not any(np.any(np.asarray(value)) for value in values)


def reason_not_to_bake(shape: mi.Shape) -> str:
    """Return why a surface's light cannot be baked, as in "shape 'ball' is ..."; "" if it can."""
    import mitsuba as mi

    if shape.class_name() == "Instance":
        return "is an instance"
    if shape.is_emitter():
        return "emits light and reflects it, too"
    bsdf = shape.bsdf()
    flags = bsdf.flags()
    if mi.has_flag(flags, mi.BSDFFlags.Glossy) or mi.has_flag(flags, mi.BSDFFlags.Delta):
        return "is not Lambertian"
    if mi.has_flag(flags, mi.BSDFFlags.BackSide) or mi.has_flag(flags, mi.BSDFFlags.Transmission):
        return "has two sides"
    if bsdf.class_name() != "SmoothDiffuse":
        return f"has a material of class {bsdf.class_name()}, not a plain diffuse one"
    parameters = mi.traverse(bsdf)
    keys = [k for k in parameters.keys() if "reflectance" in k]  # noqa: SIM118 - not a mapping
    if not any(key.endswith(("reflectance.data", "reflectance.value")) for key in keys):
        return "has a reflectance that is neither uniform nor an image"
    turned = (np.array(parameters[key].matrix) for key in keys if key.endswith(".to_uv"))
    if not all(np.allclose(matrix, np.eye(len(matrix))) for matrix in turned):
        return "has a texture with a to_uv transform"
    if str(mi.variant()).startswith("scalar"):
        return ""
    images = (np.asarray(parameters[key]) for key in keys if key.endswith("reflectance.data"))
    if not all(_is_bilinear(bsdf, image) for image in images):
        return "has an image that is not interpolated bilinearly"
    if isinstance(shape, mi.Mesh) and not shape.has_vertex_texcoords():
        return "has no UV coordinates"
    sample, at_uv = _probed(shape)
    if not _has_own_uv(shape, sample, at_uv):
        return "has points that share a UV coordinate, or lie outside the UV square"
    if not _has_its_side(sample, at_uv):
        return "has flipped normals, which Mitsuba ignores at a UV coordinate"
    return ""


def _is_bilinear(bsdf: mi.BSDF, image: NDArray[np.floating]) -> bool:
    """Return whether a material's image is interpolated, where that shows."""
    import drjit as dr
    import mitsuba as mi

    for every in (1 + min(image.shape[:2]) // _LINES, 1):
        across = np.abs(np.diff(_gray(image[::every]), axis=1))
        down = np.abs(np.diff(_gray(image[:, ::every]), axis=0))
        right = int(across.max(initial=0.0) >= down.max(initial=0.0))
        steps = across if right else down
        if steps.max(initial=0.0) > _CLEAR:
            break
    if not steps.any():
        return True
    row, column = map(int, np.unravel_index(int(np.argmax(steps)), steps.shape))
    row, column = (every * row, column) if right else (row, every * column)
    rows, columns, _ = image.shape
    si = dr.zeros(mi.SurfaceInteraction3f)
    u, v = column + 0.5 + 0.25 * right, row + 0.75 - 0.25 * right  # at a quarter of the step
    si.uv = mi.Point2f(u / columns, v / rows)
    si.wi = mi.Vector3f(0, 0, 1)
    value = float(np.asarray(bsdf.eval_diffuse_reflectance(si)).ravel()[0])
    before, after = map(float, _gray(image[[row, row + 1 - right], [column, column + right]]))
    return abs(value - (0.75 * before + 0.25 * after)) < 0.05 * abs(after - before)


def _gray(image: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the reflectance of pixels (..., channels), their luminance in every variant."""
    gray = image @ LUMINANCE if image.shape[-1] == 3 else image[..., 0]
    return gray.astype(np.float32)


def _has_own_uv(shape: mi.Shape, sample: Any, at_uv: Any) -> bool:
    """Return whether UV coordinates identify points of the surface, and are in the square."""
    import drjit as dr

    size = float(np.max(np.asarray(dr.norm(shape.bbox().extents()))))
    low, high = -_UV_TOLERANCE, 1 + _UV_TOLERANCE
    u, v = sample.uv.x, sample.uv.y
    in_square = (u > low) & (u < high) & (v > low) & (v < high)
    again = in_square & at_uv.is_valid() & (dr.norm(at_uv.p - sample.p) < _UV_TOLERANCE * size)
    return float(np.mean(np.asarray(dr.select(again, 1.0, 0.0)))) > 0.99


def _has_its_side(sample: Any, at_uv: Any) -> bool:
    """Return whether fronts at UV coordinates are those at the same points of the surface."""
    import drjit as dr

    alike = dr.select(dr.dot(at_uv.sh_frame.n, sample.n) > 0, 1.0, 0.0)
    return float(np.mean(np.asarray(alike))) > 0.99


def _probed(shape: mi.Shape) -> tuple[Any, Any]:
    """Return random points of a surface, and what Mitsuba finds at their UV coordinates."""
    import mitsuba as mi

    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, _PROBES)
    sample_position: Any = shape.sample_position  # its type stub has a different Float
    sample = sample_position(0.0, sampler.next_2d())
    return sample, shape.eval_parameterization(mi.Point2f(sample.uv))
