"""On a machine with an NVIDIA GPU, eres uses it, and gets the same results as elsewhere."""

import json

import numpy as np
import pytest

from another_process import run_python
from eres_render import Renderer, load_scene
from eres_render.rendering.backend import select_variant
from eres_render.rendering.irradiance import irradiance_maps
from eres_render.rendering.lightmaps import lightmaps

pytestmark = pytest.mark.gpu


def test_the_gpu_is_chosen_first():
    assert select_variant() == "cuda_ad_mono"


@pytest.mark.parametrize("integrator", ["baked", "path"])
def test_a_frame_is_that_of_a_machine_without_a_gpu(integrator):
    """Scalar code renders the same carpet, except for the noise of 256 samples per pixel."""
    code = (
        "import sys, json; from eres_render import *;"
        "s = load_scene('carpet');"
        "f = Renderer(s, 16, 256, integrator=sys.argv[1]).frame(s.trajectory().pose(1.0));"
        "print(json.dumps(f.tolist()))"
    )
    run = run_python(code, integrator, timeout_s=300, ERES_VARIANT="scalar_rgb")
    scene = load_scene("carpet")
    here = Renderer(scene, 16, 256, integrator=integrator).frame(scene.trajectory().pose(1.0))
    error = np.log(here) - np.log(np.array(json.loads(run.stdout)))
    assert abs(error.mean()) < 0.01
    assert error.std() < 0.06


def test_the_same_pose_gives_the_identical_frame():
    """Common random numbers need sums in a fixed order, on a GPU too."""
    renderer = Renderer(load_scene("carpet"), 64, 9)
    pose = renderer.trajectory.pose(1.0)
    np.testing.assert_array_equal(renderer.frame(pose), renderer.frame(pose))


def test_light_is_baked_as_elsewhere():
    """The packaged lightmap, baked on a CPU, differs by noise only: 0.6 % expected at 4096 spp."""
    assert select_variant() == "cuda_ad_mono"
    scene = load_scene("carpet")
    again = irradiance_maps(scene, scene.settings.bake.cell_m, spp=4096)["carpet"]
    ratio = again / lightmaps(scene)["carpet"]
    assert abs(ratio.mean() - 1) < 1e-3
    assert ratio.std() < 0.012
