"""Options of commands that simulate a camera: names, files, and options given by hand."""

import dataclasses
import math
from types import SimpleNamespace

import pytest

from eres_render import load_scene
from eres_render.random_scenes.random_scene import MAX_LIGHT
from sensor import SensorError, SensorModel, find_camera, plain_camera, read_camera
from sensor.cameras.camera import KEYS
from tasks.cli.camera_options import CameraOptions
from tasks.errors import TaskError
from tasks.events.simulation import warn_of_fill_factor
from tasks.generation import dataset
from tasks.study.config import Simulate, Study, digest
from tasks.study.run.jobs import jobs_of
from tasks.study.study_file import read_study

MINE = """
base = "davis346"
threshold = 0.15
cutoff = { value = 40, unit = "Hz", source = "a step of the light", kind = "measured" }
refractory = { value = 20, unit = "us", source = "its data sheet" }
dark = { value = 1, unit = "%", source = "a fit", kind = "measured" }
bus = 3
"""


def camera(**options):
    return CameraOptions(**options).camera(64, 48, usual_width=32)


def test_without_options_a_camera_is_plain():
    """Promise: ideal pixels, the height of the frames, no bus."""
    assert camera() == plain_camera(32, 24)
    assert camera(resolution=16) == plain_camera(16, 12)


def test_each_key_has_an_option_that_wins():
    """Promise: every number of a camera can be given by hand, whatever --sensor states."""
    numbers = {name: key for name, key in KEYS.items() if key.kind in (float, int)}
    numbers = {name: key for name, key in numbers.items() if key.part != "name"}
    for name in set(numbers) - {"width", "height", "illuminance", "cutoff", "fifo"}:
        found = camera(sensor="davis346", **{name: 1.0})
        assert getattr(found, KEYS[name].field) == KEYS[name].units.get("Mev/s", float)(1.0), name
        others = {KEYS[name].field, "sources"} | (
            {"contrast_threshold_off"} if name == "threshold" else set()
        )
        for one in {one.name for one in dataclasses.fields(found)} - others:
            assert getattr(found, one) == getattr(find_camera("davis346"), one), (name, one)


def test_the_later_wins(tmp_path):
    """Promise: defaults, base, file, --electronics, options."""
    file = tmp_path / "mine.toml"
    file.write_text(MINE)
    assert camera(sensor=str(file)) == read_camera(file)
    assert camera(sensor=str(file)).leak_hz == 0.1  # of its base
    other = camera(sensor=str(file), electronics="v2e-noisy", threshold=0.3)
    assert (other.width, other.cutoff_hz, other.bus_hz) == (346, 30.0, 3e6)
    assert (other.photoreceptor, other.contrast_threshold) == ("v2e", 0.3)
    assert camera(electronics="v2e-noisy").size == (32, 24)
    assert camera(sensor="davis346", leak=0.0).leak_hz == 0.0
    assert camera(sensor="davis346", bus="dvs128").bus_hz == 1e6
    assert camera(sensor="davis346", bus="unlimited").bus is None


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"electronics": "v2e-nosy"}, "did you mean 'v2e-noisy'"),
        ({"sensor": "nowhere.toml"}, "nowhere.toml: no such file"),
        ({"sensor": "ideal", "lux": 9.0, "cutoff": 9.0}, "give --lux or --cutoff, not both"),
        ({"sensor": "davis346", "resolution": 9}, "give --sensor or --resolution, not both"),
        ({"latency": -1.0}, "latency: found -1"),
        ({"bus": "atis"}, "bus of 'atis' is unknown"),
        ({"bus": "fast"}, "bus: found 'fast'"),
        ({"bus": -1.0}, "bus: found -1"),
        ({"resolution": 0}, "width: found 0"),
    ],
)
def test_impossible_options_are_refused(options, text):
    with pytest.raises((SensorError, TaskError), match=text):
        camera(**options)


def test_a_camera_without_a_grid_needs_a_resolution():
    with pytest.raises(TaskError, match="--resolution WIDTH"):
        CameraOptions(sensor="v2e-clean").camera(64, 48)
    found = CameraOptions(sensor="v2e-clean", resolution=8).camera(64, 48)
    assert (found.size, found.photoreceptor) == ((8, 6), "v2e")


def test_one_file_is_one_camera_in_every_command(tmp_path, eres, monkeypatch):
    """Promise: options, a study and a dataset make the same model of one file."""
    file, study = tmp_path / "mine.toml", tmp_path / "study.toml"
    file.write_text(MINE)
    study.write_text(
        'scenes = ["carpet"]\n[simulate]\nwidths = []\nsensors = ["mine.toml"]\n'
        "cutoffs_hz = [40]\nspeeds = [1]"
    )
    expected = read_camera(file).model(cutoff_hz=40.0, white=2.0)
    assert camera(sensor=str(file)).model(white=2.0) == expected
    (setting,) = jobs_of(read_study(study), load_scene("carpet"))[0].settings(2.0)
    assert (setting.model, setting.readout) == (expected, read_camera(file).bus)
    asked = []
    monkeypatch.setattr(dataset, "make_dataset", lambda settings, *_: asked.append(settings) or [])
    options = "--sensor", file, "--threshold-deviation", 0
    assert eres("dataset", tmp_path / "out", *options)[0] == 0
    (model,) = asked[0].models(0, 2.0).values()
    bright = expected.dark_level * MAX_LIGHT / 2.0
    assert model == dataclasses.replace(expected, dark_level=bright)
    assert asked[0].sensor.bus == read_camera(file).bus


def test_a_study_names_a_photoreceptor(tmp_path):
    """Promise: it reaches every sensor and the keys of results; without it both stay the same."""
    file = tmp_path / "mine.toml"
    file.write_text('scenes = ["carpet"]\n[simulate]\nphotoreceptors = ["v2e"]')
    study = read_study(file)
    assert study.simulate.photoreceptors == ("v2e",)
    models = [one.model for one in jobs_of(study, load_scene("carpet"))[0].settings(2.0)]
    assert {model.photoreceptor for model in models} == {"v2e"}
    references = {model.cutoff_hz: model.cutoff_reference for model in models}
    assert references == {math.inf: None, 200.0: 2.0, 50.0: 2.0}
    assert {model.dark_level for model in models} == {2e-3}
    plain = Study(name="mine", scenes=("carpet",)).simulate
    without = {
        name: getattr(plain, name)
        for name in (
            *("widths", "cutoffs_hz", "contrast_thresholds", "speeds"),
            *("dark_fraction", "warmup_time_constants"),
        )
    }
    assert digest(plain.decides) == digest(without)
    older = {**without, "photoreceptor": "v2e"}
    assert digest(Simulate(photoreceptors=("v2e",)).decides) == digest(older)
    both = Simulate(photoreceptors=("two_pole", "v2e"))
    assert digest(both.decides) not in (digest(older), digest(without))
    file.write_text('scenes = ["carpet"]\n[simulate]\nphotoreceptors = ["three_pole"]')
    with pytest.raises(ValueError, match=r"photoreceptors.*: found 'three_pole', expected 'two"):
        read_study(file)


@pytest.mark.parametrize(
    ("resolution", "fill_factor", "said"),
    [
        (64, 0.5, "fill factor 0.5 has no effect: a sensor pixel spans 1 px"),
        (64, 1.0, ""),
        (32, 0.5, "fill factor 0.5 has little effect: a sensor pixel spans 2 px"),
        (21, 0.5, ""),
    ],
)
def test_frames_too_coarse_for_a_fill_factor_are_said(resolution, fill_factor, said, caplog):
    """Promise: where a fill factor cannot act on frames, it does not go unnoticed."""
    frames = SimpleNamespace(width=64, height=64, white_level=1.0)
    warn_of_fill_factor(
        frames, SensorModel(width=resolution, height=resolution, fill_factor=fill_factor)
    )
    assert said in caplog.text
    assert ("fill factor" in caplog.text) == bool(said)
