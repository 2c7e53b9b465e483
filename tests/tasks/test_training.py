"""Training our own networks: exact continuation, twins, weights, refusals, commands.

Needs PyTorch: `make .venv/.learned`.
"""

import json
import logging
import re
import resource
import shutil
import tomllib
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from eres_render.errors import RenderError
from eres_render.storage.settings_reader import read_typed
from tasks.errors import TaskError, TrainingError, WeightsError
from tasks.learned.training.settings import (
    FLOWS,
    RECONSTRUCTIONS,
    FlowTraining,
    ReconstructionTraining,
    Schedule,
    find_training,
)
from tasks.methods import load_method
from tasks.methods.networks import network
from tasks.methods.networks import weights_of as files_of_weights
from tasks.random_crops.settings import Crops, FlowCrops
from tasks.registry import TASKS

torch = pytest.importorskip("torch", reason="PyTorch is not installed: make .venv/.learned")

from tasks.learned.checkpoint import read_checkpoint, with_weights  # noqa: E402
from tasks.learned.eraft_network import ERAFT  # noqa: E402
from tasks.learned.ours import FLOW, RECONSTRUCTION, save  # noqa: E402
from tasks.learned.training import loop  # noqa: E402
from tasks.learned.training.flow import Flow  # noqa: E402
from tasks.learned.training.loop import Training, start  # noqa: E402
from tasks.learned.training.reconstruction import Reconstruction, tiles_as_ranks  # noqa: E402
from tasks.learned.training.run_folder import opened  # noqa: E402

pytestmark = pytest.mark.usefixtures("one_torch_thread", "small_textures")

BRIEF = Schedule(
    steps=4, crops_per_step=1, rising_steps=2, validate_every=2, validation_crops=1,
    checkpoint_minutes=1e-9,
)  # fmt: skip
TINY = ReconstructionTraining(
    crops=Crops(side_px=16, motion_px=(0.5, 2.0)),
    schedule=BRIEF,
    base_channels=4,
    encoders=2,
    residual_blocks=1,
    run_in_windows=2,
    windows=4,
    windows_at_once=2,
    ranked_px=32,
)
TINY_FLOW = FlowTraining(
    crops=FlowCrops(motion_px=(1.0, 2.0)),
    schedule=replace(FLOWS["trial"].schedule, steps=1, crops_per_step=1, validation_crops=1),
    bins=3,
    narrower=16,
    windows=3,
    updates=2,
)


def trained(folder, light="all", seed=0, settings=TINY, code="x", **options):
    return start(settings, light, seed, folder, device="cpu", made_with={"code": code}, **options)


@pytest.fixture(scope="module")
def small_textures():
    """Keep these tests fast: textures have a sixteenth of the texels."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tasks.random_crops.texture.SIDE", 128)
        yield


@pytest.fixture(scope="module")
def run(small_textures, tmp_path_factory):
    """A finished training."""
    folder = tmp_path_factory.mktemp("run")
    problem, scores = trained(folder)
    return folder, problem, scores


def weights_of(folder):
    return torch.load(folder / "weights.pt", weights_only=True)


class Stop(Exception):
    pass


def stopped(folder, after, **options):
    """Train, and stop after a number of steps."""

    def stop(stage, done, total):
        if done == after:
            raise Stop

    with pytest.raises(Stop):
        trained(folder, on_progress=stop, **options)


def test_an_interrupted_training_ends_with_the_same_weights(run, tmp_path):
    """Promise: crops, order, optimizer and learning rate continue as without an interruption."""

    stopped(tmp_path, 3)
    assert not (tmp_path / "weights.pt").exists()
    trained(tmp_path)
    expected, found = weights_of(run[0]), weights_of(tmp_path)
    assert found["origin"] == expected["origin"] == {"seed": 0, "steps": 4}
    for name, tensor in expected["weights"].items():
        assert torch.equal(found["weights"][name], tensor), name
    curves = [(folder / "curve.csv").read_text().splitlines() for folder in (run[0], tmp_path)]
    without_seconds = [[row.split(",")[:1] + row.split(",")[2:] for row in one] for one in curves]
    assert without_seconds[0] == without_seconds[1]
    assert [row[0] for row in without_seconds[0]] == ["step", "2", "4"]


@pytest.mark.slow
def test_an_interrupted_training_of_flow_ends_with_the_same_weights(tmp_path):
    """Promise: means of batch normalization and the schedule continue too."""
    schedule = replace(TINY_FLOW.schedule, steps=3, checkpoint_minutes=1e-9)
    settings = replace(TINY_FLOW, schedule=schedule)
    trained(tmp_path / "whole", settings=settings)
    stopped(tmp_path / "parts", 2, settings=settings)
    trained(tmp_path / "parts", settings=settings)
    whole, parts = (weights_of(tmp_path / name)["weights"] for name in ("whole", "parts"))
    for name, tensor in whole.items():
        assert torch.equal(parts[name], tensor), name


def made_with(folder):
    return json.loads((folder / "training.json").read_text())["made_with"]


@pytest.mark.slow
def test_a_change_of_code_is_said(run, tmp_path, caplog, eres):
    """Promise: a training that other code continues warns of it once, and its card names both
    commits; starts that left nothing, and a finished training, are not mixed."""
    with caplog.at_level(logging.WARNING):
        stopped(tmp_path, 0, code="git zero")
        stopped(tmp_path, 1, code="git one")
        assert made_with(tmp_path) == {"code": "git one", "device": "cpu"}
        stopped(tmp_path, 2, code="git one")
        assert caplog.text == ""
        stopped(tmp_path, 3, code="git two")
        assert "continues with code git two, and was started with code git one" in caplog.text
        caplog.clear()
        trained(tmp_path, code="git two")
        trained(tmp_path, code="git three")
        assert caplog.text == ""
    assert made_with(tmp_path) == {"code": "git one; git two", "device": "cpu"}
    code, out, _ = eres("train", "card", tmp_path)
    assert code == 0
    assert "code git one; git two" in out


def test_other_code_is_said_at_every_start(tmp_path, caplog):
    """Promise: code is compared with that of the start before; changes without a commit have no
    name to compare."""
    settings = {"task": "flow", "light": "all", "seed": 0}
    started = "with code git one-dirty, and was started"
    for run, steps in (
        (
            "clean",
            [("git one", ""), ("git one", ""), ("git one-dirty", f"{started} with code git one")],
        ),
        ("dirty", [("git one-dirty", ""), ("git one-dirty", started)]),
        (
            "two",
            [("git one", ""), ("git two", "with code git two"), ("git one", "git one; git two")],
        ),
    ):
        for code, said in steps:
            caplog.clear()
            made_with = {"code": code}
            with caplog.at_level(logging.WARNING), opened(tmp_path / run, settings, made_with):
                (tmp_path / run / "checkpoint.pt").touch()
            assert said in caplog.text
            assert bool(said) == bool(caplog.text)


@contextmanager
def full_disk(size):
    """Limit files to a number of bytes."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_no_room_for_a_checkpoint_or_for_weights(tmp_path):
    """Promise: an error that names the file; the checkpoint before stays, and nothing else does."""
    problem = Reconstruction(TINY, "all", 0)
    training = Training(problem, "cpu")
    training.step = 1
    training.save(tmp_path)
    training.step = 2
    weights = tmp_path / "weights.pt"
    with full_disk(4000):
        with pytest.raises(RenderError, match=r"checkpoint\.pt: cannot be written: File too large"):
            training.save(tmp_path)
        with pytest.raises(RenderError, match=r"weights\.pt: cannot be written: File too large"):
            save(weights, problem.network, FLOW, "all", {})
    assert [file.name for file in tmp_path.iterdir()] == ["checkpoint.pt"]
    training.load(tmp_path)
    assert training.step == 1


def test_twins_differ_in_light_alone():
    """Promise: the same initial weights, truths and run-in; events differ."""
    twins = [Reconstruction(TINY, light, 5) for light in ("ideal", "all")]
    states = [twin.network.state_dict() for twin in twins]
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])
    batches = [[twin.batch(step) for step in range(3)] for twin in twins]
    for ideal, drawn in zip(*batches, strict=True):
        assert torch.equal(ideal[1], drawn[1])
    assert any(not torch.equal(a[0], b[0]) for a, b in zip(*batches, strict=True))
    assert len({twins[0].run_in(step) for step in range(20)}) == TINY.run_in_windows + 1
    other = Reconstruction(TINY, "ideal", 6).network.state_dict()
    assert not all(torch.equal(states[0][name], other[name]) for name in other)


def test_tiles_are_compared_whatever_their_mean_and_contrast():
    """Promise: each tile gets the mean 1/2 and the variance 1/12 of ranks, so an image that is
    right within each tile has no error there; a flat tile is gray."""
    draw = torch.Generator().manual_seed(3)
    image = torch.rand((2, 16, 16), generator=draw)
    factors = torch.tensor([0.5, 1.0, 2.0, 4.0]).reshape(1, 2, 2)
    gains, offsets = (one.repeat_interleave(8, 1).repeat_interleave(8, 2) for one in (factors,) * 2)
    tiles = tiles_as_ranks(image, 2)
    assert tiles.shape == (8, 8, 8)
    torch.testing.assert_close(tiles.mean(dim=(1, 2)), torch.full((8,), 0.5))
    torch.testing.assert_close(
        tiles.var(dim=(1, 2), correction=0), torch.full((8,), 1 / 12), rtol=2e-3, atol=0
    )
    torch.testing.assert_close(tiles_as_ranks(gains * image + offsets, 2), tiles, rtol=0, atol=1e-3)
    middle = image[1, 8:, :8] - image[1, 8:, :8].mean()
    expected = 0.5 + middle / (12 * (middle.square().mean() + 1e-4)) ** 0.5
    torch.testing.assert_close(tiles[6], expected)
    torch.testing.assert_close(
        tiles_as_ranks(torch.full((1, 8, 8), 0.9), 2), torch.full((4, 4, 4), 0.5)
    )


def test_a_training_starts_from_the_high_pass_filter():
    """Promise: before the first step, the image is nearly that of the sums of events."""
    problem = Reconstruction(replace(TINY, base_channels=8), "ideal", 0)
    grids, _ = problem.batch(1)
    states = None
    with torch.inference_mode():
        for k in range(grids.shape[1]):
            image, states = problem.network(grids[:, k], states)
    sums = torch.sigmoid(2 * grids[:, -1, -1])
    assert sums.std() > 0.02
    assert torch.corrcoef(torch.stack([image.flatten(), sums.flatten()]))[0, 1] > 0.9


def test_a_new_memory_lasts():
    """Promise: before the first step, the memory fades by less than a fifth per window without new
    input, so that gradients reach far back."""
    network = Reconstruction(TINY, "ideal", 0).network
    zero = torch.zeros(1, network.options.num_bins, 32, 32)
    with torch.inference_mode():
        _, states = network(zero)
        full = [(torch.zeros_like(hidden), torch.ones_like(cell)) for hidden, cell in states]
        _, after = network(zero, full)
    for (_, before), (_, cell) in zip(states, after, strict=True):
        assert (cell - before).min() > 0.8


def test_stored_weights_give_the_same_images(run):
    """Promise: weights.pt is in half precision, and the method that reads it has the trained
    network's output."""
    folder, problem, scores = run
    stored = weights_of(folder)
    assert {t.dtype for t in stored["weights"].values() if t.is_floating_point()} == {torch.half}
    name = "our_reconstruction_all_light"
    found = network("video", name, {name: str(folder / "weights.pt")})
    grids, _ = problem.batch(9)
    assert found.bins == TINY.bins
    grid = grids[0, 0].numpy()
    image, _ = found.image(grid)
    with torch.inference_mode():
        expected, _ = problem.network.eval()(grids[:1, 0])
    np.testing.assert_allclose(image, expected[0, 0].numpy(), atol=0.02)  # bfloat16 in one of them
    method = load_method("video", name, {name: str(folder / "weights.pt")})(16, 16, 0.2)
    assert method.image(0).shape == (16, 16)
    assert list(scores) == ["ideal", "200 Hz", "50 Hz"]
    assert all(len(values) == 3 for values in scores.values())
    assert 8 < scores["ideal"][2] < 12, "gray"


def test_a_finished_training_is_not_repeated(run):
    """Promise: the same command prints the scores again."""
    folder, _, scores = run
    before = (folder / "weights.pt").stat().st_mtime_ns
    _, again = trained(folder)
    assert again == scores
    assert (folder / "weights.pt").stat().st_mtime_ns == before
    described = json.loads((folder / "training.json").read_text())
    assert described["settings"]["light"] == "all"
    assert (folder / "curve.png").read_bytes()[:4] == b"\x89PNG"


def test_damaged_weights_are_no_finished_training(run, tmp_path):
    """Promise: an error that names the file, also for a checkpoint that is something else."""
    folder = tmp_path / "training"
    shutil.copytree(run[0], folder)
    (folder / "weights.pt").write_bytes(b"")
    with pytest.raises(WeightsError, match=r"weights.pt: could not be read as a PyTorch"):
        trained(folder)
    (folder / "weights.pt").unlink()
    torch.save(torch.zeros(3), folder / "checkpoint.pt")
    with pytest.raises(TrainingError, match=r"checkpoint.pt: could not be read as the checkpoint"):
        trained(folder)


def test_flow_is_learned_and_stored(tmp_path):
    """Promise: the same loop trains flow; the method reads the weights, at quarter channels too."""
    _, scores = trained(tmp_path, "ideal", settings=TINY_FLOW)
    assert all(0 < value[0] < 100 and 0.3 < value[1] < 5 for value in scores.values())
    name = "our_flow_ideal_light"
    found = network("dense_flow", name, {name: str(tmp_path / "weights.pt")})
    assert found.bins == 3
    flow = found.flow(*np.zeros((2, 3, 128, 128), np.float32), iterations=1)
    assert flow.shape == (2, 128, 128)
    with pytest.raises(WeightsError, match="our flow: found a sensor of 96x96 px, expected"):
        found.check_size(96, 96)


def test_pairs_of_a_batch_do_not_affect_each_other():
    """Promise: the flow of several pairs at once is that of each alone."""
    torch.manual_seed(0)
    net = ERAFT(3, narrower=16).eval()
    old, new = torch.randn(2, 2, 3, 128, 128)
    with torch.inference_mode():
        (both,) = net(old, new, 2)
        for k in range(2):
            (alone,) = net(old[k : k + 1], new[k : k + 1], 2)
            torch.testing.assert_close(both[k : k + 1], alone, rtol=1e-4, atol=1e-4)


def test_weights_of_others_are_refused(run, tmp_path):
    """Promise: one line says what a wrong file holds."""
    folder, problem, _ = run
    file, name = tmp_path / "w.pt", "our_reconstruction_all_light"

    def refused(words, method=name):
        with pytest.raises(WeightsError, match=words) as error:
            network("video", method, {method: str(file)})
        assert "\n" not in str(error.value)

    stored = weights_of(folder)
    file.write_bytes((folder / "weights.pt").read_bytes())
    refused("light: found 'all', expected 'ideal'", "our_reconstruction_ideal_light")
    file.write_bytes((folder / "weights.pt").read_bytes()[:-200])
    refused("PyTorch checkpoint")
    save(file, problem.network, FLOW, "all", {})
    refused("arch: found 'eres flow', expected 'eres reconstruction'")
    torch.save({**stored, "weights": {"a": torch.zeros(1)}}, file)
    refused("found a table with 1 entry: a")
    head = "unetrecurrent.head.conv2d.weight"
    torch.save({**stored, "weights": {**stored["weights"], head: torch.zeros(9, 6, 5, 5)}}, file)
    refused("found shape")
    torch.save({"arch": print}, file)
    refused("found a pickle of .*print, which could run code")
    torch.save({"state_dict": {}}, file)
    refused("expected arch, light and weights")
    other = "our_flow_all_light"
    torch.save({"arch": FLOW, "light": "all", "weights": {"b": torch.zeros(2)}}, file)
    with pytest.raises(WeightsError, match=r"fnet.conv1.weight: found shape \(\), expected four"):
        network("dense_flow", other, {other: str(file)})
    with pytest.raises(WeightsError, match="needs weights; give --weights eraft=FILE"):
        network("dense_flow", "eraft", None)
    assert stored["arch"] == RECONSTRUCTION


def test_folders_of_other_trainings_are_refused(run, tmp_path):
    """Promise: nothing of another training is overwritten or continued."""
    folder, _, _ = run
    with pytest.raises(TrainingError, match="light: found 'all', expected 'ideal'; choose another"):
        trained(folder, "ideal")
    with pytest.raises(TrainingError, match="base_channels: found 4, expected 8"):
        trained(folder, settings=replace(TINY, base_channels=8))
    (tmp_path / "training.json").write_text("{")
    with pytest.raises(TrainingError, match="could not be read as JSON"):
        trained(tmp_path)
    half = tmp_path / "half"
    half.mkdir()
    for name in ("training.json", "checkpoint.pt"):
        (half / name).write_bytes((folder / name).read_bytes())
    (half / "checkpoint.pt").write_bytes((folder / "checkpoint.pt").read_bytes()[:-100])
    with pytest.raises(WeightsError, match="could not be read as a PyTorch checkpoint"):
        trained(half)
    torch.save({"step": 1}, half / "checkpoint.pt")
    with pytest.raises(TrainingError, match="could not be read as the checkpoint"):
        trained(half)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("scores.json", '{"score": ', "could not be read as JSON"),
        ("scores.json", "{}", "score: missing, expected a string"),
        (
            "scores.json",
            {"scores": {"ideal": [1.0]}},
            "scores: found {'ideal': 1} numbers, expected 3",
        ),
        ("scores.json", {"scores": {}}, "scores: found {} numbers"),
        ("training.json", {"settings": {}}, "settings.task: missing"),
        ("training.json", {"settings": []}, "settings: found"),
    ],
)
def test_damaged_files_of_a_finished_training_are_named(run, name, content, said, eres, tmp_path):
    """Promise: neither the command nor the card fails without a word on the file."""
    folder = tmp_path / "copy"
    shutil.copytree(run[0], folder)
    file = folder / name
    if isinstance(content, dict):
        content = json.dumps({**json.loads(file.read_text()), **content})
    file.write_text(content)
    words = re.escape(f"{file}: {said}")
    with pytest.raises(TrainingError, match=words):
        trained(folder)
    code, _, err = eres("train", "card", folder)
    assert (code, err.count("\n")) == (1, 1)
    assert re.search(words, err)


@pytest.mark.parametrize("seed", [-1, 2**64, 99999999999999999999999])
def test_a_seed_that_pytorch_cannot_take_is_refused(seed, eres, tmp_path):
    """Promise: one line with the range, and no folder."""
    code, _, err = eres("train", "flow", "--out", tmp_path / "x", "--seed", seed)
    assert (code, err) == (1, f"error: --seed: found {seed}, expected 0 to 2^64 - 1\n")
    assert not (tmp_path / "x").exists()


def test_weights_without_settings_are_refused(run, tmp_path):
    """Promise: a folder that lost training.json neither gives its scores nor goes on, whatever the
    settings; the error names the missing file."""
    for name in ("weights.pt", "checkpoint.pt"):
        folder = tmp_path / name
        folder.mkdir()
        shutil.copy(run[0] / "scores.json", folder)
        shutil.copy(run[0] / name, folder)
        words = rf"training\.json: is missing, so the settings of {name} are unknown"
        with pytest.raises(TrainingError, match=words):
            trained(folder, "ideal")
        assert not (folder / "training.json").exists()


def test_what_cannot_be_trained_is_said_before(tmp_path, monkeypatch):
    """Promise: errors name too little memory, a missing GPU and a diverging loss; those of the
    machine leave no folder behind, so that other settings can be tried in it."""
    fast = replace(TINY, schedule=replace(BRIEF, learning_rate=1.0, weight_decay=1e30))
    with pytest.raises(TrainingError, match="learning_rate: found 2, expected at most 1"):
        replace(BRIEF, learning_rate=2.0)
    with pytest.raises(TrainingError, match=r"schedule\.learning_rate"):
        trained(tmp_path / "fast", settings=fast)
    monkeypatch.setattr(loop, "memory_bytes", lambda: 1000)
    with pytest.raises(TrainingError, match=r"needs about .* lower crops\.side_px, schedule\."):
        trained(tmp_path / "large")
    assert not (tmp_path / "large").exists()
    monkeypatch.undo()
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    card = SimpleNamespace(total_memory=1000)
    monkeypatch.setattr(torch.cuda, "get_device_properties", lambda number: card)
    with pytest.raises(TrainingError, match=r"needs about .* this GPU has 0\.0 GB"):
        start(TINY, "all", 0, tmp_path / "gpu", device="cuda", made_with={})
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(TrainingError, match="device: 'cuda' needs a GPU"):
        start(TINY, "all", 0, tmp_path / "gpu", device="cuda", made_with={})
    assert not (tmp_path / "gpu").exists()


def test_memory_is_that_of_all_that_is_asked_for():
    """Promise: many updates of the flow, and many held-out crops, count before they are made."""
    small = FlowTraining()
    needed = Flow(small, "all", 0).memory_bytes()
    assert Flow(replace(small, updates=60), "all", 0).memory_bytes() > 3 * needed
    held_out = replace(small.schedule, validation_crops=10_000)
    crops_bytes = 3 * 10_000 * 4 * 128**2 * (4 * 15 + 3 * 2)
    assert Flow(replace(small, schedule=held_out), "all", 0).memory_bytes() > crops_bytes
    for problem in (Flow(TINY_FLOW, "all", 0), Reconstruction(TINY, "all", 0)):
        inputs, truths = problem.batch(0)
        values = inputs[0].numel() + truths[0].numel()
        assert values == problem.values_per_px * inputs.shape[-1] ** 2


def test_settings_are_names_or_files(tmp_path):
    """Promise: a file changes the fields that it has; errors name wrong fields."""
    assert find_training(RECONSTRUCTIONS, "small") == ReconstructionTraining()
    file = tmp_path / "mine.toml"
    file.write_text(
        "base_channels = 8\nranked_px = 128\n[crops]\nside_px = 64\n[schedule]\nsteps = 7\n"
    )
    found = find_training(RECONSTRUCTIONS, str(file))
    assert (found.base_channels, found.crops.side_px, found.schedule.steps) == (8, 64, 7)
    file.write_text("[crops]\nideal_share = 0.5\n")
    assert find_training(FLOWS, str(file)).crops == FlowCrops(ideal_share=0.5)
    for text, words in (
        ("steps = 3", "steps: unknown"),
        ("bins = 1", "bins: found 1, expected at least 2"),
        ("base_channels = 1", "base_channels: found 1, expected at least 2"),
        ("windows = 0", "windows: found 0, expected a positive number"),
        ("windows_at_once = 5", "windows_at_once: found 5, expected a divisor of 12"),
        ("ranked_px = 320", "found 320, expected at least crops.side_px, 80, and at most 160"),
        ("tiles = 3", "tiles: found 3, expected a divisor of crops.side_px, 80"),
        ("[crops]\nside_px = 60", "side_px: found 60, expected a multiple of 8"),
        ("[crops]\ncutoff_hz = [50.0]", "cutoff_hz"),
        ("[schedule]\nsteps = -1", "schedule: steps: found -1"),
    ):
        file.write_text(text)
        with pytest.raises(TaskError, match=words):
            find_training(RECONSTRUCTIONS, str(file))
    file.write_text("narrower = 3")
    with pytest.raises(TaskError, match="narrower: found 3, expected 1, 2, 4, 8 or 16"):
        find_training(FLOWS, str(file))
    with pytest.raises(TrainingError, match="did you mean 'small'"):
        find_training(RECONSTRUCTIONS, "smal")


@pytest.mark.parametrize(("task", "known"), [("reconstruction", RECONSTRUCTIONS), ("flow", FLOWS)])
def test_the_page_shows_every_setting_with_its_default(task, known, tmp_path):
    """Promise: the TOML on docs/training.md has every field, and their defaults."""
    page = (Path(__file__).parents[2] / "docs" / "training.md").read_text()
    text = page.split(f"```toml {task}\n")[1].split("```")[0]
    (tmp_path / "all.toml").write_text(text)
    assert find_training(known, str(tmp_path / "all.toml")) == known["small"]

    def names(table):
        return {k: names(v) if isinstance(v, dict) else None for k, v in table.items()}

    assert names(tomllib.loads(text)) == names(asdict(known["small"]))


@pytest.mark.slow
@pytest.mark.parametrize("light", ["ideal", "all"])
@pytest.mark.parametrize(
    ("problem_of", "kind", "within"),
    [(Reconstruction, ReconstructionTraining, 0.1), (Flow, FlowTraining, 0.02)],
)
def test_the_weights_that_come_with_eres_have_the_scores_of_their_card(
    problem_of, kind, within, light, monkeypatch
):
    """Promise: the scores of the training, within 0.1 dB or 0.02 px, on the held-out crops of its
    settings."""
    monkeypatch.setattr("tasks.random_crops.texture.SIDE", 512)
    task = problem_of.__name__
    card = Path(__file__).parents[2] / "docs" / "networks_card.md"
    section = card.read_text(encoding="utf-8").split(f"## {task}\n")[1]
    cells = section.split(f"| {light} light | 2 |")[1].split("|")[:3]
    said = json.loads(section.split("```json")[1].split("```")[0])
    said = {name: value for name, value in said.items() if name != "task"}
    settings = read_typed(kind, said, card, TrainingError)
    problem = problem_of(settings, light, 0)
    file = Path(files_of_weights(f"our_{task.lower()}_{light}_light"))
    with_weights(lambda: problem.network, read_checkpoint(file)["weights"], file)
    problem.hold_out()
    found = [scores[0] for scores in problem.scores("cpu").values()]
    np.testing.assert_allclose(found, [float(cell) for cell in cells], atol=within)


@pytest.mark.parametrize("network", ["reconstruction", "flow"])
def test_options_of_a_training_reach_it(network, eres, tmp_path, monkeypatch):
    """Promise: the light, the seed and the device are those of the command."""
    asked = []

    def record(settings, *given, device, **others):
        asked.append((type(settings).__name__, *given, device))
        raise TrainingError("asked")

    monkeypatch.setattr("tasks.learned.training.loop.start", record)
    given = "--light", "ideal", "--seed", 7, "--device", "cpu", "--out", tmp_path
    code, _, err = eres("train", network, "--config", "trial", *given)
    assert (code, err) == (1, "error: asked\n")
    assert asked == [(f"{network.capitalize()}Training", "ideal", 7, tmp_path, "cpu")]


def test_a_dry_run_of_a_training_only_tells_what_it_takes(eres, tmp_path, monkeypatch, caplog):
    """Promise: steps, memory, disk space and time are told, and nothing is written."""
    monkeypatch.setitem(
        RECONSTRUCTIONS, "trial", replace(TINY, schedule=replace(BRIEF, steps=9000))
    )
    given = "--config", "trial", "--out", tmp_path / "new", "--dry-run"
    with caplog.at_level(logging.INFO):
        assert eres("train", "reconstruction", *given)[:2] == (0, "")
    weights = sum(map(torch.numel, Reconstruction(TINY, "all", 0).network.parameters()))
    said = (
        rf"9000 steps of 1 crops, {weights} weights: about 0\.\d GB of memory, 1 MB on disk, (.*)"
    )
    amount, unit = re.fullmatch(said, caplog.messages[-1])[1].split()
    assert 10 < float(amount) * {"s": 1, "min": 60, "h": 3600}[unit] < 9000
    assert not (tmp_path / "new").exists()


def test_a_file_is_no_folder_of_a_training(eres, tmp_path, monkeypatch):
    """Promise: one line that says so, and the file stays as it is."""
    monkeypatch.setitem(FLOWS, "trial", FlowTraining())
    (tmp_path / "file").write_text("in the way")
    code, out, err = eres("train", "flow", "--config", "trial", "--out", tmp_path / "file")
    assert (code, out) == (1, "")
    assert err.startswith("error: ")
    assert "file: found a file, exp" in err
    assert (tmp_path / "file").read_text() == "in the way"


def test_the_command_trains_and_describes(run, eres, tmp_path, monkeypatch):
    """Promise: a finished run's scores, and a card with data, time, code, scores, limits."""
    folder, _, _ = run
    monkeypatch.setitem(RECONSTRUCTIONS, "trial", TINY)
    code, out, err = eres("train", "reconstruction", "--config", "trial", "--out", folder)
    assert (code, err) == (0, "")
    assert [line.split()[0] for line in out.splitlines()[-3:]] == ["ideal", "200", "50"]
    code, out, _ = eres("train", "card", folder, "--out", tmp_path / "card.md")
    text = (tmp_path / "card.md").read_text()
    assert code == 0
    for words in (
        "| all light | 0 |",
        "| gray |",
        "eres train",
        "code x",
        '"motion_px"',
        "## Limits",
    ):
        assert words in text
    code, _, err = eres("train", "card", folder, "--out", tmp_path / "card.md")
    assert code == 1
    assert "--overwrite" in err
    other = tmp_path / "other"
    shutil.copytree(folder, other)
    described = json.loads((other / "training.json").read_text())
    described["settings"]["crops"]["side_px"] *= 2
    described["made_with"]["device"] = "cuda; cpu"  # begun on a GPU, ended on a processor
    (other / "training.json").write_text(json.dumps(described))
    code, out, _ = eres("train", "card", folder, other)
    assert [out.count(text) for text in ("| all light | 0 |", "| gray |", "```json")] == [2, 2, 2]
    assert [out.count(f"MB; device {name}, code x") for name in ("cpu", "cuda; cpu")] == [1, 1]
    code, _, err = eres("train", "card", tmp_path)
    assert code == 1
    assert "training.json: no such file" in err
    code, _, err = eres("train", "flow", "--config", "none", "--out", tmp_path / "x")
    assert (code, err.count("\n")) == (1, 1)


def test_our_networks_are_methods_that_need_weights():
    """Promise: they run only when they are named, or weights are given for them."""
    ours = {name for spec in TASKS.values() for name in spec.networks if name.startswith("our_")}
    assert len(ours) == 4
    assert not ours & {name for spec in TASKS.values() for name in spec.usual()}


@pytest.mark.slow
def test_the_loss_falls(tmp_path, monkeypatch):
    """Promise: a network that sees the same crops again and again overfits to them, starting from
    the high-pass filter's loss."""
    schedule = replace(
        BRIEF, steps=80, learning_rate=3e-3, rising_steps=5, validate_every=8, checkpoint_minutes=60
    )
    settings = replace(TINY, crops=Crops(side_px=32, motion_px=(0.5, 2.0)), schedule=schedule)
    settings = replace(settings, base_channels=8)
    same = Reconstruction(settings, "ideal", 0).batch(0)
    monkeypatch.setattr(Reconstruction, "batch", lambda self, step: same)
    trained(tmp_path, "ideal", settings=settings)
    rows = (tmp_path / "curve.csv").read_text().splitlines()
    losses = [float(row.split(",")[2]) for row in rows[1:]]
    assert len(losses) == 10
    assert losses[-1] < 0.7 * losses[0]
