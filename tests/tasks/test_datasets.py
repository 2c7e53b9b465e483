"""`EventDataset`: windows with their frames and truth, in any process."""

import functools
import multiprocessing
import os
import pickle
import shutil
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from eres_render import SequenceError, ground_truth, load_scene, open_sequence, render_scene
from event_streams import assert_same, make_events, random_events
from light_scenes import small_carpet_folder
from sensor import EventError, EventFormatError, Events, SensorModel
from sensor.formats import Header, load_events, read_header, write_events
from sensor.formats.dsec_reader import DsecReader
from sensor.optics import integrate
from sensor.representations import voxel_grid
from tasks.datasets import EventDataset
from tasks.errors import TaskError
from tasks.events.simulation import SimulationOptions, simulate_sequence

GRID = functools.partial(voxel_grid, bins=3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two rendered clips of 32 x 32 px, and their events at 16 x 16 px with truth."""
    folder = tmp_path_factory.mktemp("data")
    scene = load_scene(small_carpet_folder(tmp_path_factory.mktemp("scene") / "carpet"))
    clips = render_scene(
        scene, folder / "clips", resolution=32, spp=1, max_displacement_px=1.0, samples=2
    )
    for k, clip in enumerate(clips):
        model = SensorModel(width=16, height=16, dark_level=1e-3 * clip.white_level)
        simulate_sequence(
            clip, model, folder / f"{k}.h5", SimulationOptions(speed=2.0), truth_step_s=0.02
        )
    return folder


def test_any_window_of_a_file(tmp_path):
    """Promise: `DsecReader.between` equals `Events.between`, before, in and after the file."""
    events = random_events(3000, mean_us=7, start_us=5_000)
    for offset_us in (0, 4_000):
        path = tmp_path / f"{offset_us}.h5"
        write_events(path, events, t_offset_us=offset_us)
        reader = DsecReader(path)
        edges = [-5, 0, 4_999, 5_000, 9_000, 9_001, 12_345, events.t_us[-1], 10**7, 10**9]
        for first in edges:
            for last in [*edges, first + 1000]:
                assert_same(reader.between(first, last), events.between(first, max(first, last)))
    for part in ((0, -1), (-3, 5000), (-7, -2), (5, 3), (0, 10**9)):
        assert_same(reader.part(*part), events[slice(*part)])
    empty = tmp_path / "empty.h5"
    write_events(empty, events[:0])
    assert len(DsecReader(empty).between(-9, 9)) == 0
    for bad in (5000.0, np.float64(0.5), "5000"):
        with pytest.raises(EventError, match=r"DsecReader: found t_us = .*, expected whole micro"):
            DsecReader(str(empty)).between(0, bad)


@pytest.mark.parametrize("damage", ["later", "zeros", "beyond"])
def test_an_index_that_does_not_fit_is_an_error(damage, tmp_path):
    """Promise: a window never has events of another time."""
    path = tmp_path / "a.h5"
    write_events(path, random_events(3000, mean_us=7, start_us=5_000))
    with h5py.File(path, "r+") as file:
        if damage == "later":
            file["events/t"][...] += 10_000
        else:
            file["ms_to_idx"][...] = 0 if damage == "zeros" else 2**63
    with (
        DsecReader(path) as reader,
        pytest.raises(EventFormatError, match="ms_to_idx: disagrees with events/t"),
    ):
        reader.between(8_000, 12_000)


def truth_of(path, t_us, **arrays):
    """A file of events over 100 ms, and ground truth for it."""
    t, x = np.arange(0, 100_000, 100), np.zeros(1000, np.uint16)
    write_events(path, Events(t, x, x, np.ones(1000, np.int8), width=8, height=6))
    with h5py.File(path, "r+") as file:
        for name, values in {"t_us": np.array(t_us), **arrays}.items():
            file[f"truth/{name}"] = values


@pytest.mark.parametrize(
    ("t_us", "steps", "size", "said"),
    [
        (
            [0, 10_000, 20_000],
            1,
            (6, 8),
            r"flow: found shape \(1, 6, 8, 2\), not \(2, 6, 8, 2",
        ),
        (
            [0, 10_000, 20_000],
            2,
            (3, 3),
            r"flow: found shape \(2, 3, 3, 2\), not \(2, 6, 8, 2",
        ),
        ([20_000, 10_000, 0], 2, (6, 8), "t_us: expected two or more ascending"),
        ([0], 0, (6, 8), "t_us: expected two or more ascending"),
    ],
)
def test_truth_that_does_not_fit_is_refused(t_us, steps, size, said, tmp_path):
    """Promise: before any window is read, so that a loop never ends early."""
    flow = np.zeros((steps, *size, 2), np.float32)
    truth_of(tmp_path / "a.h5", t_us, flow=flow, flow_valid=np.ones((steps, *size), bool))
    with pytest.raises(TaskError, match=rf"a\.h5: truth/{said}"):
        EventDataset(tmp_path)


def test_flow_outside_of_the_truth_is_not_valid(tmp_path):
    """Promise: a window whose center is in no interval has no valid flow."""
    flow = np.ones((2, 6, 8, 2), np.float32)
    truth_of(tmp_path / "a.h5", [0, 10_000, 20_000], flow=flow, flow_valid=np.ones((2, 6, 8), bool))
    for length in (10_000, np.int32(10_000), np.uint16(10_000)):
        dataset = EventDataset(tmp_path, window_us=length)
        assert [bool(item["flow_valid"].all()) for item in dataset] == [True, True] + 7 * [False]


def test_a_file_is_closed_after_use_and_after_damage(tmp_path):
    """Promise: a file can be replaced; a size is whole pixels."""
    path = tmp_path / "a.h5"
    write_events(path, random_events(9))
    with DsecReader(path) as reader:
        assert len(reader) == 9
    assert not reader.file
    with h5py.File(path, "r+") as file:
        del file["ms_to_idx"]
    with pytest.raises(EventError, match=r"a\.h5: .*ms_to_idx"):
        DsecReader(path)
    with h5py.File(path, "r+"):  # fails while it is open for reading
        pass
    with pytest.raises(EventError, match=r"width: found 346\.0"):
        Header(346.0, 260)


def test_windows_of_the_truth(folder):
    """Promise: without a length, windows are the truth's intervals, with all targets."""
    dataset = EventDataset(folder)
    assert dataset.targets == ("frame", "flow", "occlusion", "depth", "pose")
    assert len(dataset) == 2 * 3
    for k in (0, 2, 3, -1):
        item = dataset[k]
        recording = dataset.recordings[int(item["recording"])]
        step = k % len(dataset) - 3 * int(item["recording"])
        assert recording.path == folder / f"{item['recording']}.h5"
        start_us, end_us = recording.truth_us[step : step + 2]
        assert item["window_us"].tolist() == item["flow_us"].tolist() == [start_us, end_us]
        expected = load_events(recording.path).between(start_us, end_us)
        assert len(expected) > 10
        for name in ("t_us", "x", "y", "p"):
            np.testing.assert_array_equal(item[name], getattr(expected, name))
        sequence = open_sequence(recording.clip)
        truth, end_s = ground_truth(sequence), end_us * 2e-6
        assert int(item["truth_us"]) == end_us
        np.testing.assert_allclose(item["depth"], truth.depth(end_s, 16), rtol=1e-3)
        np.testing.assert_allclose(item["pose"], truth.trajectory.pose(end_s), atol=1e-5)
        flow = truth.flow(start_us * 2e-6, end_s, 16)
        np.testing.assert_allclose(item["flow"], flow.flow_px, atol=1e-3)
        np.testing.assert_array_equal(item["flow_occluded"], flow.occluded)
        nearest = np.argmin(np.abs(sequence.t_s - end_s))
        seen = integrate(sequence.frame(nearest), 16, 16)
        np.testing.assert_array_equal(item["frame"], seen.astype(np.float32))
        assert int(item["frame_us"]) == round(sequence.t_s[nearest] / 2 * 1e6)
    with pytest.raises(IndexError):
        dataset[len(dataset)]


def test_frames_are_those_of_events_that_were_shifted(folder, tmp_path, eres):
    """Promise: `eres convert --shift-us` leaves each window with its frame."""
    data = Path(shutil.copytree(folder, tmp_path / "data"))
    before = EventDataset(data)[1]
    assert eres("convert", data / "0.h5", tmp_path / "0.h5", "--shift-us", 30_000)[0] == 0
    (tmp_path / "0.h5").replace(data / "0.h5")
    after = EventDataset(data)[1]
    assert after["frame_us"] == before["frame_us"] + 30_000
    np.testing.assert_array_equal(after["frame"], before["frame"])


def test_steps_of_the_truth_are_at_least_a_microsecond(folder, tmp_path):
    """Promise: times of the truth differ; a wrong unit does not fill the memory."""
    clip = open_sequence(folder / "clips" / "clip_000")
    model = SensorModel(width=8, height=8, dark_level=1e-3 * clip.white_level)
    with pytest.raises(TaskError, match=r"truth: found a step of 0\.5 us"):
        simulate_sequence(
            clip, model, tmp_path / "0.h5", SimulationOptions(speed=2.0), truth_step_s=1e-6
        )
    assert not list(tmp_path.iterdir())


def test_frames_are_those_of_the_fill_factor(folder, tmp_path):
    """Promise: a sensor of which a tenth is sensitive sees the middle of each of its pixels."""
    clip = open_sequence(folder / "clips" / "clip_000")
    white = 1e-3 * clip.white_level
    model = SensorModel(width=8, height=8, dark_level=white, fill_factor=0.1)
    shutil.copytree(clip.folder, tmp_path / "clip_000")
    options = SimulationOptions(seed=np.int64(1))  # a number that was computed
    simulate_sequence(clip, model, str(tmp_path / "0.h5"), options, truth_step_s=0.02)
    item = EventDataset(tmp_path)[0]
    nearest = np.argmin(np.abs(1e6 * clip.t_s - item["frame_us"]))
    seen, whole = (integrate(clip.frame(nearest), 8, 8, share) for share in (0.1, 1.0))
    np.testing.assert_array_equal(item["frame"], seen.astype(np.float32))
    assert np.abs(seen - whole).max() > 0.01 * whole.max()


def test_a_file_that_is_written_again_is_read_again(tmp_path):
    """Promise: a new data set does not have the events of a file that was there before."""
    path = tmp_path / "one.h5"
    for x in (3, 7):
        t_us = np.arange(0, 4_000, 10)
        column, p = np.full(len(t_us), x, np.uint16), np.ones(len(t_us), np.int8)
        write_events(path, Events(t_us, column, column, p, width=16, height=16))
        assert np.all(EventDataset(tmp_path, window_us=1_000)[0]["x"] == x)


def test_masks_of_objects_are_empty_where_nothing_moves(folder, tmp_path):
    """Promise: recordings of still scenes and of moving objects make one dataset; each window has
    the mask and the occlusion of its own time."""
    copy = copied(folder, tmp_path)
    with h5py.File(copy / "1.h5", "a") as file:
        truth = file["truth"]
        numbers = np.arange(len(truth["t_us"]), dtype=np.uint8)
        truth["instances"] = np.broadcast_to(numbers[:, None, None], (len(numbers), 16, 16))
        truth["flow_occluded"][1] = True
    assert EventDataset(copy).targets[-1] == "instances"
    dataset = EventDataset(copy, targets=["instances", "occlusion"])
    items = [dataset[k] for k in range(6)]
    assert [int(item["instances"].max()) for item in items] == [0, 0, 0, 1, 2, 3]
    assert {(item["instances"].shape, item["instances"].dtype) for item in items} == {
        ((16, 16), np.dtype(np.uint8))
    }
    assert [bool(item["flow_occluded"].all()) for item in items[3:]] == [False, True, False]
    assert set(items[0]) >= {"flow_us", "truth_us"}
    assert not {"flow", "depth"} & set(items[0])
    write_events(copy / "2.h5", load_events(copy / "1.h5"))
    with pytest.raises(TaskError, match=r"2.h5: has no instances"):
        EventDataset(copy, targets=["instances"], window_us=1000)


@pytest.mark.parametrize("length", [{"window_us": 7_000}, {"window_events": 40}])
def test_windows_by_time_and_by_count(folder, length):
    """Promise: windows follow one another in the clip's window, and leave out less than one."""
    dataset = EventDataset(folder, targets=["flow"], **length)
    for number in (0, 1):
        items = [dataset[k] for k in range(len(dataset)) if dataset[k]["recording"] == number]
        path = dataset.recordings[number].path
        origin = read_header(path).origin
        events = load_events(path).between(origin["window_start_us"], origin["window_end_us"])
        t_us = np.concatenate([item["t_us"] for item in items])
        np.testing.assert_array_equal(t_us, events.t_us[: len(t_us)])
        rest = events[len(t_us) :]
        if "window_events" in length:
            assert {len(item["t_us"]) for item in items} == {40}
            assert len(rest) < 40
        else:
            assert {int(np.ptp(item["window_us"])) for item in items} == {7_000}
            assert items[0]["window_us"][0] == origin["window_start_us"]
            assert 0 <= origin["window_end_us"] - items[-1]["window_us"][1] < 7_000
        for item in items:
            assert item["flow_us"][0] <= item["window_us"].mean() <= item["flow_us"][1]
            assert set(item) >= {"flow", "flow_valid"}
            assert "depth" not in item


def test_a_transform_makes_arrays(folder):
    """Promise: the transform gets the window's events; batches of its arrays can be stacked."""
    plain, grids = (
        EventDataset(folder, targets=()),
        EventDataset(folder, targets=(), transform=GRID),
    )
    for a, b in zip(
        map(plain.__getitem__, range(len(plain))), map(grids.__getitem__, range(9)), strict=False
    ):
        events = make_events(*(a[name] for name in ("t_us", "x", "y", "p")), 16, 16)
        np.testing.assert_array_equal(b["events"], GRID(events))
        assert set(b) == {"events", "window_us", "recording"}


def open_files():
    found = []
    for descriptor in Path("/proc/self/fd").iterdir():
        try:
            found.append(os.readlink(descriptor))
        except OSError:  # the one that listed them
            continue
    return [name for name in found if name.endswith(".h5")]


def read_in_worker(dataset):
    """Return the files open at the start, and all grids."""
    return open_files(), [dataset[k]["events"] for k in range(len(dataset))]


@pytest.mark.skipif(sys.platform != "linux", reason="needs fork and /proc")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # fork with numba's threads
def test_forked_processes_open_their_own_files(folder):
    """Promise: workers read the same even if the parent read before, and inherit no open file."""
    dataset = EventDataset(folder, transform=GRID)
    expected = [dataset[k]["events"] for k in range(len(dataset))]
    assert len(open_files()) >= 2
    with multiprocessing.get_context("fork").Pool(2, maxtasksperchild=1) as pool:
        for inherited, found in pool.map(read_in_worker, [dataset] * 3, chunksize=1):
            assert inherited == []
            np.testing.assert_array_equal(found, expected)


def test_it_can_be_pickled_after_use(folder):
    """Promise: a dataset is small and has no open file, also after it was read."""
    dataset = EventDataset(folder, transform=GRID)
    expected = dataset[1]["events"]
    data = pickle.dumps(dataset)
    assert len(data) < 5000
    np.testing.assert_array_equal(pickle.loads(data)[1]["events"], expected)


def test_torchs_data_loader(folder):
    """Promise: torch's DataLoader with workers gives the same batches as none."""
    torch = pytest.importorskip("torch")
    dataset = EventDataset(folder, transform=GRID)
    for workers in (0, 2):
        loader = torch.utils.data.DataLoader(dataset, batch_size=3, num_workers=workers)
        batches = list(loader)
        assert len(batches) == 2
        for k, batch in enumerate(batches):
            items = [dataset[3 * k + i] for i in range(3)]
            assert set(batch) == set(items[0])
            for name, value in batch.items():
                np.testing.assert_array_equal(value.numpy(), [item[name] for item in items])


def copied(folder, tmp_path):
    return Path(shutil.copytree(folder, tmp_path / "data"))


def no_events(folder):
    (folder / "1.h5").unlink()


def no_clip(folder):
    shutil.rmtree(folder / "clips" / "clip_001")


def no_frame(folder):
    sorted((folder / "clips" / "clip_001").rglob("*.exr"))[3].unlink()


def no_truth(folder):
    header = read_header(folder / "1.h5")
    write_events(folder / "2.h5", load_events(folder / "1.h5"), origin=header.origin)
    (folder / "1.h5").unlink()


def unfinished(folder):
    (folder / ".2.h5.77.unfinished").write_bytes(b"")


def cut(folder):
    data = (folder / "1.h5").read_bytes()
    (folder / "1.h5").write_bytes(data[: len(data) // 2])


def raw(folder):
    write_events(folder / "2.raw", load_events(folder / "1.h5"))


def twice(folder):
    shutil.copytree(folder / "clips" / "clip_001", folder / "again")


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (no_events, r"clip_001: has no events; run `eres simulate"),
        (no_clip, r"1.h5: has no frame"),
        (no_frame, r"missing"),
        (no_truth, r"2.h5: has no flow"),
        (unfinished, r"unfinished: is unfinished"),
        (cut, r"1.h5: could not be read as DSEC HDF5"),
        (raw, r"2.raw: has no index.*`eres convert .*2.raw .*2.h5`"),
        (twice, r"clip_001: is the same clip as .*again;"),
    ],
)
def test_half_a_recording_is_named(folder, tmp_path, damage, said):
    """Promise: nothing incomplete is skipped silently; the error names the file."""
    copy = copied(folder, tmp_path)
    damage(copy)
    with pytest.raises((TaskError, SequenceError, ValueError), match=said):
        EventDataset(copy)


def test_files_that_are_not_events_may_lie_beside_them(folder, tmp_path):
    """Promise: notes, tables and the times of images are left alone; events are still named."""
    copy = copied(folder, tmp_path)
    (copy / "README.txt").write_text("Two recordings.")
    (copy / "frames.csv").write_text("t_us_start,t_us_end,file\n0,10,000000.png\n")
    (copy / "timestamps.txt").write_text("# unit: us\n10\n20\n")
    (copy / "poses.txt").write_text("# t x y z qx qy qz qw\n0.0 0 0 0 0 0 0 1\n")
    np.savez(copy / "table.npz", losses=np.zeros(3))
    assert len(EventDataset(copy)) == len(EventDataset(folder))
    events = load_events(copy / "1.h5")
    for name in ("2.txt", "2.npz", "3.txt", "3.npz", "3.dat"):
        if name.startswith("2"):
            write_events(copy / name, events)
        else:  # in microseconds, as NumPy writes them; damaged
            np.savetxt(copy / name, np.stack(events[:9].columns, 1), "%d")
        with pytest.raises(TaskError, match=f"{name}: has no index"):
            EventDataset(copy)
        (copy / name).unlink()


def test_sensors_of_different_size_are_refused(folder, tmp_path):
    """Promise: all windows have the same size, so that they can be stacked."""
    copy = copied(folder, tmp_path)
    write_events(copy / "2.h5", random_events(9, 8, 16))
    with pytest.raises(TaskError, match=r"2.h5: found 8x16 px, expected 16x16 px"):
        EventDataset(copy, targets=(), window_us=1000)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"window_us": 0}, "window_us: found 0"),
        ({"window_us": 5, "window_events": 5}, "window_us or window_events"),
        ({"window_us": 10**9}, "shorter than a window"),
        ({"targets": ["flwo"]}, "found 'flwo', expected some of frame, flow, occlusion, depth"),
    ],
)
def test_arguments_are_checked(folder, arguments, said):
    """Promise: errors name the argument."""
    with pytest.raises(TaskError, match=said):
        EventDataset(folder, **arguments)


def test_an_empty_folder_is_an_error(tmp_path):
    """Promise: a folder without events is named, and so are a file and what is not there."""
    with pytest.raises(TaskError, match=r"holds no files of events \(\.h5"):
        EventDataset(tmp_path)
    with pytest.raises(TaskError, match="nowhere: no such folder"):
        EventDataset(tmp_path / "nowhere")
    (tmp_path / "events.h5").touch()
    with pytest.raises(TaskError, match=r"events\.h5: no such folder"):
        EventDataset(tmp_path / "events.h5")


def test_any_kind_of_sequence_and_integer_is_taken(folder):
    """Promise: targets may come from a generator, and lengths from NumPy."""
    dataset = EventDataset(folder, targets=(name for name in ["flow"]))
    assert dataset.targets == ("flow",)
    assert "flow" in dataset[0]
    window_us = EventDataset(folder, window_us=np.int64(10_000))[0]["window_us"]
    assert np.ptp(window_us) == 10_000


def test_a_file_without_events_does_not_spoil_a_folder(tmp_path):
    """Promise: it has no windows; those of the other files are there."""
    x = np.zeros(50, np.uint16)
    events = Events(np.arange(50) * 100, x, x, np.ones(50, np.int8), 8, 8)
    write_events(tmp_path / "a.h5", events[:0])
    write_events(tmp_path / "b.h5", events)
    assert len(EventDataset(tmp_path, window_us=1000)) == 4
