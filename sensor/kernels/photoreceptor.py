"""The poles of the photoreceptor, advanced exactly over one frame interval."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor.kernels.elementary import inlined, jit

# Limits of a dt. In float64 a pole does not move below the first and does not lag above the second.
# So no cutoff and no light overflows.
MIN_X = 1e-30
MAX_X = 1e16


class Step(NamedTuple):
    """Coefficients of both poles over one frame interval; all 0 without a filter."""

    x: float = 0.0  # a dt
    e: float = 0.0  # exp(-x)
    v1_u0: float = 0.0  # weight of u at the start in v1 at the end, and so on
    v1_u1: float = 0.0
    v2_v1: float = 0.0
    v2_u0: float = 0.0
    v2_u1: float = 0.0


STEP = np.dtype([(name, np.float64) for name in Step._fields])  # dtype of an array of steps


class Response(NamedTuple):
    """Input and output of a block's photoreceptors over one interval, (block,) each."""

    u0: NDArray[np.float64]  # log intensity at the start of the interval
    u1: NDArray[np.float64]  # and at its end
    v1: NDArray[np.float64]  # outputs of the poles at the start
    v2: NDArray[np.float64]
    v1_end: NDArray[np.float64]  # and at the end
    v2_end: NDArray[np.float64]
    poles: float


@jit
def within_float(x):
    """Limit x = a dt to the range in which float64 does not overflow."""
    return min(max(x, MIN_X), MAX_X)


def closed_form(x: float, e: float, phi: float, two: bool) -> Step:
    """Return the `Step` of an interval.

    For the input u0 + s t, with x = a dt, e = exp(-x) and phi = (1 - e) / x, the closed forms
    v1(dt) = u0 + s dt - s/a + A e and v2(dt) = u0 + s dt - 2 s/a + (B + A x) e are linear in the
    state and in u at both ends. With a single pole, v2 has the form of v1.

    Parameters
    ----------
    x, e, phi
        As above.
    two
        Whether there are two poles.

    Returns
    -------
    Step
    """
    if two:
        v2_u1 = 1.0 + e - 2.0 * phi
        return Step(x, e, phi - e, 1.0 - phi, x * e, 1.0 - e - x * e - v2_u1, v2_u1)
    return Step(x, e, phi - e, 1.0 - phi, 0.0, phi - e, 1.0 - phi)


step_of = inlined(closed_form)


def photoreceptor_step(dt_s: float, cutoff_hz: float, poles: int = 2) -> Step:
    """Return the coefficients that advance the poles exactly over one frame interval.

    Parameters
    ----------
    dt_s
        Length of the interval, s.
    cutoff_hz
        Corner frequency of each pole; inf for no filter.
    poles
        1 or 2.

    Returns
    -------
    Step
    """
    if math.isinf(cutoff_hz):
        return Step()
    x = within_float(2.0 * math.pi * float(dt_s) * float(cutoff_hz))
    return closed_form(x, math.exp(-x), -math.expm1(-x) / x, poles == 2)


@jit
def poles_to_end_in_own_light(n, response, light_a, light_0, dt_s, x, e):
    """Advance the poles of n pixels with a cutoff that depends on the light.

    a = light_a (I + I_dark + light_0), constant over an interval: the value at the mean of the log
    intensities at both ends.

    Parameters
    ----------
    n
        Number of pixels.
    response
        `Response`; its `v1_end` and `v2_end` are the output.
    light_a
        a for each unit of light.
    light_0
        Light to add to I + I_dark: 0 if a is proportional to it.
    dt_s
        Length of the interval, s.
    x, e
        (n,) output: a dt and exp(-a dt) of each pixel.
    """
    u0, u1, v1, v2 = response.u0, response.u1, response.v1, response.v2
    v1_end, v2_end = response.v1_end, response.v2_end
    two = response.poles == 2.0
    for i in range(n):
        light = math.exp(0.5 * (u0[i] + u1[i])) + light_0
        xi = within_float(light_a * dt_s * light)
        ei = math.exp(-xi)
        x[i], e[i] = xi, ei
        by = step_of(xi, ei, -math.expm1(-xi) / xi, two)
        v1_end[i] = ei * v1[i] + by.v1_u0 * u0[i] + by.v1_u1 * u1[i]
        if two:
            v2_end[i] = ei * v2[i] + by.v2_v1 * v1[i] + by.v2_u0 * u0[i] + by.v2_u1 * u1[i]
        else:
            v2_end[i] = ei * v2[i] + by.v2_u0 * u0[i] + by.v2_u1 * u1[i]
