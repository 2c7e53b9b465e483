"""A run's answers are the same in its scores, in README and in the docs."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from answers import (
    ANSWERS,
    claim_counts,
    claim_list,
    details,
    main,
    overview,
    sample_worth,
    with_answers,
)

from study_rows import EI, EPF, HF, nothing_rows, paper_rows
from tasks.row import Row, write_rows
from tasks.study.claims.verdict import Status, Verdict
from tasks.study.report.finished_run import FinishedRun, read_run
from tasks.study.results.asked import Series
from tasks.study.results.cells import effective_samples
from tasks.study.results.choice import Choices, answered, choose_all
from tasks.study.results.scores import Scores

ROOT = Path(__file__).parents[2]
RUN = ROOT / "docs" / "results" / "paper"
PAGE = "Before.\n\n<!-- answer: {} -->\nformer text\n<!-- end of answer --> After."


@pytest.fixture(scope="module")
def of_the_paper() -> FinishedRun:
    return read_run(RUN)


PAGES = {
    "chip": "docs/chip.md",
    "firenet": "docs/learned.md",
    "firenet_slider": "docs/virtual_slider.md",
    "paper-v2e": "docs/v2e.md",
    "paper-seeds": "docs/seeds.md",
}
PAGES_OF_THE_PAPER = "README.md", "docs/results.md", "docs/results_run.md"


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES_OF_THE_PAPER)
def test_what_the_pages_say_is_what_the_run_says(of_the_paper: FinishedRun, page: str) -> None:
    """Promise: README and docs have the exact answers of docs/results/paper; if not, `make answers`
    rewrites them."""
    assert with_answers(ROOT / page, of_the_paper) == (ROOT / page).read_text()


@pytest.mark.slow
@pytest.mark.parametrize("run", PAGES)
def test_pages_of_other_runs_say_what_these_say(run: str) -> None:
    """Promise: as above, of the other runs that pages have answers about."""
    page = ROOT / PAGES[run]
    assert with_answers(page, read_run(RUN.with_name(run))) == page.read_text()


def choices(rows: list[Row], *series: Series) -> dict[Series, Choices]:
    return {one: choose_all(Scores(rows), one) for one in series or (EI,)}


def test_the_conditions_of_an_answer() -> None:
    """Every light at the lowest speed, then the least light at the highest; conditions of only one
    scene, here a speed of 10 on the carpet, are not in the list."""
    found = choices(paper_rows(EPF), EPF)[EPF]
    assert answered(found) == [(math.inf, 1.0), (200.0, 1.0), (50.0, 1.0), (50.0, 2.0)]
    slow = {where: choice for where, choice in found.items() if where[2] == 1.0}
    assert answered(slow) == [(math.inf, 1.0), (200.0, 1.0), (50.0, 1.0)]
    one = {where: choice for where, choice in slow.items() if where[1] == 200.0}
    assert answered(one) == [(200.0, 1.0)]


def test_the_table_has_a_line_for_each_method() -> None:
    """Images are best at 1280 px except at night, where at speed 2 no width on the carpet beats
    doing nothing; the filter is on the carpet only. Scenes that agree share a number, and the
    paper's number is next to ours."""
    images = paper_rows(scenes=("carpet", "rocks"))
    rows = images + nothing_rows(images, 14.3) + paper_rows(HF, scenes=("carpet",))
    text = overview(choices(rows, EI, HF))
    assert text.startswith("The smallest width in px with a median within 0.1 dB of the best, by")
    lines = [line.strip("| ").split(" | ") for line in text.split("\n") if line.startswith("| ")]
    assert lines[2] == [
        "reconstruction by event integration, carpet / rocks",
        *("1280", "1280", "1280", "1280", "346 / 240", "346 / 240", "none / 128", "128"),
    ]
    assert lines[3][0] == "video reconstruction by high-pass filter, carpet"
    assert len({len(line) for line in lines[2:]}) == 1


def test_a_bar_in_a_name_ends_no_cell() -> None:
    rows = [replace(one, scene="a|b") for one in paper_rows(scenes=("carpet",), samples=3)]
    assert r", a\|b |" in overview(choices(rows, EI)).splitlines()[-1]


def test_without_the_paper_there_is_no_column_for_it() -> None:
    """Another width than the paper's, and a lost sample: no column of the paper, and a dash."""
    rows = [replace(r, width=r.width + 1, cutoff_hz=2 * r.cutoff_hz) for r in paper_rows()]
    lost = [r for r in rows if (r.scene, r.width, r.cutoff_hz, r.sample) != ("room", 347, 100.0, 3)]
    text = details(choices(lost))
    assert "aper" not in text
    assert "| ideal, speed 1 | 400 Hz, speed 1 | 100 Hz, speed 1 | 100 Hz, speed 2 |" in text
    assert "| reconstruction by event integration, room | 1281 | 1281 | – | – |" in text
    assert "Speed 1 is 0.9 m/s on carpet, 0.7 m/s on rocks and 1.2 m/s on room." in " ".join(
        text.split()
    )


def test_what_the_samples_do_not_tell_apart_is_in_brackets() -> None:
    """At night 640 px leads 128 px by 1 dB in five samples and trails in four: 128 px is tied."""
    lead = (2.0, 2.0, 2.0, 2.0, 2.0, -1.0, -1.0, -1.0, -1.0)
    rows = [
        Row("x", *EI[:2], w, 50.0, 0.2, 1.0, i, "psnr_db", 20.0 + (w == 640) * d, 1e6)
        for w in (128, 640)
        for i, d in enumerate(lead)
    ]
    assert details(choices(rows)).endswith("| reconstruction by event integration, x | 640 (128) |")
    assert overview(choices(rows)).endswith("| reconstruction by event integration, x | 640 |")


def test_pages_are_rewritten_or_left_as_they_are(tmp_path: Path) -> None:
    """The text around the comments does not change, and repeated runs replace the text between
    them; an error names a page without a place, or with an unknown one, and does not change it, and
    a page that does not exist."""
    write_rows(tmp_path / "rows.parquet", paper_rows(scenes=("carpet",)))
    (tmp_path / "study.json").write_text("{}")
    (tmp_path / "environment.json").write_text("{}")
    page = tmp_path / "page.md"
    page.write_text(PAGE.format("overview, of a run"))
    for _ in range(2):
        main([str(tmp_path), str(page)])
        text = page.read_text()
        assert text.startswith(
            "Before.\n\n<!-- answer: overview, of a run -->\n\nThe smallest width in px"
        )
        assert text.endswith("|\n\n<!-- end of answer --> After.")
        assert "former text" not in text
        assert text.count("| reconstruction by event integration, carpet |") == 1
    for content, fault in (
        ("Nothing.\n", "found no answer block, expected <!-- answer: overview -->"),
        (PAGE.format("summary"), "found <!-- answer: summary -->, expected <!-- answer: overview"),
    ):
        page.write_text(content)
        with pytest.raises(SystemExit, match=re.escape(f"error: {page}: {fault}")):
            main([str(tmp_path), str(page)])
        assert page.read_text() == content
    with pytest.raises(SystemExit, match=r"error: .*missing\.md: no such file"):
        main([str(tmp_path), str(tmp_path / "missing.md")])
    for path, fault in ((tmp_path, "Is a directory"), (tmp_path / "page.bin", "can't decode")):
        (tmp_path / "page.bin").write_bytes(b"\xff\xfe")
        with pytest.raises(SystemExit, match=f"error: {path}: .*{fault}"):
            main([str(tmp_path), str(path)])
    with pytest.raises(SystemExit, match=r"error: .*rows\.parquet"):
        main([str(tmp_path / "none"), str(page)])


def test_speeds_in_m_per_s_are_not_factors() -> None:
    """Promise: 2 m/s is not said to be twice the scene's base speed."""
    rows = [replace(row, speed_m_s=2 * row.speed) for row in paper_rows()]
    text = details(choices(rows))
    assert "| ideal, 2 m/s |" in text
    assert "50 Hz, 4 m/s" in text
    assert "peed 1" not in text


def test_speed_1_is_that_of_the_run(tmp_path: Path) -> None:
    """Promise: with another path on the carpet, speed 1 is that of study.json; of a scene that it
    does not name, the packaged one."""
    write_rows(tmp_path / "rows.parquet", paper_rows(scenes=("carpet", "rocks")))
    (tmp_path / "study.json").write_text('{"base_m_per_s": {"carpet": 0.71556}}')
    (tmp_path / "environment.json").write_text("{}")
    for name in ("overview", "details"):
        text = " ".join(ANSWERS[name](read_run(tmp_path)).split())
        assert "Speed 1 is 0.72 m/s on carpet and 0.7 m/s on rocks." in text


def test_the_lead_of_each_seed(tmp_path: Path) -> None:
    """Promise: a column for each texture and path, and the interval of all; here the finest sensor
    is 1 dB better on the second seed."""
    rows = [row for row in paper_rows(scenes=("carpet",)) if row.width >= 640]
    rows += [replace(r, scene="carpet@1", value=r.value + (r.width == 1280)) for r in rows]
    write_rows(tmp_path / "rows.parquet", rows)
    for name in ("study.json", "environment.json"):
        (tmp_path / name).write_text("{}")
    heads, _, *lines = ANSWERS["seeds"](read_run(tmp_path)).splitlines()
    assert heads == "|  | seed 0 | seed 1 | all | paper |"
    for line in lines:
        of_first, of_second, of_all, paper = line.strip("| ").split(" | ")[1:]
        assert of_first == paper
        assert float(of_second.replace("−", "-")) == pytest.approx(
            float(of_first.replace("−", "-")) + 1, abs=0.011
        )
        assert of_all.endswith("]")
    assert lines


def verdicts(*statuses: Status) -> list[Verdict]:
    return [Verdict(n, "", "", status, "", "", "") for n, status in enumerate(statuses, start=1)]


def test_claims_are_counted_and_named() -> None:
    """The paragraph names the claims of each verdict, and those that another photoreceptor changes;
    a claim that is not measured counts nowhere."""
    yes, no, open_, unknown, _ = Status
    first = verdicts(yes, yes, no, unknown, yes)
    assert " ".join(claim_counts({"two_pole": first}).split()) == (
        "Of 4 claims that this run measures, 3 hold (1, 2, 5), 1 does not (3) and none is "
        "undecided."
    )
    of_one = [replace(one, number=10) for one in verdicts(yes, no)]
    assert " ".join(claim_counts({"two_pole": [*first, *of_one]}).split()) == (
        "Of 5 claims that this run measures, 3 hold (1, 2, 5), 2 do not (3, 10) and none is "
        "undecided."
    )
    other = verdicts(yes, no, open_, unknown, unknown)
    text = claim_counts({"two_pole": first, "v2e": other, "one_pole": first})
    assert " ".join(text.split()).endswith(
        "With v2e's limit for small steps, only these verdicts change: 2 does not and 3 is "
        "undecided. With one pole, no verdict changes."
    )
    nothing = verdicts(unknown, Status.NO_VERDICT)
    assert claim_counts({"two_pole": nothing}).startswith("None of the paper's claims is")


def test_the_worth_of_samples_is_that_of_the_finest_lead() -> None:
    """Promise: by day at base speed, for each scene; a drift along the path counts, and there is
    nothing to say of too few samples or of ideal light alone."""
    drift = [replace(r, value=r.value + 0.1 * r.sample * (r.width == 1280)) for r in paper_rows(EI)]

    def said(rows: list[Row]) -> str:
        return sample_worth(FinishedRun(Path(), [Scores(rows)], {}, {}))

    worth = f"{effective_samples(np.arange(9.0)):.2g} of 9"
    text, _, table = said(drift).partition("\n\n")
    assert "lead of 1280 px over 640 px, day, 200 Hz, speed 1" in " ".join(text.split())
    assert table.splitlines() == [
        "|  | carpet | rocks | room |",
        "| --- | --- | --- | --- |",
        f"| reconstruction by event integration | {worth} | {worth} | {worth} |",
    ]
    assert said([r for r in drift if r.sample < 3]).endswith("| – | – | – |")
    assert "no two sensors" in said([r for r in drift if math.isinf(r.cutoff_hz)])


def test_all_claims_are_listed_with_their_verdicts() -> None:
    """Promise: a line for each verdict, what decides, and the verdicts that change with another
    photoreceptor; what is not measured is only named."""
    yes, no, _, missing, *_ = Status
    first = [replace(v, title=f"claim {v.number}", why="lag") for v in verdicts(yes, no, missing)]
    assert claim_list({"two_pole": first[:2]}).splitlines() == [
        "|  | claim | verdict | why |",
        "| --- | --- | --- | --- |",
        "| 1 | claim 1 | holds | lag |",
        "| 2 | claim 2 | does not hold | lag |",
    ]
    both = claim_list({"two_pole": first, "v2e": verdicts(no, no, missing)}).splitlines()
    assert both[2] == "| 1 | claim 1 | holds (v2e's limit for small steps: does not hold) | lag |"
    assert both[3:] == ["| 2 | claim 2 | does not hold | lag |", "", "Not measured: 3."]
