"""The sensor is independent: it needs numpy, numba, scipy, and two small libraries."""

import pytest

from another_process import run_python

ALONE = """
import os, sys
import few_packages
few_packages.find_only("sensor", "numpy", "numba", "llvmlite", "scipy", "filelock", "psutil")
os.chdir(sys.argv[1])
for name in ("mitsuba", "h5py", "hdf5plugin", "cv2", "rich", "tyro", "matplotlib", "eres_render"):
    try:
        __import__(name)
    except ModuleNotFoundError:
        continue
    sys.exit(f"{name} was not blocked")

import numpy as np
from sensor import SensorModel, simulate
from sensor.formats import FORMATS, load_events, write_events

t_s = np.arange(20) * 1e-3
frames = 1.1 + np.sin(np.arange(16) + 200 * t_s[:, None, None]) * np.ones((20, 16, 16))
events = simulate(frames, t_s, SensorModel(width=16, height=16, cutoff_hz=200.0), seed=1)
print(len(events))
for name, format in FORMATS.items():
    if format.write is None:
        continue
    try:
        write_events(f"events.{name}", events, format=name)
        print(name, len(load_events(f"events.{name}", format=name)))
    except ModuleNotFoundError as error:
        print(name, error.name)
"""


@pytest.mark.slow
def test_sensor_works_with_few_packages(tmp_path):
    """Promise: `import sensor`, `simulate` and all own formats but HDF5 need no other package."""
    fired, *formats = run_python(ALONE, tmp_path, PATH="").stdout.splitlines()
    assert int(fired) > 100
    written = {name: rest for name, _, rest in (line.partition(" ") for line in formats)}
    assert written.pop("dsec") == "h5py"
    assert written == dict.fromkeys(("evt3", "evt2", "npz", "text"), fired)
