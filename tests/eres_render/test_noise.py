"""Path-traced frames: when eres uses them, their noise, and the warnings."""

import json
import logging
from pathlib import Path

import numpy as np
import pytest

from another_process import run_python
from benchmark_files import benchmark
from eres_render import (
    Clip,
    Noise,
    Renderer,
    RenderError,
    clips,
    continuous_stretch,
    load_scene,
    measure_noise,
    render_scene,
)
from eres_render.rendering import backend
from eres_render.sequence.monte_carlo_noise import count_events
from light_scenes import light_evenly, room_folder, small_carpet_folder
from sensor import SensorModel, simulate
from tasks.study.config import Evaluate, Flow, Render, Simulate, Study
from tasks.study.run import run_study

ROOT = Path(__file__).parents[2]
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


def test_events_are_counted_as_the_sensor_counts_them():
    """Each of eight renders of 200 pixels over 40 frames of a random walk fires exactly the
    expected events. So does their mean."""
    rng = np.random.default_rng(3)
    steps = 0.15 * rng.standard_normal((40, 8, 200))
    frames = np.exp(np.cumsum(steps, axis=0)).astype(np.float32)
    dark, t_s = 0.01, np.linspace(0, 1, 40)

    def fired(radiance):  # (40, rows, 200)
        rows = radiance.shape[1]
        events = simulate(radiance, t_s, SensorModel(width=200, height=rows, dark_level=dark))
        counts = np.zeros((rows, 200))
        np.add.at(counts, (events.y, events.x), 1)
        return counts

    each, of_mean, _ = count_events(frames, dark, 0.2)
    assert each.sum() > 1000
    np.testing.assert_allclose(8 * each, fired(frames).sum(axis=0))
    mean = frames.astype(np.float64).mean(axis=1, keepdims=True)
    np.testing.assert_array_equal(of_mean, fired(mean)[0])


def test_noise_that_stays_makes_no_events_and_noise_that_flickers_does():
    """Physics: a pixel fires at changes, and the log variance is that of the input.

    Light rises by one unit of log, 5 events at C = 0.2. Noise that a render keeps from frame to
    frame adds none. One of 64 renders that also jumps up or down by 0.5 at each of 20 frames fires
    2 or 3 times at each jump, depending on its memory; the mean hardly moves.
    """
    noise = 0.1 * np.random.default_rng(0).standard_normal((64, 500))
    rise = np.linspace(0, 1.001, 21)[:, None, None]
    each, of_mean, variances = count_events(np.exp(rise + noise), 0.0, 0.2)
    assert set(of_mean) == {5}
    np.testing.assert_array_equal(each, 5)
    np.testing.assert_allclose(variances, [0.01, 0.01 / 16], rtol=0.1)

    flicker = np.zeros((21, 64, 1))
    flicker[1::2, 7] = 0.5
    each, of_mean, _ = count_events(np.exp(flicker), 0.0, 0.2)
    assert of_mean == 0
    assert each == 20 * 2 / 64


def test_repeats_are_frames_with_noise_of_their_own(renderer):
    """Expected: the mean of many frames equals a frame of many samples; independent noise averages
    out.

    The random numbers do not change between poses, so the same pose gives the same frame.
    """
    pose, many = renderer.trajectory.pose(1.0), 256
    pixels = np.random.default_rng(1).choice(48 * 48, 40, replace=False)
    radiance = renderer.repeats(pose, pixels, many)
    assert radiance.shape == (many, 40)
    np.testing.assert_array_equal(renderer.repeats(pose, pixels, many), radiance)
    frame = renderer.at(spp=256).frame(pose).ravel()[pixels]
    assert np.median(abs(radiance.mean(axis=0) / frame - 1)) < 0.02
    one, of_16 = (np.var(r, axis=0, ddof=1) for r in (radiance, means_of(radiance, 16)))
    assert np.mean(of_16 / one) == pytest.approx(1 / 16, rel=0.3)
    same = np.corrcoef(renderer.repeats(pose, np.full(40, pixels[0]), many).T)
    assert abs(same[np.triu_indices(40, 1)]).mean() < 0.1


def means_of(radiance, count):
    return radiance.reshape(-1, count, radiance.shape[-1]).mean(axis=1)


@pytest.mark.slow
def test_repeats_are_the_same_light_by_scalar_code(renderer, shiny_room):
    code = (
        "import sys, json; import numpy as np; from eres_render import *;"
        "r = Renderer(load_scene(sys.argv[1]), 48, 16);"
        "pixels = np.array([100, 1176, 2000]);"
        "print(json.dumps(r.repeats(r.trajectory.pose(1.0), pixels, 256).tolist()))"
    )
    run = run_python(code, shiny_room.folder, ERES_VARIANT="scalar_rgb")
    scalar = np.array(json.loads(run.stdout))
    here = renderer.repeats(renderer.trajectory.pose(1.0), np.array([100, 1176, 2000]), 256)
    np.testing.assert_allclose(scalar.mean(axis=0), here.mean(axis=0), rtol=0.04)
    # 256 repeats give a standard deviation to 4 % of itself, for noise that is normal.
    np.testing.assert_allclose(scalar.std(axis=0), here.std(axis=0), rtol=0.4)


@pytest.mark.slow
def test_measured_noise_is_the_deviation_from_many_samples(renderer):
    """Expected: the deviation of a frame from the mean of many is the estimated noise, within 15
    %."""
    stretches = [Clip(k, t_s, t_s, t_s + 0.01) for k, t_s in enumerate((1.0, 4.0, 7.0))]
    noise = measure_noise(renderer, stretches, 0.5)
    dark = 1e-3 * renderer.white_level
    squares = []
    for clip in stretches:
        pose = renderer.trajectory.pose(clip.t_start_s)
        frames = [renderer.frame(pose, seed=k).astype(np.float64) for k in range(10, 30)]
        squares.append(
            (np.log(renderer.frame(pose) + dark) - np.log(np.mean(frames, 0) + dark)) ** 2
        )
    assert noise.log_noise == pytest.approx(float(np.sqrt(np.mean(squares))), rel=0.15)
    assert noise.events_hz > noise.false_events_hz > 3 * noise.false_events_error_hz
    assert noise.log_noise_of_quarter == pytest.approx(0.25 * noise.log_noise, rel=0.4)


def test_light_of_rare_paths_has_no_figure_of_false_events():
    """A small lamp in a mirror ball: few paths find it, and those are bright.

    Each of 16 samples finds 1001 instead of 1 with a probability of 1/1000: most renders miss it,
    so their mean varies as much.
    """
    rng = np.random.default_rng(0)
    frames = 1 + 1000 * rng.binomial(16, 1 / 1000, (30, 64, 400)) / 16
    _, _, variances = count_events(frames, 1e-3, 0.2)
    one, quarter = np.sqrt(variances)
    rare = Noise(one, 0.2, 5.0, -2.0, 0.5, quarter)
    assert not rare.averages_out
    assert "7 with 64 times the samples: how many are false is unknown" in rare.describe()
    even = Noise(one, 0.2, 5.0, 2.0, 0.5, one / 4)
    assert even.averages_out
    assert "5 events per second, of which 2 ± 0.5 are false" in even.describe()


@pytest.mark.parametrize(("width", "samples"), [(48, 3), (320, 19)])
def test_measuring_costs_a_twentieth_of_the_render_or_seconds(shiny_room, width, samples):
    """Counted in samples: seconds for three clips of 48 px, a twentieth of 19 clips of 320 px."""
    renderer = Renderer(shiny_room, width, 16)
    renderer.white_level = 1.0
    taken = []

    def count(pose, pixels, repeats, *, t_s):
        taken.append(len(pixels) * repeats * renderer.spp)
        return np.ones((repeats, len(pixels)))

    renderer.repeats = count
    wanted = clips(shiny_room, samples=samples)
    measure_noise(renderer, wanted, 1.0)
    stretches = min(4, samples)
    render = len(taken) / stretches * samples * width**2 * renderer.spp
    seconds_worth = 1_000_000 if renderer.variant.startswith("scalar") else 8_000_000
    assert (0.05 * render > seconds_worth) == (width == 320)
    assert 0.01 * render < sum(taken) <= max(0.05 * render, seconds_worth)


def test_clips_of_any_length_are_measured(renderer):
    """Promise: a clip of a microsecond has a stretch as well; none at all, and a threshold of 0,
    are errors."""
    short = Clip(0, 1.0, 1.0, 1.000001)
    assert measure_noise(renderer.at(spp=1), [short], 0.5).log_noise > 0
    with pytest.raises(RenderError, match="clips: found none, expected at least one"):
        measure_noise(renderer, [], 0.5)
    with pytest.raises(RenderError, match="contrast_threshold: found 0, expected a positive"):
        measure_noise(renderer, [short], 0.5, contrast_threshold=0)


@pytest.mark.slow
def test_light_without_noise_has_no_false_events(tmp_path):
    """A closed box that glows evenly and reflects nothing looks the same in every direction."""
    folder = room_folder(tmp_path / "glow")
    text = (folder / "scene.xml").read_text()
    glow = '<emitter type="area"><rgb name="radiance" value="0.7"/></emitter></shape>'
    for digit in range(2, 10):
        text = text.replace(f'value="0.{digit}"/></bsdf>', 'value="0"/></bsdf>')
    (folder / "scene.xml").write_text(text.replace("</shape>", glow))
    renderer = Renderer(load_scene(folder), 8, 4, integrator="path")
    noise = measure_noise(renderer, [continuous_stretch(renderer.scene, 0.3)], 0.5)
    assert noise.log_noise < 1e-6
    assert (noise.events_hz, noise.false_events_hz, noise.false_events_error_hz) == (0, 0, 0)


def test_a_path_traced_render_warns_with_numbers(tmp_path, shiny_room, caplog):
    with caplog.at_level(logging.INFO):
        render_scene(
            shiny_room,
            tmp_path / "out",
            resolution=16,
            spp=4,
            duration_s=0.02,
            max_displacement_px=1.0,
            continuous=True,
        )
    said = [record for record in caplog.records if record.name.startswith("eres_render")]
    assert any("shape 'mirror' is not Lambertian" in r.getMessage() for r in said)
    (warning,) = (r.getMessage() for r in said if r.levelno == logging.WARNING)
    assert "path-traced at 4 spp: log noise 0." in warning
    assert "with a contrast threshold of 0.2 fires" in warning
    assert "are false, as they are absent with 64 times the samples" in warning


@pytest.mark.slow
def test_a_study_of_a_path_traced_scene_warns_once(tmp_path, shiny_room, caplog):
    """Promise: a study with false events reports them, by the same measurement."""
    study = Study(
        name="shiny",
        scenes=(str(shiny_room.folder),),
        render=Render(resolution=62, spp=4, max_displacement_px=9.0, window_s=0.01, samples=2),
        simulate=Simulate(widths=(16,), cutoffs_hz=(np.inf,)),
        evaluate=Evaluate(flow=Flow(methods=())),
    )
    run_study(study, tmp_path / "run")
    (said,) = (
        r.getMessage() for r in caplog.records if r.name == "eres_render.sequence.monte_carlo_noise"
    )
    assert "path-traced at 4 spp: log noise 0." in said


@pytest.mark.slow
@pytest.mark.parametrize("name", ["diffuse ball in a room", "glossy floor in a room"])
def test_said_false_events_are_the_sensors(name, tmp_path):
    """Promise: the estimate is within 25 % of the sensor's extra events over 256 times the samples.

    At 24 px; the test also allows two standard errors of the choice of pixels.
    """
    if backend.select_variant().startswith("scalar"):
        pytest.skip("path tracing so many paths needs a vectorized variant")
    path_noise = benchmark("path_noise")
    said, measured = path_noise.compare(path_noise.write_scene(tmp_path, name), 24, 16, 256)
    assert said.log_noise == pytest.approx(measured.log_noise, rel=0.15)
    tolerance = 0.25 * measured.false_events_hz + 2 * said.false_events_error_hz
    assert measured.false_events_hz > 4 * said.false_events_error_hz
    assert said.false_events_hz == pytest.approx(measured.false_events_hz, abs=tolerance)


def test_another_seed_is_other_noise_and_the_same_seed_the_same(renderer):
    pose = renderer.trajectory.pose(1.0)
    frame = renderer.frame(pose)
    np.testing.assert_array_equal(renderer.frame(pose, seed=0), frame)
    assert not np.array_equal(renderer.frame(pose, seed=1), frame)


def test_continuous_sequences_have_no_samples(tmp_path, shiny_room):
    with pytest.raises(RenderError, match="samples: found 3, but a continuous sequence has no"):
        render_scene(shiny_room, tmp_path / "x", samples=3, continuous=True)
    assert not (tmp_path / "x").exists()
