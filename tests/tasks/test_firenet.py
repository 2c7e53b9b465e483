"""FireNet and FireNet+ equal the published code; outputs with weights from a formula are stored.

Needs PyTorch: `make .venv/.learned`.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path, PosixPath
from types import ModuleType

import numpy as np
import pytest

from eres_render import render_scene
from hashed_fill import assert_described, hashed_events, voxels, weight
from sensor import Events
from small_study import only, tiny_study
from tasks.errors import WeightsError
from tasks.evaluation.settings import Video
from tasks.methods import load_method
from tasks.study.run import run_study

torch = pytest.importorskip("torch", reason="PyTorch is not installed: make .venv/.learned")

from tasks.learned import cpu, e2vid, e2vid_network  # noqa: E402
from tasks.learned.checkpoint import read_checkpoint  # noqa: E402
from tasks.learned.firenet import FireNetNetwork, firenet, firenet_plus  # noqa: E402

pytestmark = pytest.mark.usefixtures("one_torch_thread")

FIRENET = json.loads((Path(__file__).parents[1] / "data" / "firenet.json").read_text())
NETWORKS = FIRENET["networks"]
LOAD = {"firenet": firenet, "firenet_plus": firenet_plus}
names = pytest.mark.parametrize("name", LOAD)


def state_of(name):
    """Return weights under the published names; the last bias starts at 0.5, as in the code."""
    state = {
        key: torch.from_numpy(weight(key, shape, FIRENET["gain"]))
        for key, shape in NETWORKS[name]["keys"].items()
    }
    (bias,) = (key for key in state if key.endswith("pred.conv2d.bias"))
    return {**state, bias: state[bias] + 0.5}


@pytest.fixture
def saved(tmp_path):
    """Return a function that saves a checkpoint and returns its file."""

    def save(content, name="weights.pth", **options):
        torch.save(content, tmp_path / name, **options)
        return tmp_path / name

    return save


@names
@pytest.mark.parametrize(("precision", "atol"), [("float64", 1e-9), ("float32", 2e-6)])
def test_firenet_equals_the_published_code(saved, monkeypatch, name, precision, atol):
    """Promise: from weights under the published names, images and states of three windows of two
    streams, of a size that nothing divides, computed five rows at a time."""
    monkeypatch.setattr(e2vid_network, "_BAND", 5 * 37 * 16 // 2)
    kind, expected = getattr(torch, precision), NETWORKS[name][precision]
    network, states = LOAD[name](saved(state_of(name)))._network.to(kind), None
    assert sum(p.numel() for p in network.parameters()) == NETWORKS[name]["parameters"] == 37_777
    with torch.inference_mode():
        for step, described in enumerate(expected["outputs"]):
            grid = torch.from_numpy(voxels(f"input{step}", (2, 5, 24, 37))).to(kind)
            image, states = network(grid, states)
            assert_described(image, described, atol)
    for (state,), described in zip(states, expected["states_after_last"], strict=True):
        assert_described(state, described, atol)


@names
def test_images_from_events_equal_the_published_code(saved, monkeypatch, name):
    """Promise: of three windows, voxel grid, normalization and padding (of FireNet alone), network,
    cut, and limits of 0 and 1, to 1e-5."""
    monkeypatch.setattr(cpu, "has_bfloat16", lambda: False)
    weights = {name: str(saved(state_of(name)))}
    method = load_method("video", name, weights)(37, 22, 0.2, window_us=50_000.0)
    for k, described in enumerate(NETWORKS[name]["chain_37x22"]):
        events, _ = hashed_events(f"stream{k}", 4000, 37, 22, 50_000)
        method.push(Events(events.t_us + 50_000 * k, events.x, events.y, events.p, 37, 22))
        image = np.exp(method.image(50_000 * (k + 1)))
        assert_described(image, described, 1e-5)


class Trap:
    """Is pickled as the configuration of FireNet+'s training; would run code when it is read."""

    def __init__(self, folder):
        self.folder = folder

    def __setstate__(self, state):
        raise AssertionError("code ran")


@pytest.fixture
def pickled_config(monkeypatch):
    """Return what FireNet+'s file holds beside weights: an object of a module that is not here."""
    module = ModuleType("parse_config")
    module.ConfigParser = type("ConfigParser", (Trap,), {"__module__": "parse_config"})
    monkeypatch.setitem(sys.modules, "parse_config", module)
    return module.ConfigParser(PosixPath("saved"))


@pytest.mark.parametrize("is_zip", [True, False])
def test_published_files_are_read_without_running_their_code(saved, pickled_config, is_zip):
    """Promise: both layouts, with options or a pickled configuration, in files of PyTorch before
    and after 1.6; other objects are refused, and so is the configuration by other methods."""
    grid, parts = voxels("grid", (5, 20, 30)).astype(np.float32), {}
    for name, config in (("firenet", {"model": {"num_bins": 5}}), ("firenet_plus", pickled_config)):
        whole = {"arch": "FireNet", "state_dict": state_of(name), "config": config}
        file = saved(whole, f"{name}.pth", _use_new_zipfile_serialization=is_zip)
        parts[name] = LOAD[name](file).image(grid)[0]
        np.testing.assert_array_equal(LOAD[name](saved(state_of(name))).image(grid)[0], parts[name])
    assert np.abs(parts["firenet"] - parts["firenet_plus"]).max() > 0.1
    with pytest.raises(WeightsError, match=r"found a pickle of parse_config\.ConfigParser"):
        e2vid.load(file)
    with pytest.raises(WeightsError, match=r"found a pickle of .*\.Trap, which could run code"):
        firenet_plus(saved({"state_dict": state_of("firenet_plus"), "config": Trap("")}))
    del sys.modules["parse_config"]
    assert not vars(
        read_checkpoint(file, ("parse_config.ConfigParser", "pathlib.PosixPath"))["config"]
    )


def without(name, key):
    state = state_of(name)
    del state[key]
    return state


E2VID_ENTRY = {"unetrecurrent.head.conv2d.weight": torch.zeros(32, 5, 5, 5)}
ARCH = "arch: found 'FireNet', expected 'E2VIDRecurrent'"


@pytest.mark.parametrize(
    ("load", "content", "words"),
    [
        (firenet, state_of("firenet_plus"), "give --weights firenet_plus=FILE"),
        (firenet_plus, {"state_dict": state_of("firenet")}, "give --weights firenet=FILE"),
        (firenet, {"state_dict": E2VID_ENTRY}, r"weight, expected the weights of firenet$"),
        (firenet_plus, {"model": E2VID_ENTRY}, "entry: model, expected tensors by name"),
        (firenet, [1], "found a list, expected tensors by name"),
        (
            firenet_plus,
            without("firenet_plus", "G2.out_gate.bias"),
            r"G2.out_gate.bias: found no entry, expected shape \(16,\)",
        ),
        (
            firenet_plus,
            {**state_of("firenet_plus"), "head.conv2d.weight": torch.zeros(16, 10, 3, 3)},
            r"found shape \(16, 10, 3, 3\), expected shape \(16, 5, 3, 3\)",
        ),
        (e2vid.load, {"arch": "FireNet", "state_dict": state_of("firenet")}, ARCH),
        (e2vid.load, state_of("firenet"), "expected arch and state_dict of E2VID"),
    ],
)
def test_weights_of_another_network_are_refused(saved, load, content, words):
    """Promise: one line says what the file holds, and for which method it is if that is known."""
    file = saved(content)
    with pytest.raises(WeightsError, match=words) as refused:
        load(file)
    assert str(refused.value).startswith(f"{file}: ")
    assert "\n" not in str(refused.value)


@names
def test_memory_is_known_before(saved, monkeypatch, name):
    """Promise: what a sensor keeps is its states and an image; too large a sensor is refused."""
    network = LOAD[name](saved(state_of(name)))
    assert isinstance(network, FireNetNetwork)
    _, states = network.image(np.zeros((5, 64, 96), np.float32))
    kept = sum(part.numel() * part.element_size() for state in states for part in state)
    assert network.kept_bytes(96, 64) == kept + 40 * 96 * 64
    monkeypatch.setattr("tasks.learned.cpu.memory_bytes", lambda: 1_000_000_000)
    network.check_size(1, 1)
    with pytest.raises(WeightsError, match=f"{name}: at 1280x1280 px it needs"):
        network.check_size(1280, 1280)


@pytest.mark.slow
def test_firenet_in_a_command_and_in_a_study(small_carpet, saved, tmp_path, eres):
    """Promise: `--weights` alone runs both; the settings of E2VID's windows are theirs too, and not
    those of our networks."""
    weights = {name: str(saved(state_of(name), f"{name}.pth")) for name in LOAD}
    options = {"resolution": 64, "spp": 4, "samples": 1, "max_displacement_px": 1.0}
    (clip,) = render_scene(small_carpet, tmp_path / "clips", **options)
    given = (f"{name}={file}" for name, file in weights.items())
    asked = ("evaluate", clip.folder, "--task", "video", "--resolution", 32, "--weights")
    code, out, err = eres(*asked, *given)
    assert code == 0, err
    assert {*LOAD, "blank"} <= {line.split()[0] for line in out.splitlines() if line.split()}
    ours = "our_reconstruction_all_light"
    video = Video(methods=(*LOAD, ours), duration_s=0.1, run_in_s=0.05, weights=weights)
    study, found = tiny_study(small_carpet.folder), []
    for window_s in (None, 0.005):
        changed = replace(study, evaluate=only(video=replace(video, e2vid_window_s=window_s)))
        rows = run_study(changed, tmp_path / f"run{window_s}")
        found.append({row.method: row.value for row in rows})
    assert {name for name in found[0] if found[0][name] != found[1][name]} == {*LOAD}
    short = replace(video, e2vid_window_s=0.0125)
    assert replace(short, methods=(ours,)).score_s(64, 64) == replace(
        video, methods=(ours,)
    ).score_s(64, 64)
    assert short.score_s(64, 64) > video.score_s(64, 64)
