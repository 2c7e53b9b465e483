"""`eres dataset`: sequences of random scenes, reproduced from seeds and resumed after a stop."""

import dataclasses
import json
import logging
import re
import shutil
from importlib.metadata import version
from pathlib import Path

import h5py
import hdf5plugin  # noqa: F401 - its filters
import numpy as np
import pytest
from distributed import LocalCluster

from eres_render import ground_truth, open_sequence
from eres_render.sequence.clips import WARM_UP_S
from eres_render.storage.locks import locked
from eres_render.trajectory.rig import to_the_right
from sensor import find_camera, plain_camera
from sensor.formats import load_events, read_header
from tasks import DISTRIBUTION
from tasks.datasets import EventDataset
from tasks.errors import TaskError
from tasks.events.frame_camera_options import FrameCameraOptions
from tasks.events.imu_options import ImuOptions
from tasks.events.truth import groups_to_copy
from tasks.generation import dataset, of_study, sequence
from tasks.generation.dataset import _complete, make_dataset
from tasks.generation.settings import DatasetSettings, claim_folder, estimate

OPTIONS = [
    *("--seconds", 0.03, "--resolution", 32, "--cutoffs", "inf", 200, "--truth", 0.01),
    *("--imu", 500, "--images", 100),
]
SETTINGS = DatasetSettings(
    seed=4,
    seconds=0.03,
    sensor=plain_camera(32),
    cutoffs_hz=(np.inf, 200),
    truth_step_s=0.01,
    imu=ImuOptions(imu=500.0),
    images_hz=100.0,
)
PAIR = DatasetSettings(
    seed=1, seconds=0.01, sensor=plain_camera(32, 24), truth_step_s=0.01, baseline_m=0.1
)
FILES = ("events_inf.h5", "events_200.h5")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A dataset of two sequences, moved to another place after it was made."""
    folder = tmp_path_factory.mktemp("made")
    make_dataset(SETTINGS, folder / "first", 2)
    shutil.move(folder / "first", folder / "data")
    return folder / "data"


def contents(folder):
    files = filter(Path.is_file, folder.rglob("*"))
    return {file.relative_to(folder): data_of(file) for file in files}


def data_of(path):
    """Return the bytes of a file, or the data of HDF5, whose unused bytes are arbitrary."""
    if path.suffix != ".h5":
        return path.read_bytes()
    found = {}

    def keep(name, item):
        data = item[()].tobytes() if isinstance(item, h5py.Dataset) else b""
        found[name] = (data, {key: str(value) for key, value in item.attrs.items()})

    with h5py.File(path) as file:
        keep("/", file)
        file.visititems(keep)
    return found


def test_a_dataset_is_read_as_it_is(made):
    """Promise: there are windows of both sequences and both cutoffs, with all targets."""
    dataset = EventDataset(made)
    assert dataset.targets == ("frame", "flow", "occlusion", "depth", "pose", "instances")
    assert [(one.path.parent.name, one.path.name) for one in dataset.recordings] == [
        (f"{k:06d}", name) for k in range(2) for name in sorted(FILES)
    ]
    assert len(dataset) == 4 * 3
    assert sum(len(item["t_us"]) for item in map(dataset.__getitem__, range(len(dataset)))) > 100
    for k in (0, 11):
        item = dataset[k]
        frames = open_sequence(dataset.recordings[int(item["recording"])].clip)
        truth, (start_s, end_s) = ground_truth(frames), item["window_us"] * 1e-6
        np.testing.assert_allclose(item["depth"], truth.depth(end_s, 32, 32), rtol=1e-4)
        flow = truth.flow(start_s, end_s, 32, 32)
        np.testing.assert_allclose(item["flow"], flow.flow_px, atol=1e-3)
        np.testing.assert_array_equal(item["flow_occluded"], flow.occluded)
        np.testing.assert_array_equal(item["instances"], truth.instances(end_s, 32, 32))
        np.testing.assert_allclose(item["pose"], frames.trajectory.pose(end_s), atol=1e-6)
        assert item["frame"].shape == (32, 32)


STUDY = """
scenes = ["carpet"]
render = {resolution = 64, spp = 1, max_displacement_px = 1.0}
simulate = {widths = [32, 64], cutoffs_hz = [inf, 200], speeds = [1.0, 2.0]}
"""


@pytest.mark.slow
def test_the_sets_of_a_study_are_whole_and_continue_to_the_same_bytes(
    tmp_path, eres, monkeypatch, caplog
):
    """Promise: a set for each width, light and speed, and one in ideal light; stopped in the third
    set and continued, all files are those of a dataset that was not stopped."""
    (tmp_path / "mine.toml").write_text(STUDY)
    options = ["--study", tmp_path / "mine.toml", "--seconds", 0.02, "--truth", 0.01]
    with caplog.at_level(logging.INFO, "tasks"):
        assert eres("dataset", tmp_path / "half", *options, "--dry-run")[0] == 0
    assert caplog.messages[-1].startswith("6 of 6 sets to make: about ")
    assert not (tmp_path / "half").exists()
    with monkeypatch.context() as patch:
        left = iter([of_study.simulate_sequence] * 2)
        patch.setattr(of_study, "simulate_sequence", lambda *a, **b: next(left, stopped)(*a, **b))
        assert eres("dataset", tmp_path / "half", *options)[0] == 130
    assert len(list((tmp_path / "half").rglob("*.h5"))) == 2
    for name in ("half", "whole"):
        assert eres("dataset", tmp_path / name, *options)[0] == 0
    half, whole = (contents(tmp_path / name) for name in ("half", "whole"))
    assert half == whole
    files = {path.as_posix(): path for path in whole if path.suffix == ".h5"}
    assert set(files) == {
        f"carpet/{width}px/events_{light}.h5"
        for width in (32, 64)
        for light in ("inf_C0.2", "200_C0.2_x1", "200_C0.2_x2")
    }
    for name in ("200_C0.2_x1", "200_C0.2_x2"):
        header = read_header(tmp_path / "whole" / f"carpet/64px/events_{name}.h5")
        assert header.origin["speed"] == float(name[-1])
        start_us, end_us = (header.origin[f"window_{x}_us"] for x in ("start", "end"))
        assert end_us - start_us == pytest.approx(20_000 / float(name[-1]), abs=1)
    assert len(EventDataset(tmp_path / "whole/carpet/32px").recordings) == 3
    code, _, told = eres("dataset", tmp_path / "whole", *options, "--stereo", 0.1)
    assert code == 1
    assert told.startswith("error: --study: ")


def test_sequences_differ_and_cutoffs_share_sensor_window_and_truth(made):
    thresholds = set()
    for k in range(2):
        folder = made / f"{k:06d}"
        ideal, slow = (read_header(folder / name) for name in FILES)
        assert (ideal.model.cutoff_hz, slow.model.cutoff_hz) == (np.inf, 200.0)
        assert ideal.model.contrast_threshold == slow.model.contrast_threshold
        thresholds.add(ideal.model.contrast_threshold)
        assert ideal.origin == slow.origin
        start_us, end_us = (ideal.origin[f"window_{name}_us"] for name in ("start", "end"))
        assert start_us == np.ceil(1e6 * WARM_UP_S)  # whatever the cutoffs
        assert end_us - start_us == 30_000
        with h5py.File(folder / FILES[0]) as one, h5py.File(folder / FILES[1]) as other:
            assert set(one["truth"]) == set(other["truth"])
            assert {"instances", "flow_occluded", "T_world_object"} <= set(one["truth"])
            assert len(one["imu/t_us"]) == 1 + int(500 * 68.198e-3)
            for group in ("truth", "imu"):
                for name in one[group]:
                    np.testing.assert_array_equal(one[group][name], other[group][name])
            assert np.isfinite(one["truth/depth"][:]).all()  # the room fills the view
        assert len(list((folder / "images").glob("*.png"))) == 7
        assert len(load_events(folder / FILES[0])) > len(load_events(folder / FILES[1]))
    assert len(thresholds) == 2
    assert all(0.14 <= C <= 0.26 for C in thresholds)


@pytest.mark.slow
def test_a_stopped_dataset_continues_to_the_same_bytes(made, tmp_path, eres, monkeypatch):
    """Promise: the same command continues where it was stopped; a sequence gets its name only when
    it is complete; and it is the same whatever was made before it."""
    out = tmp_path / "data"
    shutil.copytree(made, out, ignore=shutil.ignore_patterns("000001"))
    command = ["dataset", out, "--count", 2, "--seed", 4, *OPTIONS]
    with monkeypatch.context() as patch:
        patch.setattr(sequence, "groups_to_copy", stopped)  # after all frames and the first events
        code, _, error = eres(*command)
    assert code == 130
    assert "the same command continues" in error
    assert not (out / "000001").exists()
    half = out / ".unfinished" / "000001"
    (half / ".events_inf.h5.77.0123.unfinished").write_bytes(b"of a killed process")
    written = {file: file.stat().st_mtime_ns for file in (half / "frames").iterdir()}
    assert eres("dataset", out, "--count", 1, "--seed", 4, *OPTIONS)[0] == 0  # leaves it as it is
    assert len(EventDataset(out)) == 2 * 3
    assert eres(*command)[0] == 0
    assert not (out / ".unfinished").exists()
    assert contents(out) == contents(made)
    kept = {
        half / "frames" / f.name: f.stat().st_mtime_ns for f in (out / "000001/frames").iterdir()
    }
    assert kept == written


def stopped(*_, **__):
    raise KeyboardInterrupt


def test_a_dry_run_of_a_dataset_only_tells_what_it_takes(made, eres, tmp_path, caplog):
    """Promise: sequences that are there do not count, and nothing is written."""
    before = contents(made)
    for out, missing in ((made, "1 sequence"), (tmp_path / "new", "3 sequences")):
        caplog.clear()
        with caplog.at_level(logging.INFO):
            assert eres("dataset", out, "--count", 3, "--dry-run", *OPTIONS)[0] == 0
        assert re.search(
            rf"^{missing} to make: about \d+ frames, \d+ MB on disk", caplog.messages[-1]
        )
    assert (contents(made), (tmp_path / "new").exists()) == (before, False)


def test_another_dataset_in_the_folder_is_refused(made, tmp_path, eres):
    before = contents(made)
    for options, found in (
        (["--seed", 5], "seed is 4 in this folder, but 5"),
        (["--seed", 4, "--spp", 9], "spp is 4 in this folder, but 9"),
        (["--seed", 4, "--leak", 0.1], "'leak': 0.1"),
    ):
        code, _, error = eres("dataset", made, *OPTIONS, *options)
        assert code == 1
        assert found in error
        assert "use the same options, or choose another folder" in error
    assert contents(made) == before
    (tmp_path / "mine.txt").touch()
    code, _, error = eres("dataset", tmp_path, *OPTIONS)
    assert code == 1
    assert "contains other files" in error
    code, _, error = eres("dataset", tmp_path / "mine.txt", *OPTIONS)
    assert "found a file, expected a folder" in error


def test_two_processes_do_not_make_the_same_dataset(made, eres):
    with locked(made / ".lock"):
        code, _, error = eres("dataset", made, "--seed", 4, "--count", 3, *OPTIONS)
    assert code == 1
    assert "another process is making this dataset" in error


@pytest.mark.parametrize(
    ("options", "found"),
    [
        (["--sensor", "davis346", "--resolution", 8], "give --sensor or --resolution, not both"),
        (["--sensor", "davis3460"], "did you mean 'davis346'?"),
        (["--count", 0], "count: found 0"),
        (["--seconds", 0], "seconds: found 0.0"),
        (["--seconds", 1e-7], "seconds: found 1e-07, expected at least a microsecond"),
        (["--spp", 5], "spp: found 5, expected a square"),
        (["--spp", 0], "spp: found 0, expected a square"),
        (["--cutoffs", 50, "nan"], "cutoffs: found (50.0, nan), expected 0.01"),
        (["--cutoffs", 50, 50], "cutoffs: found (50.0, 50.0), expected 0.01"),
        (["--cutoffs", 200.0001, 200.0002], "different in the first six"),
        (
            ["--threshold", 0.05],
            "threshold_deviation: found 0.03, expected 0 or more, and less than 0.025",
        ),
        (["--stereo", 0.4], "stereo: found 0.4, expected above 0 and at most 0.3 m"),
        (["--imu", 0], "imu: found 0 Hz"),
        (["--gyroscope-noise", 1], "--gyroscope-noise 1.0 needs an IMU"),
        (["--cutoffs", 1e-308], "cutoffs: found (1e-308,), expected 0.01 Hz"),
        (["--images", 300], "images: found 300.0, expected a positive rate, and exposures"),
        (["--resolution", 0], "width: found 0"),
        (["--threshold", "inf"], "threshold: found inf"),
        (["--exposure", 0.01], "images: found None, expected a rate"),
        (["--truth", 1e-7], "truth: found 1e-07, expected at least a microsecond"),
        (["--max-displacement", 0], "--max-displacement: found 0.0, expected a positive number"),
        (
            ["--images", 1, "--seconds", 0.002, "--warm-up", 0],
            "outlast the 0.002 s",
        ),
        (["--cutoffs", 20], "warm_up: found 0.038198, expected at least 0.047747 s for 20 Hz"),
    ],
)
def test_senseless_options_are_refused(tmp_path, eres, options, found):
    code, _, error = eres("dataset", tmp_path / "out", *options)
    assert code == 1
    assert found in error
    assert not (tmp_path / "out").exists()


def test_a_refused_dataset_can_be_asked_for_with_other_options(tmp_path, eres):
    """Promise: nothing that was not begun stays behind as settings."""
    out = tmp_path / "out"
    code, _, error = eres("dataset", out, "--count", 1, *OPTIONS, "--scheduler", "foo")
    assert (code, "--scheduler: found 'foo'" in error) == (1, True)
    assert not (out / "dataset.json").exists()


def test_a_dataset_has_cutoffs_and_no_single_one(tmp_path, eres):
    """Promise: its help lists no option that it refuses; the error for it names the right one."""
    said = eres("dataset", "--help")[1]
    assert re.search(r"--cutoffs\b", said)
    assert not re.search(r"--(cutoff|illuminance)\s", said)
    code, _, error = eres("dataset", tmp_path / "out", "--cutoff", 50)
    assert (code, "--cutoffs FLOAT" in error) == (2, True)


def test_a_list_of_cutoffs_is_a_tuple():
    """Promise: the same dataset continues, however its cutoffs are given."""
    settings = DatasetSettings(
        seed=0, seconds=1.0, sensor=plain_camera(4), cutoffs_hz=[200, np.inf]
    )
    assert settings == dataclasses.replace(settings, cutoffs_hz=(200.0, np.inf))


def test_a_cutoff_follows_the_light_where_there_is_one():
    """Promise: ideal pixels beside those whose cutoff follows the light, as in a study."""
    camera = dataclasses.replace(plain_camera(4), cutoff_follows_light=True)
    settings = DatasetSettings(seed=0, seconds=1.0, sensor=camera, cutoffs_hz=(np.inf, 200.0))
    ideal, real = settings.models(0, white_level=1.0).values()
    assert (ideal.cutoff_hz, ideal.cutoff_reference) == (np.inf, None)
    assert real.cutoff_hz == 200
    assert real.cutoff_reference is not None


def test_a_dataset_states_its_sensor(tmp_path):
    """Promise: dataset.json has what the sensor does not have by default; another is refused."""
    camera = dataclasses.replace(plain_camera(32, 24), leak_hz=0.1, fill_factor=0.22)
    settings = DatasetSettings(seed=0, seconds=1.0, sensor=camera)
    claim_folder(settings, tmp_path)
    stored = json.loads((tmp_path / "dataset.json").read_text())
    assert stored["sensor"] == {"width": 32, "height": 24, "fill_factor": 0.22, "leak": 0.1}
    other = dataclasses.replace(camera, photoreceptor="one_pole")
    with pytest.raises(TaskError, match=r"sensor is .*one_pole"):
        claim_folder(dataclasses.replace(settings, sensor=other), tmp_path)


def test_a_dataset_takes_a_whole_camera():
    """Promise: OFF thresholds keep their ratio to ON over the sequences; the dark level is a share
    of the white of the brightest scene."""
    camera = find_camera("davis346")
    model = DatasetSettings(seed=0, seconds=1.0, sensor=camera).models(3, 2.0)["inf"]
    assert model.contrast_threshold != camera.contrast_threshold
    ratio = camera.contrast_threshold_off / camera.contrast_threshold
    assert model.off_threshold / model.contrast_threshold == pytest.approx(ratio)
    assert (model.leak_hz, model.dark_level, model.fill_factor) == (0.1, 4e-3, 0.22)


def test_a_dataset_continues_with_numbers_of_numpy(tmp_path):
    """Promise: settings that were computed are those of a dataset begun with Python's numbers."""
    settings = DatasetSettings(
        seed=3, seconds=1.0, sensor=plain_camera(64, 48), cutoffs_hz=(50.0, np.inf)
    )
    claim_folder(settings, tmp_path)
    computed = {"seed": np.int64(3), "cutoffs_hz": np.array([50.0, np.inf])}
    camera = FrameCameraOptions(full_well=np.float32(10_000))
    claim_folder(dataclasses.replace(settings, camera=camera, **computed), tmp_path)


def test_thresholds_stay_near_their_mean():
    settings = DatasetSettings(seed=0, seconds=1.0, sensor=plain_camera(4))
    C = [settings.models(k, 1.0)["inf"].contrast_threshold for k in range(400)]
    assert np.mean(C) == pytest.approx(0.2, abs=0.005)
    assert np.std(C) == pytest.approx(0.0264, abs=0.003)  # of a normal clipped at two sigma
    assert 0.14 <= min(C) <= 0.145
    assert 0.255 <= max(C) <= 0.26
    noisy = dataclasses.replace(plain_camera(4), leak_hz=0.1, threshold_mismatch=0.03)
    model = DatasetSettings(seed=0, seconds=1.0, sensor=noisy).models(0, 1.0)["inf"]
    assert (model.leak_hz, model.threshold_mismatch, model.dark_level) == (0.1, 0.03, 4e-3)
    assert model.contrast_threshold == C[0]


@pytest.mark.parametrize(
    ("options", "fields"),
    [
        ([], {"threshold": 0.2, "off": None, "fill": 0.22}),
        (["--fill-factor", 0.5], {"fill": 0.5}),
        (["--resolution", 16], {"fill": 1.0}),
        (["--sensor", "davis240", "--threshold", 0.5], {"threshold": 0.5, "off": None}),
        (["--threshold", 0.5, "--threshold-off", 0.4], {"threshold": 0.5, "off": 0.4}),
    ],
)
def test_a_dataset_has_the_sensor_of_eres_simulate(tmp_path, eres, monkeypatch, options, fields):
    """Promise: the camera's fill factor; one threshold for both polarities where one is given."""
    asked = []
    monkeypatch.setattr(dataset, "make_dataset", lambda settings, *_: asked.append(settings) or [])
    assert eres("dataset", tmp_path / "out", "--threshold-deviation", 0, *options)[0] == 0
    model = asked[0].models(0, 1.0)["inf"]
    found = {
        "threshold": model.contrast_threshold,
        "off": model.contrast_threshold_off,
        "fill": model.fill_factor,
    }
    assert {name: found[name] for name in fields} == fields


@pytest.mark.slow
@pytest.mark.filterwarnings("default:Creating scratch directories")
def test_workers_make_the_same_sequences(made, tmp_path, eres):
    """Promise: a worker's files are the same byte by byte; a worker without the folder says so."""
    out = tmp_path / "data"
    shutil.copytree(made, out, ignore=shutil.ignore_patterns("000001"))
    here = {"host": "127.0.0.1", "protocol": "tcp://", "dashboard_address": ":0"}
    one = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "memory_limit": 0}
    with LocalCluster(**here, **one, silence_logs=logging.CRITICAL) as cluster:
        address = ["--scheduler", cluster.scheduler_address]
        command = ["dataset", out, "--count", 2, "--seed", 4, *OPTIONS, *address]
        code, _, error = eres(*command)
    assert code == 0, error
    assert contents(out) == contents(made)
    with pytest.raises(TaskError, match=r"cannot see the folder .*elsewhere"):
        _complete(SETTINGS, 0, str(tmp_path / "elsewhere"), version(DISTRIBUTION))
    with pytest.raises(TaskError, match=r"has eres .*, expected 9\.9"):
        _complete(SETTINGS, 0, str(out), "9.9")
    code, _, error = eres(
        "dataset", out, "--count", 3, "--seed", 4, *OPTIONS, "--scheduler", "here"
    )
    assert code == 1
    assert "expected tcp://HOST:PORT" in error


@pytest.mark.slow
def test_a_right_camera_sees_the_scene_from_beside(tmp_path):
    """What the left camera sees at depth z, the right one sees f b / z farther left at depth z."""
    (folder,) = make_dataset(PAIR, tmp_path / "data", 1)
    with (
        h5py.File(folder / "events_inf.h5") as left,
        h5py.File(folder / "right" / "events_inf.h5") as right,
    ):
        poses = (one["truth/T_world_cam"][-1] for one in (left, right))
        T_left_right = np.linalg.inv(next(poses)) @ next(poses)
        np.testing.assert_allclose(T_left_right, to_the_right(0.1), atol=1e-6)
        here, there = (one["truth/depth"][-1] for one in (left, right))
        focal_px = left["truth/K"][0, 0]
    row, column = np.indices(here.shape)
    shifted = np.round(column - focal_px * 0.1 / here).astype(int)
    seen = shifted >= 0
    ratio = there[row[seen], shifted[seen]] / here[seen]
    assert np.median(abs(ratio - 1)) < 0.01
    white = {open_sequence(place).white_level for place in (folder, folder / "right")}
    assert len(white) == 1
    dataset = EventDataset(tmp_path / "data")
    assert [one.clip for one in dataset.recordings] == [folder, folder / "right"]


@pytest.mark.slow
def test_a_stopped_pair_continues_to_the_same_bytes(tmp_path, monkeypatch):
    """Promise: stopped at the right camera's events, a pair is completed and keeps its frames."""
    settings = dataclasses.replace(PAIR, cutoffs_hz=(np.inf, 2000.0))
    make_dataset(settings, tmp_path / "whole", 1)
    views = []

    def stopped_at_the_second(*arguments):
        views.append(arguments)
        return stopped() if len(views) == 2 else groups_to_copy(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(sequence, "groups_to_copy", stopped_at_the_second)
        with pytest.raises(KeyboardInterrupt):
            make_dataset(settings, tmp_path / "stopped", 1)
    half = tmp_path / "stopped/.unfinished/000000"
    written = [file.stat().st_mtime_ns for file in sorted(half.rglob("frames/*"))]
    (folder,) = make_dataset(settings, tmp_path / "stopped", 1)
    assert contents(tmp_path / "stopped") == contents(tmp_path / "whole")
    assert [file.stat().st_mtime_ns for file in sorted(folder.rglob("frames/*"))] == written
    assert len({file.parent for file in folder.rglob("frames/*")}) == 2


def test_the_estimate_grows_with_the_work():
    """Promise: time and disk space are logged before the start, as measured for 346 x 260 px."""
    settings = DatasetSettings(
        seed=0, seconds=1.0, sensor=plain_camera(346, 260), cutoffs_hz=(np.inf, 200, 50)
    )
    found = re.fullmatch(
        r"100 sequences to make: about (\d+) frames, (\S+) GB on disk, (\d+) min",
        estimate(settings, 100),
    )
    frames, gigabytes, minutes = map(float, found.groups())
    assert 40_000 < frames < 70_000
    assert 10 < gigabytes < 25
    assert minutes < 100  # twice that on one core
    pair = dataclasses.replace(settings, baseline_m=0.1)
    assert estimate(pair, 50).split(":")[1] == estimate(settings, 100).split(":")[1]
    assert estimate(settings, 1).startswith("1 sequence to make: about")
