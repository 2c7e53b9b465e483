"""Frames of a baked scene with one ray for each pixel corner in place of one for each sample.

A pixel whose four corners show the same flat piece, and which no edge crosses in front of it, shows
nothing else: its samples are looked up in the piece's texture where the homography of the piece has
them. Mitsuba says what the corners show, and traces every other pixel.
"""

from __future__ import annotations

from collections.abc import Collection
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eres_render.camera import Camera
from eres_render.rendering.flat_surfaces import TRACED, FlatSurfaces, flat_surfaces
from eres_render.rendering.lookup_kernels import (
    BLACK,
    look_up,
    mark_edges,
    pieces_at,
    view_bent,
    view_pieces,
)

Float64 = NDArray[np.float64]

_BANDS = 8  # of rows a thread


class LookUp:
    """Looks up what a camera sees of a baked scene, where that can be looked up.

    Parameters
    ----------
    world
        The baked scene.
    baked
        Ids of the shapes with baked textures.
    """

    def __init__(self, world: Any, baked: Collection[str]) -> None:
        self._world = world
        self._surfaces: FlatSurfaces = flat_surfaces(world, baked)
        pieces = self._surfaces.pieces
        # One more piece for what no ray meets: black, infinitely far, unless there is a sky.
        self._nothing = TRACED if world.environment() is not None else len(pieces.normal)
        self._homographies = np.zeros((len(pieces.normal) + 1, 3, 3))
        self._state = np.full(len(pieces.normal) + 1, BLACK, np.int8)
        textures = self._surfaces.textures
        self._addresses = np.array([t.ctypes.data for t in textures], np.uint64)
        self._sizes = np.array([t.shape for t in textures], np.int64).reshape(-1, 2)

    def frame(
        self,
        camera: Camera,
        T_world_cam: Float64,
        corner_rays: Any,
        positions: tuple[NDArray[np.float32], NDArray[np.float32]],
        threads: int,
    ) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
        """Return an image, (H, W) float32, and the pixels that are missing in it, (N,)."""
        surfaces = self._surfaces
        eye = np.ascontiguousarray(T_world_cam[:3, 3])
        M = np.ascontiguousarray(T_world_cam[:3, :3] @ np.linalg.inv(camera.K))
        P = np.ascontiguousarray(camera.K @ T_world_cam[:3, :3].T)
        piece_at = self._pieces_seen(corner_rays).reshape(camera.height + 1, camera.width + 1)
        view_pieces(eye, M, surfaces.pieces, self._homographies, self._state)
        view_bent(eye, surfaces.bent, self._state)
        marked = np.zeros((camera.height, camera.width), np.uint8)
        self._mark_boxes(P, eye, marked)
        mark_edges(surfaces.edges, eye, P, 1e-3, piece_at, self._homographies, marked)
        image = np.empty(marked.shape, np.float32)
        bands = np.linspace(0, camera.height, threads * _BANDS + 1).astype(int)

        def fill(band: int) -> None:
            rows = (bands[band], bands[band + 1])
            look_up(
                rows, piece_at, marked, self._homographies, self._state, surfaces.pieces,
                self._addresses, self._sizes, *positions, image,
            )  # fmt: skip

        with ThreadPoolExecutor(threads) as workers:
            list(workers.map(fill, range(len(bands) - 1)))
        return image, np.flatnonzero(marked)

    def _pieces_seen(self, rays: Any) -> NDArray[np.int32]:
        import drjit as dr
        import mitsuba as mi

        found = self._world.ray_intersect_preliminary(rays, coherent=True)
        shape = np.asarray(dr.reinterpret_array(mi.UInt32, found.shape))
        triangle = np.asarray(found.prim_index)
        piece_at = np.empty(len(shape), np.int32)
        surfaces = self._surfaces
        pieces_at(
            shape, triangle, surfaces.first_triangle, surfaces.piece_of_triangle, self._nothing,
            piece_at,
        )  # fmt: skip
        return piece_at

    def _mark_boxes(self, P: Float64, eye: Float64, marked: NDArray[np.uint8]) -> None:
        """Mark where what is no mesh may be."""
        for low, high in self._surfaces.boxes:
            corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), -1).reshape(-1, 3)
            seen = (corners - eye) @ P.T
            start, end = (seen[list(i)] for i in zip(*_BOX_EDGES, strict=True))
            cut = (start[:, 2] < 1e-3) != (end[:, 2] < 1e-3)
            share = (1e-3 - start[cut, 2]) / (end[cut, 2] - start[cut, 2])
            between = start[cut] + share[:, None] * (end[cut] - start[cut])
            seen = np.concatenate([seen[seen[:, 2] >= 1e-3], between])
            if len(seen):
                at = seen[:, :2] / seen[:, 2:]
                size = marked.shape[1], marked.shape[0]
                first = np.clip(np.floor(at.min(0) - 1), 0, size).astype(int)
                last = np.clip(np.ceil(at.max(0) + 1), 0, size).astype(int)
                marked[first[1] : last[1], first[0] : last[0]] = 1


_BOX_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4)]
