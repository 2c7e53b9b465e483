"""Light on a relief: shadows, against rays marched one by one and in closed form."""

import math

import numpy as np
import pytest

from eres_render.textures.fractal_noise import fractal_noise
from eres_render.textures.relief import lit, log_light


def in_shadow(relief, x, y, z):
    """Return whether anything stands between each texel and the lamp: a ray for each texel."""
    steps = max(abs(x), abs(y))
    dx, dy, dz = x / steps, y / steps, z / steps
    rows, columns = relief.shape
    found = np.zeros(relief.shape, bool)
    for i, k in np.ndindex(relief.shape):
        for n in range(1, rows + columns):
            u, v = k + n * dx, i + n * dy
            if not (0 <= u <= columns - 1 and 0 <= v <= rows - 1):
                break
            left, top = min(int(u), columns - 2), min(int(v), rows - 2)
            a, b = u - left, v - top
            (p, q), (r, s) = relief[top : top + 2, left : left + 2]
            height = (1 - b) * ((1 - a) * p + a * q) + b * ((1 - a) * r + a * s)
            if height > relief[i, k] + n * dz:
                found[i, k] = True
                break
    return found


@pytest.mark.parametrize(
    ("towards", "share"),
    [
        ((0.0, -1.0, 0.6), 1.0),  # along the rows and the diagonals both are exact
        ((1.0, 0.0, 0.6), 1.0),
        ((-1.0, 1.0, 0.8), 1.0),
        ((-0.6, -0.75, 0.6), 0.97),  # between them the sweep blends neighbors at every step
        ((0.8, 0.3, 0.5), 0.97),
    ],
)
def test_shadows_are_those_of_rays_marched_one_by_one(towards, share):
    relief = 6 * fractal_noise((40, 48), 16, 4, np.random.default_rng(1))
    inner = np.s_[8:-8, 8:-8]  # at a side the sweep extends the relief
    seen = lit(relief, *towards)[inner]
    truth = in_shadow(relief, *towards)[inner]
    assert 0.1 < truth.mean() < 0.7
    clear = (seen == 0) | (seen == 1)  # the others are penumbra, a texel wide
    assert clear.mean() > 0.8
    assert np.mean((seen == 0)[clear] == truth[clear]) >= share


@pytest.mark.parametrize("elevation_deg", [20.0, 35.0, 60.0])
@pytest.mark.parametrize(("x", "y"), [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_a_wall_casts_a_shadow_of_its_height_over_the_tangent(x, y, elevation_deg):
    relief = np.zeros((200, 200), np.float32)
    relief[100:102, 100:102] = height = 24.0
    level = math.radians(elevation_deg)
    seen = lit(relief, x * math.cos(level), y * math.cos(level), math.sin(level))
    away = seen[100, :] if x else seen[:, 100]
    away = away[101:] if x + y < 0 else away[100::-1]
    soft = 0.5 / math.tan(level)  # half of the edge, where the shadow is less than a texel deep
    assert (1 - away).sum() == pytest.approx(height / math.tan(level) - soft, abs=1.0)
    assert np.sum(1 - seen) == pytest.approx(2 * np.sum(1 - away), rel=1e-3)  # nowhere else


def test_level_ground_gets_one_and_a_stone_is_darker_away_from_the_sun():
    y, x = np.mgrid[-40:41, -40:41].astype(np.float32)
    dome = np.sqrt(np.maximum(15.0**2 - x**2 - y**2, 0))
    sun = (-0.6, -0.75, 0.6)
    light = np.exp(log_light(dome, sun, 0.45, least=0.0))
    np.testing.assert_allclose(np.exp(log_light(0 * dome, sun, 0.45, least=0.0)), 1.0, rtol=1e-5)
    towards, away = light[40 - 14, 40 - 11], light[40 + 14, 40 + 11]  # on the ground at its foot
    assert away < 0.45 < towards  # all of the sun and part of the sky are hidden
