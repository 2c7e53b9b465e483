"""Sphinx settings for the documentation site: `make docs`."""

import importlib.metadata
import os
import re

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml

os.environ["NUMBA_DISABLE_JIT"] = "1"  # makes kernels plain functions with signatures

project = "eres"
release = importlib.metadata.version("eres-events")
html_title = f"eres {release}"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

default_role = "py:obj"  # `simulate` in a docstring is a name
highlight_language = "text"

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docstrings have types with shapes and units
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
        found = known.get(literal.astext())
        if found is None or isinstance(literal.parent, nodes.reference | nodes.title):
            continue
        page = app.builder.get_relative_uri(docname, found.docname)
        link = nodes.reference(refuri=f"{page}#{found.node_id}", internal=True)
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


def setup(app):
    app.connect("doctree-resolved", link_names)
    app.connect("doctree-resolved", break_names)
    app.connect("autodoc-process-docstring", keep_bars)
    # Browsers show MathML without help, so pages load nothing from elsewhere.
    app.add_html_math_renderer("mathml", (inline_math, None), (display_math, None))
