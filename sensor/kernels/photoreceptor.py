"""The photoreceptor's poles, taken exactly over one frame interval."""

from __future__ import annotations

import math

import numpy as np

from sensor.kernels.elementary import jit

# How far a frame interval's step reaches, one row of `step` for each setting and interval.
DT_S, X, E, V1_U0, V1_U1, V2_V1, V2_U0, V2_U1 = range(8)
STEP_SIZE = 8

# A setting's electronics, one row of `electronics` each.
POLES, LEAK_PER_S, NOISE_HZ, NOISE_EXPONENT, LIGHT_A = range(5)
ELECTRONICS_SIZE = 5

# Below the least a dt a pole stands still, above the greatest it lags by nothing: to float64, both
# are exact. No cutoff and no light overflows.
LEAST_X = 1e-30
GREATEST_X = 1e16


@jit
def within_float(x):
    """x = a dt, held where float64 holds what is computed from it."""
    return min(max(x, LEAST_X), GREATEST_X)


def photoreceptor_step(dt_s: float, cutoff_hz: float, poles: int = 2) -> np.ndarray:
    """Coefficients that take the poles exactly over one frame interval.

    For the input u0 + s t, with x = a dt, e = exp(-x) and phi = (1 - e) / x, the closed forms
    v1(dt) = u0 + s dt - s/a + A e and v2(dt) = u0 + s dt - 2 s/a + (B + A x) e are linear in the
    state and in both frames' u. With a single pole, v2 follows v1's form.
    """
    step = np.zeros(STEP_SIZE)
    step[DT_S] = dt_s
    if math.isinf(cutoff_hz):
        return step
    x = within_float(2.0 * math.pi * float(dt_s) * float(cutoff_hz))
    e = math.exp(-x)
    phi = -math.expm1(-x) / x
    step[X], step[E] = x, e
    step[V1_U0], step[V1_U1] = phi - e, 1.0 - phi
    if poles == 1:
        step[V2_U0], step[V2_U1] = step[V1_U0], step[V1_U1]
        return step
    step[V2_V1], step[V2_U1] = x * e, 1.0 + e - 2.0 * phi
    step[V2_U0] = 1.0 - e - x * e - step[V2_U1]
    return step


@jit
def poles_to_end(n, u0, u1, v1, v2, step, v1_end, v2_end):
    """Take the poles over one interval."""
    step_e = step[E]
    v1_u0, v1_u1 = step[V1_U0], step[V1_U1]
    v2_v1, v2_u0, v2_u1 = step[V2_V1], step[V2_U0], step[V2_U1]
    for i in range(n):
        v1_end[i] = step_e * v1[i] + v1_u0 * u0[i] + v1_u1 * u1[i]
        v2_end[i] = step_e * v2[i] + v2_v1 * v1[i] + v2_u0 * u0[i] + v2_u1 * u1[i]


@jit
def poles_to_end_in_own_light(n, u0, u1, v1, v2, dt_s, electronics, v1_end, v2_end, x, e):
    """As `poles_to_end`, for a cutoff proportional to the light: a = LIGHT_A (I + I_dark).

    Over an interval the cutoff is held at that of the middle of its log intensity, which sets each
    pixel's own x and e.
    """
    two = electronics[POLES] == 2.0
    for i in range(n):
        xi = within_float(electronics[LIGHT_A] * dt_s * math.exp(0.5 * (u0[i] + u1[i])))
        ei = math.exp(-xi)
        phi = -math.expm1(-xi) / xi
        x[i] = xi
        e[i] = ei
        v1_end[i] = ei * v1[i] + (phi - ei) * u0[i] + (1.0 - phi) * u1[i]
        if two:
            ramp = 1.0 + ei - 2.0 * phi
            v2_end[i] = (
                ei * v2[i] + xi * ei * v1[i] + (1.0 - ei - xi * ei - ramp) * u0[i] + ramp * u1[i]
            )
        else:
            v2_end[i] = ei * v2[i] + (phi - ei) * u0[i] + (1.0 - phi) * u1[i]
