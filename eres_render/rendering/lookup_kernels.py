"""Kernels of `eres_render.rendering.lookup`: the radiance of pixels that can be looked up."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from eres_render.compiling import compiler
from eres_render.rendering.flat_surfaces import Pieces
from eres_render.rendering.visibility_kernels import BLACK, MIXED, box_of, jit, jit_inline, show_row

_BLOCK_PX = 64  # most pixels of a row that share what is worked out in double precision
_MIN_BLOCK_PX = 16
_DEPTH_CHANGE = 0.125  # most change of 1 / z along a larger block, as a share of it
_MIN_DENOMINATOR = 0.05
_SAMPLES = 16  # at a time: a multiple of LLVM's vectors, so that no loop for a rest is needed

# LLVM vectorizes the sum over a pixel's samples only if it may reorder the additions.
_jit_sums = compiler(Path(__file__).parent, fastmath={"contract", "reassoc", "nsz"})


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


@jit
def look_up(first, last, visible, textures, samples, marked, image):
    """Fill in the unmarked pixels of rows [first, last), W m^-2 sr^-1; mark what must be traced."""
    width = image.shape[1]
    pieces = visible.pieces
    shown = np.empty(width, np.int32)
    for row in range(first, last):
        show_row(row, visible.piece_at, marked, shown)
        column = 0
        while column < width:
            g = shown[column]
            if g < 0 or visible.state[g] == MIXED:
                marked[row, column] = 1
                column += 1
                continue
            end = column + 1
            while end < width and shown[end] == g:
                end += 1
            if visible.state[g] == BLACK:
                image[row, column:end] = 0.0
            elif pieces.texture[g] < 0:
                image[row, column:end] = pieces.radiance[g]
            else:
                t = pieces.texture[g]
                step = _block_px(visible.homographies[g, 2], row, column, end)
                for begin in range(column, end, step):
                    stop = min(begin + step, end)
                    # The middle of the block, and its half width and height.
                    block = (0.5 * (begin + stop), row + 0.5, 0.5 * (stop - begin), 0.5)
                    if len(samples.corners):
                        left, right, top, bottom = box_of(
                            samples.corners, row, begin, stop, samples.margin
                        )
                        block = (0.5 * (left + right), 0.5 * (top + bottom),
                                 0.5 * (right - left), 0.5 * (bottom - top))  # fmt: skip
                    _fill(row, begin, stop, block, visible.homographies[g], textures.address[t],
                          textures.size[t], samples, marked, image)  # fmt: skip
            column = end


@jit_inline
def _block_px(per_z, row, first, last):
    """Return how many of the pixels [first, last) may share a block."""
    at = per_z[1] * row + per_z[2]
    nearly = _DEPTH_CHANGE * min(at + per_z[0] * first, at + per_z[0] * last)
    size = _BLOCK_PX
    while size > _MIN_BLOCK_PX and abs(per_z[0]) * size > nearly:
        size //= 2
    return size


@_jit_sums
def _fill(row, first, last, block, h, address, size, samples, marked, image):
    """Fill in pixels [first, last) of a row that show one texture, through its homography `h`.

    At (dx, dy) px from the center of the block the texel is

        (u, v) + (ux dx + uy dy, vx dx + vy dy) / (1 + wx dx + wy dy)

    Single precision is enough for these small steps, but not for what depends on the block.
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
    if least < _MIN_DENOMINATOR:  # seen at so flat an angle that its texels are far apart
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


@jit_inline
def _inside(dx, dy, steps, corner, n_columns):
    """Return the light, times 2^-112, (dx, dy) px from the center of a block inside the texture.

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


@jit_inline
def _texel(dx, dy, steps):
    """Return the texel (dx, dy) px from the center of a block, relative to the base."""
    (u, ux, uy), (v, vx, vy), (one, wx, wy) = steps
    per_z = one / (one + wx * dx + wy * dy)
    return u + (ux * dx + uy * dy) * per_z, v + (vx * dx + vy * dy) * per_z


@jit_inline
def _between(t0, t1, b0, b1, fu, fv):
    """Interpolate bilinearly between four texels, fu to the right and fv downward."""
    t, b = t0 + fu * (t1 - t0), b0 + fu * (b1 - b0)
    return t + fv * (b - t)


@jit_inline
def _left(pair):
    """Return the lower of two half-floats, times 2^-112; none is negative."""
    return _float_of((pair & np.uint32(0xFFFF)) << np.uint32(13))


@jit_inline
def _right(pair):
    """Return the upper of two half-floats, times 2^-112."""
    return _float_of((pair >> np.uint32(16)) << np.uint32(13))
