"""Path-traced frames: when they are chosen, how noisy they are said to be, and what is warned."""

import logging

import numpy as np
import pytest

from eres_render import Noise, Renderer, RenderError, load_scene, measure_noise, render_scene
from light_scenes import light_evenly, room_folder, small_carpet_folder

LAMP = """<shape type="rectangle" id="lamp">
  <transform name="to_world">
    <scale value="0.5"/><rotate x="1" angle="180"/><translate z="2.9"/>
  </transform>
  <emitter type="area"><rgb name="radiance" value="5"/></emitter>
</shape>
<shape type="sphere" id="mirror">
  <point name="center" value="1.5 1.5 0.5"/><float name="radius" value="0.2"/>
  <bsdf type="conductor"/>
</shape></scene>"""


@pytest.fixture(scope="module")
def shiny_room(tmp_path_factory):
    """The box room with a lamp and a mirror ball: not Lambertian."""
    folder = room_folder(tmp_path_factory.mktemp("scenes") / "shiny", ("</scene>", LAMP))
    for file in folder.glob("lightmap_*.exr"):
        file.unlink()
    return load_scene(folder)


@pytest.fixture(scope="module")
def renderer(shiny_room):
    return Renderer(shiny_room, 48, 16)


def test_light_is_baked_where_it_can_be_and_traced_where_not(renderer, tmp_path):
    assert renderer.integrator == "path"
    folder = small_carpet_folder(tmp_path / "carpet")
    assert Renderer(load_scene(light_evenly(folder, "carpet", 1.0)), 8, 1).integrator == "baked"


def test_measured_noise_is_the_deviation_from_many_samples(renderer):
    """Expected: one frame deviates from the mean of many by the noise said, within 15 %."""
    noise = measure_noise(renderer, 0.5)
    dark = 1e-3 * renderer.white_level
    squares = []
    for t_s in (1.0, 4.0, 7.0):
        pose = renderer.trajectory.pose(t_s)
        frames = [renderer.frame(pose, seed=k).astype(np.float64) for k in range(10, 50)]
        squares.append(
            (np.log(renderer.frame(pose) + dark) - np.log(np.mean(frames, 0) + dark)) ** 2
        )
    assert noise.log_noise == pytest.approx(float(np.sqrt(np.mean(squares))), rel=0.15)
    # With shared random numbers noise changes less from frame to frame than fresh noise would.
    assert noise.log_noise_step < 0.75 * noise.log_noise


def test_false_events_of_a_pixel_at_rest():
    """Expected: none without noise or without change; with fresh noise, as theory has it.

    A resting pixel's memory settles between two levels, u C above and (1 - u) C below the light.
    It goes over from one to the other with p1 = Q((1 - u) C / sigma), and back with
    p2 = Q(u C / sigma): 2 p1 p2 / (p1 + p2) events a frame, averaged over u.
    """
    from scipy.stats import norm

    assert Noise(0.0, 0.0).false_events_per_frame(0.2) == 0
    assert Noise(0.05, 0.0).false_events_per_frame(0.2) == 0
    sigma, c = 0.06, 0.2
    u = np.linspace(0, 1, 2001)[1:-1]
    p1, p2 = norm.sf((1 - u) * c / sigma), norm.sf(u * c / sigma)
    expected = float(np.mean(2 * p1 * p2 / (p1 + p2)))
    found = Noise(sigma, sigma).false_events_per_frame(c, fresh_seeds=True)
    assert found == pytest.approx(expected, rel=0.1)


def test_a_path_traced_render_warns_with_numbers(tmp_path, renderer, shiny_room, caplog):
    with caplog.at_level(logging.INFO):
        render_scene(
            shiny_room,
            tmp_path / "out",
            resolution=16,
            spp=4,
            duration_s=0.02,
            max_displacement_px=1.0,
            continuous=True,
            progress=False,
        )
    said = [record for record in caplog.records if record.name.startswith("eres_render")]
    assert any("shape 'mirror' is not Lambertian" in r.getMessage() for r in said)
    (warning,) = (r.getMessage() for r in said if r.levelno == logging.WARNING)
    assert "path-traced at 4 spp: log noise 0." in warning
    assert "at a contrast threshold of 0.2 a pixel at rest fires about" in warning


def test_another_seed_is_other_noise_and_the_same_seed_the_same(renderer):
    pose = renderer.trajectory.pose(1.0)
    frame = renderer.frame(pose)
    np.testing.assert_array_equal(renderer.frame(pose, seed=0), frame)
    assert not np.array_equal(renderer.frame(pose, seed=1), frame)


def test_a_crop_is_the_middle_of_the_image(renderer):
    crop = renderer.at(crop_px=12)
    assert (crop.camera.width, renderer.camera.width) == (12, 48)
    assert crop.camera.focal_px == pytest.approx(renderer.camera.focal_px)
    assert renderer.at(crop_px=99).camera == renderer.camera
    pose = renderer.trajectory.pose(1.0)
    few, many = crop.at(spp=1024).frame(pose), renderer.at(spp=1024).frame(pose)[18:30, 18:30]
    np.testing.assert_allclose(few, many, rtol=0.1)
    assert crop.image_motion(1.0, 1.01) < renderer.image_motion(1.0, 1.01)


def test_continuous_sequences_have_no_samples(tmp_path, shiny_room):
    with pytest.raises(RenderError, match="samples: found 3, but a continuous sequence has no"):
        render_scene(shiny_room, tmp_path / "x", samples=3, continuous=True)
    assert not (tmp_path / "x").exists()
