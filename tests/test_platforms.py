"""The sensor, its files and the locks need nothing that only Linux has.

Nobody has run them on macOS or Windows yet: here what these lack is hidden, and the name of the
platform is theirs. The libraries below us stay those of Linux.
"""

import subprocess
import sys

import pytest

from another_process import ROOT, environment

HIDDEN = """
import os, sys
import cv2, h5py, hdf5plugin, matplotlib.pyplot, numba, numba.cuda, numpy, psutil, scipy.optimize
import filelock, OpenEXR, pytest, rich.console, tyro, tasks.cli
platform, *tests = sys.argv[1:]
names = ["sched_getaffinity", "sched_setaffinity"]
if platform == "win32":
    names += ["sysconf", "fork", "geteuid"]
else:
    del psutil.Process.cpu_affinity
for name in names:
    delattr(os, name)


class Elsewhere:
    def pytest_sessionstart(self):  # pytest itself has started here
        sys.platform = platform
        if platform == "win32":
            sys.modules["fcntl"] = sys.modules["resource"] = None


sys.exit(pytest.main(["-q", "-x", "-p", "no:cacheprovider", *tests], plugins=[Elsewhere()]))
"""
TESTS = (
    "tests/sensor/test_simulate.py",
    "tests/sensor/test_live.py",
    "tests/sensor/test_formats_roundtrip.py",
    "tests/sensor/test_cameras.py",
    "tests/tasks/test_footage.py",
)


@pytest.mark.slow
@pytest.mark.parametrize("platform", ["darwin", "win32"])
def test_what_only_linux_has_is_not_needed(platform):
    """Promise: simulation, live cameras, formats, cameras and footage run without it."""
    command = [sys.executable, "-c", HIDDEN, platform, *TESTS]
    ran = subprocess.run(command, cwd=ROOT, env=environment(), capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout[-3000:] + ran.stderr[-2000:]
