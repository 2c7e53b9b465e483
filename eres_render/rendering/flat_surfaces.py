"""A baked scene as flat pieces, each with an affine map from position to texture.

A camera sees such a piece through a homography, so the radiance at any position in the image is one
look-up in a texture: `eres_render.rendering.lookup` makes frames of them.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]

_WELD = 1e-6  # vertices are one if they are nearer than this share of the scene's size
_FLAT = 1e-6  # triangles lie in one plane to this share of it
_TEXELS = 5e-3  # neighbors have one map if it holds this well at the vertices of both
_STRAIGHT = 1e-6  # 1 - cosine between a shading normal and its triangle's own

TRACED = -1
"""In place of a piece: what cannot be looked up."""


class Pieces(NamedTuple):
    """Flat pieces, G of them.

    Attributes
    ----------
    normal, point : (G, 3) float64
        The plane of each, m. The normal is that of its triangles, or of their shading if that
        points the other way.
    texel, texel_of : (G, 2), (G, 2, 3) float64
        A point X shows texel `texel + texel_of @ (X - point)`; texel centers lie at integers.
    texture : (G,) int32
        Index of its texture, -1 if it has one radiance everywhere.
    radiance : (G,) float32
        That radiance, W m^-2 sr^-1.
    """

    normal: Float64
    point: Float64
    texel: Float64
    texel_of: Float64
    texture: Int32
    radiance: NDArray[np.float32]


class Bent(NamedTuple):
    """Triangles with interpolated shading normals, N of them.

    Attributes
    ----------
    piece : (N,) int32
    vertices, normals : (N, 3, 3) float64
        Of each of the three vertices, m.
    """

    piece: Int32
    vertices: Float64
    normals: Float64


@dataclass(frozen=True, eq=False, slots=True)
class FlatSurfaces:
    """What a camera can see of a baked scene.

    Attributes
    ----------
    textures
        Radiance, (rows, columns) float16 each: views of Mitsuba's own memory.
    piece_of_triangle : (T,) int32
        Of all meshes, one after the other; `TRACED` where there is none.
    first_triangle : (S,) int64
        Of each shape, by its number in Mitsuba's registry; -1 for what is not a mesh.
    edges : (E, 2, 3) float64
        Every edge but those inside a piece, m.
    boxes : (B, 2, 3) float64
        Lower and upper corner of every shape that is not a mesh, m.
    """

    pieces: Pieces
    bent: Bent
    textures: list[NDArray[np.float16]]
    piece_of_triangle: Int32
    first_triangle: NDArray[np.int64]
    edges: Float64
    boxes: Float64


def flat_surfaces(world: Any, baked: Collection[str]) -> FlatSurfaces:
    """Take a baked scene apart.

    Parameters
    ----------
    world
        The scene in Mitsuba; its surfaces glow.
    baked
        Ids of the shapes whose texture is a baked one: clamped, bilinear, not transformed. Any
        other texture is traced.
    """
    meshes, boxes, textures = [], [], []
    first_triangle = {}
    count = 0
    for shape in world.shapes():
        if not shape.is_mesh():
            boxes.append([np.ravel(shape.bbox().min), np.ravel(shape.bbox().max)])
            continue
        mesh = _mesh(shape, textures, shape.id() in baked)
        first_triangle[_registry_number(shape)] = count
        count += len(mesh.vertices)
        meshes.append(mesh)
    triangles = _Triangles(*(np.concatenate(column) for column in zip(*meshes, strict=True)))
    numbers = np.full(max(first_triangle) + 1, -1, np.int64)
    numbers[list(first_triangle)] = list(first_triangle.values())
    pieces, bent, piece_of_triangle, edges = _pieces(triangles, textures)
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
    shape: Int32  # (T,), -1: cannot be looked up


def _registry_number(shape: Any) -> int:
    import drjit as dr
    import mitsuba as mi

    return int(np.asarray(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])


def _mesh(shape: Any, textures: list[NDArray[np.float16]], baked: bool) -> _Triangles:
    """Read a mesh, and append its texture."""
    import drjit as dr
    import mitsuba as mi

    faces = np.asarray(shape.face_indices(dr.arange(mi.UInt32, shape.face_count()))).T
    every = dr.arange(mi.UInt32, shape.vertex_count())

    def of_vertices(values: Any) -> Float64:
        return np.asarray(values, np.float64).T[faces]

    vertices = of_vertices(shape.vertex_position(every))
    normals = np.broadcast_to(_unit_normal(vertices)[:, None], vertices.shape)
    if shape.has_vertex_normals() and not shape.has_face_normals():
        normals = of_vertices(shape.vertex_normal(every))
    texels = np.zeros((len(faces), 3, 2))
    texture, radiance = -1, 0.0
    emission = mi.traverse(shape.emitter())
    known = not shape.has_flipped_normals()
    if "radiance.value" in emission:
        radiance = float(np.ravel(emission["radiance.value"])[0])
    elif baked and shape.has_vertex_texcoords():
        image = np.asarray(emission["radiance.data"])[:, :, 0]
        rows, columns = image.shape
        texels = of_vertices(shape.vertex_texcoord(every)) * (columns, rows) - 0.5
        texture = len(textures)
        textures.append(image)
    else:
        known = False
    number = _registry_number(shape)
    return _Triangles(
        vertices=vertices,
        normals=normals,
        texels=texels,
        texture=np.full(len(faces), texture, np.int32),
        radiance=np.full(len(faces), radiance, np.float32),
        shape=np.full(len(faces), number if known else TRACED, np.int32),
    )


def _unit_normal(vertices: Float64) -> Float64:
    """Return the normals of (T, 3, 3) triangles; NaN for one without area."""
    normal = np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    with np.errstate(invalid="ignore"):
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _pieces(
    triangles: _Triangles, textures: list[NDArray[np.float16]]
) -> tuple[Pieces, Bent, Int32, Float64]:
    vertices = triangles.vertices
    size = float(np.max(np.ptp(vertices.reshape(-1, 3), axis=0)))
    normal = _unit_normal(vertices)
    texel_of = _texel_maps(triangles, normal)
    known = (triangles.shape != TRACED) & np.isfinite(texel_of).all((1, 2))
    known &= np.isfinite(normal).all(1)

    def agree(of: NDArray[np.intp], at: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether the planes and maps of some triangles hold at the vertices of others."""
        offset = vertices[at] - vertices[of][:, :1]
        off_plane = np.abs(np.einsum("nvi,ni->nv", offset, normal[of])).max(1)
        found = triangles.texels[of][:, :1] + np.einsum("nvi,nki->nvk", offset, texel_of[of])
        off_map = np.abs(found - triangles.texels[at]).max((1, 2))
        same = np.einsum("ni,ni->n", normal[of], normal[at]) > 0
        same &= triangles.shape[of] == triangles.shape[at]
        return same & (off_plane < _FLAT * size) & (off_map < _TEXELS)

    # An edge of two triangles runs forward in one and back in the other, or they overlap.
    corner = _welded(vertices, _WELD * size)
    start, end = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    owner = np.repeat(np.arange(len(vertices)), 3)
    n_corners = int(corner.max()) + 1
    forward, back = start * n_corners + end, end * n_corners + start
    order = np.argsort(forward, kind="stable")
    at = np.searchsorted(forward[order], back)
    other = order[np.minimum(at, len(order) - 1)]
    unique = np.bincount(np.unique(forward, return_inverse=True)[1])
    once = unique[np.unique(forward, return_inverse=True)[1]] == 1
    paired = (forward[other] == back) & once & once[other]
    left, right = owner[paired], owner[other[paired]]
    joined = known[left] & known[right] & agree(left, right) & agree(right, left)
    links = coo_array(
        (np.ones(int(joined.sum())), (left[joined], right[joined])), shape=(len(vertices),) * 2
    )
    _, piece = connected_components(links, directed=False)
    # A long row of neighbors that nearly agree need not agree as a whole.
    whole = _largest_of(piece, vertices)
    drifted = np.zeros(piece.max() + 1, bool)
    drifted[piece[known & ~agree(whole[piece], np.arange(len(piece)))]] = True
    alone = drifted[piece] | ~known
    piece = np.where(alone, piece.max() + 1 + np.arange(len(piece)), piece)
    kept, piece = np.unique(piece, return_inverse=True)
    whole = _largest_of(piece, vertices)

    inside = np.zeros(len(start), bool)
    inside[paired] = piece[left] == piece[right]
    ends = np.stack([vertices.reshape(-1, 3), np.roll(vertices, -1, axis=1).reshape(-1, 3)], axis=1)
    # Of an edge that two triangles share, one is enough.
    edges = ends[~inside & ~(paired & (forward > back))]

    cosine = np.einsum("nvi,ni->nv", triangles.normals, normal)
    cosine /= np.linalg.norm(triangles.normals, axis=2)
    straight = (np.abs(cosine) > 1 - _STRAIGHT).all(1) & (np.ptp(np.sign(cosine), axis=1) == 0)
    bent = ~straight & known
    away = np.where(cosine[whole, 0] < 0, -1.0, 1.0)
    pieces = Pieces(
        normal=normal[whole] * away[:, None],
        point=vertices[whole, 0],
        texel=triangles.texels[whole, 0],
        texel_of=texel_of[whole],
        texture=triangles.texture[whole],
        radiance=triangles.radiance[whole],
    )
    piece = np.where(known, piece, TRACED).astype(np.int32)
    return (
        pieces,
        Bent(piece[bent], vertices[bent], triangles.normals[bent]),
        piece,
        np.ascontiguousarray(edges),
    )


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


def _welded(vertices: Float64, size: float) -> NDArray[np.int64]:
    """Number (T, 3, 3) vertices, the same number for the same place: (T, 3)."""
    place = np.round(vertices.reshape(-1, 3) / size).astype(np.int64)
    return np.unique(place, axis=0, return_inverse=True)[1].reshape(-1, 3)


def _largest_of(piece: NDArray[np.integer], vertices: Float64) -> NDArray[np.intp]:
    """Return the largest triangle of each piece."""
    area = np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    order = np.lexsort((np.linalg.norm(area, axis=1), piece))
    return order[np.append(np.flatnonzero(np.diff(piece[order])), len(order) - 1)]
