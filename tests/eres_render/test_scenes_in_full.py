"""The packaged scenes with all their textures, which take long to make."""

import numpy as np
import pytest

from eres_render import Renderer, load_scene
from eres_render.rendering import backend
from light_scenes import assert_looked_up_as_traced

pytestmark = pytest.mark.slow


def test_light_of_the_rocks_that_is_looked_up_is_what_rays_to_every_sample_find():
    """Promise: log radiance within 1e-4 rms along the path; test_scenes.py has the other scenes."""
    assert_looked_up_as_traced(load_scene("rocks"), 1e-4)


@pytest.mark.parametrize(
    ("name", "t_s"),
    [("carpet", (3.3, 7.0)), ("rocks", (3.3, 7.0)), ("room", (1.0, 3.5, 5.5, 7.5))],
)
def test_baked_and_path_traced_views_agree(name, t_s):
    """Log radiance agrees to 40 dB with peak 1, that is to 1 % rms, at 128 px over several poses.

    The test removes the path tracer's own noise: the mean square error is the mean product of the
    errors against two traces of 1024 independent paths per pixel, so their noise has no
    correlation. The rest of it in the mean is 5 % of the limit.
    """
    if backend.select_variant().startswith("scalar"):
        pytest.skip("path tracing so many paths needs a vectorized variant")
    scene = load_scene(name)
    baked = Renderer(scene, 128, 1024, integrator="baked")
    traced = Renderer(scene, 128, 1024, integrator="path")
    squares, means = [], []
    for pose in scene.trajectory().pose(t_s):
        log_baked = np.log(baked.frame(pose).astype(np.float64))
        one, other = (log_baked - np.log(traced.frame(pose, seed=k)) for k in (1, 2))
        squares.append(np.mean(one * other))
        means.append(np.mean(one + other) / 2)
    psnr_db = -10 * np.log10(np.mean(squares))
    print(f"{name}: {psnr_db:.1f} dB")  # for pytest -rP
    assert psnr_db >= 40, squares
    assert abs(np.mean(means)) < 2e-3
