"""The cache of Numba never has outdated kernels."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from sensor.kernels import elementary

CALLER = """
from kernels.elementary import jit
from kernels.callee import one


@jit
def two():
    return one() + one()
"""
CALLEE = """
from kernels.elementary import jit


@jit
def one():
    return {}
"""


def test_an_edit_of_a_kernel_recompiles_those_that_call_it(tmp_path):
    """Promise: Numba checks only the file of a function; here its callers in other files of the
    folder are compiled again as well, and nothing is compiled again without an edit."""
    folder = tmp_path / "kernels"
    folder.mkdir()
    (folder / "__init__.py").touch()
    shutil.copy(Path(elementary.__file__), folder)
    (folder / "caller.py").write_text(CALLER)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def result():
        (folder / "callee.py").write_text(CALLEE.format(value))
        code = "from kernels.caller import two; print(two(), sum(two.stats.cache_hits.values()))"
        run = subprocess.run(
            [sys.executable, "-c", code],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        return tuple(map(int, run.stdout.split()))

    value = 1
    assert result() == (2, 0)
    assert result() == (2, 1)
    value = 5
    assert result() == (10, 0)
