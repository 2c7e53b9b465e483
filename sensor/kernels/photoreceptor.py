"""The photoreceptor's poles, taken exactly over one frame interval."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor.kernels.elementary import jit

# Below the least a dt a pole stands still, above the greatest it lags by nothing: to float64, both
# are exact. No cutoff and no light overflows.
LEAST_X = 1e-30
GREATEST_X = 1e16


class Step(NamedTuple):
    """What takes the poles over one frame interval; all 0 where there is no filter."""

    x: float = 0.0  # a dt
    e: float = 0.0  # exp(-x)
    v1_u0: float = 0.0  # share of the first frame's u in v1 at the end, and so on
    v1_u1: float = 0.0
    v2_v1: float = 0.0
    v2_u0: float = 0.0
    v2_u1: float = 0.0


STEP = np.dtype([(name, np.float64) for name in Step._fields])  # of arrays of steps


class Response(NamedTuple):
    """A block's photoreceptors over one interval: what comes in, and what comes out."""

    u0: NDArray[np.float64]  # log intensity at the interval's ends
    u1: NDArray[np.float64]
    v1: NDArray[np.float64]  # outputs of the poles at its start
    v2: NDArray[np.float64]
    v1_end: NDArray[np.float64]  # and at its end
    v2_end: NDArray[np.float64]
    poles: float


@jit
def within_float(x):
    """x = a dt, held where float64 holds what is computed from it."""
    return min(max(x, LEAST_X), GREATEST_X)


def photoreceptor_step(dt_s: float, cutoff_hz: float, poles: int = 2) -> Step:
    """Coefficients that take the poles exactly over one frame interval.

    For the input u0 + s t, with x = a dt, e = exp(-x) and phi = (1 - e) / x, the closed forms
    v1(dt) = u0 + s dt - s/a + A e and v2(dt) = u0 + s dt - 2 s/a + (B + A x) e are linear in the
    state and in both frames' u. With a single pole, v2 follows v1's form.
    """
    if math.isinf(cutoff_hz):
        return Step()
    x = within_float(2.0 * math.pi * float(dt_s) * float(cutoff_hz))
    e = math.exp(-x)
    phi = -math.expm1(-x) / x
    first = x, e, phi - e, 1.0 - phi
    if poles == 1:
        return Step(*first, v2_u0=phi - e, v2_u1=1.0 - phi)
    v2_u1 = 1.0 + e - 2.0 * phi
    return Step(*first, v2_v1=x * e, v2_u0=1.0 - e - x * e - v2_u1, v2_u1=v2_u1)


@jit
def poles_to_end(n, response, step):
    """Take the poles over one interval."""
    u0, u1, v1, v2 = response.u0, response.u1, response.v1, response.v2
    v1_end, v2_end = response.v1_end, response.v2_end
    e, v1_u0, v1_u1 = step.e, step.v1_u0, step.v1_u1
    v2_v1, v2_u0, v2_u1 = step.v2_v1, step.v2_u0, step.v2_u1
    for i in range(n):
        v1_end[i] = e * v1[i] + v1_u0 * u0[i] + v1_u1 * u1[i]
        v2_end[i] = e * v2[i] + v2_v1 * v1[i] + v2_u0 * u0[i] + v2_u1 * u1[i]


@jit
def poles_to_end_in_own_light(n, response, light_a, dt_s, x, e):
    """As `poles_to_end`, for a cutoff proportional to the light: a = light_a (I + I_dark).

    Over an interval the cutoff is held at that of the middle of its log intensity, which sets each
    pixel's own x and e.
    """
    u0, u1, v1, v2 = response.u0, response.u1, response.v1, response.v2
    v1_end, v2_end = response.v1_end, response.v2_end
    two = response.poles == 2.0
    for i in range(n):
        xi = within_float(light_a * dt_s * math.exp(0.5 * (u0[i] + u1[i])))
        ei = math.exp(-xi)
        phi = -math.expm1(-xi) / xi
        x[i], e[i] = xi, ei
        v1_end[i] = ei * v1[i] + (phi - ei) * u0[i] + (1.0 - phi) * u1[i]
        if two:
            ramp = 1.0 + ei - 2.0 * phi
            v2_end[i] = (
                ei * v2[i] + xi * ei * v1[i] + (1.0 - ei - xi * ei - ramp) * u0[i] + ramp * u1[i]
            )
        else:
            v2_end[i] = ei * v2[i] + (phi - ei) * u0[i] + (1.0 - phi) * u1[i]
