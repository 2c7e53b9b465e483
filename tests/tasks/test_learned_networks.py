"""Networks equal the published code, whose outputs with weights from a formula are stored.

Needs PyTorch: `make .venv/.learned`.
"""

import json
import math
import pickle
import time
from collections import OrderedDict
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from eres_render import render_scene
from hashed_fill import assert_described, hashed_events, voxels, weight
from recordings import make_recording
from sensor import Events
from sensor.representations import voxel_grid
from small_study import only, tiny_study
from tasks.errors import WeightsError
from tasks.evaluation.settings import check_methods
from tasks.methods.e2vid import DARKEST, E2vid
from tasks.recording.evaluate import evaluate_recording
from tasks.recording.frames import open_frames
from tasks.recording.options import FlowOptions, VideoOptions
from tasks.recording.recording import open_recording
from tasks.recording.video import write_video
from tasks.study.config import DenseFlow, Video
from tasks.study.run import run_study

torch = pytest.importorskip("torch", reason="PyTorch is not installed: make .venv/.learned")

from torch.nn import functional  # noqa: E402

from tasks.cpu_time import cpu_s  # noqa: E402
from tasks.learned import cpu, e2vid, eraft  # noqa: E402
from tasks.learned import e2vid_network as e2vid_network_file  # noqa: E402
from tasks.learned.correlation import Correlation  # noqa: E402
from tasks.learned.e2vid_network import E2vidOptions, E2VIDRecurrent  # noqa: E402
from tasks.learned.eraft_network import ERAFT, cells, padded  # noqa: E402
from tasks.methods import check_method, code_of, load_method  # noqa: E402
from tasks.methods.networks import digest_of  # noqa: E402

pytestmark = pytest.mark.usefixtures("one_torch_thread")

DATA = Path(__file__).parents[1] / "data"
E2VID = json.loads((DATA / "e2vid.json").read_text())
ERAFT_DATA = json.loads((DATA / "eraft.json").read_text())
CONFIGS = list(E2VID["configs"])


def e2vid_state(config):
    keys = E2VID["keys"][config]["keys"]
    return OrderedDict((k, torch.from_numpy(weight(k, s, E2VID["gain"]))) for k, s in keys.items())


def e2vid_network(config, kind=torch.float32):
    network = E2VIDRecurrent(E2vidOptions(**E2VID["configs"][config])).to(kind).eval()
    network.load_state_dict({k: v.to(kind) for k, v in e2vid_state(config).items()})
    return network


def e2vid_checkpoint(config="small", **changes):
    return {
        "arch": "E2VIDRecurrent",
        "model": E2VID["configs"][config],
        "state_dict": e2vid_state(config),
        **changes,
    }


def eraft_state():
    def value(key, shape):
        gain = ERAFT_DATA["gain"]["*"]
        if key.startswith("cnet."):
            gain = 0.8
        if key == "update_block.flow_head.conv2.weight":
            gain = 0.25
        return torch.from_numpy(weight(key.replace("downsample.1.", "norm3."), shape, gain))

    keys = ERAFT_DATA["keys"]["15"]["keys"]
    return OrderedDict((key, value(key, shape)) for key, shape in keys.items())


@pytest.fixture(scope="module")
def random_eraft():
    """Return a state of E-RAFT, 5 bins, that PyTorch draws; quicker than that of the formula."""
    torch.manual_seed(0)
    return ERAFT(5).state_dict()


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Return a function that saves a checkpoint and returns its file."""
    folder = tmp_path_factory.mktemp("weights")

    def save(content, name="weights.pth"):
        torch.save(content, folder / name)
        return folder / name

    return save


def shapes(network):
    return [(key, list(value.shape)) for key, value in network.state_dict().items()]


@pytest.mark.parametrize("config", CONFIGS)
def test_e2vid_has_the_published_entries(config):
    """Promise: names, order, shapes and number of parameters are those of the published code."""
    with torch.device("meta"):
        network = E2VIDRecurrent(E2vidOptions(**E2VID["configs"][config]))
    expected = E2VID["keys"][config]
    assert shapes(network) == list(expected["keys"].items())
    assert sum(p.numel() for p in network.parameters()) == expected["parameters"]


@pytest.mark.parametrize("bins", [15, 5])
def test_eraft_has_the_published_entries(bins):
    """Promise: 179 entries, ten of them twice, and the published number of parameters."""
    with torch.device("meta"):
        network = ERAFT(bins)
    expected = ERAFT_DATA["keys"][str(bins)]
    assert shapes(network) == list(expected["keys"].items())
    assert len(network.state_dict()) == 179
    assert sum(p.numel() for p in network.parameters()) == expected["parameters"]


@pytest.mark.parametrize(
    ("config", "precision"),
    [
        ("small", "float64"),
        ("concat_gru", "float64"),
        *(
            pytest.param(config, precision, marks=pytest.mark.slow)
            for config in CONFIGS
            for precision in ("float64", "float32")
        ),
    ],
)
def test_e2vid_equals_the_published_code(config, precision):
    """Promise: images and states of three windows, to 1e-9 in float64 and 2e-6 in float32."""
    kind, atol = {"float64": (torch.float64, 1e-9), "float32": (torch.float32, 2e-6)}[precision]
    network, states = e2vid_network(config, kind), None
    expected = E2VID["networks"][config][precision]
    shape = 2, network.options.num_bins, 64, 96
    with torch.inference_mode():
        for step, described in enumerate(expected["outputs"]):
            grid = torch.from_numpy(voxels(f"input{step}", shape)).to(kind)
            image, states = network(grid, states)
            assert_described(image, described, atol)
    for state, described in zip(states, expected["states_after_last"], strict=True):
        of_state = described if isinstance(described, list) else [described]
        for one, stored in zip(state, of_state, strict=True):
            assert_described(one, stored, atol)


@pytest.mark.slow
def test_e2vids_images_from_events_equal_the_published_code(saved, monkeypatch):
    """Promise: grid, normalization, padding, network and cut of three windows, to 1e-5."""
    monkeypatch.setattr(cpu, "has_bfloat16", lambda: False)
    file = saved(e2vid_checkpoint("lightweight"), "lightweight.pth")
    network = e2vid.load(file)
    method = E2vid(40, 30, 0.2, network=network, window_us=50_000.0)
    for k, described in enumerate(E2VID["chain_lightweight_40x30"]):
        events, _ = hashed_events(f"stream{k}", 5000, 40, 30, 50_000)
        later = events.t_us + 50_000 * k
        method.push(Events(later, events.x, events.y, events.p, 40, 30))
        image = np.exp(method.image(50_000 * (k + 1)))
        assert image.min() > DARKEST
        assert_described(image, described["image"], 1e-5)


def test_e2vids_images_are_those_of_its_padded_windows(monkeypatch):
    """Promise: each window's grid is padded by reflection, goes through the network with the state
    of the window before, and the image is cut out again; 10 x 7 px become 12 x 8."""
    monkeypatch.setattr(cpu, "has_bfloat16", lambda: False)
    network, states = e2vid_network("small"), None
    method = E2vid(10, 7, 0.2, network=e2vid.E2vidNetwork(network), window_us=50_000.0)
    events, _ = hashed_events("stream", 600, 10, 7, 100_000)
    method.push(events)
    for start_us in (0, 50_000):
        grid = voxel_grid(events.between(start_us, start_us + 50_000), 5)
        whole = np.pad(grid, [(0, 0), (1, 0), (1, 1)], mode="reflect")
        with torch.inference_mode():
            expected, states = network(torch.from_numpy(whole)[None], states)
    found = np.exp(method.image(100_000))
    np.testing.assert_allclose(found, expected[0, 0, 1:, 1:-1], atol=1e-6)
    assert np.ptp(found) > 0.1


def test_a_memory_by_bands_of_rows_is_that_of_all_rows_at_once(monkeypatch):
    """Promise: without gradients bands of rows, the last one shorter, give the same memory."""
    torch.manual_seed(0)
    lstm = e2vid_network_file._ConvLSTM(8)
    x, state = torch.randn(1, 8, 37, 20), (torch.randn(1, 8, 37, 20), torch.randn(1, 8, 37, 20))
    whole = lstm(x, state)
    monkeypatch.setattr(e2vid_network_file, "_BAND", 5 * 32 * 20)
    with torch.inference_mode():
        banded = lstm(x, state)
    for one, other in zip(whole, banded, strict=True):
        torch.testing.assert_close(one.detach(), other, rtol=0, atol=1e-6)


@pytest.mark.parametrize("width", ["128", "240", "346", "640", "1280"])
def test_padding_is_that_of_the_published_code(width):
    """Promise: E2VID reflects on all sides, E-RAFT adds zeros on the left and at the top."""
    row = torch.arange(1.0, int(width) + 1).expand(1, 1, 8, -1)
    whole = e2vid.padded(row, 8, "reflect")
    size, left, *_ = E2VID["crops"][width]
    assert whole.shape[-1] == size
    assert torch.equal(whole[..., left : left + int(width)], row)
    if left:
        assert whole[0, 0, 0, 0] == left + 1
    size, left = ERAFT_DATA["padding_left_top"][width]
    whole = padded(row)
    assert whole.shape[-2:] == (32, size)
    assert torch.equal(whole[..., 24:, left:], row)
    assert not whole[..., :24, :].any()
    assert not whole[..., :left].any()


@pytest.mark.parametrize(
    ("run", "updates"),
    [
        (1, 1),
        pytest.param(0, 4, marks=pytest.mark.slow),
        pytest.param(1, 4, marks=pytest.mark.slow),
    ],
)
def test_eraft_equals_the_published_code(run, updates):
    """Promise: every stage, and the flow of each update to 1e-4 px."""
    expected = ERAFT_DATA["runs"][run]
    size = [(128, 160), (130, 161)][run]
    network = ERAFT(15)
    network.load_state_dict(eraft_state())
    old, new = (voxels(name, (1, 15, *size)).astype(np.float32) for name in ("old", "new"))
    new[..., 3:] = 0.7 * old[..., :-3] + 0.3 * new[..., 3:]
    old, new = torch.from_numpy(old), torch.from_numpy(new)
    network.eval()
    with torch.inference_mode():
        whole = padded(old), padded(new)
        assert list(whole[0].shape) == expected["padded"]
        features = [network.fnet(grid) for grid in whole]
        for found, name in zip(features, ("fmap_old", "fmap_new"), strict=True):
            assert_described(found, expected[name], 1e-4, 1e-5)
        assert_described(network.cnet(whole[1]), expected["cnet"], 1e-4, 1e-5)
        levels = correlation_levels(*features)
        assert [list(one.shape) for one in levels] == expected["corr_level_shapes"]
        found = [[float(one.mean()), float(one.std())] for one in levels]
        np.testing.assert_allclose(found, expected["corr_level_means_std"], rtol=1e-4)
        at = cells(*features[0].shape[-2:]) + 0.37
        described = expected["lookup_at_grid_plus_0.37"]
        assert_described(Correlation(*features).look_up(at), described, 2e-4, 1e-5)
        for count, described in enumerate(expected["flow_up_after_1_to_4"][:updates], start=1):
            (full,) = network(old, new, count)
            assert_described(full, described, 1e-4)
        assert list(full.shape[-2:]) == list(size)


def correlation_levels(old, new):
    """Return the whole correlation, (h * w, 1, h', w') at each level: the slow reference."""
    queries = old[0].reshape(old.shape[1], -1).T / math.sqrt(old.shape[1])
    products = (queries @ new[0].reshape(new.shape[1], -1)).view(-1, 1, *new.shape[-2:])
    return [functional.avg_pool2d(products, 2**level) for level in range(4)]


def look_up_in_all(levels, at):
    """Return what is around places in the whole correlation, one place and level at a time."""
    steps = torch.arange(-4.0, 5.0)
    x, y = torch.meshgrid(steps, steps, indexing="ij")  # the offset in x is the slow one
    found = []
    for level, products in enumerate(levels):
        height, width = products.shape[-2:]
        places = at[0].flatten(1).T / 2**level
        around = [
            functional.grid_sample(
                products[k : k + 1],
                torch.stack(
                    [2 * (place[0] + x) / (width - 1) - 1, 2 * (place[1] + y) / (height - 1) - 1],
                    dim=-1,
                )[None],
                align_corners=True,
            ).flatten()
            for k, place in enumerate(places)
        ]
        found.append(torch.stack(around, dim=1))
    return torch.cat(found).view(1, -1, *at.shape[-2:])


@pytest.fixture(params=["kernel", "with gradients"])
def features(request):
    """Return a function that makes features whose look-ups take one of the two ways."""
    return lambda made: made.requires_grad_(request.param == "with gradients")


@pytest.mark.parametrize("moved", ["little", "far", "out"])
def test_look_ups_equal_those_in_the_whole_correlation(features, moved):
    """Promise: a look-up does not depend on how it is computed: nearby, all over the image, and
    outside it, with a number of rows that is not a multiple of a block's or a band's, and in each
    image of a batch."""
    generator = torch.Generator().manual_seed(3)
    old, new = features(torch.randn((2, 2, 6, 42, 17), generator=generator))
    reach = {"little": 0.8, "far": 30.0, "out": 0.8}[moved]
    at = cells(42, 17) + reach * torch.randn((2, 2, 42, 17), generator=generator)
    at[:, 1] += {"little": 0, "far": 0, "out": 90}[moved]
    found = Correlation(old, new).look_up(at)
    for k in range(2):
        one = slice(k, k + 1)
        expected = look_up_in_all(correlation_levels(old[one], new[one]), at[one])
        assert bool(expected[:, :81].any()) == (moved != "out")
        torch.testing.assert_close(found[one], expected, atol=2e-5, rtol=1e-5)


def test_a_look_up_finds_the_products_of_the_cells_around(features):
    """Analytic: at whole cells the offset (dx, dy) is channel 9 (dx + 4) + dy + 4 of level 0, and
    has the inner product over the root of the number of channels."""
    generator = torch.Generator().manual_seed(5)
    old, new = features(torch.randn((2, 1, 4, 16, 16), generator=generator))
    found = Correlation(old, new).look_up(cells(16, 16))
    for dx, dy in ((0, 0), (3, -1), (-4, 4)):
        product = (old[0, :, 9, 6] @ new[0, :, 9 + dy, 6 + dx]) / 2
        torch.testing.assert_close(found[0, 9 * (dx + 4) + dy + 4, 9, 6], product)
    assert not found[0, 0, 2, 2], "outside the image"


def test_places_that_are_not_finite_give_no_error(features):
    """Promise: the look-up accepts a flow that has diverged; the method then fails."""
    at = cells(16, 16)
    at[0, :, 3, 3], at[0, 1, 5, 5] = torch.nan, torch.inf
    same = features(torch.ones(1, 4, 16, 16))
    assert Correlation(same, same).look_up(at).shape == (1, 324, 16, 16)


def test_checkpoints_load_with_and_without_options(saved):
    """Promise: a file may have the options or not, as they are those of the weights."""
    whole = e2vid_checkpoint()
    bare = {"state_dict": whole["state_dict"]}
    grid = voxels("grid", (5, 16, 16)).astype(np.float32)
    images = [e2vid.load(saved(one)).image(grid)[0] for one in (whole, bare)]
    assert np.array_equal(*images)
    for name in CONFIGS:
        keys = E2VID["keys"][name]["keys"]
        state = {key: torch.empty(shape, device="meta") for key, shape in keys.items()}
        found = e2vid.options_of(state, Path("weights"))
        expected = asdict(E2vidOptions(**E2VID["configs"][name]))
        expected["norm"] = "BN" if expected["norm"] == "BN" else None
        assert asdict(found) == expected


class Rogue:
    """Would run code when it is unpickled."""

    def __reduce__(self):
        return print, ("code ran",)


def small_state_without(key):
    state = e2vid_state("small")
    del state[key]
    return state


def small_state_with(key, value):
    return {**e2vid_state("small"), key: value}


ERAFT_ENTRIES = dict.fromkeys(ERAFT_DATA["keys"]["15"]["keys"], torch.zeros(1))
HEAD, PRED = "unetrecurrent.head.conv2d.weight", "unetrecurrent.pred.conv2d.bias"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ([1, 2], "found a list, expected arch and state_dict of E2VID"),
        ({"epoch": 3}, "found a table with 1 entry: epoch"),
        (lambda: e2vid_checkpoint(arch="E2VID"), "arch: found 'E2VID', expected 'E2VIDRecurrent'"),
        ({"model": ERAFT_ENTRIES}, "found a table with 1 entry: model"),
        ({"state_dict": ERAFT_ENTRIES}, "entries: fnet.conv1.weight.* the weights of E2VID"),
        (lambda: e2vid_checkpoint(state_dict=small_state_without(HEAD)), "the weights of E2VID"),
        (
            lambda: e2vid_checkpoint(state_dict=small_state_without(PRED)),
            f"{PRED}: found no entry",
        ),
        (
            lambda: e2vid_checkpoint(state_dict=small_state_with(PRED, torch.zeros(2))),
            r"found shape \(2,\), expected shape \(1,\)",
        ),
        (
            lambda: e2vid_checkpoint(state_dict=small_state_with("more", torch.zeros(2))),
            r"more: found shape \(2,\), expected no entry",
        ),
        (
            lambda: e2vid_checkpoint(state_dict=small_state_with(PRED, torch.tensor([np.nan]))),
            "found values that are not finite",
        ),
        (
            lambda: e2vid_checkpoint(
                state_dict=small_state_with(PRED, torch.tensor([1e300], dtype=torch.float64))
            ),
            "found values that are not finite in torch.float32",
        ),
        (
            lambda: e2vid_checkpoint(state_dict=small_state_with(PRED, torch.tensor([1]))),
            rf"{PRED}: found torch.int64 values, expected torch.float32 values",
        ),
        (
            lambda: e2vid_checkpoint(state_dict={"a": 1}),
            "found a table with 1 entry: a, expected",
        ),
        ({"state_dict": Rogue()}, "found a pickle of .*print, which could run code"),
    ],
)
def test_wrong_e2vid_checkpoints_are_refused(saved, content, words, capsys):
    """Promise: one line says what the file holds; code in it never runs."""
    file = saved(content() if callable(content) else content)
    with pytest.raises(WeightsError, match=words) as refused:
        e2vid.load(file)
    assert str(refused.value).startswith(str(file))
    assert "\n" not in str(refused.value)
    assert not capsys.readouterr().out


def test_files_that_are_no_checkpoints_are_refused(saved):
    """Promise: errors say that a file is truncated, damaged, has other bytes, is a pickle or a
    folder."""
    file = saved(e2vid_checkpoint())
    data = file.read_bytes()
    junk = (b"", b"no checkpoint", b"scenes = 1", b"RIFF", b"J12", pickle.dumps([1], 2))
    for content in (*junk, data[:1000], data[:-100]):
        file.write_bytes(content)
        with pytest.raises(WeightsError, match=r"PyTorch checkpoint|found a list"):
            e2vid.load(file)
    middle = len(data) // 2
    file.write_bytes(
        data[:middle] + bytes(255 - b for b in data[middle : middle + 9]) + data[middle + 9 :]
    )
    with pytest.raises(WeightsError, match=r"is damaged: \w+/data/\d+ does not match its checksum"):
        e2vid.load(file)
    with pytest.raises(WeightsError, match="cannot be read: Is a directory"):
        e2vid.load(file.parent)
    with pytest.raises(WeightsError, match="no such file"):
        e2vid.load(file.parent / "none.pth")


def test_eraft_checkpoints_are_checked(saved, random_eraft):
    """Promise: a network with the published names has a flow; others are refused."""
    grids = [voxels(name, (5, 128, 128)).astype(np.float32) for name in ("old", "new")]
    flow = eraft.load(saved({"model": random_eraft})).flow(*grids, iterations=1)
    assert flow.shape == (2, 128, 128)
    assert flow.any()
    first = "fnet.conv1.weight"
    for channels in (1, 60, 65):
        state = {**random_eraft, first: torch.zeros(channels, 5, 7, 7)}
        with pytest.raises(WeightsError, match=rf"{first}: found shape \({channels}, 5, 7, 7\)"):
            eraft.load(saved({"model": state}))
    with pytest.raises(WeightsError, match="arch 'E2VIDRecurrent' and 3 entries"):
        eraft.load(saved(e2vid_checkpoint()))


def test_sizes_are_checked_before_anything_runs(saved, random_eraft, monkeypatch):
    """Promise: a sensor that is too small for E-RAFT, or too large for the memory, is refused."""
    small = e2vid.load(saved(e2vid_checkpoint()))
    file = saved({"model": random_eraft}, "eraft.tar")
    flow = eraft.load(file)
    flow.check_size(128, 128)
    with pytest.raises(WeightsError, match="eraft: found a sensor of 64x64 px"):
        check_method("dense_flow", "eraft", {"eraft": str(file)}, [(640, 640), (64, 64)])
    with pytest.raises(
        WeightsError, match="eraft: found a sensor of 128x127 px, expected at least"
    ):
        flow.check_size(128, 127)
    monkeypatch.setattr("tasks.learned.cpu.memory_bytes", lambda: 4_000_000_000)
    flow.check_size(640, 640)
    for network, name in ((flow, "eraft"), (small, "e2vid")):
        with pytest.raises(WeightsError, match=f"{name}: at .* needs .* GB .* machine has 4.0 GB"):
            network.check_size(12_800, 12_800)


@pytest.mark.parametrize("config", sorted(E2VID["configs"]))
def test_what_a_sensor_keeps_is_known_before(saved, config):
    """Promise: the memory that a sensor keeps between windows is that of its states and images."""
    network = e2vid.load(saved(e2vid_checkpoint(config)))
    _, states = network.image(np.zeros((network.bins, 64, 96), np.float32))
    tensors = [part for state in states for part in state]
    kept = sum(tensor.numel() * tensor.element_size() for tensor in tensors)
    assert network.kept_bytes(96, 64) == kept + 40 * 96 * 64


def test_a_study_that_keeps_too_much_is_refused(monkeypatch):
    """Promise: memory for all sensors is compared with half of the machine's before anything is
    rendered, and the error names the networks."""
    names = "our_reconstruction_all_light", "our_reconstruction_ideal_light"
    evaluate = {"video": Video(methods=(*names, "blank"))}
    evaluate["dense_flow"] = DenseFlow(methods=("our_flow_all_light",))  # keeps nothing
    monkeypatch.setattr("tasks.methods.networks.memory_bytes", lambda: 5_200_000_000)
    check_methods(evaluate, [(1280, 1280)] * 5)
    with pytest.raises(
        WeightsError,
        match=f"{names[0]} and {names[1]}: for 6 sensors .* 3.0 GB in memory, .* 5.2 GB; choose",
    ):
        check_methods(evaluate, [(1280, 1280)] * 6)


def multiply():
    """Keep PyTorch's threads busy."""
    a = torch.ones(400, 400)
    for _ in range(40):
        a = a @ a / 400


def look_up():
    """Keep the threads of look-ups busy."""
    correlation = Correlation(*torch.ones(2, 1, 256, 64, 64))
    for _ in range(10):
        correlation.look_up(cells(64, 64))


@pytest.mark.parametrize("work", [multiply, look_up])
def test_the_cpu_time_of_helpers_counts(monkeypatch, work):
    """Promise: CPU time of a network on other threads counts as that of the calling thread."""
    monkeypatch.setattr(cpu, "cores", lambda: 2)
    cpu._helpers.cache_clear()
    cpu.run(work)  # compiles the kernel
    before_s, process_s = cpu_s(), time.process_time()
    cpu.run(work)
    spent_s = time.process_time() - process_s
    assert 0.5 * spent_s < cpu_s() - before_s < 1.2 * spent_s
    monkeypatch.undo()
    cpu._helpers.cache_clear()
    cpu.run(work)
    assert torch.get_num_threads() == 1


def test_bfloat16_changes_images_little(saved, monkeypatch):
    """Promise: reduced precision changes images by less than 4 % of their range."""
    file = saved(e2vid_checkpoint("small"))
    grid = voxels("grid", (5, 32, 32)).astype(np.float32)
    found = []
    for has in (False, True):
        monkeypatch.setattr(cpu, "has_bfloat16", lambda has=has: has)
        network, states = e2vid.load(file), None
        for _ in range(5):
            image, states = network.image(grid, states)
        found.append(image)
    difference = np.abs(found[0] - found[1])
    assert 0 < difference.max() < 0.04


def test_weights_identify_the_rows(saved):
    """Promise: other weights in the same file are another network, and have another digest."""
    file = saved(e2vid_checkpoint(), "same.pth")
    weights = {"e2vid": str(file)}
    network = load_method("video", "e2vid", weights).keywords["network"]
    assert load_method("video", "e2vid", weights).keywords["network"] is network
    before = code_of(["e2vid", "blank"], weights)
    assert before == {"e2vid": f"2 {digest_of(str(file))}"}
    saved(e2vid_checkpoint("concat_gru"), "same.pth")
    assert load_method("video", "e2vid", weights).keywords["network"] is not network
    assert code_of(["e2vid"], weights) != before


@pytest.mark.slow
def test_e2vid_in_a_command_and_in_a_study(small_carpet, saved, tmp_path, eres):
    """Promise: `--weights` and the weights of a study reach the network; the error for a file of
    another network is one line."""
    file = saved(e2vid_checkpoint(), "e2vid.pth")
    options = {"resolution": 64, "spp": 4, "samples": 1, "max_displacement_px": 1.0}
    (clip,) = render_scene(small_carpet, tmp_path / "clips", **options)
    asked = ("evaluate", clip.folder, "--task", "video", "--resolution", 32, "--weights")
    code, out, err = eres(*asked, file, "--method", "e2vid", "late_truth", "blank")
    assert code == 0, err
    scores = {line.split()[0]: line for line in out.splitlines()}
    assert all(name in scores for name in ("e2vid", "late_truth", "blank"))
    code, out, err = eres(*asked, f"e2vid={saved([1])}")
    assert code == 1
    assert "found a list, expected arch and state_dict of E2VID" in " ".join(err.split())
    study = tiny_study(small_carpet.folder)
    video = Video(methods=("e2vid",), duration_s=0.1, run_in_s=0.05, weights={"e2vid": str(file)})
    study = replace(study, evaluate=only(video=video))
    rows = run_study(study, tmp_path / "run")
    assert {(row.task, row.method) for row in rows} == {("video", "e2vid")}
    assert "torch" in json.loads((tmp_path / "run" / "environment.json").read_text())


@pytest.mark.slow
def test_the_networks_of_eres_run_on_recordings(tmp_path):
    """Promise: with the weights that come with eres, on a recording of another program: images at
    the frames' times, dense flow from two windows, and a folder of images."""
    made = make_recording(tmp_path, (128, 128))
    recording, frames = (
        open_recording(made.events_file),
        open_frames(made.frames, encoding="linear"),
    )
    names = [f"our_{{}}_{light}_light" for light in ("ideal", "all")]
    images = [name.format("reconstruction") for name in names]
    found = evaluate_recording(recording, "video", frames=frames, methods=[*images, "blank"])
    scored = {score.method: [] for score in found.rows}
    for score in found.rows:
        scored[score.method].append(score.value)
    assert set(scored) == {*images, "blank"}
    assert all(len(values) == 6 and np.isfinite(values).all() for values in scored.values())
    options = FlowOptions(window_ms=25.0, windows=1, features=5, patch_px=21, search_px=8.0)
    flows = [name.format("flow") for name in names]
    found = evaluate_recording(recording, "dense_flow", methods=flows, flow=options)
    assert {score.method for score in found.rows} >= {*flows}
    assert all(np.isfinite(score.value) and not score.failure for score in found.rows)
    count = write_video(recording, tmp_path / "images", VideoOptions(method=images[0], fps=50.0))
    assert count == len([*(tmp_path / "images").glob("*.png")]) >= 2
