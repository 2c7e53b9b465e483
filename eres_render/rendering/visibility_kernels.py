"""Kernels of `eres_render.rendering.lookup`: what pixels show.

Pixels (column, row) cover [column, column + 1) x [row, row + 1). x = (column, row, 1) in the image
is the direction `M x` in the world, with z = 1 along the camera's axis.
"""

from pathlib import Path

import numpy as np

from eres_render.compiling import compiler

CORNER_BLOCK_PX = 4  # side of blocks of pixels whose corners are tried first
UNKNOWN = -2  # in place of a piece
BLACK, LIT, MIXED = 0, 1, -1
_UNSEEN = 2  # state of a bent piece until one of its triangles is looked at

MARGIN = 0.01  # px: a ray in single precision is not where an edge in double precision is
_BEHIND = 1e-4  # share of its depth by which an edge must lie behind a plane to be hidden by it

_FOLDER = Path(__file__).parent
jit = compiler(_FOLDER, fastmath={"contract"})
jit_inline = compiler(_FOLDER, inline="always")


@jit
def view_pieces(eye, M, pieces, homographies, state):
    """Fill in each piece's homography (G, 3, 3) from the image to (texel, texel, 1), and its state.

    The homography's third row times (column, row, 1) is 1 / z, negative where the plane lies behind
    the eye.
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


@jit
def view_bent(eye, bent, state):
    """Fill in whether each piece with shading normals that differ from its own is lit.

    Normal and direction to the eye are weighted means over the vertices, so the sign of their
    product is certain if it is the same for all nine pairs.
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
        shade = LIT if towards == 9 else (BLACK if away == 9 else MIXED)
        g = bent.piece[t]
        state[g] = shade if state[g] == _UNSEEN or state[g] == shade else MIXED


@jit
def pieces_at(shape, triangle, first_triangle, piece_of_triangle, nothing, piece_at):
    """Fill in the piece that each of N rays meets, or -1 if it cannot be looked up.

    `shape` is a number in Mitsuba's registry, 0 without a hit.
    """
    for i in range(len(shape)):
        if shape[i] == 0:
            piece_at[i] = nothing
        elif shape[i] < len(first_triangle) and first_triangle[shape[i]] >= 0:
            piece_at[i] = piece_of_triangle[first_triangle[shape[i]] + triangle[i]]
        else:
            piece_at[i] = -1


@jit
def mark_edges(edges, eye, P, near, piece_at, per_z, marked):
    """Mark every pixel that an edge may cross in front of the piece under the pixel's corners.

    `edges` are (E, 2, 3), m. `P` maps directions to (column z, row z, z). `near` is the least z
    that is seen, m. `piece_at` (H + 1, W + 1) is at pixel corners. `per_z` (G, 3) times (column,
    row, 1) is 1 / z on each piece. Marked pixels cost little.
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
        low, high = min(y0, y0 + dy) - MARGIN, max(y0, y0 + dy) + MARGIN
        if not (high >= 0.0 and low <= height):
            continue
        if not (max(x0, x0 + dx) >= -MARGIN and min(x0, x0 + dx) <= width + MARGIN):
            continue
        first, last = max(int(np.floor(max(low, 0.0))), 0), min(int(min(high, height)), height - 1)
        for row in range(first, last + 1):
            # The share of the edge in this row, then in each of its pixels.
            a, b = _within(y0, dy, row - MARGIN, row + 1.0 + MARGIN, 0.0, 1.0)
            if a > b:
                continue
            left, right = min(x0 + a * dx, x0 + b * dx), max(x0 + a * dx, x0 + b * dx)
            if not (right >= -MARGIN and left <= width + MARGIN):
                continue
            c0 = max(int(np.floor(max(left - MARGIN, 0.0))), 0)
            c1 = min(int(min(right + MARGIN, width)), width - 1)
            for column in range(c0, c1 + 1):
                if marked[row, column]:
                    continue
                g = piece_at[row, column]
                if g < 0:
                    continue
                s, t = _within(x0, dx, column - MARGIN, column + 1.0 + MARGIN, a, b)
                if s > t:
                    continue
                w = per_z[g]
                x, y = x0 + s * dx, y0 + s * dy
                in_front = q0 + s * dq >= (1.0 - _BEHIND) * (w[0] * x + w[1] * y + w[2])
                x, y = x0 + t * dx, y0 + t * dy
                in_front |= q0 + t * dq >= (1.0 - _BEHIND) * (w[0] * x + w[1] * y + w[2])
                if in_front:
                    marked[row, column] = 1


@jit_inline
def _within(start, step, low, high, a, b):
    """Narrow [a, b] to the s for which start + s * step is in [low, high]."""
    if step == 0.0:
        return (a, b) if low <= start <= high else (1.0, 0.0)
    p, q = (low - start) / step, (high - start) / step
    return max(a, min(p, q)), min(b, max(p, q))


@jit
def show_row(row, piece_at, marked, shown):
    """Fill in the only piece that each pixel of a row shows, by its corners and mark; -1: none."""
    above, below, is_marked = piece_at[row], piece_at[row + 1], marked[row]
    for column in range(marked.shape[1]):
        g = above[column]
        others = (above[column + 1] ^ g) | (below[column] ^ g) | (below[column + 1] ^ g)
        shown[column] = g if (g >= 0) & (others == 0) & (is_marked[column] == 0) else -1


@jit
def spread(coarse, marked, piece_at, settled, unknown):
    """Copy the pieces under the corners of blocks of pixels to the corners of their pixels.

    `coarse` (h + 1, w + 1) and `marked` (h, w) are of blocks. `piece_at` (H + 1, W + 1) and
    `settled` (H, W) are filled in where a block shows one piece and nothing else. `unknown` is
    filled in with the other corners, `row * (W + 1) + column`, and their number is returned. They
    come block by block, as rays through neighboring corners are cheaper one after another.
    """
    height, width = piece_at.shape
    blocks = marked.shape[1]
    # Of the row of blocks above, and of this one: the piece, and whether the block is settled.
    room = blocks * CORNER_BLOCK_PX + 1
    above, here = np.full(room, UNKNOWN, np.int32), np.empty(room, np.int32)
    is_settled, shown = np.empty(room, np.uint8), np.empty(blocks, np.int32)
    n = 0
    for top in range(0, height, CORNER_BLOCK_PX):
        here[:] = UNKNOWN
        is_settled[:] = 0
        i = top // CORNER_BLOCK_PX
        if i < marked.shape[0]:
            show_row(i, coarse, marked, shown)
            for j in range(blocks):
                g = shown[j]
                if g >= 0:
                    left = j * CORNER_BLOCK_PX
                    for column in range(CORNER_BLOCK_PX):
                        here[left + column] = g
                        is_settled[left + column] = 1
                    here[left + CORNER_BLOCK_PX] = g
        for column in range(width):
            g = here[column]
            piece_at[top, column] = g if g != UNKNOWN else above[column]
        for row in range(top + 1, min(top + CORNER_BLOCK_PX, height)):
            for column in range(width):
                piece_at[row, column] = here[column]
        for row in range(top, min(top + CORNER_BLOCK_PX, height - 1)):
            for column in range(width - 1):
                settled[row, column] = is_settled[column]
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


@jit
def through_lens(first, last, shown, left, top, corners, margin, piece_at, marked):
    """Find what pixels show through a lens from what a pinhole shows.

    `shown` (h, w) is the only piece that a pixel of the pinhole shows, -1: none. `corners` (H + 1,
    W + 1, 2) are the lens's pixel corners in the pinhole, px, from an origin `left` and `top` px
    inside `shown`. Bent sides of pixels reach `margin` px beyond their corners. `piece_at` (H + 1,
    W + 1) is filled in; `marked` (H, W) is 1 where a pixel may show more than its piece.
    """
    for row in range(first, last):
        for column in range(piece_at.shape[1]):
            x, y = corners[row, column]
            piece_at[row, column] = shown[int(y + top), int(x + left)]
    for row in range(first, min(last, marked.shape[0])):
        for column in range(marked.shape[1]):
            g = piece_at[row, column]
            x_0, x_1, y_0, y_1 = box_of(corners, row, column, column + 1, margin)
            for i in range(int(y_0 + top), int(y_1 + top) + 1):
                for j in range(int(x_0 + left), int(x_1 + left) + 1):
                    if g < 0 or shown[i, j] != g:
                        marked[row, column] = 1


@jit_inline
def box_of(corners, row, first, last, margin):
    """Return left, right, top and bottom of some pixels of a row, bent by a lens."""
    left = right = corners[row, first, 0]
    top = bottom = corners[row, first, 1]
    for i in range(row, row + 2):
        for j in range(first, last + 1):
            left, right = min(left, corners[i, j, 0]), max(right, corners[i, j, 0])
            top, bottom = min(top, corners[i, j, 1]), max(bottom, corners[i, j, 1])
    return left - margin, right + margin, top - margin, bottom + margin


@jit
def shown_alone(piece_at, marked, shown):
    """Fill in the only piece that each of (H, W) pixels shows, as `show_row` does."""
    for row in range(marked.shape[0]):
        show_row(row, piece_at, marked, shown[row])
