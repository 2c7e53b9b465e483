"""Count the lines of code of each folder, without blank lines, comments and docstrings.

Run: python benchmarks/count_code.py [COMMIT]

Of templates, JavaScript and CSS, all lines count that are not blank.
"""

from __future__ import annotations

import ast
import io
import subprocess
import sys
import tokenize
from collections import Counter
from pathlib import Path

_PACKAGES = ("eres_render", "sensor", "tasks")
_SUFFIXES = (".py", ".html", ".js", ".css")
_NO_CODE = {
    *(tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE),
    *(tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER),
}
_WITH_DOCSTRING = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def main() -> None:
    """Print the table."""
    commit = sys.argv[1] if len(sys.argv) > 1 else None
    lines: Counter[str] = Counter()
    for file in _git("ls-tree", "-r", "--name-only", commit) if commit else _git("ls-files"):
        parts = Path(file).parts
        if parts[0] in (*_PACKAGES, "tests", "benchmarks") and file.endswith(_SUFFIXES):
            text = "\n".join(_git("show", f"{commit}:{file}")) if commit else Path(file).read_text()
            count = _python(text) if file.endswith(".py") else sum(map(bool, text.split("\n")))
            lines[parts[0]] += count
            lines["packages"] += count * (parts[0] in _PACKAGES)
            for depth in range(2, len(parts) if parts[0] == "tasks" else 0):
                lines["/".join(parts[:depth])] += count
    for folder in sorted(lines):
        print(f"{lines[folder]:7} {folder}")


def _git(*arguments: str) -> list[str]:
    run = subprocess.run(["git", *arguments], capture_output=True, text=True, check=True)
    return run.stdout.splitlines()


def _python(text: str) -> int:
    """Return the number of lines with a token that is neither comment nor docstring."""
    found: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in _NO_CODE:
            found.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, _WITH_DOCSTRING) and ast.get_docstring(node) is not None:
            found.difference_update(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    return len(found)


if __name__ == "__main__":
    main()
