"""Numba's cache never has outdated kernels."""

import re
from concurrent.futures import ThreadPoolExecutor

import pytest

from another_process import ROOT, environment, run_python

JIT = """
from pathlib import Path
from {} import compiler

jit = compiler(Path(__file__).parent)
"""
SENSOR, RENDER = "sensor.compiling", "eres_render.compiling"
CALLER = """
from kernels.compiling import jit
from kernels.callee import one


@jit
def two():
    return one() + one()
"""
CALLEE = """
from kernels.compiling import jit


@jit
def one():
    return {}
"""


@pytest.fixture
def folder(tmp_path, request):
    """A package of a kernel that calls another, which the test writes."""
    jit = JIT.format(getattr(request, "param", SENSOR))
    folder = tmp_path / "kernels"
    folder.mkdir()
    for name, text in (("__init__", ""), ("compiling", jit), ("caller", CALLER)):
        (folder / f"{name}.py").write_text(text)
    return folder


@pytest.fixture
def variables(tmp_path):
    """The environment of a process that finds the package, with an empty cache.

    Python takes bytecode for that of an edited file of the same size and second.
    """
    return {
        "PYTHONDONTWRITEBYTECODE": "1",
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
        "PYTHONPATH": f"{tmp_path}:{environment()['PYTHONPATH']}",
    }


@pytest.mark.slow
@pytest.mark.parametrize("folder", [SENSOR, RENDER], indirect=True)
def test_an_edit_of_a_kernel_recompiles_those_that_call_it(folder, variables):
    """Promise: Numba checks only the file of a function; here an edit also recompiles its callers
    in other files of the folder, and nothing is recompiled without an edit. `is_cached` tells."""

    def result():
        (folder / "callee.py").write_text(CALLEE.format(value))
        code = (
            "from kernels.caller import two; from sensor.compiling import is_cached;"
            "print(int(is_cached(two)), two(), sum(two.stats.cache_hits.values()))"
        )
        return tuple(map(int, run_python(code, **variables).stdout.split()))

    value = 1
    assert result() == (0, 2, 0)
    assert result() == (1, 2, 1)
    value = 5
    assert result() == (0, 10, 0)


TOGETHER = """
import sys, time
from pathlib import Path
from kernels.caller import two

here = Path(sys.argv[1])
(here / f"ready_{sys.argv[2]}").touch()
while len(list(here.glob("ready_*"))) < 3:
    time.sleep(1e-3)
print(two(), sum(two.stats.cache_misses.values()))
"""


@pytest.mark.slow
@pytest.mark.parametrize("folder", [SENSOR, RENDER], indirect=True)
def test_one_process_compiles_and_the_others_wait(folder, variables, tmp_path):
    """Promise: of processes that call a kernel at once, with an empty cache, one compiles it."""
    (folder / "callee.py").write_text(CALLEE.format(1))
    with ThreadPoolExecutor(3) as processes:
        ends = [
            processes.submit(run_python, TOGETHER, tmp_path, k, timeout_s=300, **variables)
            for k in range(3)
        ]
        said = sorted(end.result().stdout.split() for end in ends)
    assert said == [["2", "0"], ["2", "0"], ["2", "1"]]


def test_no_kernel_is_compiled_by_numba_alone():
    """Promise: Numba itself neither sees edits of other files nor compiles once for all."""
    packages = ("sensor", "eres_render", "tasks")
    files = [file for package in packages for file in (ROOT / package).rglob("*.py")]
    alone = [file for file in files if re.search(r"numba\.n?jit\b(?!`)", file.read_text())]
    assert {str(file.relative_to(ROOT)) for file in alone} == {
        "sensor/compiling.py",
        "eres_render/compiling.py",
    }
