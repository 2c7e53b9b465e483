"""A report in a real browser: nothing fails, all is readable on a phone and usable by keyboard."""

from pathlib import Path

import pytest

from browser import Browser, find_chromium
from study_rows import EI, EPF, EPPT, nothing_rows
from study_rows import paper_rows as task_rows
from tasks.evaluation.timings import timings_file
from tasks.row import Row
from tasks.study.report import write_report
from test_study_costs import JOB
from test_study_report import add_previews, make_run

PHONE, DESK = (390, 844), (1280, 2000)
OPEN_ALL = "document.querySelectorAll('details').forEach((one) => (one.open = true))"

# Ratio of WCAG 2.1 for every text that is shown, against what is painted behind it; those below
# 4.5. A canvas turns any CSS colour into sRGB.
LOW_CONTRAST = """(() => {
  const brush = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const rgba = (colour) => {
    brush.clearRect(0, 0, 1, 1);
    brush.fillStyle = colour;
    brush.fillRect(0, 0, 1, 1);
    return [...brush.getImageData(0, 0, 1, 1).data].map((part) => part / 255);
  };
  const over = ([r, g, b, a], under) => [r, g, b].map((c, k) => c * a + under[k] * (1 - a));
  const behind = (element) => {
    if (!element) return [1, 1, 1];
    const frame = element.ownerSVGElement?.querySelector(".frame");
    if (frame) return rgba(getComputedStyle(frame).fill);
    return over(rgba(getComputedStyle(element).backgroundColor), behind(element.parentElement));
  };
  const luminance = (colour) => colour
    .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
    .reduce((sum, c, k) => sum + c * [0.2126, 0.7152, 0.0722][k], 0);
  const low = [];
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const text = texts.currentNode.textContent.trim(), element = texts.currentNode.parentElement;
    if (!text || !element.checkVisibility() || element.closest("script, noscript")) continue;
    const style = getComputedStyle(element), ground = behind(element).slice(0, 3);
    const paint = over(rgba(element.ownerSVGElement ? style.fill : style.color), ground);
    const [dark, light] = [luminance(paint), luminance(ground)].sort((a, b) => a - b);
    const ratio = (light + 0.05) / (dark + 0.05);
    if (ratio < 4.5) low.push(`${text.slice(0, 30)}: ${ratio.toFixed(2)}`);
  }
  return low;
})()"""

# What is focused, in words, and whether that can be seen; nothing once all have had their turn.
FOCUSED = """(() => {
  const one = document.activeElement, style = getComputedStyle(one);
  if (one === document.body || one.dataset.reached) return null;
  one.dataset.reached = true;
  const ring = one.ownerSVGElement?.querySelector(".ring");
  const seen = ring ? ring.getAttribute("visibility") === "visible"
    : style.outlineStyle !== "none" && parseFloat(style.outlineWidth) > 0;
  const name = one.ariaLabel || one.textContent.trim() || one.querySelector("img")?.alt;
  return { kind: ring ? "point" : one.localName, seen, name };
})()"""

# What a mouse can press or a wheel can scroll; of a panel's points the Tab key reaches one.
STOPS = """[...document.querySelectorAll("a, button, select, summary, .scroll, .panel")]
  .filter((one) => one.checkVisibility() && !one.matches("dialog *"))
  .filter((one) => !one.matches(".panel") || one.querySelector(".mark")).length"""


def some_rows() -> list[Row]:
    """A sample of each task of Fig. 3."""
    every = (EI, EPF, EPPT)
    rows = [r for one in every for r in task_rows(one, samples=1, scenes=["carpet"])]
    return rows + nothing_rows(rows, 1.0)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = make_run(tmp_path_factory.mktemp("run"), some_rows())
    add_previews(folder)
    (folder / "costs").mkdir()
    (folder / "costs" / "part.json").write_bytes(timings_file(JOB))
    return write_report(folder)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory):
    binary = find_chromium()
    if binary is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium)")
    browser = Browser(binary, tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("size", [PHONE, DESK])
def test_it_opens_without_complaint_and_network(
    browser: Browser, report: Path, size: tuple[int, int], dark: bool
) -> None:
    """Promise: no error or warning, no address but its own, nothing wider than the window, and
    every text has the contrast of WCAG AA, with all that can be unfolded open."""
    browser.open(report, *size, dark=dark)
    browser.evaluate(OPEN_ALL)
    addresses = {url for url in browser.requests if not url.startswith("data:")}
    assert addresses == {report.as_uri()}
    assert browser.evaluate("document.documentElement.scrollWidth") == size[0]
    assert browser.evaluate(LOW_CONTRAST) == []
    assert browser.evaluate("document.querySelectorAll('.mark').length") == 9 * 5
    assert browser.complaints == []


def test_tab_reaches_everything(browser: Browser, report: Path) -> None:
    """Promise: without a mouse each link, button, choice, folded part, wide table and panel is
    reached, has a name, and shows that it has the focus."""
    browser.open(report, *DESK)
    count = browser.evaluate(STOPS)
    assert count > 30
    reached = []
    for _ in range(count + 5):
        browser.press("Tab")
        if (focused := browser.evaluate(FOCUSED)) is None:
            break
        reached.append(focused)
    assert [one for one in reached if not (one["seen"] and one["name"])] == []
    kinds = [one["kind"] for one in reached]
    assert kinds.count("select") == 1
    assert kinds.count("point") == 3
    assert len(reached) == count


def test_arrow_keys_read_the_points(browser: Browser, report: Path) -> None:
    """Promise: the points of a panel are read one after the other, as their tooltips are shown."""
    browser.open(report, *PHONE)
    browser.evaluate("document.querySelector('.mark').focus()")
    lines = []
    for _ in range(15):
        name = browser.evaluate("document.activeElement.ariaLabel")
        tip = "[...document.querySelectorAll('.tip:not([hidden]) > *')].map((one) => one.innerText)"
        assert browser.evaluate(f"{tip}.join(', ')") == name
        lines.append(name)
        browser.press("ArrowRight")
    assert browser.evaluate("document.activeElement.ariaLabel") == lines[0]
    assert len(set(lines)) == 15
    assert lines[0].startswith("128 px, ideal, speed 1 (0.9 m/s), PSNR 15.39 dB")
    browser.press("Escape")
    assert browser.evaluate("document.querySelectorAll('.tip:not([hidden])').length") == 0


def test_the_picker_and_a_preview_by_keyboard(browser: Browser, report: Path) -> None:
    """Promise: typing chooses another method's plots; Enter enlarges a preview, Escape closes it
    and the focus is where it was."""
    browser.open(report, *DESK)
    shown = "document.querySelector('.plots:not([hidden]) h3').textContent"
    assert browser.evaluate(shown) == "carpet, reconstruction by event integration"
    browser.evaluate("document.getElementById('pick').focus()")
    browser.press("ArrowDown")
    assert browser.evaluate(shown) == "carpet, optical flow by photometric flow"
    assert browser.evaluate("document.querySelectorAll('.plots:not([hidden]) .mark').length") > 40

    browser.evaluate("document.querySelector('.shot').focus()")
    browser.press("Enter")
    assert browser.evaluate("document.getElementById('zoom').open")
    browser.press("Escape")
    assert not browser.evaluate("document.getElementById('zoom').open")
    assert browser.evaluate("document.activeElement.matches('.shot')")
    assert browser.complaints == []


def test_a_screen_reader_finds_names(browser: Browser, report: Path) -> None:
    """Promise: nothing that is announced as a picture, control or region is without a name."""
    browser.open(report, *DESK)
    browser.evaluate(OPEN_ALL)
    roles = {"image", "img", "button", "link", "combobox", "region", "DisclosureTriangle"}
    nodes = browser.call("Accessibility.getFullAXTree")["nodes"]
    told = [n for n in nodes if not n["ignored"] and n["role"]["value"] in roles]
    assert {"button", "link", "combobox", "region"} <= {n["role"]["value"] for n in told}
    assert sum(n["role"]["value"] in ("image", "img") for n in told) > 40
    assert [n["role"]["value"] for n in told if not n["name"]["value"]] == []
