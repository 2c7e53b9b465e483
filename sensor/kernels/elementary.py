"""How kernels are compiled; logarithm and exponential that LLVM vectorizes."""

from __future__ import annotations

from pathlib import Path

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from sensor.compiling import compiler

_FOLDER = Path(__file__).parent

allocating = compiler(_FOLDER, fastmath={"contract"})
"""Compile a kernel that allocates or returns arrays.

"contract" allows fused multiply-add; no other fast math.
"""

# Without counting references to each array of a tuple, which takes long to compile.
jit = compiler(_FOLDER, fastmath={"contract"}, _nrt=False)
"""Compile a kernel that neither allocates nor returns arrays."""

inlined = compiler(_FOLDER, fastmath={"contract"}, _nrt=False, inline="always")
"""Compile a kernel and paste it into its callers: a call in a loop prevents vectorization.

Numba pastes before it infers types, so that LLVM optimizes the code only once.
"""


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
    """Return the natural logarithm of a positive, normal float64, to 1 ulp.

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
    """Return (scale, r, tail) with exp(x) = scale (1 + r + tail); x is limited to +-700.

    exp(x) = 2^k exp(r) with k an integer and |r| <= ln(2) / 2. The tail is the Taylor series of
    exp(r) from r^2 / 2. For |x| < ln(2) / 2, r is x and the scale is 1.
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
    """Return exp(x) to about 1 ulp; x is limited to +-700."""
    scale, r, tail = exp_parts(x)
    return scale * (1.0 + (r + tail))
