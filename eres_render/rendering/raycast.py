"""Cast rays at a loaded scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class Hits:
    """The first surfaces that N rays met.

    `distance` is in units of the lengths of the rays' directions, inf without a hit. `shape` is an
    index into `RayCaster.shape_ids`, -1 without a hit. `blind_side` is True at the back of a
    one-sided surface.
    """

    distance: Float64
    shape: NDArray[np.intp]
    blind_side: NDArray[np.bool_]


class RayCaster:
    """Casts rays at a Mitsuba scene, in the selected variant and in single precision."""

    def __init__(self, mi_scene: Any) -> None:
        import mitsuba as mi

        self._mi_scene = mi_scene
        shapes = mi_scene.shapes()
        # In an instance rays meet a shape of its group, which is not among these.
        self.shape_ids: list[str] = [*(str(shape.id()) for shape in shapes), "of an instance"]
        has_back = (mi.has_flag(s.bsdf().flags(), mi.BSDFFlags.BackSide) for s in shapes)
        self._has_back = np.array([*has_back, True, True])  # also of an instance's, and of nothing

    def cast(self, origins: Float64, directions: Float64) -> Hits:
        """Cast rays from (N, 3) or (3,) m along (N, 3) directions of any length."""
        import mitsuba as mi

        if not len(directions):  # Dr.Jit would end the process
            return Hits(np.empty(0), np.empty(0, np.intp), np.empty(0, np.bool_))
        origins = np.broadcast_to(origins, directions.shape)
        scalar = str(mi.variant()).startswith("scalar")
        cast = self._cast_one_by_one if scalar else self._cast_together
        distance, normal, shape = cast(origins, directions)
        blind_side = (np.sum(normal * directions, axis=1) > 0) & ~self._has_back[shape]
        return Hits(np.where(shape >= 0, distance, np.inf), shape, blind_side)

    def distance(self, origins: Float64, directions: Float64) -> Float64:
        """Return `Hits.distance` as `cast` finds it, (N,), at less cost."""
        import mitsuba as mi

        if not len(directions) or str(mi.variant()).startswith("scalar"):
            return self.cast(origins, directions).distance
        hits = self._mi_scene.ray_intersect_preliminary(_rays(origins, directions), coherent=True)
        return np.asarray(hits.t, np.float64)

    def _cast_together(
        self, origins: Float64, directions: Float64
    ) -> tuple[Float64, Float64, NDArray[np.intp]]:
        import drjit as dr
        import mitsuba as mi

        ray = _rays(origins, directions)
        si = self._mi_scene.ray_intersect(ray, mi.RayFlags.ShadingFrame, coherent=False)
        number, normal = dr.reinterpret_array(mi.UInt32, si.shape), front(si)
        dr.eval(number, si.t, normal)  # together, in code that does not hold their length
        number = np.asarray(number)
        index_of = np.full(int(number.max()) + 1, len(self.shape_ids) - 1, dtype=np.intp)
        index_of[0] = -1
        for i, shape in enumerate(self._mi_scene.shapes()):
            own = registry_number(shape)
            if own < len(index_of):
                index_of[own] = i
        normals = np.stack([np.asarray(axis, np.float64) for axis in normal], axis=1)
        return np.asarray(si.t, np.float64), normals, index_of[number]

    def _cast_one_by_one(
        self, origins: Float64, directions: Float64
    ) -> tuple[Float64, Float64, NDArray[np.intp]]:
        import mitsuba as mi

        n = len(directions)
        distance, normal = np.full(n, np.inf), np.zeros((n, 3))
        shape = np.full(n, -1, dtype=np.intp)
        index_of = {s: i for i, s in enumerate(self._mi_scene.shapes())}
        for k in range(n):
            ray = mi.Ray3f(mi.Point3f(origins[k]), mi.Vector3f(directions[k]))
            si = self._mi_scene.ray_intersect(ray, mi.RayFlags.ShadingFrame, coherent=False)
            if si.is_valid():
                distance[k], normal[k] = si.t, front(si)
                shape[k] = index_of.get(si.shape, len(self.shape_ids) - 1)
        return distance, normal, shape


def registry_number(shape: Any) -> int:
    """Return the number of a shape in Mitsuba's registry, by which rays tell what they met."""
    import drjit as dr
    import mitsuba as mi

    return int(np.asarray(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])


def front(si: Any) -> Any:
    """Return geometric normals on the side of the shading normals, the front.

    A mirrored mesh has its geometric normals on the other side.
    """
    import drjit as dr

    return dr.mulsign(si.n, dr.dot(si.n, si.sh_frame.n))


def _rays(origins: Float64, directions: Float64) -> Any:
    """Return rays gathered from arrays, as Dr.Jit compiles plain loads anew for each alignment."""
    import drjit as dr
    import mitsuba as mi

    def gathered(kind: Any, values: Float64) -> Any:
        return dr.unravel(kind, mi.Float(values.astype(np.float32).ravel()))

    origins = np.broadcast_to(origins, directions.shape)
    return mi.Ray3f(gathered(mi.Point3f, origins), gathered(mi.Vector3f, directions))
