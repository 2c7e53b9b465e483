"""Docstrings of public functions describe parameters and results."""

import ast
import importlib
import inspect
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("sensor", "eres_render", "tasks")


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
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for function in public_functions(ast.parse(path.read_text()))
        if (sections := missing(function))
    ]
    assert not lacking, "\n".join(lacking)


def documented():
    """Yield name and object of the functions and methods in the reference."""
    for page in sorted((ROOT / "docs/api").glob("*.md")):
        entries = re.findall(r"automodule:: (\S+)\n   :members:(.*)", page.read_text())
        for module, members in entries:
            names = members.replace(",", " ").split()
            code = importlib.import_module(module)
            own = [k for k, v in vars(code).items() if getattr(v, "__module__", "") == module]
            for name in names or getattr(code, "__all__", own):
                one = getattr(code, name)
                for inner, found in vars(one).items() if inspect.isclass(one) else [(name, one)]:
                    if inspect.isfunction(found) and not inner.startswith("_"):
                        yield f"{module}.{name}.{inner}", found


def test_paths_of_files_may_be_texts():
    """Promise: `read_rows("rows.parquet")` works wherever a path is asked for.

    Type checking shows that the functions do with a text what they do with a `Path`.
    """
    functions = dict(documented())
    assert len(functions) > 150
    only_paths = [
        f"{name}: {parameter}"
        for name, function in functions.items()
        for parameter in inspect.signature(function).parameters.values()
        if str(parameter.annotation) in ("Path", "Path | None", "Sequence[Path]")
        and not name.startswith("eres_render.trajectory.")  # a camera's path
    ]
    assert not only_paths, "\n".join(only_paths)
