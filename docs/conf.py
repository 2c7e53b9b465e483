"""Sphinx settings for the documentation site: `make docs`."""

import importlib.metadata
import io
import os
import re
import textwrap
from contextlib import redirect_stdout, suppress
from unittest import mock

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util.docutils import SphinxDirective

from tasks.cli.command_line import command_names
from tasks.cli.main import main

os.environ["NUMBA_DISABLE_JIT"] = "1"  # makes kernels plain functions with signatures
os.environ |= {"COLUMNS": "84", "NO_COLOR": "1"}  # of the terminal that shows the commands' help

project = "eres"
release = importlib.metadata.version("eres-events")
html_title = f"eres {release}"

extensions = [
    *("myst_parser", "sphinx_copybutton"),
    *("sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"),
]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

default_role = "py:obj"  # `simulate` in a docstring is a name
highlight_language = "text"

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
napoleon_google_docstring = False
napoleon_attr_annotations = False
napoleon_use_rtype = False

smartquotes = False  # docstrings contain code

html_theme = "furo"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_copyright = False
pygments_style = "friendly"


def link_names(app, doctree, docname):
    """Link `sensor.simulate` in a text to its entry in the reference.

    The pages stay plain Markdown, which a code host shows as well.
    """
    known = app.env.get_domain("py").objects
    for literal in list(doctree.findall(nodes.literal)):
        entry = known.get(literal.astext())
        if entry is None or isinstance(literal.parent, nodes.reference | nodes.title):
            continue
        page = app.builder.get_relative_uri(docname, entry.docname)
        link = nodes.reference(refuri=f"{page}#{entry.node_id}", internal=True)
        literal.replace_self(link)
        link += literal


def break_names(app, doctree, docname):
    """Break long names in tables between their parts, not anywhere or nowhere."""
    for entry in doctree.findall(nodes.entry):
        for literal in list(entry.findall(nodes.literal)):
            parts = re.split(r"(?<=[._/:])(?=\w)", literal.astext())
            literal.children = []
            for part in parts:
                literal += [nodes.Text(part), nodes.raw("", "<wbr>", format="html")]


def keep_bars(app, what, name, obj, options, lines):
    """Keep |x| in a docstring as a magnitude; reStructuredText would read a substitution."""
    lines[:] = [line.replace("|", r"\|") for line in lines]


def inline_math(translator, node):
    translator.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def display_math(translator, node):
    translator.body.append(tex2mathml(node.astext(), as_block=True))
    raise nodes.SkipNode


def shorten_arrays(app, what, name, obj, options, signature, returns):
    """Write array types as the code does: NDArray[int64]."""
    spelled_out = re.compile(
        r"(?:numpy\.|~)*ndarray\[tuple\[(?:~?typing\.)?Any, \.\.\.\], "
        r"(?:numpy\.|~)*dtype\[([^\[\]]*(?:\[[^\[\]]*\])?)\]\]"
    )
    return tuple(text and spelled_out.sub(r"NDArray[\1]", text) for text in (signature, returns))


def of_groups(groups):
    """Return the commands of a list that has their names, or the first word of several."""
    return [name for name in command_names() if {name, name.split()[0]} & {*groups}]


class CommandHelp(SphinxDirective):
    """Print the help of some commands, as a terminal shows it: their groups, or their names."""

    has_content = True

    def run(self):
        sections = []
        for name in of_groups(self.content):
            output = io.StringIO()
            asked = mock.patch("sys.argv", ["eres", *name.split(), "--help"])
            with asked, redirect_stdout(output), suppress(SystemExit):
                main()
            label = f"eres-{name}".replace(" ", "-")
            section = nodes.section(ids=[label], names=[label])
            section += nodes.title("", f"eres {name}")
            lines = [textwrap.fill(line, 84) for line in output.getvalue().splitlines()]
            section += nodes.literal_block("", "\n".join(lines), language="text")
            sections.append(section)
        return sections


def setup(app):
    app.add_directive("command-help", CommandHelp)
    app.connect("doctree-resolved", link_names)
    app.connect("doctree-resolved", break_names)
    app.connect("autodoc-process-docstring", keep_bars)
    app.connect("autodoc-process-signature", shorten_arrays)
    # Browsers show MathML without help, so pages load nothing from elsewhere.
    app.add_html_math_renderer("mathml", (inline_math, None), (display_math, None))
