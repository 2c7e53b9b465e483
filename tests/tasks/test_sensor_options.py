"""Options of pixels: profiles, and options given by hand."""

import math
from types import SimpleNamespace

import pytest

from eres_render import load_scene
from sensor import SensorError, SensorModel
from tasks.errors import TaskError
from tasks.events.sensor_options import IDEAL_PIXEL, NO_BUS, BusOptions, PixelOptions
from tasks.events.simulation import sensor_for
from tasks.generation.settings import DatasetSettings, claim_folder
from tasks.study.config import Simulate, Study, digest
from tasks.study.run.jobs import jobs_of
from tasks.study.study_file import read_study

FRAMES = SimpleNamespace(width=64, height=48, white_level=2.0)


def sensor(threshold=None, **options):
    pixel = PixelOptions(**options)
    return sensor_for(FRAMES, resolution=32, contrast_threshold=threshold, pixel=pixel)


def test_without_options_pixels_are_ideal():
    assert sensor() == SensorModel(width=32, height=24, dark_level=0.002)


def test_a_profile_sets_the_electronics():
    model = sensor(profile="v2e-noisy")
    assert (model.photoreceptor, model.cutoff_hz, model.leak_hz) == ("v2e", 30.0, 0.1)
    assert model.cutoff_reference == FRAMES.white_level
    assert sensor(profile="v2e-clean").cutoff_reference is None


def test_options_given_by_hand_win():
    """Promise: each option overrides the profile, even 0; a threshold holds for ON and OFF."""
    model = sensor(
        threshold=0.3, profile="v2e-noisy", leak=0.0, cutoff=200.0, photoreceptor="two_pole"
    )
    assert (model.leak_hz, model.cutoff_hz, model.photoreceptor) == (0.0, 200.0, "two_pole")
    assert (model.contrast_threshold, model.off_threshold) == (0.3, 0.3)
    assert model.cutoff_reference is None
    assert model.shot_noise_hz == 5.0
    apart = sensor(threshold=0.3, profile="davis240", threshold_off=0.25)
    assert (apart.contrast_threshold, apart.off_threshold) == (0.3, 0.25)


def test_light_wins_over_the_cutoff_of_a_profile_and_noise_follows():
    model = sensor(profile="v2e-noisy", illuminance=1.0)
    assert model.cutoff_hz == pytest.approx(3.0)
    assert model.shot_noise_hz == pytest.approx(5 * 10**0.2)
    assert sensor(profile="v2e-noisy", illuminance=1.0, shot_noise=2.0).shot_noise_hz == 2.0
    for exponent, rate_hz in ((0.0, 5.0), (0.5, 5.0 * 10**0.5)):  # a tenth of the profile's light
        model = sensor(profile="v2e-noisy", illuminance=1.0, shot_noise_exponent=exponent)
        assert model.shot_noise_exponent == exponent
        assert model.shot_noise_hz == pytest.approx(rate_hz)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"hot_pixel_rate": 5.0}, "hot-pixel-rate: found it without --hot-pixels, expected both"),
        ({"shot_noise_exponent": 0.1}, "shot-noise-exponent: found it without --shot-noise"),
        ({"profile": "v2e-nosy"}, "did you mean 'v2e-noisy'"),
        ({"profile": "nowhere.toml"}, "nowhere.toml: no such profile"),
        ({"cutoff": 9.0, "illuminance": 9.0}, "found both cutoff and illuminance"),
        ({"profile": "v2e-noisy", "cutoff_follows_light": True}, "follows the light in its own"),
        ({"cutoff_follows_light": True}, "found no cutoff"),
        (
            {"photoreceptor": "v2e"},
            "found v2e without a cutoff, expected --cutoff or --illuminance",
        ),
        ({"photoreceptor": "one_pole"}, "found one_pole without a cutoff"),
        ({"photoreceptor": "v2e", "profile": "davis346"}, "found v2e without a cutoff"),
        ({"latency": -1.0}, "latency_s: found -1"),
    ],
)
def test_impossible_options_are_refused(options, text):
    with pytest.raises((SensorError, TaskError), match=text):
        sensor(**options)


def test_a_photoreceptor_is_taken_where_there_is_a_cutoff():
    """Promise: a cutoff given by hand, that of a profile and that of the light will do, as does a
    profile that names its photoreceptor; `inf` asks for ideal pixels."""
    for options in (
        {"cutoff": 200.0},
        {"illuminance": 67.0},
        {"profile": "v2e-noisy"},
        {"cutoff": math.inf},
    ):
        assert sensor(photoreceptor="one_pole", **options).photoreceptor == "one_pole"
    assert sensor(profile="v2e-clean").photoreceptor == "v2e"


def test_a_dataset_with_a_photoreceptor_needs_a_cutoff(eres, tmp_path):
    """Promise: the error names the option of `eres dataset`; a list of cutoffs may have `inf`."""
    out = tmp_path / "data"
    code, _, err = eres("dataset", out, "--count", 1, "--photoreceptor", "v2e")
    assert code == 1
    assert "photoreceptor: found v2e without a cutoff, expected --cutoffs, such as" in err
    assert not out.exists()
    pixel = PixelOptions(photoreceptor="v2e").settled()
    models = settings(pixel=pixel, cutoffs_hz=(math.inf, 200.0)).models(0, 2.0)
    assert models["200"].cutoff_reference == 2.0


def test_a_camera_has_its_fill_factor_unless_it_is_given():
    """Promise: --sensor gives size and fill factor; options given by hand win."""
    frames = SimpleNamespace(width=640, height=480, white_level=1.0)
    assert sensor_for(frames, sensor="dvs128").fill_factor == 0.094
    by_hand = sensor_for(frames, sensor="dvs128", pixel=PixelOptions(fill_factor=1.0))
    assert by_hand.fill_factor == 1.0


def test_a_camera_has_its_bus_unless_it_is_given():
    """Promise: --sensor sets the rate of the bus; --bus overrides it, also with unlimited; without
    a camera, or with one of unknown bandwidth, there is no limit."""
    assert NO_BUS.readout("davis346").max_rate_hz == 12e6
    assert BusOptions(fifo=64).readout("gen3-cd").fifo_depth == 64
    assert BusOptions(bus="3").readout("davis346").max_rate_hz == 3e6
    assert BusOptions(bus="dvs128").readout("davis346").max_rate_hz == 1e6
    assert BusOptions(bus="unlimited").readout("davis346") is None
    assert (NO_BUS.readout("atis"), NO_BUS.readout()) == (None, None)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"bus": "fast"}, "nor unlimited, nor a camera"),
        ({"bus": "atis"}, "the bandwidth of 'atis' is unknown"),
        ({"bus": "unlimited", "fifo": 9}, "fifo, row-overhead: found no bus"),
        ({"row_overhead": 1e-6}, "fifo, row-overhead: found no bus"),
        ({"bus": "-1"}, "max_rate_hz: found -1"),
    ],
)
def test_impossible_buses_are_refused(options, text):
    with pytest.raises((SensorError, TaskError), match=text):
        BusOptions(**options).readout()


def settings(**more):
    return DatasetSettings(seed=0, seconds=1.0, width=32, height=24, **more)


def test_a_dataset_takes_a_profile():
    """Promise: OFF thresholds keep their ratio to ON while thresholds vary over sequences."""
    pixel = PixelOptions(profile="davis346")
    found = settings(pixel=pixel, threshold=0.134).models(3, 2.0)["inf"]
    nominal = pixel.applied_to(SensorModel(width=1, height=1), 1.0)
    assert found.contrast_threshold != 0.134
    assert found.off_threshold / found.contrast_threshold == pytest.approx(
        nominal.off_threshold / 0.134
    )
    assert found.leak_hz == 0.1


def test_a_dataset_of_an_older_version_continues(tmp_path):
    """Promise: dataset.json with `poles` is accepted for the same settings."""
    out = tmp_path / "data"
    claim_folder(settings(), out)
    file = out / "dataset.json"
    text = file.read_text()
    older = text
    for name in ("profile", "threshold_off"):
        older = older.replace(f'  "{name}": null,\n', "")
    older = older.replace('"photoreceptor": "two_pole"', '"poles": 2')
    older = older.replace('"refractory": 0.0,\n  "latency": 0.0\n', '"refractory": 0.0\n')
    assert "poles" in older
    assert "latency" not in older
    file.write_text(older)
    claim_folder(settings(), out)
    file.write_text(older.replace('"poles": 2', '"poles": 1'))
    with pytest.raises(TaskError, match="pixel: found"):
        claim_folder(settings(), out)
    assert IDEAL_PIXEL.settled().fill_factor == 1.0


def test_a_study_names_a_photoreceptor(tmp_path):
    """Promise: it reaches every sensor and the keys of results; without it both stay the same."""
    file = tmp_path / "mine.toml"
    file.write_text('scenes = ["carpet"]\n[simulate]\nphotoreceptor = "v2e"')
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
    file.write_text('scenes = ["carpet"]\n[simulate]\nphotoreceptor = "three_pole"')
    with pytest.raises(ValueError, match=r"photoreceptors.*: found 'three_pole', expected 'two"):
        read_study(file)


@pytest.mark.parametrize(
    ("resolution", "fill_factor", "said"),
    [
        (
            64,
            0.5,
            "found 0.5 with pixels that are 1 px of the frames wide, expected at least 3: with ",
        ),
        (64, 1.0, ""),
        (
            32,
            0.5,
            "with pixels that are 2 px of the frames wide, expected at least 3: with fewer it ",
        ),
        (21, 0.5, ""),
    ],
)
def test_frames_too_coarse_for_a_fill_factor_are_said(resolution, fill_factor, said, caplog):
    """Promise: where a fill factor cannot act on frames, it does not go unnoticed."""
    frames = SimpleNamespace(width=64, height=64, white_level=1.0)
    sensor_for(frames, resolution=resolution, pixel=PixelOptions(fill_factor=fill_factor))
    assert said in caplog.text
    assert ("fill factor" in caplog.text) == bool(said)
