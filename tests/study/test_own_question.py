"""A question of one's own: cameras, lux, m/s and buses, from a TOML file to rows and words."""

from __future__ import annotations

import csv
import json
import math
import re
from collections import Counter
from dataclasses import replace
from html import escape
from pathlib import Path

import numpy as np
import pytest

from eres_render import load_scene
from finished_runs import add_previews, make_run, page_of
from made_scaling import made
from sensor import Readout, cutoff_in_light, find_camera
from study_rows import paper_rows
from tasks.errors import StudyError
from tasks.evaluation.timings import read_timings
from tasks.row import Row, read_rows
from tasks.study.config import Render, Study, with_scenes
from tasks.study.report.finished_run import read_run
from tasks.study.report.sections.scaling import interval_plot
from tasks.study.report.sections.timings import method_table
from tasks.study.report.sections.tradeoff import tradeoff_plots
from tasks.study.results.asked import MetersPerSecond
from tasks.study.results.choice import choose
from tasks.study.results.comparison import line_label, main_tables
from tasks.study.results.scores import Scores, by_photoreceptor
from tasks.study.results.words import cutoff_label, speed_label
from tasks.study.run import run_study
from tasks.study.run.highlights import scaling_files
from tasks.study.run.jobs import jobs_of
from tasks.study.settings import to_json
from tasks.study.study_file import read_study

QUIET = """
[evaluate.flow]
methods = []
[evaluate.tracking]
methods = []
"""


def written(folder: Path, text: str) -> Path:
    (folder / "mine.toml").write_text(text)
    return folder / "mine.toml"


def read(folder: Path, simulate: str, rest: str = "") -> Study:
    text = f'scenes = ["carpet"]\n[simulate]\n{simulate}\n{rest}'
    return read_study(written(folder, text))


def test_sensors_are_cameras_files_and_tables(tmp_path) -> None:
    """Promise: a name, a TOML file and a table each give a camera; files are relative to the file
    that names them; what a camera says replaces the study's lists."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "pixel.toml").write_text(
        'title = "mine"\n[threshold_on]\nvalue = 0.3\nunit = "log"\nsource = "measured"\n'
        '[threshold_off]\nvalue = 0.4\nunit = "log"\nsource = "measured"'
    )
    (tmp_path / "parts" / "wide.toml").write_text(
        'width = 200\nheight = 100\nelectronics = "pixel.toml"\nbus = 0.5'
    )
    sensors = """
    sensors = ["davis346", "parts/wide.toml", {name = "noisy", width = 320, leak = 0.1}]
    contrast_thresholds = [0.2, 0.5]
    """
    simulate = read(tmp_path, sensors).simulate
    assert simulate.widths == ()
    assert [one.size for one in simulate.all_cameras(Render())] == [
        (346, 260),
        (200, 100),
        (320, 320),
    ]
    davis, wide, noisy = simulate.sensors
    assert (davis.name, wide.name, noisy.name) == ("davis346", "wide", "noisy")
    assert (davis.fill_factor, noisy.leak_hz, wide.bus_hz) == (0.22, 0.1, 5e5)
    found = {
        (s.name, round(m.contrast_threshold, 4), round(m.off_threshold, 4))
        for s, _, m in simulate.models(Render())
    }
    assert found == {
        ("davis346", 0.1337, 0.2549),  # 14.3 % up, 22.5 % down
        ("wide", 0.3, 0.4),
        ("noisy", 0.2, 0.2),
        ("noisy", 0.5, 0.5),
    }


def test_a_base_without_changes_is_that_camera(tmp_path) -> None:
    named, based, renamed = (
        read(tmp_path, f"sensors = [{sensor}]").simulate
        for sensor in ('"davis346"', '{base = "davis346"}', '{base = "davis346", name = "mine"}')
    )
    (camera,) = named.sensors
    assert camera == find_camera("davis346")
    assert based == named
    assert renamed.sensors == (replace(camera, name="mine"),)


def test_light_in_lux_decides_the_cutoff_as_the_camera_measured(tmp_path) -> None:
    """Physics: bandwidth is proportional to light: 3 Hz per lux, or from the camera's own pair."""
    (tmp_path / "fast.toml").write_text(
        'title = "mine"\n[cutoff]\nvalue = 1\nunit = "kHz"\nsource = "measured"\n'
        '[illuminance]\nvalue = 100\nunit = "lux"\nsource = "measured"'
    )
    sensors = 'illuminance_lux = [inf, 20]\nsensors = [{width = 64, electronics = "fast.toml"}]'
    simulate = read(tmp_path, f"{sensors}\nwidths = [32]").simulate
    assert simulate.cutoffs_hz == (math.inf, cutoff_in_light(20))
    found = {
        (model.width, light.illuminance_lux): model for _, light, model in simulate.models(Render())
    }
    assert found[32, 20.0].cutoff_hz == cutoff_in_light(20)
    assert found[64, 20.0].cutoff_hz == pytest.approx(200.0)
    assert math.isinf(found[64, 0.0].cutoff_hz)


def test_each_exponent_of_the_area_is_one_more_sensor(tmp_path) -> None:
    """Physics: a cutoff that a DVS128 lends, 201 Hz at 67 lux, is multiplied by the ratio of the
    areas of the photodiodes, 150.4 um^2 of a DVS128, to the power of the exponent. A cutoff of the
    camera's own is not, nor that of pixels of unknown area: both are one sensor."""
    cameras = '"dvs128", "davis346", "gen3-cd", "gen4-cd", "dvs-gen4", {name = "mine", width = 64}'
    study = f"sensors = [{cameras}]\nilluminance_lux = [67]\n"
    simulate = read(tmp_path, f"{study}area_exponents = [0, 1]").simulate
    assert {camera.name: round(model.cutoff_hz) for camera, _, model in simulate.models()} == {
        "dvs128": 201,
        "mine": 201,
        **dict.fromkeys(
            [f"{name} area^0" for name in ("davis346", "gen3-cd", "gen4-cd", "dvs-gen4")], 201
        ),
        "davis346 area^1": 101,  # 18.5^2 * 0.22 = 75.3 um^2
        "gen3-cd area^1": 75,
        "gen4-cd area^1": 24,
        "dvs-gen4 area^1": 7,
    }
    at_0_5 = read(tmp_path, f"{study}area_exponents = [0.5]").simulate
    found = {camera.name: model.cutoff_hz for camera, _, model in at_0_5.models()}
    area_um2 = find_camera("davis346").area_um2
    assert found["davis346 area^0.5"] == pytest.approx(201 * math.sqrt(area_um2 / 150.4))
    assert len([*read(tmp_path, study).simulate.models()]) == 6


def test_speeds_in_m_per_s_are_factors_on_each_scene(tmp_path) -> None:
    """Factor 1 is 0.9 m/s on carpet and 0.7 m/s on rocks, so 1.8 m/s is 2 and 2.571."""
    study = read(tmp_path, "speeds_m_s = [1.8]", QUIET)
    for name, factor in (("carpet", 2.0), ("rocks", 1.8 / 0.7)):
        (setting, *_) = jobs_of(study, load_scene(name))[0].settings(1.0)
        assert setting.speed == pytest.approx(factor)
        assert setting.speed_m_s == 1.8
    assert "speeds" not in to_json(study)["simulate"]  # the usual factors, which are not used


def test_a_bus_is_a_rate_or_that_of_a_camera(tmp_path) -> None:
    assert read(tmp_path, "bus_mev_s = 0.5").simulate.bus_mev_s == 0.5
    assert read(tmp_path, 'bus = "davis346"').simulate.bus_mev_s == 12.0
    (setting, *_) = jobs_of(read(tmp_path, "bus_mev_s = 0.5"), load_scene("carpet"))[0].settings(1)
    assert setting.readout is not None
    assert setting.readout.max_rate_hz == 5e5


def test_a_sensor_may_have_another_bus_than_the_study_or_none(tmp_path) -> None:
    """Promise: `bus` in a camera's table counts, also where it is unlimited or another camera's."""
    sensors = ", ".join(
        f'{{name = "{name}", width = {width}{bus}}}'
        for name, width, bus in (
            ("usual", 346, ""),
            ("fast", 240, ", bus = 20"),
            ("free", 128, ', bus = "unlimited"'),
            ("lent", 64, ', bus = "dvs128"'),
        )
    )
    study = read(tmp_path, f"widths = []\nbus_mev_s = 12.0\nsensors = [{sensors}]")
    settings = jobs_of(study, load_scene("carpet"))[0].settings(1)
    buses = {one.name: one.readout and one.readout.max_rate_hz for one in settings}
    assert buses == {"usual": 12e6, "fast": 20e6, "free": None, "lent": 1e6}


def test_a_camera_brings_its_own_bus(tmp_path) -> None:
    """Promise: a camera is whole, and so are the electronics of another: its bus goes before that
    of the study, which carries a camera of unknown bandwidth (ATIS); a table may say otherwise."""
    electronics = '{width = 64, electronics = "dvs128"}'
    sensors = f'"davis346", "atis", {electronics}, {{base = "gen4-cd", bus = "unlimited"}}'
    study = read(tmp_path, f"widths = []\nbus_mev_s = 2.0\nsensors = [{sensors}]")
    settings = jobs_of(study, load_scene("carpet"))[0].settings(1)
    buses = {one.name: one.readout and one.readout.max_rate_hz for one in settings}
    assert buses == {"davis346": 12e6, "atis": 2e6, "64x64": 1e6, "gen4-cd": None}


def test_a_sensor_may_have_another_queue_for_the_bus_of_the_study(tmp_path) -> None:
    """Promise: `fifo` and `row_overhead` alone are those of the study's bus at this sensor."""
    sensors = '{name = "late", width = 128, fifo = 1000}, {name = "usual", width = 64}'
    study = read(tmp_path, f"bus_mev_s = 12.0\nsensors = [{sensors}]")
    late, usual = map(study.simulate.readout, study.simulate.sensors)
    assert late == Readout(max_rate_hz=12e6, fifo_depth=1000)
    assert usual == Readout(max_rate_hz=12e6, fifo_depth=4096)
    with pytest.raises(StudyError, match=r"simulate.sensors: 'late': fifo needs a bus"):
        jobs_of(read(tmp_path, f"sensors = [{sensors}]"), load_scene("carpet"))


def test_the_bus_carries_something_at_the_fast_speed_too(tmp_path) -> None:
    """Physics: windows of flow at 10 times the base speed last 5 ms."""
    fast = "[evaluate.flow]\nfast_methods = ['initial_flow']\nfast_speed = 10.0"
    with pytest.raises(StudyError, match=r"bus_mev_s: an event takes 0\.01 s .* 0.005 s"):
        jobs_of(read(tmp_path, "bus_mev_s = 1e-4\nspeeds = [1]", fast), load_scene("carpet"))
    assert jobs_of(read(tmp_path, "bus_mev_s = 1e-4\nspeeds = [1]"), load_scene("carpet"))


def test_a_bus_that_carries_nothing_at_the_speeds_of_a_scene_is_refused(tmp_path) -> None:
    """Physics: windows are 50 ms of base time, so at 9 m/s, ten times the carpet's speed, 5 ms."""
    fast, slow = (read(tmp_path, f"bus_mev_s = 1e-4\nspeeds_m_s = [{v}]", QUIET) for v in (9, 0.45))
    with pytest.raises(StudyError, match=r"bus_mev_s: an event takes 0\.01 s .* 0.005 s"):
        jobs_of(fast, load_scene("carpet"))
    assert jobs_of(slow, load_scene("carpet"))


@pytest.mark.parametrize(
    ("simulate", "message"),
    [
        ("bus_mev_s = 1e-6", "bus_mev_s: an event takes 1 s .* 0.025 s"),
        (
            "sensors = [{width = 64, bus = 12, row_overhead = 1}]",
            "'64x64': bus: an event takes 1 s .* 0.025 s",
        ),
        (
            "bus_mev_s = 12\nsensors = [{width = 64, row_overhead = 1}, {width = 65}]",
            "'64x64': row_overhead: an event takes 1 s",
        ),
        (
            "sensors = [{width = 64, bus = 1e-4, row_overhead = 0.02}]",
            "'64x64': bus: an event takes 0.03 s",
        ),
    ],
)
def test_a_bus_that_carries_nothing_is_refused_by_its_sensor(tmp_path, simulate, message):
    with pytest.raises(StudyError, match=message):
        jobs_of(read(tmp_path, simulate, QUIET), load_scene("carpet"))


@pytest.mark.parametrize(
    ("simulate", "message"),
    [
        (
            "illuminance_lux = [1]\ncutoffs_hz = [1]",
            "give cutoffs_hz or illuminance_lux",
        ),
        ("speeds = [1]\nspeeds_m_s = [1]", "give speeds or speeds_m_s"),
        ('bus = "davis346"\nbus_mev_s = 1', "give bus or bus_mev_s"),
        ('bus = "davis364"', "simulate.bus: .*did you mean 'davis346'"),
        ('bus = "atis"', "simulate.bus: .* bus of 'atis'"),
        ("bus_mev_s = 0", "simulate.bus_mev_s: found 0.0, expected a positive number"),
        ("bus = 3", "simulate.bus: found 3, expected a string"),
        (
            'sensors = ["davis364"]',
            r"sensors\[0\]: camera: found 'davis364'; did you mean 'davis346'",
        ),
        ("sensors = [3]", r"simulate.sensors\[0\]: found 3, expected a name"),
        ("sensors = [{name = 3, width = 64}]", r"simulate.sensors\[0\]: name: found 3, expected"),
        ('sensors = ["imx636"]', r"sensors\[0\]: imx636: needs width and height"),
        ("sensors = [{leak = 3}]", r"sensors\[0\]: camera: needs width and height"),
        ("sensors = [{height = 9}]", r"sensors\[0\]: width, height: give both or neither"),
        ('sensors = [{base = "atis", height = 0}]', r"sensors\[0\]: height: found 0, expected"),
        (
            'sensors = ["davis346"]\nilluminance_lux = [0, 67]',
            "toml: simulate.illuminance_lux: found 0",
        ),
        ('sensors = [{width = 9, electronics = "davis34"}]', r"\[0\]: .* mean 'davis346'"),
        ("sensors = [{width = 9, leek = 1}]", r"sensors\[0\]: leek: unknown; .* mean 'leak'"),
        (
            'sensors = [{width = 9, leak = "a"}]',
            r"simulate.sensors\[0\]: leak: found 'a', expected",
        ),
        (
            'sensors = ["davis346", {name = "davis346", width = 9}]',
            r"simulate.sensors: found \('davis346', 'davis346'\), expected each once",
        ),
        ('sensors = ["none.toml"]', r"mine.toml: simulate.sensors\[0\]: .*none.toml: no such"),
        ("area_exponents = [1]", "simulate.area_exponents: .* simulate.illuminance_lux"),
        ("area_exponents = []\nilluminance_lux = [67]", "area_exponents: found none"),
        ("area_exponents = [2]\nilluminance_lux = [67]", "area_exponents: found 2.0, .* at most 1"),
        ("area_exponents = [1, 1]\nilluminance_lux = [67]", "area_exponents: .* each once"),
        ("frame_steps_px = [1]", "simulate.frame_steps_px: needs 'v2e'"),
        ('simulators = ["v2"]', r"simulators\[0\]: found 'v2', expected 'exact' or 'v2e' or"),
        ('simulators = ["v2e"]\nframe_steps_px = [0.7]', "found 0.7 px, .* multiple of 0.5 px"),
        (
            'simulators = ["v2e"]\nphotoreceptors = ["two_pole", "v2e"]',
            "photoreceptors: found 2, expected one beside 'v2e'",
        ),
        ("illuminance_lux = [9, 9]", r"lux: found \(9.0, 9.0\), expected each once"),
        ("speeds_m_s = [2, 2]", r"speeds_m_s: found \(2.0, 2.0\), expected each once"),
        ("contrast_thresholds = [0.2, 30]", "contrast threshold of 30, expected at most 27.7"),
        ('photoreceptors = ["v2e", "v2e"]', "photoreceptors: found .*expected each once"),
        ("buss = 3", "simulate.buss: unknown; did you mean 'bus'"),
        ("contrast_thresholds = [1e-12]", "toml: simulate: threshold: found 1e-12"),
        ("cutoffs_hz = [1e-308]", "simulate: found a cutoff of 1e-308 Hz, expected at least 0.001"),
        ('photoreceptors = ["v2"]', r"photoreceptors\[0\]: found 'v2', expected 'two_pole' or"),
    ],
)
def test_contradictions_are_refused_by_field_with_what_would_do(tmp_path, simulate, message):
    with pytest.raises(StudyError, match=message):
        read(tmp_path, simulate)


def test_a_flat_sensor_alone_is_refused_before_rendering(tmp_path) -> None:
    """Promise: the error names the sensor and the part of the frames that it sees, which is too low
    for the scaling statistics; after a larger sensor it is accepted."""
    flat, render = '{name = "flat", width = 320, height = 20}', "[render]\nresolution = 640"
    said = r"'flat' has 320x20 px, which see 640x40 px .* at least 62 px"
    with pytest.raises(StudyError, match=said):
        jobs_of(read(tmp_path, f"sensors = [{flat}]", render), load_scene("carpet"))
    after = read(tmp_path, f'sensors = ["davis346", {flat}]', render)
    assert jobs_of(after, load_scene("carpet"))


def test_a_named_sensor_may_be_the_slowest(tmp_path) -> None:
    """Promise: the error about the warm-up names it, with its own cutoff and the light it needs."""
    (tmp_path / "slow.toml").write_text(
        'title = "mine"\n[cutoff]\nvalue = 2\nunit = "kHz"\nsource = "measured"\n'
        '[illuminance]\nvalue = 1000\nunit = "lux"\nsource = "measured"'
    )
    sensors = 'sensors = [{name = "slow", width = 64, electronics = "slow.toml"}]\nwidths = [32]'
    said = r"6 time constants of 4 Hz of 'slow' at speed 2\), .* at least 7\.64 Hz \(3\.82 lux\)"
    with pytest.raises(StudyError, match=said):
        jobs_of(read(tmp_path, f"{sensors}\nilluminance_lux = [2]", QUIET), load_scene("carpet"))
    assert jobs_of(
        read(tmp_path, f"{sensors}\nilluminance_lux = [3.82]", QUIET), load_scene("carpet")
    )
    own = f"{sensors}\nilluminance_lux = [3.82]".replace('.toml"', '.toml", warm_up = 12')
    with pytest.raises(StudyError, match=r"12 time constants of 7\.64 Hz of 'slow'"):
        jobs_of(read(tmp_path, own, QUIET), load_scene("carpet"))


def test_the_warm_up_is_that_of_the_sensors(tmp_path) -> None:
    """Promise: the light of plain sensors does not count where there are none: at 1 lux they have
    3 Hz, but a camera of 1 kHz at 100 lux has 10 Hz."""
    (tmp_path / "fast.toml").write_text(
        'title = "mine"\n[cutoff]\nvalue = 1\nunit = "kHz"\nsource = "measured"\n'
        '[illuminance]\nvalue = 100\nunit = "lux"\nsource = "measured"'
    )
    alone = (
        'sensors = [{name = "fast", width = 64, electronics = "fast.toml"}]\nilluminance_lux = [1]'
    )
    study = read(tmp_path, f"{alone}\nspeeds = [1]", QUIET)
    assert study.simulate.longest_warm_up_s == pytest.approx(6 / (2 * math.pi * 10))
    assert jobs_of(study, load_scene("carpet"))
    with pytest.raises(StudyError, match="6 time constants of 3 Hz at speed 1"):
        jobs_of(
            read(tmp_path, f"{alone}\nspeeds = [1]\nwidths = [32]", QUIET), load_scene("carpet")
        )


def test_a_camera_finer_than_the_frames_is_refused(tmp_path) -> None:
    with pytest.raises(StudyError, match="'gen4-cd' has 1280x720 px, finer than"):
        read(tmp_path, 'sensors = ["gen4-cd"]', "[render]\nresolution = 640")
    tall = "[render]\nresolution = 640\nheight = 1280"
    read(tmp_path, 'sensors = [{name = "tall", width = 360, height = 700}]', tall)
    wide = "[render]\nresolution = 640\nheight = 200"
    with pytest.raises(StudyError, match="finer than the 200x200 px of the frames"):
        read(tmp_path, 'sensors = [{name = "square", width = 400, height = 400}]', wide)


@pytest.mark.parametrize(
    ("simulate", "rest", "message"),
    [
        (
            "cutoffs_hz = [1]",
            "",
            r"needs 1.91 s of path .* 7.64 Hz \(2.55 lux\), or every_s",
        ),
        ("speeds = [4]", "", "pose tracking in a window; expected at most 3.57, or no methods"),
        ("", "[render]\nevery_s = 30", "no sample fits the path of carpet, 10 s long, .* 19.9"),
        ("", "[render]\nsamples = 21", "found 21, expected 1 to 20"),
        (
            "speeds = [1e6]",
            QUIET,
            r"simulate.speeds: found 1e\+06 times .* expected 2.5e-05 to .* last 5e-08 s",
        ),
        (
            "speeds_m_s = [1e-12]",
            QUIET,
            r"simulate.speeds_m_s: found 1\.11111e-12 times .* last 4\.5e\+10 s",
        ),
        ("", "[render]\nwindow_s = 100", "a window of 100 s; shorten window_s"),
        (
            "",
            "[evaluate.tracking]\ntracking_window_s = 99",
            "a window of 99 s; shorten window_s or tracking_window_s",
        ),
    ],
)
def test_what_no_frame_can_give_is_refused_before_rendering(tmp_path, simulate, rest, message):
    with pytest.raises(StudyError, match=message):
        jobs_of(read(tmp_path, simulate, rest), load_scene("carpet"))


POSES = """
0.0 0.00 0 1  1 0 0 0
0.2 0.05 0 1  1 0 0 0
0.4 0.10 0 1  1 0 0 0
"""
GALLERY = """<scene version="3.0.0">
  <sensor type="perspective"><float name="fov" value="50"/></sensor>
  <emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>
  <shape type="rectangle" id="floor">
    <transform name="to_world"><scale value="3"/></transform>
    <bsdf type="diffuse"><texture type="checkerboard" name="reflectance">
      <transform name="to_uv"><scale value="60"/></transform>
    </texture></bsdf>
  </shape>
</scene>
"""


def own_study(folder: Path) -> Study:
    """A Mitsuba file with a path, lux and m/s; a flat sensor on a slow bus, one on a slow bus with
    an endless queue, one with noise, and one of the same width with an OFF threshold that is twice
    its ON threshold.
    """
    (folder / "gallery.xml").write_text(GALLERY)
    (folder / "poses.txt").write_text(POSES)
    text = f"""
    scenes = ["gallery.xml"]
    [trajectories]
    "gallery.xml" = "poses.txt"
    [render]
    resolution = 64
    spp = 4
    every_s = 0.3
    max_displacement_px = 1.0
    [simulate]
    widths = [32]
    sensors = [
      {{name = "flat", width = 60, height = 30, bus = 0.002, fifo = 50}},
      {{name = "late", width = 40, bus = 0.002, fifo = 1_000_000}},
      {{name = "noisy", width = 36, leak = 20, hot_pixels = 0.05, hot_pixel_rate = 500}},
      {{name = "apart", width = 36, threshold_off = 0.4}},
    ]
    illuminance_lux = [inf, 100]
    speeds_m_s = [0.5]
    photoreceptors = ["two_pole", "v2e"]
    {QUIET}
    """
    return read_study(written(folder, text))


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """The folder of a finished run."""
    folder = tmp_path_factory.mktemp("own")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ERES_CACHE", str(folder / "cache"))
        patch.setattr("tasks.study.run.compute.warn_of_noise", lambda *_: None)  # another test's
        run_study(own_study(folder), folder / "run")
    return folder / "run"


@pytest.fixture(scope="module")
def rows(run) -> list[Row]:
    return read_rows(run / "rows.parquet")


def test_rows_say_what_was_asked(rows) -> None:
    """Promise: sensor, lux, m/s, bus and reading are in each row; the path's 0.25 m/s make 0.5
    m/s a factor of 2."""
    assert {(r.sensor, r.width, r.bus_mev_s) for r in rows} == {
        ("", 32, math.inf),
        ("apart", 36, math.inf),
        ("noisy", 36, math.inf),
        ("late", 40, 0.002),
        ("flat", 60, 0.002),
    }
    assert {(r.cutoff_hz, r.illuminance_lux) for r in rows} == {(math.inf, 0.0), (300.0, 100.0)}
    assert {r.speed_m_s for r in rows} == {0.5}
    assert [*{r.speed for r in rows}] == pytest.approx([2.0], rel=1e-6)
    assert {r.scene for r in rows} == {"gallery"}
    by_kind = [[r for r in rows if r.photoreceptor == kind] for kind in ("two_pole", "v2e")]
    assert len(by_kind[0]) == len(by_kind[1]) == len(rows) / 2


def test_what_a_bus_drops_does_not_reach_the_methods(rows) -> None:
    """Physics: a bus of 2000 events/s and a queue of 50 take 50 + 50 events of a window of 25 ms,
    far fewer than the pixels fire, so reconstruction gains less than without a bus."""
    flat = [r for r in rows if r.sensor == "flat" and math.isinf(r.cutoff_hz)]
    sent = {r.event_rate_hz * (1 - r.dropped) * 0.025 for r in flat}
    assert 49 < max(sent) <= 101
    assert all(r.dropped > 0.5 for r in flat)
    assert {r.dropped for r in rows if not r.sensor} == {0.0}
    values = {r.method: r.value for r in flat}
    free = {r.method: r.value for r in rows if not r.sensor and math.isinf(r.cutoff_hz)}
    gains = [one["event_integration"] - one["no_events"] for one in (values, free)]
    assert gains[0] < 0.5 * gains[1]


def in_ideal_light(rows: list[Row], sensor: str) -> tuple[float, float, set[float]]:
    """Return the gain of reconstruction by events, events of a pixel per second, drops."""
    found = {r.method: r for r in rows if r.sensor == sensor and math.isinf(r.cutoff_hz)}
    gain = found["event_integration"].value - found["no_events"].value
    rate_hz = {r.event_rate_hz / r.width**2 for r in found.values()}
    return gain, *rate_hz, {r.dropped for r in found.values()}


def test_events_that_a_bus_delays_do_not_reach_the_methods_in_time(rows) -> None:
    """Physics: a queue without end drops nothing, but 2000 events/s leave the sensor after the
    window: the pixels fire as those of a sensor without a bus, and the image gains little."""
    gain, rate_hz, drops = in_ideal_light(rows, "late")
    free_gain, free_rate_hz, _ = in_ideal_light(rows, "")
    assert drops == {0.0}
    assert rate_hz == pytest.approx(free_rate_hz, rel=0.1)
    assert 0.0 < gain < 0.2 * free_gain


def test_a_noisy_sensor_and_one_with_two_thresholds_are_simulated_and_scored(rows) -> None:
    """Physics: a leak of 20 Hz and 5 % of the pixels at 500 Hz add up to 45 events a second to a
    pixel. With twice the OFF threshold a pixel that goes back and forth fires as often when light
    rises and half as often when it falls, or less, and the image, integrated with both
    thresholds, still gains."""
    free_gain, free_rate_hz, _ = in_ideal_light(rows, "")
    gain, rate_hz, _ = in_ideal_light(rows, "noisy")
    assert 20.0 < rate_hz - free_rate_hz < 45.0
    assert 0.0 < gain < free_gain
    gain, rate_hz, _ = in_ideal_light(rows, "apart")
    assert rate_hz < 0.75 * free_rate_hz
    assert 0.25 * free_gain < gain < free_gain


def test_words_are_those_of_the_question(rows) -> None:
    """Promise: tables say lux, m/s and the sensor's name, not Hz and factors."""
    (scores,) = by_photoreceptor(rows)["two_pole"]
    assert isinstance(scores, Scores)
    (series,) = scores.series()
    assert [cutoff_label(hz) for hz in scores.cutoffs_hz(series)] == ["ideal", "100 lux"]
    assert [speed_label("gallery", speed) for speed in scores.speeds(series)] == ["0.5 m/s"]
    (table,) = main_tables(scores)
    labels = [line_label(line, series) for line in table.blocks[0].lines]
    assert labels[:5] == ["32 px", "apart, 36 px", "noisy, 36 px", "late, 40 px", "flat, 60 px"]
    assert all(e.paper is None for line in table.blocks[0].lines for e in line.entries)


def test_two_sensors_of_one_width_are_apart_everywhere(run) -> None:
    """Promise: table, choice, plots, films, histograms, times and the lines of tables.csv have each
    of the five sensors by its name, though two of them are 36 px wide."""
    sensors = [(32, ""), (36, "apart"), (36, "noisy"), (40, "late"), (60, "flat")]
    labels = ["32 px", "apart", "noisy", "late", "flat"]
    finished = read_run(run)
    (series,) = finished.series
    assert finished.scores.sensors(series) == sensors
    for light in finished.scores.cutoffs_hz(series):
        choice = choose(finished.scores, series, "gallery", light, MetersPerSecond(0.5))
        assert choice is not None
        assert [*choice.event_rates_hz] == sensors
        assert len({*choice.event_rates_hz.values()}) == 5
    (drawn,) = tradeoff_plots(finished, series).values()
    (intervals,) = (interval_plot(one) for one in finished.scaling.values())
    for shown in (drawn, intervals):
        assert [key.name for key in shown.keys] == labels
        assert len({key.color for key in shown.keys}) == 5
    (pictures,) = finished.previews.values()
    films = [one for one in pictures if one.shows_film]
    assert [one.caption for one in films] == 2 * labels
    assert len({(run / "previews" / one.file).read_bytes() for one in films}) == 10
    assert [one.text for one in method_table(finished.timings).heads[1:-2]] == labels
    page_of(run)  # writes tables.csv
    with (run / "tables.csv").open() as file:
        lines = [one for one in csv.DictReader(file) if one["method"] == "event_integration"]
    assert Counter((int(one["width"]), one["sensor"]) for one in lines) == Counter(2 * sensors)


def test_the_page_says_lux_for_every_sensor(run) -> None:
    """Promise: pictures and tables have the light of the question."""
    page = page_of(run)
    assert "100 lux" in page
    assumed = read_run(run).assumes
    assert [line.partition(":")[0] for line in assumed] == [
        "plain",
        "flat",
        "late",
        "noisy",
        "apart",
    ]
    assert "late: 40x40; C 0.2; ideal pixels; 100 lux: cutoff 300 Hz" in assumed[2]
    assert "bus 0.002 Mev/s" in assumed[2]
    assert all(escape(line) in page for line in assumed)
    assert "flat, 60 px" in page
    assert re.search(r"share of a window's events that it lost: late 0\s%, flat \d+", page)
    assert 'id="bus"' not in page
    assert '"name": "flat"' in page
    with (run / "tables.csv").open() as file:
        lines = [*csv.DictReader(file)]
    assert {one["illuminance_lux"] for one in lines} == {"", "100.0"}
    assert {(one["speed"], one["speed_m_s"]) for one in lines} == {("", "0.5")}
    (pictures,) = read_run(run).previews.values()
    assert {cutoff_label(one.cutoff_hz) for one in pictures} == {"ideal", "100 lux"}


def test_pictures_and_histograms_have_the_lux_of_the_study(tmp_path) -> None:
    """Promise: lux of any number of digits."""
    lux = {math.inf: 0.0, 200.0: 66.6666667, 50.0: 1234.567}
    rows = [
        replace(row, illuminance_lux=lux[row.cutoff_hz], cutoff_hz=cutoff_of(lux[row.cutoff_hz]))
        for row in paper_rows(samples=1, scenes=["carpet"])
    ]
    run = make_run(tmp_path, rows)
    add_previews(run)
    index = run / "previews" / "index.json"
    (picture, *_) = json.loads(index.read_text())
    lights = [{"cutoff_hz": repr(cutoff_of(one)), "illuminance_lux": one} for one in lux.values()]
    index.write_text(json.dumps([{**picture, **light} for light in lights]))
    (run / "scaling").mkdir()
    stored = [
        replace(one, cutoff_hz=cutoff_of(lux[one.cutoff_hz]), illuminance_lux=lux[one.cutoff_hz])
        for one in made().intervals
    ]
    for name, content in scaling_files(
        replace(made(), intervals=tuple(stored)), np.ones((64, 64))
    ).items():
        (run / "scaling" / name).write_bytes(content)
    page = page_of(run)
    assert re.findall(r"<h4>(.*?) <small>", page) == ["ideal", "1234.57 lux", "66.6667 lux"]
    assert re.findall(r'"label": "(\(c\) .*?)"', page) == ["(c) ideal", *["(c) 66.6667 lux"] * 2]


def cutoff_of(illuminance_lux: float) -> float:
    """Return the cutoff of plain sensors, Hz; ideal at 0."""
    return cutoff_in_light(illuminance_lux) if illuminance_lux else math.inf


def test_a_folder_beside_the_file_stays_a_folder(tmp_path, monkeypatch) -> None:
    """Promise: "./carpet" in a file is not the packaged carpet, and keeps its path of poses."""
    monkeypatch.chdir(tmp_path)
    text = 'scenes = ["./carpet/"]\n[trajectories]\n"./carpet/" = "poses.txt"\n'
    Path("own.toml").write_text(text)
    study = read_study(Path("own.toml"))
    assert study.scenes == ("./carpet",)
    assert with_scenes(study, ["./carpet"]).trajectories == {"./carpet": "poses.txt"}


@pytest.fixture
def asked(monkeypatch) -> list[Study]:
    """Return the studies that commands ask for; each ends with the error "enough"."""
    found: list[Study] = []

    def run(study: Study, *given: object, **options: object) -> None:
        found.append(study)
        raise StudyError("enough")

    monkeypatch.setattr("tasks.study.run.run_study", run)
    return found


def test_sensor_tables_are_read_by_the_command_too(tmp_path, eres, asked) -> None:
    """Promise: `eres study` reads the cameras of a file as `read_study` does."""
    file = tmp_path / "cameras.toml"
    table = '{width = 64, electronics = "davis346", leak = 0.2, bus = "dvs128"}'
    file.write_text(f'scenes = ["carpet"]\n[simulate]\nwidths = []\nsensors = [{table}]\n')
    _, _, err = eres("study", file, "--out", tmp_path / "run")
    assert err == "error: enough\n"
    assert asked == [read_study(file)]
    (camera,) = asked[0].simulate.sensors
    assert (camera.leak_hz, camera.bus_hz) == (0.2, 1e6)


def test_options_name_photoreceptors_and_a_path(tmp_path, eres, asked) -> None:
    """Promise: `eres study` passes both to the study, and refuses a path for several scenes."""
    options = ["--photoreceptor", "two_pole", "v2e", "--trajectory", "poses.txt"]
    eres("study", "--scenes", "gallery.xml", *options, "--out", tmp_path / "run")
    assert asked[0].simulate.photoreceptors == ("two_pole", "v2e")
    assert asked[0].trajectories == {"gallery.xml": "poses.txt"}
    code, _, err = eres("study", "--preset", "paper", *options, "--out", tmp_path / "run")
    assert (code, len(asked)) == (1, 1)
    assert "trajectory: 3 scenes" in err


@pytest.mark.parametrize(
    ("said", "kept"),
    [
        ("my/street", True),
        ("my/street/", True),
        ("./my/street", True),
        ("carpet", True),
        ("./carpet", False),
        ("carpet/", False),
    ],
)
def test_a_path_of_the_study_is_found_by_any_name_of_its_scene(said, kept) -> None:
    """Promise: the command line may write a folder in another way, as shells complete it; a folder
    is not the packaged scene of its name."""
    paths = {"my/street": "poses.txt", "carpet": "own.txt"}
    study = replace(Study(name="own", scenes=("my/street", "carpet")), trajectories=paths)
    found = with_scenes(study, [said])
    file = "poses.txt" if "street" in said else "own.txt"
    assert found.trajectories == ({said: file} if kept else None)


def test_sensors_of_two_shapes_are_one_job(run):
    """Promise: its costs count once, and its frames as rendered once."""
    jobs = json.loads((run / "study.json").read_text())["jobs"]
    assert sorted(file.stem for file in (run / "costs").iterdir()) == sorted(jobs)
    for one in read_timings(run / "costs", jobs):
        assert one.frames == 2 * one.rendered_frames > 0  # read for each shape
        assert (one.resolution, one.height) == (64, 64)
        assert one.sensors == 5 * (1 + 2)  # ideal, and 100 lux with both photoreceptors
