"""From radiance to log intensity: Eq. (3) and the dark level."""

from __future__ import annotations

import numpy as np

from sensor.kernels.elementary import jit, log


@jit
def integrate_area(
    frame,  # (H, W)
    row_first,  # overlaps of the rows, as `optics.area_weights` gives them
    row_count,
    row_weight,
    col_first,  # and of the columns
    col_count,
    col_weight,
    out,  # (height, width) out
):
    """I = k * E, Eq. (3): the mean over each pixel's area, rows first.

    Returns whether all radiance is finite and at least 0.
    """
    good = True
    height, width = out.shape
    line = np.empty(frame.shape[1])
    for y in range(height):
        line[:] = 0.0
        for j in range(row_count[y]):
            weight = row_weight[y, j]
            source = frame[row_first[y] + j]
            for x in range(line.size):
                good &= (source[x] >= 0.0) & (source[x] < np.inf)
                line[x] += weight * source[x]
        for x in range(width):
            total = 0.0
            for j in range(col_count[x]):
                total += col_weight[x, j] * line[col_first[x] + j]
            out[y, x] = total
    return good


@jit
def log_intensity(
    radiance,  # (n,) linear radiance
    dark,  # I_dark
    u,  # (n,) out
):
    """u = log(I + I_dark). Returns whether all radiance is finite and at least 0."""
    good = True
    for i in range(u.size):
        good &= (radiance[i] >= 0.0) & (radiance[i] < np.inf)
        u[i] = log(radiance[i] + dark)
    return good


@jit
def log_of_flagged(flagged, radiance, dark, light, u):
    """u = log(I + I_dark) of the flagged pixels. Returns whether their radiance is radiance."""
    for k in range(flagged.size):
        light[k] = radiance[flagged[k]]
    return log_intensity(light[: flagged.size], dark, u)
