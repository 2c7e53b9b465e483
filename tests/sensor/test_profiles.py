"""Profiles of sensors: what is packaged, what a file may say, and what light does to them."""

import math

import pytest

from sensor import SensorError, SensorModel, cutoff_in_light
from sensor.profiles import find_profile, profile_names, read_profile

TEXT = """
title = "mine"
[cutoff]
value = 0.2
unit = "kHz"
source = "measured"
interval = [0.1, 0.3]
"""


def written(tmp_path, text):
    file = tmp_path / "mine.toml"
    file.write_text(text)
    return file


@pytest.mark.parametrize("name", profile_names())
def test_every_packaged_profile_names_its_sources(name):
    """Promise: each value has a source, and what is not known is listed as unknown."""
    profile = find_profile(name)
    assert profile.name == name
    assert all(len(found.source) > 10 for found in profile.known.values())
    assert {*profile.known, *profile.unknown} >= {"photoreceptor", "threshold_on", "latency"}
    assert not {*profile.known} & {*profile.unknown}


def test_the_profiles_are_those_of_the_cameras_and_of_v2e():
    cameras = "davis240", "davis346", "dvs128", "gen3-cd", "gen4-cd", "imx636"
    assert {*profile_names()} == {*cameras, "ideal", "v2e-clean", "v2e-noisy"}
    assert "threshold_mismatch" in find_profile("imx636").unknown


def test_v2e_noisy_is_that_of_its_authors():
    """Source: `set_dvs_params("noisy")`: 0.2, 0.2, 0.05, 30 Hz, 0.1 Hz, 5 Hz; noise in white a
    quarter of that in black."""
    model = find_profile("v2e-noisy").applied_to(SensorModel(width=2, height=2))
    assert (model.photoreceptor, model.cutoff_hz, model.leak_hz) == ("v2e", 30.0, 0.1)
    assert (model.contrast_threshold, model.off_threshold) == (0.2, 0.2)
    assert (model.threshold_mismatch, model.shot_noise_hz) == (0.05, 5.0)
    assert 1001**-model.shot_noise_exponent == pytest.approx(0.25, abs=0.005)


def test_contrast_in_percent_becomes_log_units():
    """Physics: 11 % brighter is ln 1.11; 11 % darker is -ln 0.89."""
    known = find_profile("davis240").known
    assert known["threshold_on"].value == pytest.approx(math.log(1.11))
    assert known["threshold_off"].value == pytest.approx(-math.log(0.89))


def test_units_and_intervals_are_those_of_the_model(tmp_path):
    profile = read_profile(written(tmp_path, TEXT))
    assert profile.known["cutoff"].value == 200.0
    assert profile.known["cutoff"].interval == (100.0, 300.0)
    kept = SensorModel(width=2, height=2, leak_hz=0.3)
    model = profile.applied_to(kept)
    assert (model.cutoff_hz, model.leak_hz, model.contrast_threshold) == (200.0, 0.3, 0.2)


def test_light_drives_cutoff_and_noise_together():
    """Physics: a hundredth of the light gives a hundredth of the cutoff, and, with an exponent e,
    100^e times the shot noise. A profile without an illuminance has that of its cutoff, at 3 Hz per
    lux."""
    plain = SensorModel(width=2, height=2)
    dvs128 = find_profile("dvs128")
    assert dvs128.applied_to(plain, 10.0).cutoff_hz == pytest.approx(30.0)
    noisy = find_profile("v2e-noisy")
    assert noisy.applied_to(plain, 10.0).shot_noise_hz == pytest.approx(5.0)
    dim = noisy.applied_to(plain, 0.1)
    assert dim.cutoff_hz == pytest.approx(cutoff_in_light(0.1))
    assert dim.shot_noise_hz == pytest.approx(5 * 100**0.2)
    assert noisy.applied_to(plain, 1000.0).shot_noise_hz < 5


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[cutoff]", "title: found None, expected the name"),
        ('title = "x"\n[cutof]\nvalue = 1', "cutof: unknown; did you mean 'cutoff'"),
        (TEXT.replace("0.2", "-0.2"), "cutoff.value: found -0.2, expected a number of at least 0"),
        (TEXT.replace('"kHz"', '"lux"'), "cutoff.unit: found 'lux', expected 'Hz' or 'kHz'"),
        (TEXT.replace('unit = "kHz"', ""), "cutoff.unit: found None, expected 'Hz' or 'kHz'"),
        (TEXT.replace("source", "origin"), "cutoff.origin: unknown, expected value, unit, source"),
        (TEXT.replace('"measured"', '""'), "cutoff.source: found '', expected a text"),
        (TEXT.replace("0.2", '"fast"'), "cutoff.value: found 'fast', expected a number"),
        (TEXT.replace("[0.1, 0.3]", "0.1"), "cutoff.interval: found 0.1, expected two numbers"),
        (TEXT.replace("0.2", "nan"), "cutoff.value: found nan"),
        (TEXT.replace("value = 0.2", "value = 0"), "cutoff_hz: found 0.0, expected a positive"),
        ('title = "x"\ncutoff = 3', "cutoff: found 3, expected a table"),
        ('title = "x"\n[photoreceptor]\nvalue = "rc"\nsource = "y"', "found 'rc', expected 'two_p"),
        ('title = "x"\n[latency]\nvalue = inf\nunit = "s"\nsource = "y"', "expected a finite"),
        (
            'title = "x"\n[threshold_off]\nvalue = 100\nunit = "%"\nsource = "y"',
            "threshold_off.value: found 100, expected a finite number of %",
        ),
        (
            'title = "x"\n[illuminance]\nvalue = 0\nunit = "lux"\nsource = "y"',
            "illuminance.value: found 0, expected a positive number of lux",
        ),
        (
            TEXT.replace("[0.1, 0.3]", "[0.3, 0.1]"),
            "found [0.3, 0.1], expected its lower end",
        ),
        ("title = ", "could not be read as TOML"),
    ],
)
def test_a_wrong_profile_is_refused(tmp_path, text, expected):
    """Promise: the error is one line that names file and field, what was found and expected."""
    file = written(tmp_path, text)
    with pytest.raises(SensorError) as error:
        find_profile(file)
    assert str(error.value).startswith(f"{file}: ")
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("lux", "exponent"), [(5e-324, 1.0), (1e-300, 2.0), (1e-30, 12.0)])
def test_shot_noise_beyond_all_bounds_is_refused(lux, exponent):
    """Promise: one line that names it, where the power of the light overflows."""
    with pytest.raises(SensorError, match="shot_noise_hz: found inf"):
        find_profile("v2e-noisy").applied_to(SensorModel(width=4, height=4), lux, exponent)


def test_a_profile_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(SensorError, match="found 'davis241'; did you mean 'davis240'"):
        find_profile("davis241")
    with pytest.raises(SensorError, match=r"expected a file such as mine\.toml, or one of"):
        find_profile("zzz")
    with pytest.raises(SensorError, match=r"nowhere\.toml: no such profile"):
        find_profile(tmp_path / "nowhere.toml")
