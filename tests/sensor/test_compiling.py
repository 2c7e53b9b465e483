"""Numba's cache never has outdated kernels."""

import re
from concurrent.futures import ThreadPoolExecutor

import pytest

from another_process import ROOT, environment, run_python
from sensor import shipped

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


OF_A_TUPLE = """
from typing import NamedTuple
from kernels.compiling import jit


class {0}(NamedTuple):
    value: int


@jit
def value(light):
    return light.value


print(value({0}(3)))
"""


@pytest.mark.slow
@pytest.mark.parametrize("folder", [SENSOR, RENDER], indirect=True)
def test_an_update_may_rename_a_type_of_an_argument(folder, variables):
    """Promise: a cache of code whose types have been renamed since is compiled anew; unpickling it
    would fail."""
    for name in ("Light", "PixelLight"):
        (folder / "tuples.py").write_text(OF_A_TUPLE.format(name))
        assert run_python("import kernels.tuples", **variables).stdout == "3\n"


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


SHIP = """
from pathlib import Path
from kernels.caller import two
from sensor.shipped import ship

ship(two, (), "x86-64-v3", Path("{folder}"))
"""
USE = """
from pathlib import Path
from sensor import shipped
shipped.FOLDER = Path("{folder}")
from kernels.caller import two
from kernels.callee import one
from sensor.compiling import is_cached

known = is_cached(two)
compiled = two() and sum(two.stats.cache_misses.values())
print(int(known), two(), compiled, len(one.overloads))
"""


def shipped_for(features):
    return shipped._usable(",".join(f"+{name}" for name in sorted(features)) + ",-sse4a")


def test_code_is_used_on_a_processor_that_has_its_instructions(monkeypatch, tmp_path):
    """Promise: of the two kinds in a wheel the better one that the processor can run, or none."""
    monkeypatch.delenv("ERES_COMPILE", raising=False)
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    shipped._usable.cache_clear()
    v3, v4 = (shipped.TARGETS[f"x86-64-v{k}"] for k in (3, 4))
    assert shipped_for(v4) == ["x86-64-v4", "x86-64-v3"]
    assert shipped_for(v4 - {"avx512vl"}) == shipped_for(v3) == ["x86-64-v3"]
    assert shipped_for(v3 - {"fma"}) == shipped_for(()) == []
    shipped._usable.cache_clear()
    monkeypatch.setenv("ERES_COMPILE", "host")
    assert shipped_for(v4) == []
    shipped._usable.cache_clear()


@pytest.mark.slow
@pytest.mark.skipif(not shipped.runs_here("x86-64-v3"), reason="needs a processor of x86-64-v3")
def test_the_wheels_code_is_used_until_an_edit(folder, variables, tmp_path):
    """Promise: code of a wheel replaces compiling, also that of the kernels that it calls, unless
    the sources differ, the user wants the code of the host, or has it already."""

    def result(value, **more):
        (folder / "callee.py").write_text(CALLEE.format(value))
        said = run_python(USE.format(folder=tmp_path / "wheel"), **variables | more).stdout
        return tuple(map(int, said.split()))

    (folder / "callee.py").write_text(CALLEE.format(1))
    target = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": ""}
    elsewhere = {"NUMBA_CACHE_DIR": str(tmp_path / "elsewhere")}
    run_python(SHIP.format(folder=tmp_path / "wheel"), **variables | target | elsewhere)
    assert result(1) == result(1) == (1, 2, 0, 0)
    assert result(5) == (0, 10, 1, 1)
    assert result(1, ERES_COMPILE="host") == (0, 2, 1, 1)
    assert result(1, NUMBA_CPU_NAME="generic")[1:] == (2, 1, 1)
    assert result(1) == (1, 2, 0, 0)


@pytest.mark.slow
@pytest.mark.skipif(not shipped.runs_here("x86-64-v3"), reason="needs a processor of x86-64-v3")
def test_a_build_compiles_the_kernels(tmp_path, monkeypatch):
    """Promise: a wheel has those of the sensor, its formats, the methods and footage, for both
    kinds of processors. `test_wheel.py` runs them."""
    monkeypatch.syspath_prepend(ROOT)
    import hatch_build  # whose folder is on no path but here

    assert hatch_build._compile_kernels(str(ROOT), tmp_path) == ""
    for target in shipped.TARGETS:
        modules = {place.name for place in (tmp_path / "kernels" / target).iterdir()}
        assert modules > {
            "sensor.kernels.advance",
            "sensor.formats.evt3",
            "tasks.methods.photometric_tracking.accumulation",
            "tasks.footage.warping",
        }


def test_no_kernel_is_compiled_by_numba_alone():
    """Promise: Numba itself neither sees edits of other files nor compiles once for all."""
    packages = ("sensor", "eres_render", "tasks")
    files = [file for package in packages for file in (ROOT / package).rglob("*.py")]
    alone = [file for file in files if re.search(r"numba\.n?jit\b(?!`)", file.read_text())]
    assert {str(file.relative_to(ROOT)) for file in alone} == {
        "sensor/compiling.py",
        "eres_render/compiling.py",
    }
