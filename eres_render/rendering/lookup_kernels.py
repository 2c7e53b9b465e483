"""Kernels of `eres_render.rendering.lookup`: which pixels can be looked up, and their radiance.

Pixels (column, row) cover [column, column + 1) x [row, row + 1). x = (column, row, 1) in the image
is the direction `M x` in the world, with z = 1 along the camera's axis.
"""

from typing import Any, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from eres_render.rendering.flat_surfaces import Pieces

CORNER_BLOCK_PX = 4  # side of blocks of pixels whose corners are tried first
UNKNOWN = -2  # in place of a piece
BLACK, LIT, MIXED = 0, 1, -1
_UNSEEN = 2  # state of a bent piece until one of its triangles is looked at

_MARGIN = 0.01  # px: a ray in single precision is not where an edge in double precision is
_BLOCK_PX = 64  # most pixels of a row that share what is worked out in double precision
_LEAST_BLOCK_PX = 16
_DEPTH_CHANGE = 0.125  # most change of 1 / z along a larger block, as a share of it
_SAMPLES = 16  # at a time: one vector of LLVM's, or two, and no loop that it would have to finish
_LEAST_DENOMINATOR = 0.05
_BEHIND = 1e-4  # share of its depth by which an edge must lie behind a plane to be hidden by it

# LLVM vectorizes the sum over a pixel's samples only if it may reorder the additions.
_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}
_jit = numba.njit(**_OPTIONS, fastmath={"contract"})
_jit_sums = numba.njit(**_OPTIONS, fastmath={"contract", "reassoc", "nsz"})


def _load(bits):
    def codegen(context, builder, signature, args):
        address = builder.inttoptr(args[0], ir.IntType(16).as_pointer())
        address = builder.gep(address, [builder.sext(args[1], ir.IntType(64))])
        address = builder.bitcast(address, ir.IntType(bits).as_pointer())
        return builder.zext(builder.load(address, align=2), ir.IntType(32))

    return types.uint32(types.uint64, types.int32), codegen


@intrinsic
def _half_at(typingctx, address, index):
    """Return the bits of the half-float at an index of an array, given the array's address."""
    return _load(16)


@intrinsic
def _pair_at(typingctx, address, index):
    """Return the bits of two half-floats, the one at the index in the lower half."""
    return _load(32)


@intrinsic
def _float_of(typingctx, bits):
    def codegen(context, builder, signature, args):
        return builder.bitcast(args[0], ir.FloatType())

    return types.float32(types.uint32), codegen


@_jit
def view_pieces(eye, M, pieces, homographies, state):
    """Find the homography of each piece from the image to (texel, texel, 1), and whether it is lit.

    Its third row times (column, row, 1) is 1 / z, negative where the plane lies behind the eye.

    Parameters
    ----------
    eye
        (3,) position of the camera, m.
    M
        (3, 3) from (column, row, 1) to directions in the world.
    pieces
        G pieces.
    homographies, state
        (G, 3, 3) and (G,), filled in.
    """
    for g in range(len(pieces.normal)):
        n, p = pieces.normal[g], pieces.point[g]
        height = 0.0
        for i in range(3):
            height += n[i] * (p[i] - eye[i])
        for j in range(3):
            w = 0.0
            for i in range(3):
                w += n[i] * M[i, j]
            homographies[g, 2, j] = w / height
        for k in range(2):
            at_eye = pieces.texel[g, k]
            for i in range(3):
                at_eye += pieces.texel_of[g, k, i] * (eye[i] - p[i])
            for j in range(3):
                along = 0.0
                for i in range(3):
                    along += pieces.texel_of[g, k, i] * M[i, j]
                homographies[g, k, j] = at_eye * homographies[g, 2, j] + along
        state[g] = LIT if height < 0.0 else BLACK


@_jit
def view_bent(eye, bent, state):
    """Find whether each piece with shading normals that differ from its own is lit.

    Normal and direction to the eye are both weighted means over the vertices, so the sign of their
    product is certain if it is the same for all nine pairs.

    Parameters
    ----------
    eye
        (3,) position of the camera, m.
    bent
        The triangles of such pieces.
    state
        (G,), filled in for their pieces.
    """
    for t in range(len(bent.piece)):
        state[bent.piece[t]] = _UNSEEN
    for t in range(len(bent.piece)):
        towards = away = 0
        for v in range(3):
            for k in range(3):
                product = 0.0
                for i in range(3):
                    product += bent.normals[t, k, i] * (eye[i] - bent.vertices[t, v, i])
                towards += product > 0.0
                away += product < 0.0
        one = LIT if towards == 9 else (BLACK if away == 9 else MIXED)
        g = bent.piece[t]
        state[g] = one if state[g] == _UNSEEN or state[g] == one else MIXED


@_jit
def pieces_at(shape, triangle, first_triangle, piece_of_triangle, nothing, piece_at):
    """Find the piece that each of N rays meets.

    Parameters
    ----------
    shape, triangle
        (N,) number of the shape in Mitsuba's registry, 0 for none, and of its triangle.
    first_triangle, piece_of_triangle
        As in `FlatSurfaces`.
    nothing
        The piece of rays that meet nothing.
    piece_at
        (N,), filled in; -1 for what cannot be looked up.
    """
    for i in range(len(shape)):
        if shape[i] == 0:
            piece_at[i] = nothing
        elif shape[i] < len(first_triangle) and first_triangle[shape[i]] >= 0:
            piece_at[i] = piece_of_triangle[first_triangle[shape[i]] + triangle[i]]
        else:
            piece_at[i] = -1


@_jit
def mark_edges(edges, eye, P, near, piece_at, per_z, marked):
    """Mark every pixel that an edge may cross in front of the piece under the pixel's corners.

    Parameters
    ----------
    edges
        (E, 2, 3) ends, m.
    eye, P
        (3,) position of the camera, m, and (3, 3) from directions to (column z, row z, z).
    near
        Least z that is seen, m.
    piece_at
        (H + 1, W + 1) piece at the corners of the pixels.
    per_z
        (G, 3), times (column, row, 1) it is 1 / z on each piece.
    marked
        (H, W) uint8, set to 1 at these pixels; pixels that are already marked cost little.
    """
    height, width = marked.shape
    end = np.empty((2, 3))
    for e in range(len(edges)):
        for k in range(2):
            for i in range(3):
                end[k, i] = 0.0
                for j in range(3):
                    end[k, i] += P[i, j] * (edges[e, k, j] - eye[j])
        if max(end[0, 2], end[1, 2]) <= near:
            continue
        for k in range(2):
            if end[k, 2] < near:  # cut where the camera's view begins
                s = (near - end[k, 2]) / (end[1 - k, 2] - end[k, 2])
                for i in range(3):
                    end[k, i] += s * (end[1 - k, i] - end[k, i])
        x0, y0, q0 = end[0, 0] / end[0, 2], end[0, 1] / end[0, 2], 1.0 / end[0, 2]
        dx, dy = end[1, 0] / end[1, 2] - x0, end[1, 1] / end[1, 2] - y0
        dq = 1.0 / end[1, 2] - q0
        low, high = min(y0, y0 + dy) - _MARGIN, max(y0, y0 + dy) + _MARGIN
        if not (high >= 0.0 and low <= height):
            continue
        if not (max(x0, x0 + dx) >= -_MARGIN and min(x0, x0 + dx) <= width + _MARGIN):
            continue
        first, last = max(int(np.floor(max(low, 0.0))), 0), min(int(min(high, height)), height - 1)
        for row in range(first, last + 1):
            # The share of the edge in this row, then in each of its pixels.
            a, b = _within(y0, dy, row - _MARGIN, row + 1.0 + _MARGIN, 0.0, 1.0)
            if a > b:
                continue
            left, right = min(x0 + a * dx, x0 + b * dx), max(x0 + a * dx, x0 + b * dx)
            if not (right >= -_MARGIN and left <= width + _MARGIN):
                continue
            c0 = max(int(np.floor(max(left - _MARGIN, 0.0))), 0)
            c1 = min(int(min(right + _MARGIN, width)), width - 1)
            for column in range(c0, c1 + 1):
                if marked[row, column]:
                    continue
                g = piece_at[row, column]
                if g < 0:
                    continue
                s, t = _within(x0, dx, column - _MARGIN, column + 1.0 + _MARGIN, a, b)
                if s > t:
                    continue
                w = per_z[g]
                x, y = x0 + s * dx, y0 + s * dy
                in_front = q0 + s * dq >= (1.0 - _BEHIND) * (w[0] * x + w[1] * y + w[2])
                x, y = x0 + t * dx, y0 + t * dy
                in_front |= q0 + t * dq >= (1.0 - _BEHIND) * (w[0] * x + w[1] * y + w[2])
                if in_front:
                    marked[row, column] = 1


@numba.njit(**_OPTIONS, inline="always")
def _within(start, step, low, high, a, b):
    """Narrow [a, b] to the s for which start + s * step is in [low, high]."""
    if step == 0.0:
        return (a, b) if low <= start <= high else (1.0, 0.0)
    p, q = (low - start) / step, (high - start) / step
    return max(a, min(p, q)), min(b, max(p, q))


@numba.njit(**_OPTIONS, inline="always")
def _shows(piece, row, column, piece_at, marked):
    """Return whether a pixel shows one piece and nothing else."""
    return (
        piece >= 0
        and not marked[row, column]
        and piece_at[row, column] == piece
        and piece_at[row, column + 1] == piece
        and piece_at[row + 1, column] == piece
        and piece_at[row + 1, column + 1] == piece
    )


@_jit
def spread(coarse, marked, piece_at, settled, unknown):
    """Copy the pieces under the corners of blocks of pixels to the corners of their pixels.

    Parameters
    ----------
    coarse
        (h + 1, w + 1) piece at the corners of the blocks, which are squares of `CORNER_BLOCK_PX`.
    marked
        (h, w) uint8, whether an edge may cross a block in front of its piece.
    piece_at
        (H + 1, W + 1) piece at the corners of the pixels, filled in where a block shows one piece
        and nothing else.
    settled
        (H, W) uint8, whether a pixel is in such a block.
    unknown
        ((H + 1) * (W + 1),), filled in with the other corners, `row * (W + 1) + column`, block by
        block: rays through neighbors cost less in turn.

    Returns
    -------
    int
        Number of other corners.
    """
    height, width = piece_at.shape
    blocks = marked.shape[1]
    # Of the row of blocks above, and of this one: the piece, and whether the block is settled.
    room = blocks * CORNER_BLOCK_PX + 1
    above, here = np.full(room, UNKNOWN, np.int32), np.empty(room, np.int32)
    is_settled = np.empty(room, np.uint8)
    n = 0
    for top in range(0, height, CORNER_BLOCK_PX):
        here[:] = UNKNOWN
        is_settled[:] = 0
        i = top // CORNER_BLOCK_PX
        if i < marked.shape[0]:
            for j in range(blocks):
                g = coarse[i, j]
                if _shows(g, i, j, coarse, marked):
                    left = j * CORNER_BLOCK_PX
                    for column in range(CORNER_BLOCK_PX):
                        here[left + column] = g
                        is_settled[left + column] = 1
                    here[left + CORNER_BLOCK_PX] = g
        for column in range(width):
            g = here[column]
            piece_at[top, column] = g if g != UNKNOWN else above[column]
        for row in range(top + 1, min(top + CORNER_BLOCK_PX, height)):
            piece_at[row] = here[:width]
        for row in range(top, min(top + CORNER_BLOCK_PX, height - 1)):
            settled[row] = is_settled[: width - 1]
        for left in range(0, width, CORNER_BLOCK_PX):
            if is_settled[left]:
                continue
            for row in range(top, min(top + CORNER_BLOCK_PX, height)):
                for column in range(left, min(left + CORNER_BLOCK_PX, width)):
                    if piece_at[row, column] == UNKNOWN:
                        unknown[n] = row * width + column
                        n += 1
        above, here = here, above
    return n


@_jit
def through_lens(shown, left, top, corners, margin, piece_at, marked):
    """Find what pixels show through a lens from what a pinhole shows.

    Parameters
    ----------
    shown
        (h, w) piece that a pixel of the pinhole shows and nothing else, -1: none.
    left, top
        Pixels of the pinhole left of and above the origin of the corners.
    corners
        (H + 1, W + 1, 2) where the pinhole shows the corners of the lens's pixels, px.
    margin
        How far the bent sides of pixels reach beyond their corners, px.
    piece_at
        (H + 1, W + 1), filled in at the corners of the lens's pixels.
    marked
        (H, W) uint8, set to 1 at pixels that may show more than the piece at their corners.
    """
    for row in range(piece_at.shape[0]):
        for column in range(piece_at.shape[1]):
            x, y = corners[row, column]
            piece_at[row, column] = shown[int(y + top), int(x + left)]
    for row in range(marked.shape[0]):
        for column in range(marked.shape[1]):
            g = piece_at[row, column]
            x_0, x_1, y_0, y_1 = _box(corners, row, column, column + 1, margin)
            for i in range(int(y_0 + top), int(y_1 + top) + 1):
                for j in range(int(x_0 + left), int(x_1 + left) + 1):
                    if g < 0 or shown[i, j] != g:
                        marked[row, column] = 1


@numba.njit(**_OPTIONS, inline="always")
def _box(corners, row, first, last, margin):
    """Return left, right, top and bottom of pixels [first, last) of a row, bent by a lens."""
    left = right = corners[row, first, 0]
    top = bottom = corners[row, first, 1]
    for i in range(row, row + 2):
        for j in range(first, last + 1):
            left, right = min(left, corners[i, j, 0]), max(right, corners[i, j, 0])
            top, bottom = min(top, corners[i, j, 1]), max(bottom, corners[i, j, 1])
    return left - margin, right + margin, top - margin, bottom + margin


@_jit
def shown_alone(piece_at, marked, shown):
    """Find the piece that each of (H, W) pixels shows and nothing else; -1: none.

    Parameters
    ----------
    piece_at
        (H + 1, W + 1) piece at the corners of the pixels.
    marked
        (H, W) uint8, whether something may be in front of it.
    shown
        (H, W), filled in.
    """
    for row in range(marked.shape[0]):
        for column in range(marked.shape[1]):
            g = piece_at[row, column]
            shown[row, column] = g if _shows(g, row, column, piece_at, marked) else -1


class Seen(NamedTuple):
    """What the corners of pixels show."""

    piece_at: NDArray[np.int32]  # (H + 1, W + 1), negative: cannot be looked up
    homographies: NDArray[np.float64]  # (G, 3, 3), as `view_pieces` finds them
    state: NDArray[np.int8]  # (G,) BLACK, LIT or MIXED
    pieces: Pieces


class Textures(NamedTuple):
    """Where textures are in memory."""

    address: NDArray[np.uint64]  # (N,) of half-floats
    size: NDArray[np.int64]  # (N, 2) rows and columns


class Samples(NamedTuple):
    """Where Mitsuba's camera, whose pixels are square, takes samples."""

    x: NDArray[np.float32]  # (H * W * spp,) shares of the image's width
    y: NDArray[np.float32]  # of its height, stretched by `stretch` about row `cy`
    stretch: float  # fx / fy
    cy: float  # px
    corners: NDArray[np.float64]  # (H + 1, W + 1, 2) of bent pixels, px; none without a lens
    margin: float  # px, as in `through_lens`


@_jit
def look_up(first, last, seen, textures, samples, marked, image):
    """Fill in the pixels of rows [first, last) that can be looked up; mark those that cannot.

    Parameters
    ----------
    first, last
        The rows.
    seen, textures, samples
        What the corners show, where textures are, and where samples are taken.
    marked
        (H, W) uint8; pixels that are already marked are skipped.
    image
        (H, W) float32, W m^-2 sr^-1, filled in.
    """
    width = image.shape[1]
    pieces = seen.pieces
    for row in range(first, last):
        column = 0
        while column < width:
            g = seen.piece_at[row, column]
            if not _shows(g, row, column, seen.piece_at, marked) or seen.state[g] == MIXED:
                marked[row, column] = 1
                column += 1
                continue
            end = column + 1
            while end < width and _shows(g, row, end, seen.piece_at, marked):
                end += 1
            if seen.state[g] == BLACK:
                image[row, column:end] = 0.0
            elif pieces.texture[g] < 0:
                image[row, column:end] = pieces.radiance[g]
            else:
                t = pieces.texture[g]
                step = _block_px(seen.homographies[g, 2], row, column, end)
                for begin in range(column, end, step):
                    stop = min(begin + step, end)
                    # The middle of the block, and its half width and height.
                    block = (0.5 * (begin + stop), row + 0.5, 0.5 * (stop - begin), 0.5)
                    if len(samples.corners):
                        left, right, top, bottom = _box(
                            samples.corners, row, begin, stop, samples.margin
                        )
                        block = (0.5 * (left + right), 0.5 * (top + bottom),
                                 0.5 * (right - left), 0.5 * (bottom - top))  # fmt: skip
                    _fill(row, begin, stop, block, seen.homographies[g], textures.address[t],
                          textures.size[t], samples, marked, image)  # fmt: skip
            column = end


@numba.njit(**_OPTIONS, inline="always")
def _block_px(per_z, row, first, last):
    """Return how many of the pixels [first, last) may share a block."""
    at = per_z[1] * row + per_z[2]
    nearly = _DEPTH_CHANGE * min(at + per_z[0] * first, at + per_z[0] * last)
    size = _BLOCK_PX
    while size > _LEAST_BLOCK_PX and abs(per_z[0]) * size > nearly:
        size //= 2
    return size


@_jit_sums
def _fill(row, first, last, block, h, address, size, samples, marked, image):
    """Fill in pixels [first, last) of a row that show one texture, through its homography `h`.

    At (dx, dy) px from the center of the block the texel is

        (u, v) + (ux dx + uy dy, vx dx + vy dy) / (1 + wx dx + wy dy)

    What depends on the block is in double precision; single precision is enough for the small steps
    from there.
    """
    height, width = image.shape
    x, y = samples.x, samples.y
    spp = np.uint64(len(x) // (height * width))
    cx, cy, half_width, half_height = block
    w = 1.0 / (h[2, 0] * cx + h[2, 1] * cy + h[2, 2])
    u = (h[0, 0] * cx + h[0, 1] * cy + h[0, 2]) * w
    v = (h[1, 0] * cx + h[1, 1] * cy + h[1, 2]) * w
    ux, uy = (h[0, 0] - u * h[2, 0]) * w, (h[0, 1] - u * h[2, 1]) * w
    vx, vy = (h[1, 0] - v * h[2, 0]) * w, (h[1, 1] - v * h[2, 1]) * w
    wx, wy = h[2, 0] * w, h[2, 1] * w
    least = 1.0 - abs(wx) * half_width - abs(wy) * half_height  # of the denominator
    if least < _LEAST_DENOMINATOR:  # seen at so flat an angle that its texels are far apart
        marked[row, first:last] = 1
        return
    # All samples lie right of and below the base, so that truncation rounds down.
    u_reach = (abs(ux) * half_width + abs(uy) * half_height) / least + 1.0
    v_reach = (abs(vx) * half_width + abs(vy) * half_height) / least + 1.0
    u_base, v_base = np.floor(u - u_reach), np.floor(v - v_reach)
    last_row, n_columns = np.int32(size[0] - 1), np.int32(size[1])
    last_column = np.int32(n_columns - 1)
    inside = u_base >= 0.0 and u + u_reach < last_column
    inside &= v_base >= 0.0 and v + v_reach < last_row
    steps = (
        (np.float32(u - u_base), np.float32(ux), np.float32(uy)),
        (np.float32(v - v_base), np.float32(vx), np.float32(vy)),
        (np.float32(1.0), np.float32(wx), np.float32(wy)),
    )
    to_columns, to_rows = np.float32(width), np.float32(height / samples.stretch)
    fcx = np.float32(cx)
    fcy = np.float32(cy - samples.cy * (1.0 - 1.0 / samples.stretch))
    scale = np.float32(_HALF_TO_FLOAT) / np.float32(spp)
    if inside:  # no clamping, and two texels a load
        corner = address + np.uint64(2) * (
            np.uint64(v_base) * np.uint64(n_columns) + np.uint64(u_base)
        )
        for column in range(first, last):
            start = np.uint64(row * width + column) * spp
            total = np.float32(0.0)
            done = np.uint64(0)
            while done + np.uint64(_SAMPLES) <= spp:
                for k in range(_SAMPLES):
                    s = start + done + np.uint64(k)
                    dx, dy = x[s] * to_columns - fcx, y[s] * to_rows - fcy
                    total += _inside(dx, dy, steps, corner, n_columns)
                done += np.uint64(_SAMPLES)
            for k in range(done, spp):
                s = start + np.uint64(k)
                dx, dy = x[s] * to_columns - fcx, y[s] * to_rows - fcy
                total += _inside(dx, dy, steps, corner, n_columns)
            image[row, column] = total * scale
        return
    iu_base, iv_base = np.int32(u_base), np.int32(v_base)
    for column in range(first, last):
        start = np.uint64(row * width + column) * spp
        total = np.float32(0.0)
        for k in range(spp):
            s = start + np.uint64(k)
            tu, tv = _texel(x[s] * to_columns - fcx, y[s] * to_rows - fcy, steps)
            iu, iv = np.int32(tu), np.int32(tv)
            fu, fv = tu - np.float32(iu), tv - np.float32(iv)
            c0 = min(max(iu_base + iu, 0), last_column)
            c1 = min(max(iu_base + iu + 1, 0), last_column)
            r0 = min(max(iv_base + iv, 0), last_row) * n_columns
            r1 = min(max(iv_base + iv + 1, 0), last_row) * n_columns
            t0, t1 = _left(_half_at(address, r0 + c0)), _left(_half_at(address, r0 + c1))
            b0, b1 = _left(_half_at(address, r1 + c0)), _left(_half_at(address, r1 + c1))
            total += _between(t0, t1, b0, b1, fu, fv)
        image[row, column] = total * scale


@numba.njit(**_OPTIONS, inline="always")
def _inside(dx, dy, steps, corner, n_columns):
    """Return the light (dx, dy) px from the center of a block whose texels all exist, times 2^-112.

    The address of the base's texel is `corner`.
    """
    tu, tv = _texel(dx, dy, steps)
    iu, iv = np.int32(tu), np.int32(tv)
    at = np.int32(iv * n_columns + iu)
    top, bottom = _pair_at(corner, at), _pair_at(corner, np.int32(at + n_columns))
    t0, t1 = _left(top), _right(top)
    b0, b1 = _left(bottom), _right(bottom)
    return _between(t0, t1, b0, b1, tu - np.float32(iu), tv - np.float32(iv))


_HALF_TO_FLOAT = 2.0**112  # the difference between the exponents' biases


@numba.njit(**_OPTIONS, inline="always")
def _texel(dx, dy, steps):
    """Return the texel (dx, dy) px from the center of a block, relative to the base."""
    (u, ux, uy), (v, vx, vy), (one, wx, wy) = steps
    per_z = one / (one + wx * dx + wy * dy)
    return u + (ux * dx + uy * dy) * per_z, v + (vx * dx + vy * dy) * per_z


@numba.njit(**_OPTIONS, inline="always")
def _between(t0, t1, b0, b1, fu, fv):
    """Interpolate bilinearly between four texels, fu to the right and fv downward."""
    t, b = t0 + fu * (t1 - t0), b0 + fu * (b1 - b0)
    return t + fv * (b - t)


@numba.njit(**_OPTIONS, inline="always")
def _left(pair):
    """Return the lower of two half-floats, times 2^-112; none is negative."""
    return _float_of((pair & np.uint32(0xFFFF)) << np.uint32(13))


@numba.njit(**_OPTIONS, inline="always")
def _right(pair):
    """Return the upper of two half-floats, times 2^-112."""
    return _float_of((pair >> np.uint32(16)) << np.uint32(13))
