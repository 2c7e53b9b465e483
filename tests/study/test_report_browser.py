"""A report in a real browser: no errors, readable on a phone, and usable by keyboard."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from browser import LOW_CONTRAST, watched
from finished_runs import JOB, add_previews, make_run, page_of
from study_rows import EI, EPF, EPPT, nothing_rows
from study_rows import paper_rows as task_rows
from tasks.evaluation.timings import timings_file
from tasks.row import Row

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

pytestmark = pytest.mark.slow
PHONE, DESK, WALL = (390, 844), (1280, 2000), (1920, 1080)
RESULTS = Path(__file__).parents[2] / "docs" / "results"
STORED = sorted(file.parent.name for file in RESULTS.glob("*/rows.parquet"))
OPEN_ALL = "document.querySelectorAll('details').forEach((one) => (one.open = true))"

# The focused element and whether its focus is visible; null after all had the focus.
FOCUSED = """(() => {
  const one = document.activeElement, style = getComputedStyle(one);
  if (one === document.body || one.dataset.reached) return null;
  one.dataset.reached = true;
  const ring = one.ownerSVGElement?.querySelector(".ring");
  const seen = ring ? ring.getAttribute("visibility") === "visible"
    : style.outlineStyle !== "none" && parseFloat(style.outlineWidth) > 0;
  const label = one.labels?.[0]?.textContent;
  const name = one.ariaLabel || label || one.textContent.trim() || one.querySelector("img")?.alt;
  return { kind: ring ? "point" : one.localName, seen, name };
})()"""

# Elements that a mouse can click or scroll; in a panel the Tab key reaches one point.
STOPS = """[...document.querySelectorAll("a, button, input, select, summary, .scroll, .panel")]
  .filter((one) => one.checkVisibility() && !one.matches("dialog *"))
  .filter((one) => !one.matches(".panel") || one.querySelector(".mark")).length"""


def some_rows() -> list[Row]:
    """Return a sample of each task of Fig. 3."""
    every = (EI, EPF, EPPT)
    options = {"samples": 1, "scenes": ["carpet"], "rate": lambda width, _: float(width**3)}
    rows = [r for one in every for r in task_rows(one, **options)]
    return rows + nothing_rows(rows, 1.0)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = make_run(tmp_path_factory.mktemp("run"), some_rows())
    add_previews(folder, films=True)
    (folder / "costs").mkdir()
    (folder / "costs" / "part.json").write_bytes(timings_file(JOB))
    page_of(folder)
    return folder / "report.html"


@pytest.fixture(scope="module")
def tab(chromium: sync_api.Browser) -> sync_api.Page:
    return chromium.new_page()


@pytest.fixture
def page(tab: sync_api.Page, report: Path) -> Iterator[sync_api.Page]:
    """Open the report on a desktop screen; any message of the page fails the test."""
    tab.set_viewport_size(dict(zip(("width", "height"), DESK, strict=True)))
    tab.emulate_media(media="screen", color_scheme="light", reduced_motion="no-preference")
    complaints = watched(tab)
    tab.goto(report.as_uri())
    tab.wait_for_selector(".mark")
    yield tab
    assert complaints == []


def assert_tables_fill_the_page(page: sync_api.Page, size: tuple[int, int], first: str) -> None:
    """Check that tables are as wide as the page, and on a phone cards that do not scroll sideways
    and whose cells say their light and speed."""
    wide = "all => all.filter((one) => one.checkVisibility()).map((one) => one.offsetWidth)"
    boxes = page.locator(".scroll:has(table)").evaluate_all(wide)
    tables = page.locator(".scroll > table").evaluate_all(wide)
    assert all(table >= box for table, box in zip(tables, boxes, strict=True))
    if size == PHONE:
        assert tables == boxes
        said = "getComputedStyle(document.querySelector('.matrix td'), '::before').content"
        assert page.evaluate(said).startswith(f'"{first}')


@pytest.mark.parametrize("size", [PHONE, DESK, WALL])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_opens_without_complaint_and_network(
    chromium: sync_api.Browser, report: Path, size: tuple[int, int], scheme: str
) -> None:
    assert open_whole(chromium, report, size, scheme, first='ideal, 0.9 m/s"') == 45


@pytest.mark.parametrize("name", STORED)
def test_reports_of_the_stored_runs_open_too(
    chromium: sync_api.Browser, tmp_path: Path, name: str
) -> None:
    """Promise: so do those of whole studies, of the slider's prints and of networks."""
    run = tmp_path / name
    shutil.copytree(RESULTS / name, run)
    page_of(run)
    for size in (PHONE, DESK, WALL):
        scheme = "dark" if size == DESK else "light"
        assert open_whole(chromium, run / "report.html", size, scheme) > 0


def open_whole(
    chromium: sync_api.Browser, report: Path, size: tuple[int, int], scheme: str, first: str = ""
) -> int:
    """Open a report with all parts unfolded, and return the number of marks in its plots.

    On a phone, the first cell's card says its light and speed, which start with `first`.

    Promise: no error or warning, no foreign address, nothing wider than the window, tables as wide
    as the page, and every text has the contrast of WCAG AA.
    """
    viewport = dict(zip(("width", "height"), size, strict=True))
    page = chromium.new_page(viewport=viewport, color_scheme=scheme, is_mobile=size == PHONE)
    complaints, addresses = watched(page), set()
    page.on("request", lambda request: addresses.add(request.url))
    page.goto(report.as_uri())
    page.evaluate(OPEN_ALL)
    page.wait_for_selector(".plots:not([hidden]) .mark", state="attached")
    assert {url for url in addresses if not url.startswith("data:")} == {report.as_uri()}
    assert page.evaluate("document.documentElement.scrollWidth") == size[0]
    assert page.evaluate(LOW_CONTRAST) == []
    assert_tables_fill_the_page(page, size, first)
    marks = page.locator(".plots:not([hidden]) .mark").count()
    page.close()
    assert complaints == []
    return marks


def test_tab_reaches_everything(page: sync_api.Page) -> None:
    """Promise: without a mouse the user reaches each link, button, choice, folded part, wide table
    and panel; each has a name and shows its focus."""
    count = page.evaluate(STOPS)
    assert count > 30
    reached = []
    for _ in range(count + 5):
        page.keyboard.press("Tab")
        if (focused := page.evaluate(FOCUSED)) is None:
            break
        reached.append(focused)
    assert [one for one in reached if not (one["seen"] and one["name"])] == []
    kinds = [one["kind"] for one in reached]
    assert kinds.count("select") == 2
    assert kinds.count("point") == 3
    assert len(reached) == count


def test_arrow_keys_read_the_points(page: sync_api.Page) -> None:
    """Promise: the arrow keys read the points of a panel in order, as their tooltips show them."""
    page.locator(".mark").first.focus()
    lines = []
    for _ in range(15):
        name = page.evaluate("document.activeElement.ariaLabel")
        assert ", ".join(page.locator(".tip:visible").inner_text().split("\n")) == name
        lines.append(name)
        page.keyboard.press("ArrowRight")
    assert page.evaluate("document.activeElement.ariaLabel") == lines[0]
    assert len(set(lines)) == 15
    assert lines[0].startswith("128 px, ideal, 0.9 m/s, PSNR 15.39 dB")
    page.keyboard.press("Escape")
    assert page.locator(".tip:visible").count() == 0


def test_a_series_is_hidden_and_a_panel_zoomed(page: sync_api.Page) -> None:
    """Promise: without 1280 px the axis of the others is larger, and each panel can have its own
    axis or that of all; ticks are those of the data in the page."""
    plot = page.locator(".plot").first

    def ticks() -> list[list[str]]:
        texts = "all => all.map(one => [...one.querySelectorAll('text[text-anchor=end]')]"
        return plot.locator(".panel svg").evaluate_all(f"{texts}.map(text => text.textContent))")

    first = ticks()
    assert first[0] != first[2]  # ideal light spans 9 dB, night less than 1
    plot.get_by_role("checkbox", name="1280 px").click()
    assert plot.locator(".mark").count() == 3 * 12
    assert ticks()[0] != first[0]
    plot.get_by_role("checkbox", name="Own axis for each panel").click()
    ideal, day, night = ticks()
    assert ideal == day == night


def test_the_picker_and_a_preview_by_keyboard(page: sync_api.Page) -> None:
    """Promise: typing selects another method's plots; Enter enlarges a preview, and Escape closes
    it and restores the focus."""
    shown = page.locator(".plots:not([hidden])")
    assert shown.locator("h3").inner_text() == "carpet, reconstruction by event integration"
    page.focus("#pick")
    page.keyboard.press("ArrowDown")
    assert shown.locator("h3").inner_text() == "carpet, optical flow by photometric flow"
    shown.locator(".mark").nth(40).wait_for()

    page.locator(".shot").first.focus()
    page.keyboard.press("Enter")
    assert page.evaluate("document.getElementById('zoom').open")
    page.keyboard.press("Escape")
    assert not page.evaluate("document.getElementById('zoom').open")
    assert page.evaluate("document.activeElement.matches('.shot')")


def test_the_answer_for_a_bus_by_keyboard(page: sync_api.Page) -> None:
    """Promise: for a bus of 12 Mev/s the answer has the widths that it carries, with their rates
    and shares, and each plot against event rates moves its line; "no limit" restores all."""
    cell = page.locator(".matrix td[data-label='ideal, 0.9 m/s']").first
    lines = page.locator(".plots:not([hidden]) line.limit")
    usual, at = cell.inner_text(), lines.first.get_attribute("x1")
    assert usual.split() == ["1280", "2097", "·", "175", "%"]
    page.focus("#bus")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowDown")
    assert page.locator("#bus").input_value() == "12"
    assert cell.inner_text().split() == ["128", "2.10", "·", "17", "%"]
    assert cell.evaluate("one => one.style.getPropertyValue('--fine')") == "0%"
    assert float(lines.first.get_attribute("x1")) < float(at)
    assert page.locator(".plots:not([hidden]) text", has_text="bus 12 Mev/s").count() == 3
    page.keyboard.press("ArrowUp")
    assert cell.inner_text().split()[0] == "none"
    page.keyboard.press("Home")
    assert cell.inner_text() == usual


def test_films_stop(page: sync_api.Page) -> None:
    """Promise: films move until the reader stops them, with the keyboard, and not at all for one
    who asks for less motion."""
    moving = "getComputedStyle(document.querySelector('img.film')).animationName"
    assert page.evaluate(moving) == "film"
    page.focus("#play")
    page.keyboard.press("Space")
    assert page.evaluate(moving) == "none"
    page.keyboard.press("Space")
    page.emulate_media(reduced_motion="reduce")
    assert page.evaluate(moving) == "none"


def test_it_prints(page: sync_api.Page) -> None:
    """Promise: on paper nothing is wider than the page, dark screens print dark ink on white, and
    the controls are left out."""
    page.emulate_media(media="print", color_scheme="dark")
    page.set_viewport_size({"width": 690, "height": 980})  # A4 without its margins
    assert page.evaluate("document.documentElement.scrollWidth") <= 690
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.locator("nav").is_hidden()
    assert page.pdf(format="A4").startswith(b"%PDF")


def test_a_screen_reader_finds_names(page: sync_api.Page) -> None:
    """Promise: every picture, control and region that a screen reader announces has a name."""
    page.evaluate(OPEN_ALL)
    roles = {
        "image",
        "img",
        "button",
        "checkbox",
        "link",
        "combobox",
        "region",
        "DisclosureTriangle",
    }
    nodes = page.context.new_cdp_session(page).send("Accessibility.getFullAXTree")["nodes"]
    told = [n for n in nodes if not n["ignored"] and n["role"]["value"] in roles]
    assert {"button", "checkbox", "link", "combobox", "region"} <= {
        n["role"]["value"] for n in told
    }
    assert sum(n["role"]["value"] in ("image", "img") for n in told) > 40
    assert [n["role"]["value"] for n in told if not n["name"]["value"]] == []
