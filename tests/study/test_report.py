"""A report is one file with the content of the rows, and nothing else."""

import html
import inspect
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from drawn import without_space
from eres_render.storage.atomic import write_bytes
from finished_runs import add_previews, make_run, page_of
from made_scaling import made
from study_rows import CM, EI, EPF, EPPT, HF, nothing_rows
from study_rows import paper_rows as task_rows
from tasks.errors import ResultError
from tasks.row import Row
from tasks.study.report import write_report
from tasks.study.report.finished_run import read_run
from tasks.study.report.page import MAX_BYTES, SECTIONS, Section
from tasks.study.report.templating import TEMPLATES
from tasks.study.results.paper import CUTOFFS_HZ, SPEEDS, WIDTHS, published
from tasks.study.run.highlights import scaling_files

ROOT = Path(__file__).parents[2]


def paper_rows(samples: int = 7, nothing_db: float = 12.0) -> list[Row]:
    """Carpet with the paper's medians; the event rate grows with the cube of the width."""
    rows = []
    for width in WIDTHS:
        for cutoff in CUTOFFS_HZ:
            for speed in SPEEDS:
                median = published("carpet", *EI[:2], width, cutoff, speed)
                assert median is not None
                for i in range(samples):
                    at = (width, cutoff, 0.2, speed, i, "psnr_db")
                    shift = i - samples // 2
                    rows.append(Row("carpet", *EI[:2], *at, median + shift, speed * width**3))
                    rows.append(Row("carpet", EI.task, "no_events", *at, nothing_db + shift, 0.0))
    return rows


def html_of(folder: Path, rows: list[Row]) -> str:
    return without_space(page_of(make_run(folder, rows)))


@pytest.fixture(scope="module")
def paper_page(tmp_path_factory: pytest.TempPathFactory) -> str:
    return html_of(tmp_path_factory.mktemp("paper"), paper_rows())


def plots_of(page: str) -> list[dict]:
    """Return the plots as the page's script reads them."""
    found = re.findall(r'<script type="application/json">(.*?)</script>', page, re.DOTALL)
    return [json.loads(plot) for plot in found]


class Told(NamedTuple):
    """A cell of the answer, as the page shows it."""

    width: str
    rest: str
    kind: str


def answers_of(page: str) -> dict[tuple[str, str, str], Told]:
    """Return the cells of the answer by scene, task, and light and speed."""
    (table,) = re.findall(r'<table class="matrix".*?</table>', page, re.DOTALL)
    found = {}
    for body in re.findall(r"<tbody.*?</tbody>", table, re.DOTALL):
        scene = re.search(r'<th scope="rowgroup">(.*?)</th>', body)[1]
        for task, cells in re.findall(r'<th scope="row">(.*?) <small>.*?</th>(.*?)</tr>', body):
            each = r'<td class="(.*?)".*?data-label="(.*?)".*?><b>(.*?)</b>(.*?)</td>'
            for kinds, where, width, rest in re.findall(each, cells):
                kind = kinds.removesuffix("group").strip()
                words = html.unescape(re.sub(r"<[^>]*>", " ", rest)).split()
                found[scene, task, where] = Told(width, " ".join(words), kind)
    return found


def test_a_run_with_scores_that_are_no_numbers_still_has_a_report(tmp_path: Path) -> None:
    """Promise: the report shows a method with only NaN values as missing, next to the others."""
    rows = task_rows(EPF, samples=3, scenes=["carpet"])
    lost = [replace(row, method="mine.flow:lost", value=np.nan) for row in rows]
    page = html_of(tmp_path, [*rows, *lost, *nothing_rows(rows, 3.5)])
    lost = re.search(r"mine\.flow:lost</th><td[^>]*>(.*?)</td><td[^>]*>(.*?)</td>", page)
    assert lost
    assert lost.groups() == ("0 of 180", "0\u202f%")


def test_the_report_is_one_file_without_network(tmp_path: Path) -> None:
    """The page loads nothing from elsewhere, the file is small, and no partial file remains.

    Beside it are the figure, as a PNG and an SVG, and the tables as CSV.
    """
    run = make_run(tmp_path, paper_rows())
    add_previews(run)
    report = write_report(run)
    page = report.read_text()
    assert report == tmp_path / "report.html"
    assert len(report.read_bytes()) < MAX_BYTES
    assert not re.search(r"""(src|href|srcset|action)\s*=\s*["']?\s*(https?:)?//""", page)
    assert not re.search(r"@import|url\(|fetch\(|XMLHttpRequest|<link", page)
    assert page.count("data:image/png;base64,") == 6
    assert {p.name for p in tmp_path.iterdir()} == {
        *("rows.parquet", "environment.json", "study.json", "previews"),
        *("report.html", "tables.csv", "figures"),
    }
    assert {p.name for p in (tmp_path / "figures").iterdir()} == {
        *("tradeoff_event_integration.png", "tradeoff_event_integration.svg")
    }
    assert (tmp_path / "tables.csv").read_text().count("\n") == 1 + 3 * 3 * 6  # a line for a cell


def test_every_width_and_condition_is_in_it(paper_page: str) -> None:
    """The page has tables, plot data, claims and provenance, all escaped; each speed has one block
    of scores."""
    page = paper_page
    for width in WIDTHS:
        assert f">{width} px<" in page
    for text in ("ideal", "day", "night", "24.09", "no events", "claim 9", "--preset quick"):
        assert text in page
    assert "llvm &lt;mono&gt;" in page
    (scores,) = re.findall(r'<section id="tables".*?</section>', page, re.DOTALL)
    blocks = re.findall(r'class="block">.*?<small>([^<]*)</small>', scores)
    assert blocks == ["0.9 m/s", "1.2 m/s", "1.8 m/s"]
    (plot,) = plots_of(page)
    assert [key["label"] for key in plot["keys"]] == [str(width) for width in WIDTHS]
    for panel in plot["panels"]:
        assert [len(line["points"]) for line in panel["lines"]] == [3] * 5
        assert panel["references"] == [12.0]


def test_names_are_no_formulas_and_settings_are_read_as_they_are_written(tmp_path: Path) -> None:
    """Promise: a dollar in the name of a scene is one in the figures, too, and the resolved
    configuration shows quotes and angle brackets."""
    ideal = (row for row in paper_rows(samples=1) if math.isinf(row.cutoff_hz))
    rows = [replace(row, scene=r"a $\foo$ b") for row in ideal]
    run = make_run(tmp_path, rows)
    question = "What's <b> for?"
    (run / "study.json").write_text(json.dumps({"question": question}))
    page = write_report(run).read_text()
    assert (run / "figures" / "tradeoff_event_integration.png").exists()
    assert '"question": "What\'s &lt;b&gt; for?"' in page


def test_other_files_of_the_folder_stay(tmp_path: Path) -> None:
    """Promise: a report replaces its own tables; a file of the user's beside them stays."""
    run = make_run(tmp_path, paper_rows(samples=1))
    (run / "figures").mkdir()
    former = "figures/tradeoff_high_pass_filter.png"
    for name in ("tables_mine.csv", "tables_v2e.csv", "figures/tradeoff_mine.png", former):
        (run / name).write_text("from elsewhere")
    page_of(run)
    for name in ("tables_mine.csv", "figures/tradeoff_mine.png"):
        assert (run / name).read_text() == "from elsewhere"
    assert not (run / former).exists()
    assert not (run / "tables_v2e.csv").exists()


def test_the_answer_follows_from_the_rows(paper_page: str) -> None:
    """The paper's medians: 1280 px wins in ideal light; at night 346 px is within 0.1 dB of the
    best at speed 1, and 128 px at speed 2. Events are those of the width, and the share is that of
    the fastest bus of real cameras: 1280^3 events are 2097 Mev/s, of 1200."""
    found = answers_of(paper_page)
    assert len(found) == 3 * 3
    at = {where: told for (_, _, where), told in found.items()}
    assert {(scene, task) for scene, task, _ in found} == {("carpet", "Reconstruction")}
    assert at["ideal, 0.9 m/s"] == ("1280", "2097 · 175 %", "over")
    assert at["night, 0.9 m/s"] == ("346", "41.4 · 3 %", "")
    assert at["night, 1.8 m/s"] == ("128", "4.19 · <1 %", "")


def test_each_scene_has_its_answers_and_speeds(tmp_path: Path) -> None:
    """Promise: a scene is a block with its own speeds in m/s; a task that is on one scene only has
    no row on the other, and a speed that only one method has, here 10, no column."""
    rows = [r for s in ("carpet", "rocks") for r in task_rows(EI, scenes=[s])]
    found = answers_of(html_of(tmp_path, rows + task_rows(CM, scenes=["carpet"])))
    assert {(scene, task) for scene, task, _ in found} == {
        *(("carpet", "Reconstruction"), ("carpet", "Optical flow"), ("rocks", "Reconstruction"))
    }
    where = {scene: [at for s, _, at in found if s == scene] for scene, *_ in found}
    assert where["carpet"][:3] == ["ideal, 0.9 m/s", "ideal, 1.2 m/s", "ideal, 1.8 m/s"]
    assert where["rocks"][-3:] == ["night, 0.7 m/s", "night, 0.93 m/s", "night, 1.4 m/s"]
    assert len(found) == 3 * 3 * 3


def test_the_answer_names_one_of_two_sensors_of_one_width(tmp_path: Path) -> None:
    """Promise: without another width the page names the better sensor, and says how near is as
    good."""
    fine = [row for row in paper_rows() if row.width == 1280]
    rows = [
        replace(r, sensor=name, value=r.value + gain)
        for name, gain in (("a", 0), ("b", 1))
        for r in fine
    ]
    page = html_of(tmp_path, rows)
    assert {told.width for told in answers_of(page).values()} == {"b"}
    assert "<li>as good within 0.1 dB</li>" in page


def test_the_answer_is_at_the_speeds_of_most_methods(tmp_path: Path) -> None:
    """Promise: a method at a speed of its own, 10, has no column of dashes, nor have the others;
    two methods at different speeds say where the study has no score."""

    def found(*rows: Row) -> dict[tuple[str, str, str], Told]:
        return answers_of(html_of(tmp_path, [*rows]))

    images, flow = (task_rows(one, samples=1, scenes=["carpet"]) for one in (EI, CM))
    fast = [replace(row, speed=10.0) for row in flow if row.speed == 1.0]
    video = task_rows(HF, samples=1, scenes=["carpet"])
    assert {*found(*images, *video, *fast)} == {*found(*images, *video)}
    one = [row for row in images if row.speed == 1.0]
    told = found(*one, *fast)
    assert told["carpet", "Reconstruction", "ideal, 9 m/s"] == ("–", "not in this study", "")
    assert told["carpet", "Optical flow", "ideal, 9 m/s"].width != "–"


def test_the_answer_is_in_the_words_of_the_study(tmp_path: Path) -> None:
    """Promise: title and kicker are question and name of the study, and a scene of the user's own
    has its speeds in m/s, from study.json; without a question the title asks in general."""
    rows = [replace(r, scene="hall") for r in paper_rows()]
    run = make_run(tmp_path, rows)
    study = {"name": "robot", "question": "Is 640 px <too> much?", "base_m_per_s": {"hall": 6.0}}
    (run / "study.json").write_text(json.dumps(study))
    page = without_space(page_of(run))
    assert "<title>Is 640 px &lt;too&gt; much?</title>" in page
    assert "<h1>Is 640 px &lt;too&gt; much?</h1>" in page
    assert "Study robot · hall · 7 samples per scene" in page
    assert ("hall", "Reconstruction", "day, 12 m/s") in answers_of(page)
    assert "hall</span>" not in page.split("<h1>")[0]
    assert "<h1>Which event-camera resolution is enough?</h1>" in html_of(tmp_path, rows)


def test_the_bus_of_the_study_is_that_of_the_page(tmp_path: Path) -> None:
    """Promise: shares and limits are of the study's own bus where it has one."""
    page = html_of(tmp_path, [replace(row, bus_mev_s=50.0) for row in paper_rows(samples=1)])
    assert answers_of(page)["carpet", "Reconstruction", "night, 0.9 m/s"].rest.endswith("83 %")
    assert {plot["limit"]["x"] for plot in plots_of(page)} == {50.0}
    assert "share of a bus of 50 Mev/s." in page
    assert 'id="bus"' not in page


def test_a_bus_of_one_sensor_is_not_that_of_the_others(tmp_path: Path) -> None:
    """Promise: shares are of the sensor's own bus; 346 px, without one, has the usual bus of real
    cameras, 1200 Mev/s, as if no sensor had one."""
    rows = paper_rows(samples=1)
    own = [replace(row, bus_mev_s=0.2) if row.width == 128 else row for row in rows]
    page = html_of(tmp_path, own)
    told = answers_of(page)
    assert told["carpet", "Reconstruction", "night, 0.9 m/s"] == ("346", "41.4 · 3 %", "")
    assert told["carpet", "Reconstruction", "night, 1.8 m/s"] == ("128", "4.19 · 2097 %", "over")
    assert "share of the bus of the sensor: 128 px 0.2 Mev/s, 240 px 1200 Mev/s (none" in page
    assert {plot["limit"]["x"] for plot in plots_of(page)} == {1200.0}


def test_a_width_that_the_samples_do_not_settle_is_tied(tmp_path: Path) -> None:
    """640 px leads 128 px by 1 dB in five samples and trails in four: tied. With five samples there
    is no interval, and the page says so."""
    lead = (2.0, 2.0, 2.0, 2.0, 2.0, -1.0, -1.0, -1.0, -1.0)
    rows = [
        Row("x", *EI[:2], w, 50.0, 0.2, 1.0, i, "psnr_db", 20.0 + (w == 640) * d, 1e6)
        for w in (128, 640)
        for i, d in enumerate(lead)
    ]
    (told,) = answers_of(html_of(tmp_path, rows)).values()
    assert told == ("640", "tied 128 1.00 · <1 %", "")
    few = html_of(tmp_path, [r for r in rows if r.sample < 5])
    assert "tied" not in next(iter(answers_of(few).values())).rest
    assert "not known: 5 samples per scene, too few" in few


def test_scores_below_doing_nothing_are_struck(tmp_path: Path) -> None:
    """If the image without events is as good, the width is struck, and a reader hears why."""
    page = html_of(tmp_path, paper_rows(nothing_db=15.0))
    told = answers_of(page)["carpet", "Reconstruction", "night, 1.8 m/s"]
    assert told.kind == "struck"
    assert told.rest.startswith("doing nothing is as good")


def test_what_was_not_compared_with_doing_nothing_is_said(tmp_path: Path) -> None:
    """Promise: the legend explains struck widths only if doing nothing was scored, and names each
    task where it was not."""

    def legend(rows: list[Row]) -> str:
        (found,) = re.findall(r'<ul class="legend note">.*?</ul>', html_of(tmp_path, rows))
        return found

    images, flow = paper_rows(samples=1), task_rows(EPF, samples=1, scenes=["carpet"])
    struck, unknown = "</s> doing nothing is as good", "doing nothing was not measured for "
    both, one = legend(images + nothing_rows(flow, 3.5) + flow), legend(images + flow)
    none = legend([row for row in images if row.method != "no_events"] + flow)
    assert [struck in text for text in (both, one, none)] == [True, True, False]
    assert unknown not in both
    assert f"{unknown}optical flow<" in one
    assert f"{unknown}reconstruction and optical flow<" in none


def test_a_condition_with_lost_samples_has_no_answer(tmp_path: Path) -> None:
    """One width lost one sample: answer and table say that samples are missing."""
    lost = (240, 50.0, 2.0, 3)
    rows = [
        r
        for r in paper_rows()
        if (r.width, r.cutoff_hz, r.speed, r.sample) != lost or r.method == "no_events"
    ]
    page = html_of(tmp_path, rows)
    told = answers_of(page)["carpet", "Reconstruction", "night, 1.8 m/s"]
    assert told == ("–", "samples are missing", "")
    assert "– (6 of 7)" in page


def test_claims_are_one_line_where_none_can_be_judged(tmp_path: Path, paper_page: str) -> None:
    """Promise: for sensors that the paper does not have, the section of claims is one paragraph and
    the page has no number of the paper; with its sensors only claims that are judged are listed."""
    page = html_of(
        tmp_path, [replace(r, width=r.width + 1, scene="hall") for r in paper_rows(samples=1)]
    )
    (claims,) = re.findall(r'<section id="claims".*?</section>', page, re.DOTALL)
    assert re.fullmatch(r"<section .*?</h2><p>No claim can be judged: [^<]*</p></section>", claims)
    assert "paper:" not in page
    assert "Δ" not in page
    listed = paper_page.count("<small>claim ")
    assert 0 < listed == paper_page.count('<div class="status ') < 21
    assert 'class="status not-measured"' not in paper_page


@pytest.mark.parametrize("field", ["width", "cutoff_hz"])
def test_one_sensor_or_light_of_ones_own_leaves_the_paper_out(tmp_path: Path, field: str) -> None:
    """Promise: points and tables have no number of the paper if the study asks another question."""
    theirs, ours = {"width": (WIDTHS[0], 320), "cutoff_hz": (CUTOFFS_HZ[1], 100.0)}[field]
    page = html_of(
        tmp_path,
        [
            replace(r, **{field: ours}) if getattr(r, field) == theirs else r
            for r in paper_rows(samples=1)
        ],
    )
    assert "paper:" not in page
    assert "Δ" not in page


def test_few_samples_are_cautioned_about(tmp_path: Path, paper_page: str) -> None:
    """With two samples the report warns that they are few; with seven it does not."""
    caution = "too few for confidence intervals"
    assert caution in html_of(tmp_path, paper_rows(samples=2))
    assert caution not in paper_page


def test_the_pictures_are_explained(tmp_path: Path) -> None:
    """The captions explain the colors and the time, and say that the radiance is tone-mapped."""
    run = make_run(tmp_path, paper_rows(samples=1))
    add_previews(run)
    page = without_space(page_of(run))
    assert "Blue: brighter, red: darker" in page
    assert "over the last 10 ms" in page
    assert 'id="play"' not in page
    assert "<figcaption>the radiance, tone-mapped</figcaption>" in page
    assert "<figcaption>128 px of events</figcaption>" in page


def test_every_picture_has_a_name_of_its_own(tmp_path: Path) -> None:
    """Promise: the text of a picture, also the caption of the large one, says all that it shows."""
    run = make_run(tmp_path, paper_rows(samples=1))
    add_previews(run, films=True)
    names = re.findall(r'alt="([^"]+)"', page_of(run))
    assert "128 px of events, carpet, ideal, 0.9 m/s" in names
    assert len(names) == len(set(names)) == len(WIDTHS) + 2


def test_films_move_next_to_old_pictures(tmp_path: Path) -> None:
    """Promise: a film is a WebP strip that the page moves and the reader can stop; pictures of
    older runs stay still."""
    run = make_run(tmp_path, paper_rows(samples=1))
    add_previews(run, films=True)
    page = without_space(page_of(run))
    assert re.search(
        r'src="data:image/webp;base64,[^"]*" alt="128 px of events, [^"]*" class="film"', page
    )
    assert page.count('class="pixels"') == len(WIDTHS)
    assert 'id="play" checked' in page
    assert "the events of 5 ms over the frame at their end; a film shows 40 ms in a second" in page


def test_a_run_of_rows_alone_has_no_empty_sections(paper_page: str) -> None:
    """Promise: previews, scaling statistics and timings are optional, as for recordings; without
    them neither their sections nor links to them are there."""
    for name in ("previews", "scaling", "costs"):
        assert f'id="{name}"' not in paper_page
        assert f'href="#{name}"' not in paper_page
    assert 'id="claims"' in paper_page


def test_a_scene_with_markup_in_its_name_stays_text(tmp_path: Path) -> None:
    """Names from outside break neither the page nor its data."""
    rows = [replace(r, scene="</script><b>x") for r in paper_rows(samples=1)]
    page = html_of(tmp_path, rows)
    assert "</script><b>x" not in page


@pytest.mark.parametrize("file", ["rows.parquet", "environment.json", "study.json"])
def test_a_missing_file_is_named(tmp_path: Path, file: str) -> None:
    """A run without one of its files has no report, and the error names the file."""
    make_run(tmp_path, paper_rows(samples=1))
    (tmp_path / file).unlink()
    with pytest.raises(ResultError, match=re.escape(file)):
        write_report(tmp_path)
    assert not (tmp_path / "report.html").exists()


def test_pictures_are_of_one_seed_of_each_scene(tmp_path: Path) -> None:
    """Promise: those of fifteen scenes, five seeds of three, fit into a report."""
    make_run(tmp_path, paper_rows(samples=1))
    add_previews(tmp_path)
    index = tmp_path / "previews" / "index.json"
    entry, *_ = json.loads(index.read_text())
    scenes = "carpet@1", "carpet", "rocks", "rocks@3"
    index.write_text(json.dumps([{**entry, "scene": scene} for scene in scenes]))
    assert [*read_run(tmp_path).previews] == ["carpet@1", "rocks"]


def test_damaged_files_are_named(tmp_path: Path) -> None:
    """Invalid JSON, a lost preview, an entry without caption or of another kind: an error for
    each."""
    make_run(tmp_path, paper_rows(samples=1))
    add_previews(tmp_path)
    index = tmp_path / "previews" / "index.json"
    entries = json.loads(index.read_text())

    (tmp_path / "previews" / "346.png").unlink()
    with pytest.raises(ResultError, match=r"346\.png: no such file"):
        write_report(tmp_path)
    index.write_text(json.dumps([{**entries[0], "kind": "video"}]))
    with pytest.raises(ResultError, match="found 'video'"):
        write_report(tmp_path)
    index.write_text(json.dumps([{k: v for k, v in entries[0].items() if k != "caption"}]))
    with pytest.raises(ResultError, match=r"\[0\]\.caption: missing"):
        write_report(tmp_path)
    (tmp_path / "study.json").write_text("{")
    with pytest.raises(ResultError, match=r"study\.json: could not be read as JSON"):
        write_report(tmp_path)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"render": []}, "render: found [], expected a table"),
        ({"jobs": 3}, "jobs: found 3, expected a list"),
        ({"evaluate": 3}, "evaluate: found 3, expected a table"),
        ({"question": 3}, "question: found 3, expected a string"),
        ({"base_m_per_s": {"carpet": "fast"}}, "base_m_per_s.carpet: found 'fast', expected a num"),
    ],
)
def test_a_damaged_study_is_named(tmp_path: Path, content: dict, said: str, eres) -> None:
    """Promise: report and claims of a run whose study.json holds values of another kind end with
    one line that names file and field."""
    make_run(tmp_path, paper_rows(samples=1))
    (tmp_path / "study.json").write_text(json.dumps(content))
    for command in ("report", "claims"):
        code, _, err = eres(command, tmp_path)
        assert (code, err.count("\n")) == (1, 1)
        assert f"{tmp_path / 'study.json'}: {said}" in err


def test_baseline_rows_alone_make_no_report(tmp_path: Path) -> None:
    """The report refuses a run with only do-nothing rows."""
    rows = [r for r in paper_rows(samples=1) if r.method == "no_events"]
    with pytest.raises(ResultError, match="has only rows of do-nothing"):
        write_report(make_run(tmp_path, rows))


def all_tasks() -> list[Row]:
    """One sample of each task; tracking from 2 mm succeeds, from 20 mm 240 px does not."""
    rows = [r for one in (EI, HF, EPF, CM) for r in task_rows(one, samples=1, scenes=["carpet"])]
    rows += task_rows(EPF._replace(variant="61 px patch"), samples=1, scenes=["carpet"])
    rows += task_rows(EPF, samples=1, scenes=["carpet"], method="photometric_flow_with_delay")
    for variant in ("sigma 2 mm", "sigma 20 mm"):
        for r in task_rows(EPPT._replace(variant=variant), samples=1, scenes=["carpet"]):
            lost = variant == "sigma 20 mm" and r.width != 240
            rows.append(replace(r, failure="no convergence in 9 passes" if lost else ""))
    once = {one.method for one in (EI, HF, EPF, EPPT)}  # a method of each task
    return rows + nothing_rows([r for r in rows if r.method in once], 1.0)


def test_every_task_has_its_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A selector with one visible set of plots, answers, tables, failures; few figures. Besides the
    plots of the methods there are that of the sweep, and two of scaling."""
    monkeypatch.setattr("tasks.study.report.page.figure_files", lambda plots: {"png": b"drawn"})
    numbers = scaling_files(made(), np.eye(64))["carpet.json"]
    write_bytes(tmp_path / "scaling" / "carpet.json", numbers)
    page = without_space(write_report(make_run(tmp_path, all_tasks())).read_text())
    options = re.findall(r'<option value="(\d+)">([^<]*)</option>', page.split('id="pick"')[1])
    assert [name for _, name in options] == [
        *("event integration", "high-pass filter", "photometric flow", "contrast maximization"),
        *("photometric flow, 61 px patch", "photometric flow with delay"),
        "photometric tracking, sigma 2 mm",
    ]
    assert [int(value) for value, _ in options] == list(range(len(options)))
    assert page.count('<div class="plots" hidden>') == len(options) - 1
    assert page.count('<div class="plot">') == len(plots_of(page)) == len(options) + 3
    assert {task for _, task, _ in answers_of(page)} == {
        *("Reconstruction", "Video reconstruction", "Optical flow", "Pose tracking")
    }
    for _, name in options:
        assert len(re.findall(rf"<summary>[^<]* by {re.escape(name)}</summary>", page)) == 1
    assert "2 mm: 100\u202f%, 20 mm: 0\u202f%" in page
    assert "no convergence in n passes (36)" in page
    assert {p.stem for p in (tmp_path / "figures").iterdir()} == {
        *(f"tradeoff_{one.method}" for one in (EI, HF, EPF, CM, EPPT)),
        *("scaling_slope", "scaling_intervals"),
    }


def test_a_single_perturbation_is_in_the_tables_alone(tmp_path: Path) -> None:
    """Promise: success is listed by perturbation if there are several; one is in all scores."""
    several = all_tasks()
    one = [r for r in several if r.variant != "sigma 20 mm"]
    for name, rows, listed in (("several", several, 1), ("one", one, 0)):
        page = page_of(make_run(tmp_path / name, rows))
        assert page.count("Numbers by scene") == listed
        assert "2 mm, the largest perturbation" in page


def test_a_run_of_one_task_needs_no_selector(tmp_path: Path) -> None:
    """Event integration alone: its plots are visible, and there is no selector."""
    page = html_of(tmp_path, paper_rows(samples=1))
    assert 'id="pick"' not in page
    assert '<div class="plots" hidden>' not in page
    assert "none of: optical flow, dense optical flow, pose tracking" in page


def test_images_that_are_not_finite_are_counted_as_failures(tmp_path: Path) -> None:
    """Promise: failures are counted in every task; an image with a NaN has the score of doing
    nothing, and the report says how often."""
    rows = paper_rows(samples=3)
    lost = [replace(r, value=12.0, failure="the image is not finite") for r in rows[::2][:27]]
    page = html_of(tmp_path, [*lost, *rows[1::2], *rows[::2][27:]])
    assert re.search(
        r"Reconstruction by event integration</th><td[^>]*>27 of 135</td><td[^>]*>20\u202f%</td>"
        r"<td[^>]*>the image is not finite \(27\)",
        page,
        re.IGNORECASE,
    )
    assert "none of: optical flow" not in page


def test_previews_that_are_too_large_are_refused(tmp_path: Path) -> None:
    """The report's size has a limit, and the error says how to reduce it."""
    make_run(tmp_path, paper_rows(samples=1))
    add_previews(tmp_path)
    (tmp_path / "previews" / "128.png").write_bytes(bytes(MAX_BYTES))
    with pytest.raises(ResultError, match="list fewer previews"):
        write_report(tmp_path)


def own_section() -> Section:
    template = TEMPLATES.from_string("<p>{{ data|join(', ') }}</p>{{ TASKS|length }}")
    return Section("mine", "Mine", "What I see", template, lambda run: ["<a>", *run.scenes])


def test_a_section_of_your_own(tmp_path: Path) -> None:
    """Promise: an entry with data and template adds a section and its link, from outside the
    package, in fewer than 20 lines."""
    assert len(inspect.getsource(own_section).splitlines()) < 20
    mine = own_section()
    none = replace(mine, id="none", title="Nothing to see", data=lambda run: None)
    make_run(tmp_path, paper_rows(samples=1))
    page = without_space(page_of(tmp_path, sections=[*SECTIONS, mine, none]))
    assert '<a href="#mine">Mine</a>' in page
    assert '<section id="mine" aria-labelledby="h-mine"><h2 id="h-mine">What I see</h2>' in page
    assert "<p>&lt;a&gt;, carpet</p>5" in page
    assert "Nothing to see" not in page


def test_python_holds_no_tags() -> None:
    """Promise: only templates contain HTML."""
    for path in (ROOT / "tasks").rglob("*.py"):
        assert not re.search(r"</?[a-z]+[ >]", path.read_text()), path
