"""Tell whether the light of a surface can be baked into a texture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import mitsuba as mi

_PROBES = 1 << 12  # points of a surface at which its UV coordinates are tried
_UV_TOLERANCE = 1e-3  # of the surface's size


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
    """Return why a surface's light cannot be baked, as in "shape 'ball' is ..."; "" if it can.

    The surface must be Lambertian, have one side, and have a different UV coordinate at each point.
    """
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
    if isinstance(shape, mi.Mesh) and not shape.has_vertex_texcoords():
        return "has no UV coordinates"
    if not _has_own_uv(shape):
        return "has points that share a UV coordinate, or lie outside the UV square"
    return ""


def _has_own_uv(shape: mi.Shape) -> bool:
    """Return whether UV coordinates identify points of the surface."""
    import drjit as dr
    import mitsuba as mi

    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, _PROBES)
    sample_position: Any = shape.sample_position  # its type stub has a different Float
    sample = sample_position(0.0, sampler.next_2d())
    found: Any = shape.eval_parameterization(mi.Point2f(sample.uv))
    size = float(np.max(np.asarray(dr.norm(shape.bbox().extents()))))
    again = found.is_valid() & (dr.norm(found.p - sample.p) < _UV_TOLERANCE * size)
    return float(np.mean(np.asarray(dr.select(again, 1.0, 0.0)))) > 0.99
