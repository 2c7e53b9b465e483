"""Docstrings of public functions describe parameters and results."""

import importlib
import inspect
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def missing(function):
    """Return the sections that a docstring of a function of two or more arguments lacks.

    None if it says "As `Other.method`", which describes them.
    """
    signature = inspect.signature(function)
    if len({*signature.parameters} - {"self", "cls"}) < 2:
        return []
    text = inspect.getdoc(function) or ""
    if text.startswith("As `"):
        return []
    returns = str(signature.return_annotation) != "None" and "Yields" not in text
    wanted = ["Parameters", "Returns"] if returns else ["Parameters"]
    return [section for section in wanted if f"{section}\n---" not in text]


def test_functions_of_two_arguments_have_parameters_and_returns():
    """Promise: `help()` of what docs/api lists gives shapes and units, so nobody has to read the
    code."""
    lacking = [
        f"{name}: {', '.join(sections)}"
        for name, function in documented()
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
                if name.startswith("_"):
                    continue
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
