"""The documentation is consistent: links, names and a study's fields; and the site builds."""

import dataclasses
import functools
import importlib
import re
import subprocess
import sys
import tomllib
from collections import Counter
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

from tasks.cli.command_line import command_names
from tasks.study.config import Study
from tasks.study.study_file import read_study

ROOT = Path(__file__).parents[2]
OF_THE_ROOT = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")
PAGES = [*(ROOT / name for name in OF_THE_ROOT), *sorted((ROOT / "docs").rglob("*.md"))]
EQUATIONS = ROOT / "docs" / "equations.md"


def page_name(page):
    return str(page.relative_to(ROOT))


@functools.cache
def blocks_of(page):
    return MarkdownIt("commonmark").enable("table").parse(page.read_text())


def inline(page):
    """Return the tokens of a page's paragraphs, headings and cells."""
    for block in blocks_of(page):
        yield from block.children or []


def code_spans(page):
    return [token.content for token in inline(page) if token.type == "code_inline"]


def anchors(page):
    """Return the anchors of a page's headings, which a code host and the site share."""
    for heading, block in pairwise(blocks_of(page)):
        if heading.type == "heading_open":
            text = "".join(t.content for t in block.children if t.type in ("text", "code_inline"))
            yield re.sub(r"[^\w\- ]", "", text.strip().lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_relative_links_and_anchors_lead_somewhere(page):
    """Promise: no link within the documentation is dead; the test needs no network."""
    for token in inline(page):
        target = str(token.attrs.get("href") or token.attrs.get("src") or "")
        if not target or re.match(r"\w+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{page_name(page)}: {target}: no such file"
        if anchor:
            assert anchor in set(anchors(file)), f"{page_name(page)}: {target}: no such heading"


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_names_of_our_code_exist(page):
    """Promise: names such as `sensor.simulate` and `tests/a_file.py::a_test` exist."""
    for span in code_spans(page):
        if re.fullmatch(r"(sensor|eres_render|tasks)(\.\w+)+", span):
            assert resolves(span), f"{page_name(page)}: there is no {span}"
        elif "::" in span:
            file, _, name = span.partition("::")
            assert re.search(rf"^def {name}\(", (ROOT / file).read_text(), re.MULTILINE), span
        elif re.fullmatch(r"(benchmarks|docs|eres_render|sensor|tasks|tests)/[\w./]+\.\w+", span):
            assert (ROOT / span).exists(), f"{page_name(page)}: there is no {span}"


def resolves(name):
    """Return whether a dotted name is a module, or a name in one."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:k]))
        except ModuleNotFoundError:
            continue
        for part in parts[k:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


@pytest.mark.slow
def test_the_readme_starts_at_once(capsys):
    """Promise: at most 900 words, a command within the first 150, and Python that runs."""
    text = (ROOT / "README.md").read_text()
    assert len(text.split()) <= 900
    assert len(text.partition("make demo")[0].split()) <= 150
    exec(re.search(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)[1], {})
    assert re.match(r"Events\(\d+ of 346x260 px", capsys.readouterr().out)


def test_each_command_has_its_help_on_one_page():
    """Promise: the pages of the command line have every command once."""
    pages = (page.read_text() for page in (ROOT / "docs").glob("cli*.md"))
    blocks = (re.search(r"```{command-help}\n(.*?)```", text, re.DOTALL)[1] for text in pages)
    listed = Counter(" ".join(blocks).split())
    for name in command_names():
        assert listed[name] + listed[name.split()[0]] * (" " in name) == 1, name


def test_every_equation_of_the_paper_is_there():
    """Promise: each of the equations (1) to (16) has a line, alone or shared."""
    first_cells = re.findall(r"^\| (\([^|]*\)) \|", EQUATIONS.read_text(), re.MULTILINE)
    numbers = [int(n) for cell in first_cells for n in re.findall(r"\((\d+)\)", cell)]
    assert numbers == list(range(1, 17))


def test_the_study_page_has_every_field_with_its_default(tmp_path):
    """Promise: the TOML on docs/study.md has every field of a study, with its default."""
    text = re.search(
        r"^```toml mine\.toml\n(.*?)^```", (ROOT / "docs" / "study.md").read_text(), re.M | re.S
    ).group(1)
    file = tmp_path / "mine.toml"
    file.write_text(text)
    assert read_study(file) == Study(name="mine", scenes=("carpet",))
    fields = re.sub(r"^# (\w+ =)", r"\1", text, flags=re.M)  # defaults TOML cannot express
    said = tomllib.loads(fields)
    assert missing_fields(Study(name="", scenes=("carpet",)), said) == []


def missing_fields(settings, said, where=""):
    """Return the fields of nested dataclasses that a table lacks."""
    missing = []
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if field.name not in said:
            missing.append(where + field.name)
        elif dataclasses.is_dataclass(value):
            missing += missing_fields(value, said[field.name], f"{where}{field.name}.")
    return missing


BUILD = """
import sys
from sphinx.cmd.build import main
code = main(["-q", "-E", "-W", "--keep-going", *sys.argv[1:]])
loaded = {"mitsuba", "drjit", "torch"} & set(sys.modules)
sys.exit(code or (f"the build loaded {loaded}" if loaded else 0))
"""


class Page(HTMLParser):
    """Collect what a page loads from elsewhere, and its code with and without a link."""

    def __init__(self, text):
        super().__init__()
        self.loaded, self.code, self.linked = [], [], []
        self._links, self._in_code = 0, False
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        source = found.get("src") if tag != "link" else found.get("href")
        if source and re.match(r"(https?:)?//", source):
            self.loaded.append(source)
        self._links += tag == "a"
        if tag == "code":
            self._in_code = True
            (self.linked if self._links else self.code).append("")

    def handle_endtag(self, tag):
        self._links -= tag == "a"
        self._in_code &= tag != "code"

    def handle_data(self, data):
        if self._in_code:
            (self.linked if self._links else self.code)[-1] += data


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    run = subprocess.run(
        [sys.executable, "-c", BUILD, str(ROOT / "docs"), str(folder)],
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    return folder


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_without_mitsuba(site):
    """Promise: `make docs` works on any machine; the reference reads code and renders nothing."""
    for page in PAGES[len(OF_THE_ROOT) :]:
        built = (site / page.relative_to(ROOT / "docs")).with_suffix(".html")
        assert "<h1>" in built.read_text(), built


@pytest.mark.slow
def test_the_site_loads_nothing_from_the_network(site):
    """Promise: the site needs no network, equations included."""
    for file in site.rglob("*.html"):
        assert Page(file.read_text()).loaded == [], file
    assert "<math" in (site / "equations.html").read_text()


@pytest.mark.slow
def test_every_function_of_an_equation_is_a_link_to_the_reference(site):
    page = Page((site / "equations.html").read_text())
    wanted = {
        span for span in code_spans(EQUATIONS) if re.match(r"(sensor|eres_render|tasks)\.", span)
    }
    assert len(wanted) > 30
    assert wanted <= set(page.linked), wanted - set(page.linked)
