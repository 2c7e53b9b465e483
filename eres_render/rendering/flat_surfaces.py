"""A scene that glows as flat pieces, each with an affine map from position to texture.

Scenes with baked light glow, and so do those that only emit. A camera sees a piece through a
homography, so the radiance at any position in the image is one look-up in a texture:
`eres_render.rendering.lookup` makes frames of them.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from eres_render.rendering.raycast import registry_number

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]

_WELD = 1e-6  # vertices are one if they are nearer than this share of the scene's size
_FLAT = 1e-6  # triangles lie in one plane to this share of it
_TEXELS = 5e-3  # neighbors have one map if it holds this well at the vertices of both
_STRAIGHT = 1e-6  # 1 - cosine between a shading normal and its triangle's own
_MAX_TEXELS = 2**31 - 1  # the kernels count them in 32 bits

TRACED = -1
"""In place of a piece: what cannot be looked up."""


class Pieces(NamedTuple):
    """G flat pieces, each with a plane, `normal` and `point` (G, 3), m.

    A point X shows texel `texel + texel_of @ (X - point)`, where texel centers lie at integers. The
    normal is on the side of the shading normals. `texture` is -1 for a piece with the same
    `radiance` everywhere, W m^-2 sr^-1.
    """

    normal: Float64
    point: Float64
    texel: Float64
    texel_of: Float64
    texture: Int32
    radiance: NDArray[np.float32]


class Bent(NamedTuple):
    """N triangles with interpolated shading normals; `vertices`, m, and `normals` are (N, 3, 3)."""

    piece: Int32
    vertices: Float64
    normals: Float64


@dataclass(frozen=True, eq=False, slots=True)
class FlatSurfaces:
    """What a camera can see of a scene that glows.

    `textures` are radiance, (rows, columns), as views of Mitsuba's own memory. `first_triangle` is
    indexed by a shape's number in Mitsuba's registry, -1 if not a mesh. `edges` (E, 2, 3), m, are
    all but the edges inside a piece. `boxes` (B, 2, 3), m, bound the shapes that are not meshes.
    """

    pieces: Pieces
    bent: Bent
    textures: list[NDArray[np.float16]]
    piece_of_triangle: Int32
    first_triangle: NDArray[np.int64]
    edges: Float64
    boxes: Float64


def flat_surfaces(mi_scene: Any, baked: Collection[str]) -> FlatSurfaces:
    """Split a scene that glows into flat pieces; `baked` are ids of shapes with a baked texture.

    Other textures are looked up if Mitsuba reads them like baked textures, and traced if not.
    """
    meshes, boxes = [], []
    textures: list[NDArray[np.float16]] = []
    first_triangle = {}
    count = 0
    for shape in mi_scene.shapes():
        if not shape.is_mesh():
            boxes.append([np.ravel(shape.bbox().min), np.ravel(shape.bbox().max)])
            continue
        mesh = _mesh(shape, textures, baked=shape.id() in baked)
        first_triangle[registry_number(shape)] = count
        count += len(mesh.vertices)
        meshes.append(mesh)
    triangles = _Triangles(*(np.concatenate(column) for column in zip(*meshes, strict=True)))
    numbers = np.full(max(first_triangle) + 1, -1, np.int64)
    numbers[list(first_triangle)] = list(first_triangle.values())
    pieces, bent, piece_of_triangle, edges = _take_apart(triangles)
    return FlatSurfaces(
        pieces=pieces,
        bent=bent,
        textures=textures,
        piece_of_triangle=piece_of_triangle,
        first_triangle=numbers,
        edges=edges,
        boxes=np.reshape(np.array(boxes, np.float64), (-1, 2, 3)),
    )


class _Triangles(NamedTuple):
    """T triangles of one or all meshes."""

    vertices: Float64  # (T, 3, 3), m
    normals: Float64  # (T, 3, 3), for shading
    texels: Float64  # (T, 3, 2)
    texture: Int32  # (T,), -1: none
    radiance: NDArray[np.float32]  # (T,)
    known: NDArray[np.bool_]  # (T,) whether they can be looked up


def _mesh(shape: Any, textures: list[NDArray[np.float16]], *, baked: bool) -> _Triangles:
    """Read a mesh, and append its texture."""
    import drjit as dr
    import mitsuba as mi

    faces = np.asarray(shape.face_indices(dr.arange(mi.UInt32, shape.face_count()))).T
    every = dr.arange(mi.UInt32, shape.vertex_count())

    def of_vertices(values: Any) -> Float64:
        return np.asarray(values, np.float64).T[faces]

    vertices = of_vertices(shape.vertex_position(every))
    normals: Float64 = np.broadcast_to(_unit_normal(vertices)[:, None], vertices.shape)
    if shape.has_vertex_normals() and not shape.has_face_normals():
        normals = of_vertices(shape.vertex_normal(every))
    texels = np.zeros((len(faces), 3, 2))
    texture, radiance = -1, 0.0
    emitter = shape.emitter()
    emission = mi.traverse(emitter) if emitter is not None else {"radiance.value": 0.0}
    plain = emitter is None or emitter.class_name() == "AreaLight"  # others have directions
    known = plain and not shape.has_flipped_normals()
    if "radiance.value" in emission:
        radiance = float(np.ravel(emission["radiance.value"])[0])
    elif shape.has_vertex_texcoords() and _can_be_looked_up(emitter, emission, baked=baked):
        image = np.asarray(emission["radiance.data"])[:, :, 0]
        rows, columns = image.shape
        texels = of_vertices(shape.vertex_texcoord(every)) * (columns, rows) - 0.5
        texture = len(textures)
        textures.append(image)
    else:
        known = False
    return _Triangles(
        vertices=vertices,
        normals=normals,
        texels=texels,
        texture=np.full(len(faces), texture, np.int32),
        radiance=np.full(len(faces), radiance, np.float32),
        known=np.full(len(faces), known),
    )


def _can_be_looked_up(emitter: Any, emission: Any, *, baked: bool) -> bool:
    if "radiance.data" in emission and math.prod(emission["radiance.data"].shape) > _MAX_TEXELS:
        return False
    return baked or _is_like_baked(emitter, emission)


def _is_like_baked(emitter: Any, emission: Any) -> bool:
    """Return whether a texture is of half-floats, clamped, bilinear and not transformed.

    Mitsuba does not tell how it reads a texture, so it reads points where that shows most.
    """
    import drjit as dr
    import mitsuba as mi

    if "radiance.data" not in emission or "radiance.to_uv" not in emission:
        return False
    data = np.asarray(emission["radiance.data"])
    if data.dtype != np.float16 or data.shape[2] != 1:
        return False
    if not np.all(data >= 0) or np.any(np.signbit(data)):  # the kernels take the sign for a number
        return False
    image = data[:, :, 0].astype(np.float32)
    rows, columns = image.shape
    across, down = (_largest_entry(np.diff(image, axis=axis)) for axis in (1, 0))
    (r, k), (q, m) = _largest_entry(image - image[:, :1]), _largest_entry(image - image[:1])
    points = [(across[1] + 0.5, across[0]), (down[1], down[0] + 0.5)]
    points += [(-1 - k, r), (k - columns, r), (m, -1 - q), (m, q - rows)]  # mirrored, repeated
    x, y = np.array(points, np.float32).T

    si = dr.zeros(mi.SurfaceInteraction3f, len(points))
    si.uv = mi.Point2f((x + 0.5) / columns, (y + 0.5) / rows)
    si.wi = mi.Vector3f(0, 0, 1)
    radiance = np.asarray(emitter.eval(si)[0])
    expected = map_coordinates(image, (y, x), order=1, mode="nearest")
    return bool(np.allclose(radiance, expected, rtol=1e-3, atol=1e-3 * float(image.max())))


def _largest_entry(values: NDArray[np.float32]) -> tuple[int, int]:
    """Return row and column of the entry with the largest magnitude, (0, 0) if there is none."""
    if not values.size:
        return 0, 0
    row, column = np.unravel_index(int(np.argmax(np.abs(values))), values.shape)
    return int(row), int(column)


def _unit_normal(vertices: Float64) -> Float64:
    """Return the normals of (T, 3, 3) triangles; NaN for one without area."""
    normal = np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    with np.errstate(invalid="ignore"):
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _take_apart(triangles: _Triangles) -> tuple[Pieces, Bent, Int32, Float64]:
    """Return pieces, bent triangles, the piece of each triangle, and edges."""
    vertices = triangles.vertices
    normal = _unit_normal(vertices)
    texel_of = _texel_maps(triangles, normal)
    known = triangles.known & np.isfinite(normal).all(1) & np.isfinite(texel_of).all((1, 2))
    left, right, edge = _neighbors(vertices)
    size = float(np.max(np.ptp(vertices.reshape(-1, 3), axis=0)))
    cosine = np.einsum("nvi,ni->nv", triangles.normals, normal)
    cosine /= np.linalg.norm(triangles.normals, axis=2)
    straight = (cosine > 1 - _STRAIGHT).all(1) | (cosine < _STRAIGHT - 1).all(1)
    lit_side = np.where(straight, np.sign(cosine[:, 0]), 0.0)  # 0: either, for bent ones

    def holds(of: NDArray[np.intp], at: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether planes, lit sides and maps of some triangles hold at the vertices of others."""
        offset = vertices[at] - vertices[of][:, :1]
        off_plane = np.abs(np.einsum("nvi,ni->nv", offset, normal[of])).max(1)
        mapped = triangles.texels[of][:, :1] + np.einsum("nvi,nki->nvk", offset, texel_of[of])
        off_map = np.abs(mapped - triangles.texels[at]).max((1, 2))
        same = np.einsum("ni,ni->n", normal[of], normal[at]) > 0
        same &= (triangles.texture[of] == triangles.texture[at]) & known[of] & known[at]
        same &= (triangles.radiance[of] == triangles.radiance[at]) & (lit_side[of] == lit_side[at])
        return same & (off_plane < _FLAT * size) & (off_map < _TEXELS)

    joined = holds(left, right) & holds(right, left)
    piece = _connected(left[joined], right[joined], len(vertices))
    # Each triangle of a long row may agree with the next, and the last not with the first.
    every = np.arange(len(piece))
    apart = np.bincount(piece, ~holds(_largest(piece, vertices)[piece], every)) > 0
    piece = np.unique(np.where(apart[piece], len(piece) + every, piece), return_inverse=True)[1]
    inside = piece[left] == piece[right]
    edges = np.delete(_edges(vertices), np.concatenate([edge[0], edge[1][inside]]), axis=0)

    whole = _largest(piece, vertices)
    pieces = Pieces(
        normal=normal[whole] * np.sign(cosine[whole, :1]),
        point=vertices[whole, 0],
        texel=triangles.texels[whole, 0],
        texel_of=texel_of[whole],
        texture=triangles.texture[whole],
        radiance=triangles.radiance[whole],
    )
    piece_of_triangle = np.where(known, piece, TRACED).astype(np.int32)
    bent = known & ~straight
    bent_triangles = Bent(piece_of_triangle[bent], vertices[bent], triangles.normals[bent])
    return pieces, bent_triangles, piece_of_triangle, edges


def _neighbors(vertices: Float64) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Return the triangles at shared edges, (P,) and (P,), and the edges in `_edges`, (2, P)."""
    size = float(np.max(np.ptp(vertices.reshape(-1, 3), axis=0)))
    place = np.round(vertices.reshape(-1, 3) / (_WELD * size)).astype(np.int64)
    start = np.unique(place, axis=0, return_inverse=True)[1].reshape(-1, 3)
    end = np.roll(start, -1, axis=1)
    # An edge runs one way in the one triangle and back in the other, or they overlap.
    count = int(start.max()) + 1
    forth, back = (start * count + end).ravel(), (end * count + start).ravel()
    known, first, times = np.unique(forth, return_index=True, return_counts=True)
    at = np.minimum(np.searchsorted(known, back), len(known) - 1)
    own = np.searchsorted(known, forth)
    paired = (known[at] == back) & (times[at] == 1) & (times[own] == 1) & (forth < back)
    left = np.flatnonzero(paired)
    right = first[at[left]]
    return left // 3, right // 3, np.stack([left, right])


def _edges(vertices: Float64) -> Float64:
    """Return the edges of (T, 3, 3) triangles: (3 T, 2, 3)."""
    return np.stack([vertices, np.roll(vertices, -1, axis=1)], axis=2).reshape(-1, 2, 3)


def _connected(left: NDArray[np.intp], right: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """Return the connected component of each of `count` nodes, (count,)."""
    links = coo_array((np.ones(len(left)), (left, right)), shape=(count, count))
    return connected_components(links, directed=False)[1]


def _texel_maps(triangles: _Triangles, normal: Float64) -> Float64:
    """Return (T, 2, 3) matrices from a step along each triangle, m, to texels."""
    a = triangles.vertices[:, 1] - triangles.vertices[:, 0]
    b = triangles.vertices[:, 2] - triangles.vertices[:, 0]
    along_a, along_b = np.cross(b, normal), np.cross(normal, a)
    with np.errstate(divide="ignore", invalid="ignore"):
        along_a = along_a / np.sum(along_a * a, axis=1, keepdims=True)
        along_b = along_b / np.sum(along_b * b, axis=1, keepdims=True)
    step_a = triangles.texels[:, 1] - triangles.texels[:, 0]
    step_b = triangles.texels[:, 2] - triangles.texels[:, 0]
    return step_a[:, :, None] * along_a[:, None] + step_b[:, :, None] * along_b[:, None]


def _largest(piece: NDArray[np.integer], vertices: Float64) -> NDArray[np.intp]:
    """Return the largest triangle of each piece."""
    area = np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    order = np.lexsort((np.linalg.norm(area, axis=1), piece))
    return order[np.append(np.flatnonzero(np.diff(piece[order])), len(order) - 1)]
