"""The sensor is independent: it needs numpy, numba, scipy, and two small libraries."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]

ALONE = """
import importlib.abc, sys

class OnlyWhatIsPromised(importlib.abc.MetaPathFinder):
    allowed = {"sensor", "numpy", "numba", "llvmlite", "scipy", "filelock", "psutil"}
    allowed |= set(sys.stdlib_module_names)

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in self.allowed:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, OnlyWhatIsPromised())
for name in ("mitsuba", "h5py", "hdf5plugin", "cv2", "rich", "tyro", "matplotlib", "eres_render"):
    try:
        __import__(name)
    except ModuleNotFoundError:
        continue
    sys.exit(f"{name} was not blocked")

import numpy as np
from sensor import EventFormatError, SensorModel, simulate
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
    except EventFormatError as error:
        print(name, error)
"""


def test_sensor_works_with_few_packages(tmp_path):
    """Promise: `import sensor`, `simulate` and all own formats but HDF5 need no other package."""
    command = [sys.executable, "-c", ALONE]
    compiled = {name: os.environ[name] for name in ("NUMBA_CACHE_DIR",) if name in os.environ}
    environment = {"PYTHONPATH": str(ROOT), "PATH": "", **compiled}
    run = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment)
    assert run.returncode == 0, run.stderr
    fired, *formats = run.stdout.splitlines()
    assert int(fired) > 100
    written = {name: rest for name, _, rest in (line.partition(" ") for line in formats)}
    assert "needs h5py, which is not installed: pip install h5py hdf5plugin" in written.pop("dsec")
    assert written == dict.fromkeys(("evt3", "evt2", "npz", "text"), fired)
