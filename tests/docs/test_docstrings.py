"""Docstrings of public functions describe parameters and results."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]


def public_functions(node):
    """Return the public functions of a module and the public methods of its classes."""
    for one in node.body:
        if isinstance(one, ast.ClassDef | ast.FunctionDef) and not one.name.startswith("_"):
            yield from public_functions(one) if isinstance(one, ast.ClassDef) else [one]


def missing(function):
    """Return the sections that a docstring of a function of two or more arguments lacks.

    None if it says "As `Other.method`", which describes them.
    """
    arguments = function.args
    names = [a.arg for a in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
    names += [a.arg for a in (arguments.vararg, arguments.kwarg) if a]
    if len(set(names) - {"self", "cls"}) < 2:
        return []
    text = ast.get_docstring(function) or ""
    if text.startswith("As `"):
        return []
    returns = function.returns is not None and ast.unparse(function.returns) != "None"
    wanted = ["Parameters", "Returns"] if returns else ["Parameters"]
    if "Yields" in text:
        wanted = ["Parameters"]
    return [section for section in wanted if f"{section}\n---" not in text]


def test_public_functions_of_two_arguments_have_parameters_and_returns():
    """Promise: `help()` gives shapes and units, so nobody has to read the code."""
    lacking = [
        f"{path.relative_to(ROOT)}:{function.lineno} {function.name}: {', '.join(sections)}"
        for package in ("sensor", "eres_render", "tasks")
        for path in sorted((ROOT / package).rglob("*.py"))
        for function in public_functions(ast.parse(path.read_text()))
        if (sections := missing(function))
    ]
    assert not lacking, "\n".join(lacking)
