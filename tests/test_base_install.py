"""The base install: frames in, events out; a command that needs more names the extra."""

import json
import tomllib

import cv2
import numpy as np
import pytest
from PIL import Image

from another_process import ROOT, run_python
from few_packages import BASE
from tasks.extras import EXTRAS

pytestmark = pytest.mark.slow
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
COMMANDS = """
import contextlib, io, json, os, sys
import few_packages
few_packages.find_only(*few_packages.OURS, *few_packages.BASE, *few_packages.NEEDED)
from tasks import cli

os.chdir(sys.argv[1])
ended = []
for command in json.load(open("commands.json")):
    sys.argv = ["eres", *command.split()]
    code, texts = 0, (io.StringIO(), io.StringIO())
    with contextlib.redirect_stdout(texts[0]), contextlib.redirect_stderr(texts[1]):
        try:
            cli.main()
        except SystemExit as stop:
            code = stop.code or 0
    ended.append((code, *(text.getvalue() for text in texts)))

try:
    import eres_events as eres, sensor, sensor.formats, sensor.representations, sensor.statistics
    for module in (sensor, sensor.formats, sensor.representations, sensor.statistics):
        for name in module.__all__:
            getattr(eres, name)
    python = eres.EventDataset.__name__, eres.open_sequence.__name__, eres.load_scene("room").name
except ImportError as error:
    python = repr(error)
json.dump([*ended, python], sys.stdout)
"""
ALONE = {
    "--version": "eres ",
    "doctor": "pip install 'eres-events[study]'",
    "scenes": "carpet",
    "sensors": "davis346",
    "methods": "photometric_flow",
    "advise --sensor gen4-cd --speed 1 --distance 1 --lux 100 --widths 320 640": "choose 640x360",
    "advise --speed 1 --distance 1 --lux 9 --widths 16 32 --image jpg/0.jpg": ": by the image",
    "stereo carpet --baseline 0.1 --out second.txt": "second.txt: ",
    "simulate png --fps 500 --out e.h5": "e.h5: ",
    **{f"simulate {kind} --fps 500 --out {kind}.h5": f"{kind}.h5: " for kind in ("jpg", "tif")},
    "info e.h5": "DSEC HDF5",
    "convert e.h5 e.raw": "e.raw: ",
    "view e.h5 --out e.png": "e.png: ",
    "view e.h5 --out e.html": "e.html: ",
    "view e.h5 --out e.webp --height 48": "e.webp: ",
}
NEED = {
    "simulate clip.mp4 --out v.h5": "video",
    "simulate deep --fps 500 --out v.h5": "video",
    "simulate png --fps 500 --interpolate auto --out v.h5": "video",
    "view e.h5 --out e.mp4": "video",
    "video e.h5 --out images": "video",
    "fit e.h5 --still 0 0.01 --out camera.toml": "video",
    "bake carpet": "render",
    "render carpet --out clips": "render",
    "convergence carpet": "render",
    "dataset data --count 1": "render",
    "evaluate e.h5 --task flow": "render",
    "study --out run": "study",
    "report run": "study",
    "claims run": "study",
    "rig render rig.toml --depth 0.3 --out rig": "study",
    "rig detect rig --out corners.parquet": "study",
    "rig evaluate rig --out run": "study",
    "train flow --out training": "learned",
    "train reconstruction --out training": "learned",
    "info e.es": "formats",
    "info e.bag": "formats",
    "view e.h5 --out e.rrd": "viewer",
}


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """Exit code, stdout and stderr of each command, by command; names of what Python imported."""
    folder = tmp_path_factory.mktemp("base")
    wave = 128 + 99 * np.sin(0.3 * (np.arange(32) + np.arange(9)[:, None]))
    frames = np.repeat(wave[:, None], 24, axis=1)
    for name in ("png", "jpg", "tif", "deep"):
        (folder / name).mkdir()
    for k, frame in enumerate(frames):
        gray, deep = frame.astype(np.uint8), (200 * frame).astype(np.uint16)
        Image.fromarray(deep).save(folder / "png" / f"{k}.png")
        Image.fromarray(gray).convert("RGB").save(folder / "jpg" / f"{k}.jpg")
        Image.fromarray(frame.astype(np.float32)).save(folder / "tif" / f"{k}.tif")
        cv2.imwrite(str(folder / "deep" / f"{k}.png"), np.dstack([deep] * 3))
    for name in ("clip.mp4", "e.es", "e.bag", "rig.toml"):
        (folder / name).touch()
    commands = [*ALONE, *NEED]
    (folder / "commands.json").write_text(json.dumps(commands))
    outputs = json.loads(run_python(COMMANDS, folder, COLUMNS="200").stdout)
    return dict(zip([*commands, "python"], outputs, strict=True))


@pytest.mark.parametrize("command", ALONE)
def test_what_needs_no_extra(ended, command):
    """Promise: these commands work where no extra is installed."""
    code, out, err = ended[command]
    assert (code, ALONE[command] in out) == (0, True), err


@pytest.mark.parametrize("command", NEED)
def test_a_command_names_the_extra_that_it_lacks(ended, command):
    """Promise: one line with pip's command, exit code 1; for PyTorch, its page before that."""
    code, _, err = ended[command]
    *_, line = err.splitlines()
    assert (code, err.count("error: ")) == (1, 1), err
    assert line.startswith("error: this needs "), err
    assert line.endswith(f"pip install 'eres-events[{NEED[command]}]'"), err
    assert ("https://pytorch.org/get-started/" in line) == (NEED[command] == "learned")


def test_python_needs_no_extra(ended):
    """Promise: representations, datasets and all names of the sensor are there without extras."""
    assert ended["python"] == ["EventDataset", "open_sequence", "room"]


def required(extra):
    """Return the distributions of an extra, with those of the extras that it includes."""
    names = set()
    for one in PROJECT["optional-dependencies"][extra]:
        name = one.partition(">")[0].partition("=")[0].partition("<")[0]
        own, _, inner = name.rstrip("]").partition("[")
        if own == PROJECT["name"]:
            names |= {each for other in inner.split(",") for each in required(other)}
        else:
            names.add(own.lower())
    return names


def test_the_extras_are_those_of_the_project():
    """Promise: each extra has the modules of its distributions, `all` has all but `cuda`."""
    owners = {
        "cv2": "opencv-python-headless",
        "distributed": "dask",
        "numba_cuda": "numba-cuda",
        "rerun": "rerun-sdk",
    }
    extras = {*PROJECT["optional-dependencies"]} - {"all", "dev", "docs"}
    assert extras == {*EXTRAS}
    for extra, modules in EXTRAS.items():
        assert {owners.get(name, name) for name in modules} == required(extra) - {"numpy"}
    assert required("all") == {name for extra in extras - {"cuda"} for name in required(extra)}
    assert {one.partition(">")[0] for one in PROJECT["dependencies"]} == {*BASE.values()}
