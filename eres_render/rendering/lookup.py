"""Frames of a baked scene from rays through corners of pixels, not through every sample.

If the four corners of a pixel show the same flat piece and no edge crosses the pixel in front of
it, the pixel shows nothing else. Its samples are then looked up in the piece's texture, at the
positions to which the piece's homography maps them. Mitsuba says what the corners show, and traces
all other pixels. The same holds for a block of pixels, so most corners need no ray either.

Through a lens edges are curved. Then this is done for the pixels of a pinhole with the same camera
matrix, whose image has room for the bent pixels of the lens; and a bent pixel shows one piece if
all the pinhole's pixels that its bounding box touches show it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eres_render.camera import Camera
from eres_render.rendering import visibility_kernels as visible
from eres_render.rendering.flat_surfaces import TRACED, flat_surfaces
from eres_render.rendering.lookup_kernels import Samples, Seen, Textures, look_up

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]

NEAR_M = 1e-3
"""Where the view begins, along the camera's axis; nothing nearer is seen."""

_MAX_ROOM = 4  # pixels of the pinhole for one of the lens
_BANDS_A_THREAD = 8  # of rows: traced pixels cost nothing here, so rows differ in cost
# Costs of looking up, in traced samples: see benchmarks/bench_small_images.py.
_MIN_SAMPLES = 340_000  # of a frame; Dr.Jit's threads wait as long as it takes to trace these
_SAMPLES_A_FRAME = 100_000
_SAMPLES_AN_EDGE = 10
_SAMPLES_A_PIXEL = 3
_SINGLE_PRECISION_PX = 0.01  # samples of bent pixels are not exactly where their corners are

# Pairs of corners of a box, numbered by bits for x, y and z, that an edge of the box joins.
_BOX_EDGES = np.array([(a, b) for a in range(8) for b in range(a + 1, 8) if a ^ b in (1, 2, 4)])


class _ThroughLens(NamedTuple):
    """The pixels of a camera in the image of a pinhole with the same camera matrix."""

    left: int  # pixels of the pinhole left of the camera's column 0, and above its row 0
    top: int
    columns: int  # of the pinhole
    rows: int
    corners: Float64  # (H + 1, W + 1, 2) of the camera's pixels, px of the camera; none: not bent
    margin: float  # how far their sides reach beyond their corners, px


class _View(NamedTuple):
    """How the pieces look from a pose."""

    eye: Float64  # (3,) m
    to_image: Float64  # (3, 3) from directions to (column z, row z, z) of the pinhole
    per_z: Float64  # (G, 3), times (column, row, 1) of the pinhole it is 1 / z
    homographies: Float64  # (G, 3, 3), as `view_pieces` finds them
    state: NDArray[np.int8]  # (G,) BLACK, LIT or MIXED


def _through_lens(camera: Camera) -> _ThroughLens:
    """Return the pixels of a camera as a pinhole sees them."""
    if camera.distortion is None:
        return _ThroughLens(0, 0, camera.width, camera.height, np.empty((0, 0, 2)), 0.0)
    columns, rows = np.meshgrid(np.arange(camera.width + 1.0), np.arange(camera.height + 1.0))
    corners = camera.undistort(np.stack([columns, rows], axis=-1))
    # A curve's distance from its chord is an eighth of the second difference; twice that is safe.
    curved = max(float(abs(np.diff(corners, 2, axis)).max(initial=0.0)) for axis in (0, 1))
    margin = 0.25 * curved + _SINGLE_PRECISION_PX
    low = [math.floor(side) - 1 for side in (corners - margin).min((0, 1))]
    high = [math.ceil(side) + 1 for side in (corners + margin).max((0, 1))]
    return _ThroughLens(-low[0], -low[1], high[0] - low[0], high[1] - low[1], corners, margin)


class LookUp:
    """What a camera sees of a baked scene, where that can be looked up.

    `baked` are ids of the shapes with a texture of radiance. `traced` is the number of pixels of
    the last frame that were traced.
    """

    def __init__(self, mi_scene: Any, baked: Collection[str]) -> None:
        self._mi_scene = mi_scene
        self._surfaces = flat_surfaces(mi_scene, baked)
        pieces = self._surfaces.pieces
        # What no ray meets is one more piece, infinitely far and black, unless there is a sky.
        self._nothing = len(pieces.normal) if mi_scene.environment() is None else TRACED
        textures = self._surfaces.textures
        self._addresses = np.array([texture.ctypes.data for texture in textures], np.uint64)
        self._sizes = np.array([texture.shape for texture in textures], np.int64).reshape(-1, 2)
        self.traced = 0
        self._last_lens: tuple[Camera, _ThroughLens] | None = None

    def pays(self, camera: Camera, spp: int) -> bool:
        """Return whether looking up costs less than tracing every sample."""
        pixels = camera.width * camera.height
        lens = self._through_lens(camera)
        of_pinhole = lens.columns * lens.rows
        # A lens bends the sides of pixels, which a single row or column does not show.
        is_thin = len(lens.corners) > 0 and min(camera.width, camera.height) == 1
        if of_pinhole > _MAX_ROOM * pixels or is_thin or spp * pixels < _MIN_SAMPLES:
            return False
        saved = spp * pixels - _SAMPLES_A_PIXEL * of_pinhole
        return saved >= _SAMPLES_A_FRAME + _SAMPLES_AN_EDGE * len(self._surfaces.edges)

    def frame(
        self,
        camera: Camera,
        T_world_cam: Float64,
        rays: Callable[[Any, Any], Any],
        x: Float32,
        y: Float32,
        trace: Callable[[NDArray[np.intp]], Float32],
        threads: int,
    ) -> Float32:
        """Return the radiance seen from a pose, (H, W), W m^-2 sr^-1.

        `rays` returns Mitsuba's rays through columns and rows of the image, px, without the lens.
        `x` and `y` (H * W * spp,) are the samples' shares of its width and height, as for Mitsuba,
        without the lens. `trace` returns the radiance of pixels `row * W + column`, (N,).
        """
        lens = self._through_lens(camera)
        view = self._view(camera, lens, T_world_cam)
        with ThreadPoolExecutor(threads) as workers:
            piece_at, marked = self._corners(view, lens, rays, workers, threads)
            rows = np.linspace(0, camera.height, threads * _BANDS_A_THREAD + 1).astype(int)
            if len(lens.corners):
                shown = np.empty(marked.shape, np.int32)
                visible.shown_alone(piece_at, marked, shown)
                piece_at = np.empty((camera.height + 1, camera.width + 1), np.int32)
                marked = np.zeros((camera.height, camera.width), np.uint8)
                corner_rows = rows.copy()
                corner_rows[-1] += 1

                def bend_band(band: int) -> None:
                    visible.through_lens(
                        corner_rows[band],
                        corner_rows[band + 1],
                        shown,
                        lens.left,
                        lens.top,
                        lens.corners,
                        lens.margin,
                        piece_at,
                        marked,
                    )

                list(workers.map(bend_band, range(len(rows) - 1)))

            image = np.empty(marked.shape, np.float32)
            corners = Seen(piece_at, view.homographies, view.state, self._surfaces.pieces)
            stretch = camera.fx / camera.fy
            samples = Samples(x, y, stretch, camera.cy, lens.corners, lens.margin)
            textures = Textures(self._addresses, self._sizes)

            def look_up_band(band: int) -> None:
                look_up(rows[band], rows[band + 1], corners, textures, samples, marked, image)

            list(workers.map(look_up_band, range(len(rows) - 1)))
        missing = np.flatnonzero(marked.view(bool))
        self.traced = len(missing)
        if len(missing):
            image.ravel()[missing] = trace(missing)
        return image

    def _view(self, camera: Camera, lens: _ThroughLens, T_world_cam: Float64) -> _View:
        """Return how the pieces look from a pose."""
        surfaces = self._surfaces
        eye = np.ascontiguousarray(T_world_cam[:3, 3])
        R = T_world_cam[:3, :3]
        from_image = np.ascontiguousarray(R @ np.linalg.inv(camera.K))
        homographies = np.zeros((len(surfaces.pieces.normal) + 1, 3, 3))
        state = np.full(len(homographies), visible.BLACK, np.int8)
        visible.view_pieces(eye, from_image, surfaces.pieces, homographies, state)
        visible.view_bent(eye, surfaces.bent, state)
        # Count the pinhole's pixels from its first one.
        to_camera = np.array([[1.0, 0.0, -lens.left], [0.0, 1.0, -lens.top], [0.0, 0.0, 1.0]])
        with np.errstate(invalid="ignore"):  # a piece seen edge-on is at no depth
            per_z = homographies[:, 2] @ to_camera
        to_image = np.linalg.inv(to_camera) @ camera.K @ R.T
        return _View(eye, to_image, per_z, homographies, state)

    def _corners(
        self,
        view: _View,
        lens: _ThroughLens,
        rays: Callable[[Any, Any], Any],
        workers: Executor,
        threads: int,
    ) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
        """Return pieces under the pinhole's pixel corners, and marks where they may be hidden."""

        def mark(piece_at: NDArray[np.int32], block: int, marked: NDArray[np.uint8]) -> None:
            """Mark blocks of pixels in which something may be in front of their piece."""
            in_blocks = np.array([block, block, 1.0])
            to_blocks, per_z = view.to_image / in_blocks[:, None], view.per_z * in_blocks
            self._mark_boxes(to_blocks, view.eye, marked)

            def mark_edges(edges: Float64) -> None:
                visible.mark_edges(edges, view.eye, to_blocks, NEAR_M, piece_at, per_z, marked)

            list(workers.map(mark_edges, np.array_split(self._surfaces.edges, threads)))

        def pinhole_rays(column: Any, row: Any) -> Any:
            return rays(column - lens.left, row - lens.top)

        block = visible.CORNER_BLOCK_PX
        blocks = -(-lens.rows // block), -(-lens.columns // block)
        every = np.arange((blocks[0] + 1) * (blocks[1] + 1), dtype=np.uint32)
        coarse = self._pieces_at(pinhole_rays, every, blocks[1] + 1, block)
        coarse = coarse.reshape(blocks[0] + 1, blocks[1] + 1)
        marked = np.zeros(blocks, np.uint8)
        mark(coarse, block, marked)

        piece_at = np.empty((lens.rows + 1, lens.columns + 1), np.int32)
        settled = np.zeros((lens.rows, lens.columns), np.uint8)
        unknown = np.empty(piece_at.size, np.uint32)
        unknown = unknown[: visible.spread(coarse, marked, piece_at, settled, unknown)]
        if len(unknown):
            piece_at.ravel()[unknown] = self._pieces_at(pinhole_rays, unknown, lens.columns + 1, 1)
        marked = settled.copy()  # nothing is in front of the pixels of these blocks
        mark(piece_at, 1, marked)
        return piece_at, marked ^ settled

    def _through_lens(self, camera: Camera) -> _ThroughLens:
        """Return `_through_lens(camera)`; that of the last camera is kept."""
        if self._last_lens is None or self._last_lens[0] != camera:
            self._last_lens = camera, _through_lens(camera)
        return self._last_lens[1]

    def _pieces_at(
        self,
        rays: Callable[[Any, Any], Any],
        corners: NDArray[np.uint32],
        columns: int,
        step_px: int,
    ) -> NDArray[np.int32]:
        """Return the piece under each of some corners of a grid, numbered row by row."""
        import drjit as dr
        import mitsuba as mi

        corner = mi.UInt32(corners)
        x, y = mi.Float(corner % columns), mi.Float(corner // columns)
        hits = self._mi_scene.ray_intersect_preliminary(
            rays(step_px * x, step_px * y), coherent=True
        )
        shape = np.asarray(dr.reinterpret_array(mi.UInt32, hits.shape))
        triangle = np.asarray(hits.prim_index)
        piece_at = np.empty(len(corners), np.int32)
        first, piece_of = self._surfaces.first_triangle, self._surfaces.piece_of_triangle
        visible.pieces_at(shape, triangle, first, piece_of, self._nothing, piece_at)
        return piece_at

    def _mark_boxes(self, to_image: Float64, eye: Float64, marked: NDArray[np.uint8]) -> None:
        """Mark every pixel in which something that is not a mesh may be seen."""
        for box in self._surfaces.boxes:
            corners = np.stack(np.meshgrid(*box.T, indexing="ij"), -1).reshape(-1, 3)
            projected = (corners - eye) @ to_image.T
            start, end = projected[_BOX_EDGES[:, 0]], projected[_BOX_EDGES[:, 1]]
            cut = (start[:, 2] < NEAR_M) != (end[:, 2] < NEAR_M)
            share = (NEAR_M - start[cut, 2:]) / (end[cut, 2:] - start[cut, 2:])
            between = start[cut] + share * (end[cut] - start[cut])
            projected = np.concatenate([projected[projected[:, 2] >= NEAR_M], between])
            if len(projected):
                at = projected[:, :2] / projected[:, 2:]
                size = marked.shape[::-1]
                left, top = np.clip(np.floor(at.min(0)) - 1, 0, size).astype(int)
                right, bottom = np.clip(np.ceil(at.max(0)) + 1, 0, size).astype(int)
                marked[top:bottom, left:right] = 1
