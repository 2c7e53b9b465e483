"""docs/methods.md: its files are written and its commands run, top to bottom."""

import pytest

from docs_page import follow
from tasks.errors import TaskError
from tasks.methods import METHOD_VERSIONS, code_of, load_method, task_of
from tasks.row import read_rows


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own_method")
    return folder, follow("methods.md", folder)


def test_a_method_of_ones_own_is_scored_beside_ours(page):
    """Promise: a function outside the project takes part in `eres evaluate` and `eres study`."""
    folder, said = page
    assert "my_flow:estimate" in said
    rows = [r for r in read_rows(folder / "run" / "rows.parquet") if r.method == "my_flow:estimate"]
    assert {row.task for row in rows} == {"flow"}
    assert len({(row.width, row.cutoff_hz, row.speed) for row in rows}) == 9


def test_code_of_own_methods_names_their_rows(tmp_path, monkeypatch):
    """Promise: an edit of the method's file is noticed, so old scores are not taken for its own.

    Of our methods it is their number.
    """
    monkeypatch.syspath_prepend(tmp_path)
    file = tmp_path / "edited_method.py"
    file.write_text("def estimate(sample): ...\n")
    before = code_of(["contrast_maximization", "edited_method:estimate"])
    file.write_text("def estimate(sample): return 1\n")
    assert list(before) == ["edited_method:estimate"]
    assert code_of(["edited_method:estimate"]) != before
    monkeypatch.setitem(METHOD_VERSIONS, "contrast_maximization", 2)
    assert code_of(["contrast_maximization"]) == {"contrast_maximization": "2"}


def test_methods_that_are_not_there_are_refused(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "odd_method.py").write_text("value = 3\ndef untyped(sample): ...\n")
    with pytest.raises(TaskError, match="did you mean 'photometric_flow'"):
        load_method("flow", "fotometric_flow")
    with pytest.raises(TaskError, match="cannot be imported"):
        load_method("flow", "no_such_package:estimate")
    with pytest.raises(TaskError, match="found no function 'value' in odd_method"):
        load_method("flow", "odd_method:value")
    with pytest.raises(TaskError, match="expected one of ReconstructionSample, FlowSample"):
        task_of("odd_method:untyped")
