"""Logarithm and exponential in forms that vectorize, and how every kernel is compiled."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from llvmlite import ir
from numba.core import types
from numba.core.dispatcher import Dispatcher
from numba.extending import intrinsic

_Kernel = TypeVar("_Kernel", bound=Callable[..., Any])

# Numba keeps what it has compiled until the function's own file changes. A kernel holds the code of
# the kernels that it calls, so here any file of the folder counts.
_FOLDER = hashlib.sha256(
    b"".join(file.read_bytes() for file in sorted(Path(__file__).parent.glob("*.py")))
).hexdigest()


def jit(kernel: _Kernel) -> _Kernel:
    """Compile a kernel; "contract" lets a * b + c become one rounding, nothing else is relaxed."""
    return _of_this_folder(numba.njit(**_OPTIONS)(kernel))


def inlined(kernel: _Kernel) -> _Kernel:
    """As `jit`, for what is called in loops that must become vectors: a call would end them."""
    return _of_this_folder(numba.njit(**_OPTIONS, inline="always")(kernel))


_OPTIONS: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "fastmath": {"contract"},
    "error_model": "numpy",
}


def _of_this_folder(compiled: Any) -> Any:
    if isinstance(compiled, Dispatcher):  # else Numba is told not to compile
        kept: Any = compiled
        index = kept._cache._cache_file
        index._source_stamp = (index._source_stamp, _FOLDER)
    return compiled


@intrinsic
def _bits_of(typingctx, x):
    def codegen(context, builder, signature, args):
        return builder.bitcast(args[0], ir.IntType(64))

    return types.int64(types.float64), codegen


@intrinsic
def _float_of(typingctx, bits):
    def codegen(context, builder, signature, args):
        return builder.bitcast(args[0], ir.DoubleType())

    return types.float64(types.int64), codegen


@jit
def log(x):
    """Natural logarithm of a positive, normal float64, to 1 ulp, in a form that vectorises.

    The reduction and polynomial of FreeBSD's msun e_log.c: x = 2^k (1 + f), sqrt(1/2) <= 1 + f <
    sqrt(2), s = f / (2 + f).
    """
    shifted = _bits_of(x) + (0x3FF0000000000000 - 0x3FE6A09E00000000)
    biased = (shifted >> 52) & 0x7FF
    f = _float_of((shifted & 0xFFFFFFFFFFFFF) + 0x3FE6A09E00000000) - 1.0
    k = _float_of(biased | 0x4330000000000000) - (4503599627370496.0 + 1023.0)
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    odd = w * (
        3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01)
    )
    even = z * (
        6.666666666666735130e-01
        + w
        * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))
    )
    half_square = 0.5 * f * f
    return k * 6.93147180369123816490e-01 - (
        (half_square - (s * (half_square + odd + even) + k * 1.90821492927058770002e-10)) - f
    )


@inlined
def exp_parts(x):
    """(scale, r, tail) with exp(x) = scale (1 + r + tail); beyond |x| = 700, of exp(+-700).

    exp(x) = 2^k exp(r) with k an integer and |r| <= ln(2) / 2; the tail of exp(r), from r^2 / 2 on,
    by its Taylor series. Where |x| < ln(2) / 2, r is x and the scale is 1.
    """
    x = max(min(x, 700.0), -700.0)
    shifted = x * 1.4426950408889634 + 6755399441055744.0  # k in the lowest bits
    k = shifted - 6755399441055744.0
    r = (x - k * 6.93147180369123816490e-01) - k * 1.90821492927058770002e-10
    p = 1.0 / 479001600.0
    p = p * r + 1.0 / 39916800.0
    p = p * r + 1.0 / 3628800.0
    p = p * r + 1.0 / 362880.0
    p = p * r + 1.0 / 40320.0
    p = p * r + 1.0 / 5040.0
    p = p * r + 1.0 / 720.0
    p = p * r + 1.0 / 120.0
    p = p * r + 1.0 / 24.0
    p = p * r + 1.0 / 6.0
    p = p * r + 0.5
    return _float_of(((_bits_of(shifted) + 1023) & 0x7FF) << 52), r, r * r * p


@inlined
def exp(x):
    """exp(x) for |x| <= 700, to 1 ulp or so, in a form that vectorizes; beyond, exp(+-700)."""
    scale, r, tail = exp_parts(x)
    return scale * (1.0 + (r + tail))
