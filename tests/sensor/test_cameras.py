"""Whole cameras: the catalogue and its sources, files, light, and the models of the engine."""

import json
import math
import tomllib
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from event_streams import assert_same
from moving_texture import texture_in_motion
from sensor import (
    EventCamera,
    SensorError,
    SensorModel,
    camera_names,
    cutoff_in_light,
    find_camera,
    plain_camera,
    read_camera,
    read_out,
    stream,
    write_camera,
)
from sensor.cameras import files
from sensor.cameras.camera import KEYS, Source
from sensor.cameras.schema import camera_schema
from sensor.events import concatenate
from sensor.levels import white_level

CATALOGUE = Path(files.__file__).parent / "catalogue"
ROOT = Path(__file__).parents[2]
SCHEMA = Draft202012Validator(camera_schema())


@pytest.mark.parametrize("name", camera_names())
def test_every_value_of_the_catalogue_has_a_source(name):
    """Promise: a value without a source is not in the catalogue; thresholds say their kind."""
    camera = find_camera(name)
    assert (camera.name, bool(camera.title)) == (name, True)
    table = tomllib.loads((CATALOGUE / f"{name}.toml").read_text())
    words = {key for key in table if KEYS[key].part == "name"}
    assert {*camera.sources} == {*table} - words
    SCHEMA.validate(table)
    assert all(len(source.text) > 10 for source in camera.sources.values())
    for key in ("threshold", "threshold_off"):
        if key in camera.sources:
            assert camera.sources[key].kind in ("smallest", "nominal", "given")


# Name, supplier, camera, year, resolution, interface, max. bandwidth in Mev/s: Table 1 as printed.
TABLE_1 = """
dvs128 | iniVation | DVS128 | 2008 | 128x128 | USB 2 | 1
davis240 | iniVation | DAVIS240 | 2014 | 240x180 | USB 2 | 12
davis346 | iniVation | DAVIS346 | 2017 | 346x260 | USB 3 | 12
dvxplorer | iniVation | DVXPlorer | 2020 | 640x480 | USB 3 | 165
atis | Prophesee | ATIS | 2011 | 304x240 | - | -
gen3-cd | Prophesee | Gen3 CD | 2017 | 640x480 | USB 3 | 66
gen3-atis | Prophesee | Gen3 ATIS | 2017 | 480x360 | USB 3 | 66
gen4-cd | Prophesee | Gen4 CD | 2020 | 1280x720 | USB 3 | 1066
dvs-gen2 | Samsung | DVS-Gen2 | 2017 | 640x480 | USB 2 | 300
dvs-gen3 | Samsung | DVS-Gen3 | 2018 | 640x480 | USB 3 | 600
dvs-gen4 | Samsung | DVS-Gen4 | 2020 | 1280x960 | USB 3 | 1200
celex-iv | CelePixel | CeleX-IV | 2017 | 768x640 | - | 200
celex-v | CelePixel | CeleX-V | 2019 | 1280x800 | - | 140
rhino-3 | Insightness | Rhino 3 | 2018 | 320x262 | USB 2 | 50
"""
GRIDS = [line.split()[0] for line in TABLE_1.strip().splitlines()]


def test_the_catalogue_has_the_cameras_of_the_papers_table():
    """Source: every row of Table 1."""
    rows = []
    for camera in map(find_camera, GRIDS):
        size, mev_s = f"{camera.width}x{camera.height}", camera.bus_hz / 1e6
        bus = "-" if math.isinf(mev_s) else f"{mev_s:g}"
        named = camera.name, camera.supplier, camera.title.removeprefix(f"{camera.supplier} ")
        rows.append(" | ".join((*named, str(camera.year), size, camera.interface or "-", bus)))
    assert rows == TABLE_1.strip().splitlines()
    others = {"ideal", "imx636", "v2e-clean", "v2e-noisy"}
    assert {*camera_names()} == {*GRIDS} | others
    assert all(find_camera(name).width is None for name in others)


def test_cameras_have_the_pitch_and_fill_factor_of_the_survey():
    """Source: table 1 of Gallego et al., IEEE TPAMI 2022: pixel size, um, and fill factor, %; the
    DVS128's fill factor from Lichtsteiner, Posch and Delbruck 2008; the DVXPlorer is not there."""
    pitches = [40, 18.5, 18.5, 9, 30, 15, 20, 4.86, 9, 9, 4.95, 18, 9.8, 13]
    fills = [9.4, 22, 22, None, 20, 25, 20, 77, 11, 12, 22, 8.5, 8, 22]
    for camera, pitch, fill in zip(map(find_camera, GRIDS), pitches, fills, strict=True):
        assert camera.pitch_um == pitch
        assert camera.fill_factor == (None if fill is None else pytest.approx(fill / 100))
        assert camera.model().fill_factor == (camera.fill_factor or 1)


def test_v2e_noisy_is_that_of_its_authors():
    """Source: `set_dvs_params("noisy")`: 0.2, 0.2, 0.05, 30 Hz, 0.1 Hz, 5 Hz; noise in white a
    quarter of that in black."""
    model = find_camera("v2e-noisy").on(2, 2).model()
    assert (model.photoreceptor, model.cutoff_hz, model.leak_hz) == ("v2e", 30.0, 0.1)
    assert (model.contrast_threshold, model.off_threshold) == (0.2, 0.2)
    assert (model.threshold_mismatch, model.shot_noise_hz) == (0.05, 5.0)
    assert 1001**-model.shot_noise_exponent == pytest.approx(0.25, abs=0.005)


def test_contrast_in_percent_becomes_log_units():
    """Physics: 11 % brighter is ln 1.11; 11 % darker is -ln 0.89."""
    davis = find_camera("davis240")
    assert davis.contrast_threshold == pytest.approx(math.log(1.11))
    assert davis.contrast_threshold_off == pytest.approx(-math.log(0.89))


def test_light_drives_cutoff_and_noise_together():
    """Physics: a hundredth of the light gives a hundredth of the cutoff, and, with an exponent e,
    100^e times the shot noise. A camera without an illuminance is in the light in which a DVS128
    has its cutoff, 3 Hz per lux."""
    assert find_camera("dvs128").model(lux=10.0).cutoff_hz == pytest.approx(30.0)
    noisy = find_camera("v2e-noisy").on(2, 2)
    assert noisy.model(lux=10.0).shot_noise_hz == pytest.approx(5.0)
    dim = noisy.model(lux=0.1)
    assert dim.cutoff_hz == pytest.approx(cutoff_in_light(0.1))
    assert dim.shot_noise_hz == pytest.approx(5 * 100**0.2)
    assert noisy.model(lux=1000.0).shot_noise_hz < 5


@pytest.mark.parametrize(("lux", "exponent"), [(5e-324, 1.0), (1e-300, 2.0), (1e-30, 12.0)])
def test_shot_noise_beyond_all_bounds_is_refused(lux, exponent):
    """Promise: one line that names it, where the power of the light overflows."""
    camera = replace(find_camera("v2e-noisy").on(4, 4), shot_noise_exponent=exponent)
    with pytest.raises(SensorError, match="shot_noise_hz: found inf"):
        camera.model(lux=lux)


def test_electronics_of_another_camera_leave_the_grid_and_a_bus():
    """Promise: what the other does not know has its default, but for the bus."""
    davis, ideal = find_camera("davis346"), find_camera("ideal")
    found = davis.with_electronics(ideal)
    assert (found.width, found.pitch_um, found.bus_hz) == (346, 18.5, 12e6)
    assert (found.contrast_threshold, found.contrast_threshold_off) == (0.2, None)
    assert (found.leak_hz, found.latency_s) == (0.0, 0.0)
    assert found.sources["threshold"] == ideal.sources["threshold"]
    assert "leak" not in found.sources
    assert davis.with_electronics(find_camera("dvs128")).bus_hz == 1e6


def test_a_cutoff_is_lent_by_area():
    """Physics: 3 Hz per lux of a DVS128, times the ratio of photodiode areas to the exponent: at 67
    lux 201 Hz at 0 for all, and at 1 101, 75, 24 and 7 Hz."""
    at_1 = {"davis346": 101, "gen3-cd": 75, "gen4-cd": 24, "dvs-gen4": 7, "dvs128": 201}
    for name, hz in at_1.items():
        camera = find_camera(name)
        assert camera.cutoff_at(67) == pytest.approx(201)
        assert replace(camera, area_exponent=1.0).cutoff_at(67) == pytest.approx(hz, abs=0.5)
    unknown = replace(find_camera("dvxplorer"), area_exponent=1.0)
    assert unknown.area_um2 is None
    assert unknown.cutoff_at(67) == pytest.approx(201)
    own = EventCamera(cutoff_hz=20.0, illuminance_lux=10.0, area_exponent=1.0, pitch_um=5.0)
    assert own.cutoff_at(1.0) == pytest.approx(2.0)
    with pytest.raises(SensorError, match="like: the camera 'gen4-cd' does not have both"):
        replace(unknown, like="gen4-cd").cutoff_at(67)


@pytest.mark.parametrize("white", [None, 3.0])
def test_a_camera_in_a_loop_gives_the_events_of_its_stream(white):
    """Promise: to the bit, with its bus and its dark level, which is a share of the given white, or
    of that of the first frame; they are those of the model and the bus one by one."""
    frames, t_s = texture_in_motion(0, 12, (20, 24), 2e-3, travel_px=6.0)
    camera = EventCamera(
        name="mine",
        width=24,
        height=20,
        cutoff_hz=300.0,
        cutoff_follows_light=True,
        leak_hz=5.0,
        dark_share=0.02,
        bus_hz=2e5,
        fifo=4,
        latency_s=1e-4,
    )
    level = white_level(frames[0]) if white is None else white
    model = camera.model(white=level)
    assert model.dark_level == 0.02 * level
    assert model.cutoff_reference == level
    expected = concatenate(list(read_out(stream(frames, t_s, model, seed=5), camera.bus)))
    assert len(expected) > 1000
    assert_same(camera.simulate(frames, t_s, seed=5, white=white), expected)
    assert_same(camera.simulate(iter(frames), t_s, seed=5, white=white, threads=1), expected)
    with camera.open(seed=5, white=white) as live:
        parts = [live.push(frame, t) for frame, t in zip(frames, t_s, strict=True)]
        parts.append(live.finish())
    assert_same(concatenate(parts), expected)
    assert live.model == model
    assert live.report.dropped > 0
    with pytest.raises(SensorError, match=r"dark_level: .* is black"):
        camera.simulate(np.zeros((2, 20, 24)), [0.0, 1.0])


def test_an_answer_says_what_it_assumes():
    text = find_camera("davis346").assumptions(lux=67)
    assert text == (
        "davis346: 346x260, 18.5 um, fill 22 %; C +0.134/-0.255 (smallest); 67 lux: cutoff 201 Hz, "
        "lent by dvs128, area^0 (101 Hz at area^1); dark 0.1 % of white; leak 0.1 Hz (shot noise "
        "unknown, 0); latency 20 us; bus 12 Mev/s"
    )
    assert "celex-iv: 768x640" in find_camera("celex-iv").assumptions()
    assert "ideal pixels" in plain_camera(64).assumptions()
    assert find_camera("rhino-3").assumptions(cutoff_hz=50.0).count("cutoff 50 Hz") == 1


def values_of(key):
    """Draw values of a key, in the unit of the field."""
    if key.kind is bool:
        return st.booleans()
    if key.kind is str:
        return st.sampled_from(key.words) if key.words else st.text(min_size=1, max_size=12)
    if key.kind is int:
        return st.integers(int(key.least), int(key.most))
    most = min(key.most, 1e12)
    return st.floats(key.least, most, allow_nan=False, allow_subnormal=False)


@settings(max_examples=50)
@given(data=st.data())
def test_what_is_written_is_read(data, tmp_path):
    """Promise: any camera comes back whole, to the bit, with sources, intervals and bounds; its
    file keeps to the schema."""
    names = data.draw(st.sets(st.sampled_from([*KEYS])))
    values, sources = {}, {}
    for name in names - {"width", "height"}:
        key = KEYS[name]
        number = key.kind is float
        kind = data.draw(st.sampled_from(["published", "smallest", "measured"]))
        interval = (0.25, 0.5) if number and data.draw(st.booleans()) else None
        if number and name != "threshold" and data.draw(st.booleans()):
            sources[name] = Source("only a bound", "bound", (0.25, math.inf))
            continue
        values[key.field] = data.draw(values_of(key))
        if key.part != "name":
            sources[name] = Source(
                data.draw(st.sampled_from(["a page", 'a "b"\\c'])), kind, interval
            )
    camera = EventCamera(name="mine", sources=sources, **values)
    write_camera(tmp_path / "mine.toml", camera)
    SCHEMA.validate(tomllib.loads((tmp_path / "mine.toml").read_text()))
    found = read_camera(tmp_path / "mine.toml")
    assert found == camera
    assert found.sources == sources


def test_values_from_python_are_written_without_sources(tmp_path):
    camera = EventCamera(name="a", width=20, height=10, leak_hz=0.3, bus_hz=3.3e6)
    write_camera(tmp_path / "a.toml", camera)
    assert (tmp_path / "a.toml").read_text() == "width = 20\nheight = 10\nleak = 0.3\nbus = 3.3\n"
    found = read_camera(tmp_path / "a.toml")
    assert (found, found.states("leak"), found.states("latency")) == (camera, True, False)
    with pytest.raises(FileExistsError):
        write_camera(tmp_path / "a.toml", camera, overwrite=False)


def test_a_file_changes_its_base(tmp_path):
    """Promise: what the file does not say is that of the base, or of a file beside it; a threshold
    in log units alone holds for both polarities."""
    (tmp_path / "one.toml").write_text('base = "davis346"\nthreshold_on = 0.15\n')
    (tmp_path / "two.toml").write_text(
        'base = "one.toml"\ntitle = "two"\n'
        'dark = { value = 1, unit = "%", kind = "given", source = "eres fit" }\n'
        'cutoff = { interval = [25, inf], unit = "Hz", source = "rec.raw" }\n'
    )
    found = find_camera(tmp_path / "two.toml")
    assert (found.name, found.title, found.width, found.bus_hz) == ("two", "two", 346, 12e6)
    assert (found.contrast_threshold, found.contrast_threshold_off) == (0.15, None)
    assert "threshold_off" not in found.sources
    assert found.model(white=3.0).dark_level == pytest.approx(0.03)
    assert found.cutoff_hz == math.inf
    assert found.sources["cutoff"] == Source("rec.raw", "bound", (25.0, math.inf))
    assert not found.states("cutoff")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("title = ", "could not be read as TOML"),
        ("cutof = 3", "cutof: unknown; did you mean 'cutoff'"),
        ('base = "davis364"', "camera: found 'davis364'; did you mean 'davis346'"),
        ("base = 3", "base: found 3, expected the name or the file"),
        ("leak = -1", "leak: found -1, expected a number of Hz"),
        ("leak = nan", "leak: found nan, expected a number of Hz"),
        ("leak = inf", "leak: found inf, expected a finite number"),
        ("leak = 2e6", "leak: found 2000000.0, expected a number from 0 to 1e+06"),
        ('leak = "much"', "leak: found 'much', expected a number of Hz"),
        ("cutoff = 0", "cutoff: found 0.0, expected a number from"),
        ("fill_factor = 1.2", "fill_factor: found 1.2, expected a number from 1e-06 to 1"),
        ("width = 3.5", "width: found 3.5, expected an integer from 1 to 65536"),
        ("height = 3", "width, height: give both or neither"),
        ("random_start = 1", "random_start: found 1, expected true or false"),
        ('photoreceptor = "rc"', "photoreceptor: found 'rc', expected 'two_pole' or"),
        (
            'threshold = { value = 11, unit = "%", source = "s" }',
            "threshold: give threshold_off, too",
        ),
        ('leak = { value = 1, unit = "lux", source = "s" }', "leak.unit: found 'lux'"),
        ("leak = { value = 1 }", "leak.source: found None"),
        ('leak = { value = 1, source = "s", kind = "x" }', "leak.kind: found 'x'"),
        ('leak = { value = 1, source = "s", origin = 2 }', "leak.origin: unknown"),
        ('leak = { value = 1, source = "s", interval = [3, 2] }', "leak.interval: found [3, 2]"),
        ('leak = { value = 1, source = "s", interval = 3 }', "leak.interval: found 3"),
        ('leak = { source = "s" }', "leak: needs a value or an interval"),
    ],
)
def test_a_wrong_file_is_refused(tmp_path, text, expected):
    """Promise: one line that names file and key, what was found and expected."""
    file = tmp_path / "mine.toml"
    file.write_text(text)
    with pytest.raises(SensorError) as error:
        find_camera(file)
    assert str(error.value).startswith(f"{file}: ")
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text",
    [
        *("cutof = 3", "base = 3", "leak = -1", "leak = 2e6", 'leak = "much"', "cutoff = 0"),
        *("fill_factor = 1.2", "width = 3.5", "random_start = 1", 'photoreceptor = "rc"'),
        'leak = { value = 1, unit = "lux", source = "s" }',
        "leak = { value = 1 }",
        'leak = { value = 1, source = "s", kind = "x" }',
        'leak = { value = 1, source = "s", origin = 2 }',
        'leak = { value = 1, source = "s", interval = 3 }',
        'leak = { source = "s" }',
    ],
)
def test_an_editor_sees_the_fault_too(text):
    """Promise: the schema refuses what the reader refuses in a single key."""
    assert not SCHEMA.is_valid(tomllib.loads(text))


def test_the_stored_schema_is_up_to_date(eres):
    """Promise: docs/camera.schema.json is what `eres sensors --schema` prints."""
    code, printed, _ = eres("sensors", "--schema")
    assert (code, json.loads(printed)) == (0, SCHEMA.schema)
    assert (ROOT / "docs" / "camera.schema.json").read_text() == printed


def test_what_contradicts_itself_is_refused():
    davis = find_camera("davis346")
    with pytest.raises(SensorError, match="lux or cutoff_hz, not both"):
        davis.model(lux=67, cutoff_hz=50.0)
    with pytest.raises(SensorError, match="imx636: needs width and height"):
        find_camera("imx636").model()
    assert find_camera("imx636").on(12, 8).model().width == 12
    follows = replace(davis, cutoff_follows_light=True)
    with pytest.raises(SensorError, match="cutoff_follows_light: needs a cutoff"):
        follows.model()
    assert follows.model(cutoff_hz=math.inf).cutoff_reference is None
    assert follows.model(lux=17, white=4.0).cutoff_reference == 4.0
    v2e = replace(davis, photoreceptor="v2e")  # follows the light in any case
    assert replace(v2e, cutoff_follows_light=True).model(lux=17) == v2e.model(lux=17)
    assert davis.model(white=4.0, dark_white=10.0).dark_level == 1e-3 * 10.0
    for lux in (0, -1, math.inf, math.nan, "dim"):
        with pytest.raises(SensorError, match="lux: found"):
            davis.model(lux=lux)
    with pytest.raises(SensorError, match=r"nowhere\.toml: no such file"):
        find_camera("nowhere.toml")
    with pytest.raises(
        SensorError, match=r"found 'zzz'; expected a file such as mine\.toml, or one"
    ):
        find_camera("zzz")


def test_fields_have_the_names_and_defaults_of_the_model():
    """Promise: what a camera has in common with `SensorModel` is called alike."""
    ours = {one.name: one.default for one in fields(EventCamera)}
    theirs = {one.name: one.default for one in fields(SensorModel)}
    known = {"dark_level", "cutoff_reference", "fill_factor", "width", "height"}
    assert {*theirs} - {*ours} == {"dark_level", "cutoff_reference"}
    for name in {*theirs} - known:
        assert ours[name] == theirs[name], name
    assert {key.field for key in KEYS.values()} <= {*ours}
