"""The pages quick_start, sensors, cameras, fit, live, learning and dataset: all steps run.

They run from top to bottom."""

import re
from pathlib import Path

import pytest

from docs_page import follow
from eres_render.rendering.backend import select_variant
from sensor.formats import load_events

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def quick_start(tmp_path_factory):
    """Return a folder after all steps of the page, and the output of its commands."""
    folder = tmp_path_factory.mktemp("quick_start")
    return folder, follow("quick_start.md", folder)


@pytest.fixture(scope="module")
def sensors(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sensors")
    return folder, follow("sensors.md", folder)


@pytest.mark.slow
def test_the_quick_start_leads_to_scores_next_to_those_of_doing_nothing(quick_start):
    _, said = quick_start
    for method in ("event_integration", "no_events", "photometric_flow", "initial_flow"):
        assert re.search(rf"^\s*{method}\s", said, re.MULTILINE), method


@pytest.mark.slow
def test_the_quick_start_converts_every_event(quick_start):
    folder, _ = quick_start
    assert len(load_events(folder / "events.raw")) == len(load_events(folder / "events.h5")) > 100


@pytest.mark.slow
def test_each_sensor_of_the_page_is_the_one_that_was_asked_for(sensors):
    folder, _ = sensors
    widths = {file.stem: load_events(file).model.width for file in folder.glob("*.h5")}
    assert widths.pop("dvs128") == 128
    assert widths.pop("mine") == 112
    named = {"plain", "mine_on_96", "dusk", "own_light", "noisy", "v2e_noisy", "slow_bus"}
    assert widths == dict.fromkeys(named, 96)
    assert load_events(folder / "dusk.h5").model.cutoff_hz == pytest.approx(51)
    assert load_events(folder / "noisy.h5").model.threshold_mismatch == 0.03
    mine = load_events(folder / "mine_on_96.h5").model
    assert (mine.contrast_threshold, mine.contrast_threshold_off, mine.leak_hz) == (0.2, None, 0.2)
    assert mine.cutoff_hz == pytest.approx(100.0)
    v2e = load_events(folder / "v2e_noisy.h5").model
    assert (v2e.photoreceptor, v2e.cutoff_hz, v2e.leak_hz) == ("v2e", 30.0, 0.0)


@pytest.mark.slow
def test_a_slow_bus_drops_events(sensors):
    folder, said = sensors
    assert "events fired" in said
    assert 0 < len(load_events(folder / "slow_bus.h5")) < len(load_events(folder / "plain.h5"))


@pytest.mark.slow
def test_the_page_of_cameras_prints_what_it_shows(tmp_path):
    if select_variant().startswith("scalar"):
        pytest.skip("scalar variants render pinholes only")
    follow("cameras.md", tmp_path)


@pytest.mark.slow
def test_the_page_of_fitted_cameras_prints_what_it_shows(tmp_path):
    """Promise: the fitted camera simulates as many events as the recording has."""
    follow("fit.md", tmp_path)
    real, again = (load_events(tmp_path / f"{name}.h5") for name in ("recording", "again"))
    assert len(again) == pytest.approx(len(real.between(0, 396_000)), rel=0.02)


@pytest.mark.slow
def test_the_page_of_live_cameras_prints_what_it_shows(tmp_path):
    """Promise: a video, v2e's interface and a camera turned by its events work as shown."""
    follow("live.md", tmp_path)


@pytest.mark.slow
def test_the_page_for_networks_has_windows_with_flow(tmp_path):
    follow("learning.md", tmp_path)  # asserts shapes
    assert (tmp_path / "data" / "clip_001.h5").is_file()


@pytest.mark.slow
def test_the_page_of_random_scenes_makes_all_that_it_shows(tmp_path):
    said = follow("dataset.md", tmp_path)
    for found in ("data/000000/events_200.h5", "images/images.json", "again/continuous"):
        assert (tmp_path / found).exists()
    assert "data: 2 sequences" in said
    assert "images: 4 images" in said


@pytest.mark.slow
def test_the_claim_of_your_own_is_judged_on_the_stored_run(monkeypatch, capsys):
    """Promise: the lines of docs/study.md print a verdict, our numbers, and the paper's."""
    monkeypatch.chdir(ROOT)
    page = (ROOT / "docs" / "study.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", page[page.index("## Your own claim") :], re.DOTALL)
    exec(compile(code, "study.md", "exec"), {})
    status, *numbers = capsys.readouterr().out.splitlines()
    assert status == "holds"
    assert re.match(
        r"carpet: 240 over 128 px \+\d\.\d\d \[\+\d\.\d\d, \+\d\.\d\d; n \d+\.?\d*, r 0\.\d\d\] dB",
        numbers[0],
    )
    assert "carpet: 240 over 128 px +1.61 dB" in numbers
