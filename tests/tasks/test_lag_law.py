"""The lag law, and the table of stored cases in the package."""

import hashlib
import math
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from benchmark_files import FOLDER, benchmark
from sensor import SensorModel, simulate
from tasks.advice.law import CROSSING_PX, NEAR_PX, chosen, delay_s, finer_wins, lag_px
from tasks.advice.stored import TABLE, Window, cases_of, stored_windows
from tasks.errors import ResultError
from tasks.row import Row, write_rows
from tasks.study.config import preset
from tasks.study.settings import AREA

ROOT = Path(__file__).parents[2]
RUNS = "docs/results/paper", "docs/results/slider"
LAW = benchmark("lag_law")


def share_right(cases, crossing_px=CROSSING_PX):
    right = [finer_wins(case.lag_px, crossing_px) == case.finer_won for case in cases]
    return round(100 * np.mean(right), 1)


def test_the_delay_is_that_of_the_simulated_pixel():
    """Physics: a slow ramp of log light comes out of two poles 1 / (pi f) late."""
    cutoff_hz, C, slope = 100.0, 0.05, 10.0
    t_s = np.linspace(0, 0.4, 4001)
    light = np.exp(slope * np.maximum(t_s - 0.1, 0))[:, None, None]
    model = SensorModel(width=1, height=1, contrast_threshold=C, cutoff_hz=cutoff_hz, dark_level=0)
    events = simulate(light, t_s, model)
    late = 1e-6 * events.t_us[-1] - (0.1 + len(events) * C / slope)
    assert late == pytest.approx(delay_s(cutoff_hz), abs=2e-5)


def test_the_lag_is_the_way_of_the_image_during_the_delay():
    """Promise: v / (pi f), and none with ideal pixels."""
    assert lag_px(550.0, 200.0) == pytest.approx(550 / (200 * math.pi))
    assert lag_px(550.0, math.inf) == 0
    assert (finer_wins(0.99), finer_wins(1.01)) == (True, False)


@pytest.mark.parametrize(
    ("lags", "index"),
    [([0.1, 0.2, 0.4], 2), ([0.1, 0.9, 1.1], 1), ([5.0, 9.0, 0.1], 0), ([7.0], 0)],
)
def test_the_ladder_ends_where_a_finer_width_does_not_win(lags, index):
    """Promise: from the coarsest on, as long as the next finer one wins; no step is left out."""
    assert chosen(lags) == index


def test_a_window_has_a_case_for_each_pair():
    """Promise: lags in px of the finer one, margins are finer minus coarser; ideal has no case."""
    widths = {"widths": (100, 200, 400), "psnr_db": (10.0, 12.0, 11.5)}
    plain = Window("run", "scene", 0, 100.0, 1.0, 400 * math.pi, **widths, events_per_px=(1, 1, 1))
    first, second = plain.cases()
    assert (first.width, first.coarser, second.width, second.coarser) == (200, 100, 400, 200)
    assert (first.lag_px, second.lag_px) == pytest.approx((2, 4))
    assert (first.margin_db, second.margin_db) == (2.0, -0.5)
    assert (first.finer_won, second.finer_won) == (True, False)
    assert [*plain._replace(cutoff_hz=math.inf).cases()] == []


@pytest.fixture(scope="module")
def stored():
    """Windows of the stored runs, by run."""
    return {run: LAW.windows_of_run(ROOT / run) for run in RUNS}


@pytest.mark.slow
def test_the_table_is_what_the_stored_runs_say(stored, tmp_path):
    """Promise: `python benchmarks/lag_law.py docs/results/paper docs/results/slider --write` wrote
    it; it has at most 100 kB, and reads as it was written."""
    windows = [one._replace(run=run) for run, inside in stored.items() for one in inside]
    LAW.write_windows(tmp_path / TABLE, windows)
    text = files("tasks.advice").joinpath(TABLE).read_text()
    assert (tmp_path / TABLE).read_text() == text
    assert len(text) <= 100_000
    assert [*stored_windows()] == windows


def test_the_preset_divides_one_chip():
    """Promise: one width of silicon and one lens, and cutoffs that go with a pixel's area."""
    for camera in preset("chip").simulate.sensors:
        assert camera.width * camera.pitch_um == pytest.approx(1280 * 4.86)
        power = float(camera.name.partition(AREA)[2].partition(",")[0])
        area = (640 / camera.width) ** 2
        assert camera.cutoff_hz == pytest.approx(200 * area**power)


@pytest.mark.slow
def test_the_chip_is_as_its_page_says(monkeypatch):
    """Promise: how many widths of docs/predictions/chip.toml are right, and what following them
    costs, as in the table of docs/chip.md; and those of the texture that `eres advise` asks
    where cutoffs differ."""
    monkeypatch.syspath_prepend(FOLDER)  # it shares a function with lag_law.py
    chip = benchmark("chip")
    found = [*chip.ladders(chip.medians(ROOT / "docs/results/chip"))]
    page, lines = (ROOT / "docs/chip.md").read_text(), 0
    for rule, choice in chip.RULES.items():
        for exponent in chip.EXPONENTS:
            own = [(at, scores) for power, at, scores in found if power == exponent]
            each = [max(scores.values()) - scores[choice(exponent, at)] for at, scores in own]
            right = f"{sum(one <= chip.NEAR_DB for one in each)} of 12"
            costs = f"{np.mean(each):.2f} | {max(each):.2f}"
            lines += f"| {rule} | area^{exponent} | {right} | {costs} |" in page
    assert lines == 6


@pytest.mark.slow
def test_how_often_the_law_is_right(stored):
    """Promise: the shares on docs/what_decides.md, and that 1 px is not fitted."""
    cases = cases_of(stored[RUNS[0]])
    far = [case for case in cases if not NEAR_PX[0] <= case.lag_px <= NEAR_PX[1]]
    assert (len(cases), len(far)) == (1440, 1121)
    assert (share_right(cases), share_right(far)) == (92.7, 98.0)
    others = [share_right(cases, at) for at in (0.8, 0.9, 1.1, 1.2)]
    assert others == [89.3, 91.5, 93.3, 91.3]
    unseen = cases_of(stored[RUNS[1]])
    assert (len(unseen), share_right(unseen)) == (540, 95.6)


PAGE = "".join((ROOT / "docs" / f"{p}.md").read_text() for p in ("what_decides", "lag_tests"))


def lines_on_the_page(capsys):
    """Return how many lines of the printed tables the page has."""
    lines = [one for one in capsys.readouterr().out.splitlines() if one.startswith("| ")]
    return sum(f"{one}\n" in PAGE for one in lines), len(lines)


@pytest.mark.slow
def test_the_page_has_the_tables_of_the_command(stored, capsys):
    """Promise: docs/what_decides.md says what `python benchmarks/lag_law.py` prints."""
    for run, count in zip(RUNS, (5, 5), strict=True):
        cases = cases_of(stored[run])
        LAW.print_shares({Path(run).name: cases, **LAW.grouped(cases, lambda case: case.scene)})
        assert lines_on_the_page(capsys) == (count, count)
    LAW.print_margins(cases_of(stored[RUNS[0]]))
    LAW.print_regrets(stored[RUNS[0]])
    assert lines_on_the_page(capsys) == (16, 16)


@pytest.fixture(scope="module")
def unseen():
    """The benchmark that predicts before it measures, and what it measured."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(FOLDER)  # it takes its tables from another benchmark
        module = benchmark("lag_predictions")
    return module, module.seen()  # which ends if the predictions were changed since


def test_the_predictions_are_those_that_were_frozen(unseen):
    """Promise: docs/predictions/lag.toml has not changed since it was measured, has a prediction
    for each case, and these follow from the law."""
    law, seen = unseen
    digest = hashlib.sha256((ROOT / "docs/predictions/lag.toml").read_bytes()).hexdigest()
    assert (
        (ROOT / "docs/predictions/lag.csv")
        .read_text()
        .startswith(f"# sha256 of lag.toml: {digest}")
    )
    assert len(seen) == 8 * 2 * 2 * 2 * 8 * 3  # places, paths, windows, poles, cutoffs, thresholds
    for each in seen:
        for sign, width in zip(each.predicted, law.WIDTHS[1:], strict=True):
            lag = each.window.lag_px(width) * each.poles / 2
            crossing = {2: 1.0, 1: 3.0}[each.poles]
            expected = "+" if lag < 0.7 * crossing else "=" if lag <= 1.4 * crossing else "-~"
            assert sign in expected


def test_the_page_has_the_tables_of_the_predictions(unseen, capsys):
    """Promise: docs/lag_tests.md has what `python benchmarks/lag_predictions.py` prints."""
    law, seen = unseen
    for poles in (2, 1):
        law.print_shares(seen, poles)
        assert lines_on_the_page(capsys) == (10, 10)
    law.print_regrets(seen)
    assert lines_on_the_page(capsys) == (7, 7)


@pytest.mark.slow
def test_the_page_has_the_delays_of_the_command(stored, capsys):
    """Promise: its tables of flow and tracking are the lines of base speed."""
    LAW.print_delays(ROOT / RUNS[0], stored[RUNS[0]])
    assert lines_on_the_page(capsys) == (12, 22)  # of two heads, and ten and ten lines


@pytest.mark.slow
def test_the_crossing_follows_the_detail_along_the_motion():
    """Physics: at a lag of 0.8 px the finer sensor wins with detail in all directions, loses with
    stripes across the motion; at 3 px it loses with two poles, and not with one."""
    textures = benchmark("lag_textures")
    frames = {
        kind: textures.frames_of(textures.texture(kind, 0), 130)
        for kind in ("all directions", "stripes")
    }

    def margin(kind, lag, photoreceptor):
        return textures.margins(frames[kind], lag, photoreceptor, 0.2, 0)[-1]

    assert margin("all directions", 0.8, "two_pole") > 0 > margin("stripes", 0.8, "two_pole")
    assert margin("all directions", 3.0, "one_pole") > 0 > margin("all directions", 3.0, "two_pole")


def test_a_run_without_the_speed_of_its_image_is_refused(tmp_path):
    """Promise: one line that names the folder and what to score."""
    condition = {"width": 64, "cutoff_hz": 200.0, "contrast_threshold": 0.2, "speed": 1.0}
    score = {"metric": "psnr_db", "value": 17.7, "event_rate_hz": 3e6}
    row = Row("carpet", "reconstruction", "event_integration", **condition, sample=0, **score)
    write_rows(tmp_path / "rows.parquet", [row])
    (tmp_path / "study.json").write_text('{"render": {"resolution": 64, "window_s": 0.05}}')
    with pytest.raises(ResultError, match=rf"^{tmp_path}: .* zero_flow"):
        LAW.windows_of_run(tmp_path)
