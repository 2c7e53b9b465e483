"""Promise: claims about networks follow the rows, and are not measured without weights; and what
is printed beside a claim does not decide it."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from study_rows import EI, EPF, EPPT, FAST, HF, Change, paper_rows
from tasks.errors import ResultError
from tasks.row import Row, write_rows
from tasks.study.claims.claim import SceneClaim
from tasks.study.claims.judge import CLAIMS, claims_of, judge_all, judge_readings
from tasks.study.claims.training import TRAINING_CLAIMS
from tasks.study.claims.verdict import Status, Verdict
from tasks.study.config import preset
from tasks.study.results.asked import Condition, Series
from tasks.study.results.intervals import Interval, estimate
from tasks.study.results.run_files import scores_of_run
from tasks.study.results.scores import Scores

E2VID = Series("video", "e2vid", "psnr_db")
ERAFT = Series("dense_flow", "eraft", "rnepe_px")
SERIES = {"10 E2VID": E2VID, "11 E2VID": E2VID, "17 E-RAFT": ERAFT, "21 E-RAFT": ERAFT}
INF = math.inf


def same(width: int, cutoff_hz: float, speed: float, value: float) -> float:
    return value


def verdict(name: str, rows: Sequence[Row]) -> Verdict:
    """Return the verdict on the claim with this number and start of its title."""
    number, _, start = name.partition(" ")
    named = [c for c in CLAIMS if c.number == int(number) and c.title.startswith(start)]
    (found,) = judge_all(rows, {}, named)
    return found


def rows_for(name: str, change: Change = same) -> list[Row]:
    """Return rows with the paper's medians; the claim that compares two methods needs both."""
    other = paper_rows(EPF, scenes=("carpet",)) if name.startswith("21") else []
    return other + paper_rows(SERIES[name], change)


FAILURES: dict[str, Change] = {
    "10 E2VID": lambda w, c, s, v: v + 3 * (w == 346 and c == 50),
    "11 E2VID": lambda w, c, s, v: v + 3 * (w == 1280 and c == 50),
    "17 E-RAFT": lambda w, c, s, v: v * (2 if w == 640 and c == 200 and s == 2 else 1),
    "21 E-RAFT": lambda w, c, s, v: v * (9 if w == 240 and c == 50 else 1),
}


@pytest.mark.parametrize("name", SERIES)
def test_the_papers_own_numbers_uphold_its_claims(name: str) -> None:
    """Rows with the paper's medians: the claim holds, with an interval; a change breaks it."""
    found = verdict(name, rows_for(name))
    assert found.status is Status.HOLDS
    assert "[" in found.ours
    assert found.paper.startswith("carpet: ")
    broken = verdict(name, rows_for(name, FAILURES[name]))
    assert broken.status is Status.DOES_NOT_HOLD


@pytest.mark.parametrize("name", SERIES)
def test_without_rows_of_the_network_nothing_is_measured(name: str) -> None:
    """A run without weights: the verdict is "not measured", and says what is missing."""
    found = verdict(name, paper_rows(HF) + paper_rows(EPF))
    assert found.status is Status.NOT_MEASURED
    assert found.ours == f"no rows of {name[3:]} on carpet, which is a network"


def test_a_comparison_needs_rows_of_both_methods() -> None:
    """Rows of E-RAFT alone: its growth is not compared, and the text names what is missing."""
    found = verdict("21 E-RAFT", paper_rows(ERAFT))
    assert found.status is Status.NOT_MEASURED
    assert "not measured, missing 128 px, ideal, speed 1" in found.ours
    assert found.ours.endswith("of photometric flow")


def test_at_9_m_per_s_the_paper_has_the_same_order() -> None:
    """The note of claim 17: the error falls from each width to the next there too."""
    for cutoff_hz in (INF, 200.0, 50.0):
        errors = [
            r.value
            for r in paper_rows(ERAFT, samples=1)
            if (r.cutoff_hz, r.speed) == (cutoff_hz, FAST)
        ]
        assert errors == sorted(errors, reverse=True)


def test_what_is_beside_a_claim_is_printed_and_does_not_decide() -> None:
    """Other methods and variants have a line each, with whether the claim would hold with them;
    also where the method itself has no rows; and networks of E2VID's family on other scenes too."""
    worse = paper_rows(EI, lambda w, c, s, v: v - w / 100, method="event_integration_nearest")
    found = verdict("4 Daylight", paper_rows(EI) + worse)
    assert found.status is Status.HOLDS
    lines = [line for line in found.ours.splitlines() if "event integration nearest" in line]
    assert len(lines) == 3
    assert lines[0].startswith("carpet, event integration nearest: best ")
    assert all(line.endswith("(does not hold)") for line in lines)
    plain = HF._replace(variant="equalization none")
    other = paper_rows(plain, lambda w, c, s, v: v + (w == 240) * (c == 50))
    found = verdict("10 High-pass", paper_rows(HF, FAILURES["10 E2VID"]) + other)
    assert found.status is Status.DOES_NOT_HOLD
    assert "carpet, high-pass filter, equalization none: ideal: best " in found.ours
    assert found.ours.endswith("(holds)")
    family = [
        replace(row, scene=scene)
        for scene in ("carpet", "rocks")
        for row in paper_rows(E2VID, method="firenet")
    ]
    for name, scores in (("10 E2VID", "ideal: best "), ("11 E2VID", "11.39 dB at 128 px")):
        substituted = verdict(name, family)
        assert substituted.status is Status.NOT_MEASURED
        absent, *lines = substituted.ours.splitlines()
        assert absent.startswith("no rows of E2VID on carpet")
        assert [line.partition(scores)[0] for line in lines] == [
            "carpet, FireNet: ",
            "rocks, FireNet: ",
        ]
    oracle = paper_rows(E2VID, method="late_truth")
    alone = verdict("11 E2VID", oracle)
    assert alone.status is Status.NOT_MEASURED
    assert alone.ours.splitlines()[0].startswith("no rows of E2VID on carpet")
    assert alone.ours.splitlines()[1].startswith("carpet, late truth: 11.39 dB at 128 px")
    far = paper_rows(EPPT._replace(variant="sigma 200 mm"))
    far = [replace(row, failure="no convergence") for row in far]
    found = verdict("20 Pose", paper_rows(EPPT) + far)
    assert "carpet, photometric tracking, sigma 200 mm: speed 1: best " in found.ours


OURS = {"23 Trained at night, a network rec": HF, "23 Trained at night, a network est": ERAFT}


def twin_rows(series: Series, network: str, at_night: float, all_light: float) -> list[Row]:
    """The ideal-light twin has the paper's medians; the other differs, at 1280 px at night more."""
    ideal = paper_rows(series, method=network.format("ideal_light"))
    rows = paper_rows(
        series,
        lambda w, c, s, v: v + all_light + (at_night if (w, c) == (1280, 50.0) else 0.0),
        method=network.format("all_light"),
    )
    return ideal + rows


@pytest.mark.parametrize("name", OURS)
def test_training_at_night_overcomes_the_trend_if_the_finest_is_best_and_beats_the_twin(
    name: str,
) -> None:
    """Promise: claim 23 asks for the lead of 1280 px at night and for a gain over the twin, paired
    by image; without weights it is not measured."""
    series, better = OURS[name], 1 if OURS[name] is HF else -1
    network = "our_reconstruction_{}" if series is HF else "our_flow_{}"

    def twins(at_night: float, all_light: float) -> list[Row]:
        return twin_rows(series, network, at_night * better, all_light * better)

    found = verdict(name, twins(at_night=9.0, all_light=0.5))
    assert found.status is Status.HOLDS
    assert "over the twin +9.50" in found.ours
    assert "+0.50" in found.ours.partition("at night, ")[2]
    assert found.paper == "only the sentence, no numbers"
    if series is HF:  # at night the filter, and so this network, is best at 240 px
        assert verdict(name, twins(at_night=0.0, all_light=0.5)).status is Status.DOES_NOT_HOLD
    assert verdict(name, twins(at_night=9.0, all_light=-20)).status is Status.DOES_NOT_HOLD
    assert verdict(name, paper_rows(HF)).status is Status.NOT_MEASURED


def test_other_sensors_are_judged_on_the_claims_about_training_alone() -> None:
    """Promise: the paper's claims are not judged with a light, a camera or a shape that it does not
    have; claim 23 is, with any further light."""
    rows = twin_rows(HF, "our_reconstruction_{}", at_night=9.0, all_light=0.5)
    slower = [replace(row, cutoff_hz=20.0) for row in rows if row.cutoff_hz == 50.0]
    assert claims_of({}, Scores(rows)) is CLAIMS
    assert claims_of({}, Scores(rows, square=False)) is TRAINING_CLAIMS
    camera = [replace(row, sensor="davis346") if row.width == 346 else row for row in rows]
    assert claims_of({}, Scores(camera)) is TRAINING_CLAIMS
    (found,) = judge_readings({}, {"two_pole": Scores(rows + slower)}, {}).values()
    assert [one.status for one in found] == [Status.HOLDS, Status.NOT_MEASURED]
    assert "; 20 Hz: lead of 1280 px +" in found[0].ours
    assert ", over the twin +9.50" in found[0].ours.partition("20 Hz")[2]
    assert "100 Hz" not in found[0].ours
    alone = [row for row in slower if row.method == "our_reconstruction_all_light"]
    assert judge_readings({}, {"two_pole": Scores(alone)}, {}) == {"two_pole": []}


ABLATED = (4, 9, 10, 12, 14, 16, 19, 20)


def test_the_ablations_are_what_the_claims_print_beside_their_own() -> None:
    """Promise: preset `ablations` computes every line beside these claims, and its own numbers."""
    evaluate = preset("ablations").evaluate
    video, tracking = evaluate["video"], evaluate["tracking"]
    variants = {f"equalization {name}" for name in video.other_equalizations}
    variants |= {f"sigma {sigma_mm:g} mm" for sigma_mm in tracking.sigmas_mm}
    for claim in CLAIMS:
        if claim.number not in ABLATED or claim.series.method == "e2vid":
            continue
        assert isinstance(claim, SceneClaim)
        assert claim.beside, claim.title
        settings = evaluate[claim.series.task]
        methods = {*settings.methods, *getattr(settings, "fast_methods", ())}
        assert claim.series.method in methods
        for change in claim.beside:
            ours = "with_delay" in change.get("method", "")  # in preset `paper`
            assert ours or {*change.values()} <= methods | variants


def test_runs_with_other_weights_are_judged_together(tmp_path: Path) -> None:
    """Promise: intervals over trainings are as wide as Student's t makes those of so few, however
    alike the images are; runs that differ in more than weights, or not in weights, are refused,
    with the first field that differs."""

    def run(name: str, gain: float, **study: object) -> Path:
        folder = tmp_path / name
        folder.mkdir()
        rows = twin_rows(HF, "our_reconstruction_{}", at_night=9.0, all_light=gain)
        write_rows(folder / "rows.parquet", rows)
        weights = {"our_reconstruction_all_light": f"{name}.pt"}
        config = {"jobs": [name], "evaluate": {"video": {"weights": weights}}, **study}
        (folder / "study.json").write_text(json.dumps(config))
        return folder

    def over_twin(*folders: Path) -> str:
        ((scores,),) = scores_of_run(*folders).values()
        (verdicts,) = judge_readings({}, {"": scores}, {}).values()
        found = next(one for one in verdicts if one.number == 23)
        assert found.status is Status.HOLDS
        return found.ours.partition("over the twin ")[2]

    one, other = run("one", 0.5), run("other", 1.5)
    assert over_twin(one).startswith(
        "+9.50 [+9.50, +9.50; n 1] dB at night, +0.50 [+0.50, +0.50; n 1] dB"
    )
    both = over_twin(one, other)
    # Draws give 0.5 dB to both sides, t of two values 12.7 / 1.96 sqrt(2) times that.
    assert both.startswith("+10.00 [+5.42, +14.58; n 1] dB at night, +1.00 [−3.58, +5.58; n 1] dB")
    finer = run("finer", 0.5, render={"spp": 16})
    with pytest.raises(ResultError, match=r"finer.*: render: found .*, but None in .*one"):
        scores_of_run(one, finer)
    with pytest.raises(ResultError, match=r"one.*: same weights as .*one"):
        scores_of_run(one, one)
    with pytest.raises(ResultError, match=r"other.*: same weights as .*other"):
        scores_of_run(one, other, other)
    (tmp_path / "other" / "study.json").write_text(
        (tmp_path / "one" / "study.json").read_text().replace('["one"]', '["other"]')
    )
    with pytest.raises(ResultError, match=r"other.*: same weights as .*one"):
        scores_of_run(one, other)


def test_joined_runs_do_not_widen_intervals_of_methods_without_weights() -> None:
    """Promise: claims without a network have the verdicts and intervals of one run."""
    rows = [
        replace(row, value=row.value + row.width * (7919 * row.sample % 5) / 4000, method=method)
        for method in ("high_pass_filter", "our_reconstruction_all_light")
        for row in paper_rows(HF)
    ]
    joined = [replace(row, item=2 * row.item + k) for k in (0, 1) for row in rows]
    one, both = Scores(rows), Scores(joined, trainings=2)
    night = [Condition("carpet", width, 50.0, 1.0) for width in (240, 1280)]
    network = HF._replace(method="our_reconstruction_all_light")

    def lead(scores: Scores, series: Series) -> Interval:
        cells = {at.width: scores.cell(series, at) for at in night}
        return estimate(lambda medians: medians[1280] - medians[240], cells)

    assert lead(one, HF).low < lead(one, HF).high
    assert lead(both, HF) == lead(one, HF)
    assert lead(both, network).high > lead(one, network).high


def test_other_software_of_joined_runs_is_said(
    tmp_path: Path, eres: Callable[..., tuple[int, str, str]]
) -> None:
    """Promise: `eres claims` names the software that differs between runs, and says nothing of
    machines."""
    folders = [tmp_path / "a", tmp_path / "b", tmp_path / "c"]
    commits = "git 1a", "git 2b", "git 1a"
    rows = twin_rows(HF, "our_reconstruction_{}", at_night=9.0, all_light=0.5)
    for k, (folder, commit) in enumerate(zip(folders, commits, strict=True)):
        folder.mkdir()
        write_rows(folder / "rows.parquet", rows)
        config = {"jobs": [k], "evaluate": {"video": {"weights": {"mine": f"{k}.pt"}}}}
        (folder / "study.json").write_text(json.dumps(config))
        found = {"code": commit, "mitsuba": "3.9.1", "processor": str(k)}
        (folder / "environment.json").write_text(json.dumps(found))
    code, out, _ = eres("claims", *folders)
    assert code == 0
    assert "The runs differ in more than weights: code git 1a, git 2b\n" in out
    for alone in (folders[:1], folders[::2]):
        assert "runs differ" not in eres("claims", *alone)[1]


@pytest.mark.parametrize("lacking", [0, 1])
def test_what_one_of_several_runs_lacks_is_not_measured(tmp_path: Path, lacking: int) -> None:
    """Promise: a run without the rows of a network does not pass for one training less."""
    folders = [tmp_path / "a", tmp_path / "b"]
    rows = twin_rows(HF, "our_reconstruction_{}", at_night=9.0, all_light=0.5)
    for k, folder in enumerate(folders):
        folder.mkdir()
        found = [row for row in rows if k != lacking or "ideal" in row.method]
        write_rows(folder / "rows.parquet", found)
        config = {
            "jobs": [k],
            "evaluate": {"video": {"weights": {"mine": f"{k}.pt"}}, "windows": 10},
        }
        (folder / "study.json").write_text(json.dumps(config))
    ((scores,),) = scores_of_run(*folders).values()
    (verdicts,) = judge_readings({}, {"": scores}, {}).values()
    assert [one.status for one in verdicts if one.number == 23] == [Status.NOT_MEASURED] * 2
