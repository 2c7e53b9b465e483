"""`eres simulate`, `convert`, `info` and `sensors`: from a render to any file of events."""

import logging
import math
import os
import shutil
import sys
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from eres_render import ground_truth, render_scene, window_times
from eres_render.errors import RenderError
from eres_render.storage.atomic import write_bytes
from event_streams import SUFFIXES, assert_same, make_events, random_events
from sensor import Events, Readout, SensorModel, camera_names, read_out, simulate
from sensor.errors import EventFormatError
from sensor.events import concatenate
from sensor.formats import (
    FORMATS,
    Triggers,
    load_events,
    read_header,
    read_triggers,
    write_events,
)
from sensor.optics import crop_to_aspect
from tasks.errors import TaskError
from tasks.evaluation.sequence import evaluate_sequence
from tasks.events.simulation import SimulationOptions, simulate_frames, simulate_sequence
from tasks.registry import TASKS
from tasks.warm_up import warn_of_frames


@pytest.fixture(scope="module")
def sequence(small_carpet, tmp_path_factory):
    """A rendered clip of 64 x 64 px."""
    folder = tmp_path_factory.mktemp("clip")
    return render_scene(
        small_carpet, folder, resolution=64, spp=1, max_displacement_px=1.0, samples=1
    )[0]


@pytest.fixture(scope="module")
def with_truth(sequence, tmp_path_factory):
    """A file of the clip's events with ground truth."""
    path = tmp_path_factory.mktemp("truth") / "a.h5"
    simulate_sequence(sequence, SensorModel(width=16, height=16), path, truth_step_s=0.02)
    return path


@pytest.mark.parametrize(
    ("arguments", "model", "speed"),
    [
        (
            ["--resolution", 40, "--cutoff", 50, "--threshold", 0.15, "--speed", 2, "--seed", 4],
            SensorModel(width=40, height=40, cutoff_hz=50.0, contrast_threshold=0.15),
            2.0,
        ),
        (["--resolution", 64], SensorModel(width=64, height=64), 1.0),
    ],
)
def test_simulate_writes_what_the_library_simulates(
    eres, sequence, tmp_path, arguments, model, speed
):
    """Promise: the file contains `sensor.simulate`'s events and their origin."""
    out = tmp_path / "out.h5"
    code, printed, err = eres("simulate", sequence.folder, "--out", out, *arguments)
    assert (code, err) == (0, "")  # no terminal, no progress
    dark = replace(model, dark_level=1e-3 * sequence.white_level)
    expected = simulate(np.stack(list(sequence)), sequence.t_s / speed, dark)
    assert len(expected) > 500
    assert_same(load_events(out), expected)
    assert f"out.h5: {len(expected)} events" in printed
    header = read_header(out)
    assert header.model == dark
    said = header.origin
    assert (said["scene"], said["clip"], said["speed"]) == (sequence.manifest.scene, 0, speed)
    assert said["seed"] == (4 if "--seed" in arguments else 0)
    assert said["window_end_us"] == round(1e6 * sequence.window_s[1] / speed)


class Started(Exception):
    """Frames were asked for."""


class LongFrames:
    """Frames of some length, none of which can be computed."""

    width = height = 4
    white_level = 1.0

    def __init__(self, length_s, t_offset_us):
        self.t_s, self.t_offset_us = np.array([0.0, length_s]), t_offset_us

    def __len__(self):
        return 2

    def __iter__(self):
        raise Started


@pytest.mark.parametrize(
    ("name", "length_s", "offset_us", "options", "able"),
    [
        ("a.h5", 7000, 0, {}, ".raw, .npz, .txt"),
        ("a.h5", 7000, 0, {"speed": 2.0}, None),
        ("a.h5", 3600, 0, {"speed": 0.5}, ".raw, .npz, .txt"),
        ("a.h5", 7000, 10**15, {}, None),  # times are counted from the start of the clock
        ("a.h5", 300_000, 10**15, {}, ".raw, .npz, .txt"),
        ("a.h5", 7000, -(10**9), {}, None),
        ("a.h5", 7000, 0, {"format": "npz"}, None),
        ("a.raw", 7000, 0, {}, None),
        ("a.raw", 1.2e6, 0, {}, ".npz, .txt"),
        ("a.raw", 1.2e6, 2**62 - 2**50 + 1, {}, ".npz, .txt"),
        ("a.raw", 7000, 2**61 + 1, {}, None),
        ("a.npz", 1.2e6, 0, {}, None),
        ("a.npz", 7000, 0, {"format": "dsec"}, ".raw, .npz, .txt"),
    ],
)
def test_a_format_that_cannot_have_the_last_frame_is_refused(
    name, length_s, offset_us, options, able, tmp_path
):
    """Promise: before the first frame, with the formats that can; what a format can is what its
    writer accepts."""
    options = SimulationOptions(**options)
    start = partial(
        *(simulate_frames, LongFrames(length_s, offset_us), SensorModel(width=4, height=4)),
        *(tmp_path / name, options),
        origin={},
    )
    last_us = round(1e6 * length_s / options.speed) + offset_us
    x = np.zeros(2, np.uint16)
    events = Events(np.array([offset_us, last_us]), x, x, np.ones(2, np.int8), 4, 4)
    write = partial(
        *(write_events, tmp_path / f"events_{name}", events),
        **{"format": options.format, "t_offset_us": offset_us},
    )
    if able is None:
        with pytest.raises(Started):
            start()
        assert write() == 2
        return
    with pytest.raises(TaskError, match=f"until {last_us} us, .*; use {able}"):
        start()
    with pytest.raises(EventFormatError, match=r"\d us"):
        write()


def test_noise_and_bus_reach_the_sensor(eres, sequence, tmp_path):
    """Promise: every option of pixels and bus acts as in the library and is stored in the file, and
    the command reports the events that the bus delayed and dropped."""
    options = {
        "--resolution": 32,
        "--lux": 20.0,
        "--photoreceptor": "one_pole",
        "--threshold-off": 0.25,
        "--latency": 3e-5,
        "--fill-factor": 0.5,
        "--threshold-mismatch": 0.02,
        "--leak": 0.5,
        "--shot-noise": 3.0,
        "--shot-noise-exponent": 0.4,
        "--hot-pixels": 0.01,
        "--hot-pixel-rate": 70.0,
        "--refractory": 2e-4,
        "--bus": 0.05,
        "--fifo": 2,
        "--row-overhead": 1e-6,
        "--seed": 6,
    }
    flags = [word for pair in options.items() for word in pair]
    out = tmp_path / "out.h5"
    code, printed, err = eres(
        "simulate",
        sequence.folder,
        "--out",
        out,
        "--random-start",
        "--cutoff-follows-light",
        *flags,
    )
    assert (code, err) == (0, "")
    white = sequence.white_level
    model = SensorModel(
        width=32,
        height=32,
        dark_level=1e-3 * white,
        cutoff_hz=60.0,
        cutoff_reference=white,
        photoreceptor="one_pole",
        contrast_threshold_off=0.25,
        latency_s=3e-5,
        random_start=True,
        fill_factor=0.5,
        threshold_mismatch=0.02,
        leak_hz=0.5,
        shot_noise_hz=3.0,
        shot_noise_exponent=0.4,
        hot_pixel_fraction=0.01,
        hot_pixel_hz=70.0,
        refractory_s=2e-4,
    )
    fired = simulate(np.stack(list(sequence)), sequence.t_s, model, seed=6)
    bus = Readout(max_rate_hz=5e4, fifo_depth=2, row_overhead_s=1e-6)
    parts = read_out(fired, bus)
    expected = concatenate(list(parts))
    assert_same(load_events(out), expected)
    header = read_header(out)
    assert header.model == model
    assert header.origin["readout_max_rate_hz"] == 5e4
    report = parts.report
    assert 0 < report.dropped < report.fired
    assert f"{report.fired} events fired, {report.dropped} dropped" in printed
    assert f"{report.delayed} delayed, by" in printed


def test_a_cameras_bus_by_name(eres, sequence, tmp_path):
    """Promise: --bus davis346 is 12 Mev/s, for any sensor."""
    out = tmp_path / "out.npz"
    arguments = ["--resolution", 64, "--bus", "davis346"]
    assert eres("simulate", sequence.folder, "--out", out, *arguments)[0] == 0
    assert read_header(out).origin["readout_max_rate_hz"] == 12e6


def test_truth_in_the_same_file(eres, sequence, tmp_path):
    """Promise: --truth adds depth, flow and poses on the events' clock, and changes no event."""
    plain, out = tmp_path / "plain.h5", tmp_path / "out.h5"
    arguments = ["--resolution", 16, "--speed", 2]
    assert eres("simulate", sequence.folder, "--out", plain, *arguments)[0] == 0
    assert eres("simulate", sequence.folder, "--out", out, "--truth", 0.02, *arguments)[0] == 0
    assert_same(load_events(out), load_events(plain))
    truth, times_s = ground_truth(sequence), window_times(sequence, 0.02)
    assert len(times_s) == 4
    with h5py.File(out) as file:
        group = file["truth"]
        np.testing.assert_allclose(group["t_us"][:], times_s / 2 * 1e6, atol=0.5)
        origin = read_header(out).origin
        ends = [origin["window_start_us"], origin["window_end_us"]]
        assert group["t_us"][[0, -1]].tolist() == ends
        np.testing.assert_array_equal(group["T_world_cam"], truth.trajectory.pose(times_s))
        np.testing.assert_array_equal(group["K"], truth.camera(16).K)
        np.testing.assert_array_equal(group["depth"][1], truth.depth(times_s[1], 16))
        flow = truth.flow(times_s[1], times_s[2], 16)
        np.testing.assert_array_equal(group["flow"][1], flow.flow_px)
        np.testing.assert_array_equal(group["flow_valid"][1], flow.valid)
        np.testing.assert_array_equal(group["flow_occluded"][1], flow.occluded)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.h5", "plain.h5"]


def test_a_camera_sees_the_middle_of_the_frames(eres, sequence, tmp_path):
    """Promise: a sensor with a wider aspect ratio than the frames also has square pixels."""
    out, wide = tmp_path / "out.h5", tmp_path / "wide.toml"
    wide.write_text("width = 32\nheight = 18\nthreshold = 0.1")
    arguments = ["--out", out, "--sensor", wide, "--truth", 1]
    assert eres("simulate", sequence.folder, *arguments)[0] == 0
    frames = np.stack([frame[14:50] for frame in sequence])
    events = load_events(out)
    assert events.model.contrast_threshold == 0.1
    assert_same(events, simulate(frames, sequence.t_s, events.model))
    with h5py.File(out) as file:
        depth = file["truth"]["depth"][0]
    whole = ground_truth(sequence).depth(sequence.window_s[0], 64)[14:50]
    of_four = whole.reshape(18, 2, 32, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(depth, of_four, rtol=1e-4)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((50, "--speed", 2), None),  # what clips are rendered for
        (
            (50, "--speed", 4),
            "warm-up is 38.2 ms of the path, expected 76.4 ms, 6 time constants of a 50 Hz",
        ),
        ((10,), "warm-up is 38.2 ms of the path, expected 95.5 ms, 6 time constants of a 10 Hz"),
    ],
)
def test_a_warm_up_that_is_too_short_is_said(eres, sequence, tmp_path, caplog, arguments, said):
    """Promise: a warning comes if events still depend on where the clip starts, and says how long
    the sensor has to see the path."""
    caplog.set_level(logging.WARNING, "tasks")
    asked = ["--resolution", 16, "--cutoff", *arguments]
    assert eres("simulate", sequence.folder, "--out", tmp_path / "a.npz", *asked)[0] == 0
    evaluated = ("evaluate", sequence.folder, "--task", "reconstruction", *asked)
    assert eres(*evaluated)[0] == 0
    assert len(caplog.messages) == (0 if said is None else 2)
    assert all(said in message for message in caplog.messages)


def frames_at(t_s, window_s):
    manifest = SimpleNamespace(max_displacement_px=0.5)
    return SimpleNamespace(t_s=t_s, window_s=window_s, folder="clip", manifest=manifest)


@pytest.mark.parametrize(
    ("start_s", "warns"),
    [(0.25, True), (0.0, False)],  # a clip without a warm-up, and a path from its start
)
def test_a_clip_without_a_warm_up_is_warned_about(caplog, start_s, warns):
    caplog.set_level(logging.WARNING, "tasks")
    t_s = np.array([start_s, start_s + 0.1])
    frames = frames_at(t_s, tuple(t_s.tolist()))
    for cutoff_hz in (50.0, math.inf):  # an ideal pixel's memory, too, starts at the first frame
        caplog.clear()
        warn_of_frames(frames, cutoff_hz, 1.0)
        assert ("is 0 ms of the path, expected 38.2 ms:" in caplog.text) == warns


def test_the_window_before_counts_in_the_warm_up(caplog):
    """Promise: 0.25 s of frames before a window of 0.1 s are 0.15 s before the window before it."""
    caplog.set_level(logging.WARNING, "tasks")
    frames = frames_at(np.array([0.0, 0.35]), (0.25, 0.35))
    warn_of_frames(frames, 5.0, 1.0)
    assert not caplog.messages
    warn_of_frames(frames, 5.0, 1.0, windows_before=1)
    assert "is 150 ms of the path, expected 191 ms, 6 time constants of a 5 Hz" in caplog.text


def test_evaluate_warns_of_the_warm_up_of_both_windows(sequence, caplog):
    """Promise: the events of the window before the scored one are those of dense flow too."""
    for task, said in (("flow", False), ("dense_flow", True)):
        caplog.clear()
        names = [name for name in TASKS[task].methods if name.startswith("initial")]
        with suppress(TaskError):  # the clip may lack the window before
            evaluate_sequence(sequence, task, camera=32, methods=names, cutoff_hz=50.0)
        assert ("is 0 ms of the path" in caplog.text) == said, task


def test_middle():
    """Promise: the largest centered crop of the sensor's aspect ratio, to a whole pixel."""
    assert crop_to_aspect(1280, 1280, 720, 1280) == np.s_[280:1000, 0:1280]
    assert crop_to_aspect(1280, 1280, 260, 346) == np.s_[159:1121, 0:1280]
    assert crop_to_aspect(480, 640, 100, 100) == np.s_[0:480, 80:560]
    assert crop_to_aspect(3, 5, 3, 5) == np.s_[0:3, 0:5]


@pytest.mark.parametrize("name", list(SUFFIXES))
def test_convert_there_and_back(eres, tmp_path, name):
    """Promise: from DSEC to any format and back, events, model and origin are kept."""
    model = SensorModel(width=640, height=480, cutoff_hz=200.0)
    events = random_events(500, model=None if name == "text" else model)
    first, there, back = (tmp_path / f for f in ("a.h5", f"b{SUFFIXES[name]}", "c.h5"))
    write_events(first, events, origin={} if name == "text" else {"seed": 3})
    code, out, _ = eres("convert", first, there, "--format", name)
    assert (code, "500 events" in out) == (0, True)
    assert eres("convert", there, back)[0] == 0
    assert back.read_bytes() == first.read_bytes()


def test_truth_is_kept_from_dsec_to_dsec(eres, with_truth, tmp_path, caplog):
    """Promise: conversion keeps, without change, everything that the output format can store."""
    a, b = Path(shutil.copy(with_truth, tmp_path)), tmp_path / "b.hdf5"
    with h5py.File(a, "r+") as file:
        file["truth"].attrs["made by"] = "hand"
        file["truth"].create_group("more")["empty"] = h5py.Empty("f4")
        # Seven rows of two chunks, the second of them not full.
        more = np.arange(35, dtype=np.int16).reshape(7, 5)
        file["truth/more"].create_dataset("odd", data=more, chunks=(1, 3), fletcher32=True)
    caplog.clear()
    assert eres("convert", a, b)[0] == 0
    assert caplog.messages == []
    assert_same(load_events(a), load_events(b))
    with h5py.File(a) as before, h5py.File(b) as after:
        names = []
        before["truth"].visit(names.append)
        assert len(names) == 10
        assert dict(after["truth"].attrs) == {"made by": "hand"}
        for name in names:
            old, new = before["truth"][name], after["truth"][name]
            if isinstance(old, h5py.Group):
                continue
            assert (new.dtype, new.shape, new.chunks) == (old.dtype, old.shape, old.chunks)
            assert (new.fletcher32, new.shuffle) == (old.fletcher32, old.shuffle)
            if old.shape is not None:
                np.testing.assert_array_equal(new[...], old[...])


def test_damaged_truth_is_not_copied(eres, with_truth, tmp_path):
    """Promise: a wrong checksum is an error that names the file, and no output file appears."""
    a, b = Path(shutil.copy(with_truth, tmp_path)), tmp_path / "b.h5"
    with h5py.File(a) as file:
        chunk = file["truth/depth"].id.get_chunk_info(1)
    data = bytearray(a.read_bytes())
    data[chunk.byte_offset + chunk.size // 2] ^= 1
    a.write_bytes(data)
    code, _, err = eres("convert", a, b)
    assert (code, f"{a}: truth: " in err) == (1, True)
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]


def test_what_a_file_cannot_hold_is_named(eres, tmp_path, caplog):
    """Promise: a warning names all that a conversion leaves out."""
    events = random_events(9, model=SensorModel(width=640, height=480))
    dsec, raw, npz, text = (tmp_path / f"a.{end}" for end in ("h5", "raw", "npz", "txt"))
    write_events(dsec, events, origin={"seed": 3})
    with h5py.File(dsec, "r+") as file:
        file["truth/depth"] = [1.0]
        file["lidar"], file["events/z"] = [1.0], [2.0]
        file.attrs["camera"] = "mine"

    def convert(source, out):
        caplog.clear()
        assert eres("convert", source, out)[0] == 0
        return caplog.messages

    assert "also holds    camera, lidar, truth, events/z" in eres("info", dsec)[1]
    assert convert(dsec, tmp_path / "b.h5") == [
        f"{tmp_path / 'b.h5'}: the format 'DSEC HDF5' cannot store camera, lidar, events/z"
    ]
    assert convert(dsec, npz) == [
        f"{npz}: the format 'numpy arrays' cannot store camera, lidar, truth, events/z"
    ]
    assert convert(npz, raw) == []
    assert convert(raw, text) == [
        f"{text}: the format 'text, t x y p' cannot store sensor model, origin"
    ]
    assert convert(text, tmp_path / "c.raw") == []
    header, words = raw.read_bytes().split(b"% end\n", 1)
    raw.write_bytes(header + b"% serial_number 12\n% end\n" + words)
    assert convert(raw, tmp_path / "d.raw") == [
        f"{tmp_path / 'd.raw'}: the format 'Prophesee EVT3' cannot store serial_number"
    ]
    with np.load(npz) as columns:
        np.savez(tmp_path / "e.npz", **columns, extra=np.zeros(3))
    assert convert(tmp_path / "e.npz", tmp_path / "f.npz") == [
        f"{tmp_path / 'f.npz'}: the format 'numpy arrays' cannot store extra"
    ]


@pytest.mark.parametrize("how", ["itself", "relative", "symlink", "hardlink"])
def test_convert_in_place_is_refused(eres, tmp_path, monkeypatch, how):
    """Promise: a command never overwrites the file that it reads, with --overwrite or without."""
    source = tmp_path / "a.h5"
    write_events(source, random_events(500))
    before = source.read_bytes()
    out = source if how == "itself" else tmp_path / "b.h5"
    if how == "relative":
        monkeypatch.chdir(tmp_path)
        out = "../" + tmp_path.name + "/a.h5"
    elif how == "symlink":
        out.symlink_to(source)
    elif how == "hardlink":
        out.hardlink_to(source)
    for also in ([], ["--overwrite"]):
        code, _, err = eres("convert", source, out, *also)
        assert (code, "would overwrite the input" in err) == (1, True)
    assert source.read_bytes() == before


def test_a_clip_is_not_replaced_by_its_events(eres, sequence, tmp_path):
    clip = tmp_path / "clip"
    shutil.copytree(sequence.folder, clip)
    (manifest,) = clip.glob("*.json")
    before = manifest.read_bytes()
    args = ("--format", "npz", "--overwrite", "--resolution", 32)
    code, _, err = eres("simulate", clip, "--out", manifest, *args)
    assert (code, "would overwrite the input" in err) == (1, True)
    assert manifest.read_bytes() == before


def test_speeds_that_no_time_can_show_are_refused(eres, sequence, tmp_path):
    args = ("--out", tmp_path / "a.h5", "--resolution", 32, "--speed", 1e9)
    code, _, err = eres("simulate", sequence.folder, *args)
    assert (code, "speed: found 1000000000.0, expected above 0 and below 1e+09" in err) == (1, True)


def test_a_file_that_exists_is_refused(eres, sequence, tmp_path):
    """Promise: simulate and convert replace a file only with --overwrite."""
    source, out = tmp_path / "a.npz", tmp_path / "b.h5"
    write_events(source, random_events(500))
    arguments = {
        "simulate": [sequence.folder, "--out", out, "--resolution", 16],
        "convert": [source, out],
    }
    for command, words in arguments.items():
        out.write_bytes(b"precious")
        code, _, err = eres(command, *words)
        assert (code, f"{out}: already exists; add --overwrite" in err) == (1, True)
        assert out.read_bytes() == b"precious"
        assert eres(command, *words, "--overwrite")[0] == 0
        assert len(load_events(out)) > 0


def test_devices_and_pipes_are_never_replaced(eres, tmp_path):
    """Promise: not even with --overwrite; a link is replaced, and its file stays as it is."""
    source, pipe, link = (tmp_path / name for name in ("a.npz", "pipe.h5", "link.h5"))
    write_events(source, random_events(500))
    os.mkfifo(pipe)
    code, _, err = eres("convert", source, pipe, "--overwrite")
    assert (code, f"{pipe}: is a device or a pipe" in err) == (1, True)
    with pytest.raises(FileExistsError, match="is a device or a pipe"):
        write_events(pipe, random_events(500))
    with pytest.raises(RenderError, match="found a device or a pipe"):
        write_bytes(pipe, b"")
    assert pipe.is_fifo()
    (tmp_path / "precious.h5").write_bytes(b"precious")
    link.symlink_to("precious.h5")
    assert eres("convert", source, link, "--overwrite")[0] == 0
    assert (tmp_path / "precious.h5").read_bytes() == b"precious"
    assert len(load_events(link)) == 500


def test_convert_asks_for_a_size(eres, tmp_path):
    """Promise: files without a size need --size WIDTH HEIGHT; the error says so."""
    source, out = tmp_path / "a.txt", tmp_path / "b.npz"
    source.write_text("0.5 3 4 1\n")
    code, _, err = eres("convert", source, out)
    assert (code, "--size WIDTH HEIGHT" in err, out.exists()) == (1, True, False)
    assert eres("convert", source, out, "--size", 346, 260)[0] == 0
    assert_same(load_events(out), make_events([500_000], [3], [4], [1], 346, 260))


def test_convert_shifts_everything_together(eres, with_truth, tmp_path):
    """Promise: --shift-us and --from-start move events, triggers, truth and window alike."""
    a, b, c = with_truth, tmp_path / "b.h5", tmp_path / "c.h5"
    events, first_us = load_events(a), int(load_events(a).t_us[0])
    assert eres("convert", a, b, "--shift-us", 1234567)[0] == 0
    assert eres("convert", b, c, "--from-start")[0] == 0
    for path, shift_us in ((b, 1234567), (c, -first_us)):
        np.testing.assert_array_equal(load_events(path).t_us, events.t_us + shift_us)
        with h5py.File(a) as old, h5py.File(path) as new:
            times = old["truth/t_us"][:] + shift_us
            np.testing.assert_array_equal(new["truth/t_us"], times)
        origin = read_header(path).origin
        assert [origin["window_start_us"], origin["window_end_us"]] == times[[0, -1]].tolist()
    code, _, err = eres("convert", a, tmp_path / "d.h5", "--from-start", "--shift-us", 5)
    assert (code, "--shift-us or --from-start" in err) == (1, True)
    for shift_us in (1 << 62, -(10**30)):
        code, _, err = eres("convert", a, tmp_path / "d.h5", "--shift-us", shift_us)
        assert (code, f"--shift-us: found {shift_us}, expected between" in err) == (1, True)


@pytest.mark.parametrize("start_us", [0, 1_600_000_000_000_000])
def test_a_clock_moves_with_its_events(eres, tmp_path, start_us):
    """Promise: after a shift, t_offset is as far before the events; from the start it is 0."""
    a, b, c = (tmp_path / f"{name}.h5" for name in "abc")
    events = random_events(50, start_us=start_us + 700)
    write_events(a, events, t_offset_us=start_us)
    assert eres("convert", a, b, "--shift-us", 3_000_000)[0] == 0
    assert read_header(b).t_offset_us == (start_us + 3_000_000 if start_us else 0)
    assert eres("convert", a, c, "--from-start")[0] == 0
    assert read_header(c).t_offset_us == load_events(c).t_us[0] == 0


def test_triggers_are_kept_and_shown(eres, tmp_path, caplog):
    """Promise: convert keeps triggers between formats that have them, and names them as lost in
    text; info shows them."""
    raw, dsec, back, text = (tmp_path / name for name in ("a.raw", "a.h5", "b.raw", "a.txt"))
    columns = np.array([1_000_000, 1_500_000, 2_000_000]), np.array([0, 6, 6], np.uint8)
    triggers = Triggers(*columns, np.array([1, -1, 1], np.int8))
    write_events(raw, random_events(2000, mean_us=900), triggers=triggers)
    assert eres("convert", raw, dsec)[0] == eres("convert", dsec, back)[0] == 0
    assert back.read_bytes() == raw.read_bytes()
    said = "1 on channel 0, 1.000000 to 1.000000 s; 2 on channel 6, 1.500000 to 2.000000 s"
    for path in (raw, dsec):
        out = " ".join(eres("info", path)[1].split())
        assert said in out
        assert "also holds" not in out
    assert eres("convert", dsec, tmp_path / "c.npz", "--from-start")[0] == 0
    shifted = triggers.t_us - load_events(raw).t_us[0]
    assert read_triggers(tmp_path / "c.npz").t_us.tolist() == shifted.tolist()
    caplog.clear()
    assert eres("convert", dsec, text)[0] == 0
    assert caplog.messages == [f"{text}: the format 'text, t x y p' cannot store triggers"]


def test_text_of_others_is_converted_with_options(eres, tmp_path):
    """Promise: --size, --time-unit and --sort reach the reader, of convert and of info."""
    source, out = tmp_path / "a.csv", tmp_path / "a.h5"
    source.write_text("9,1,2,1\n5,3,4,-1\n")
    options = ["--size", 8, 9, "--time-unit", "ms", "--sort"]
    code, _, err = eres("convert", source, out, "--size", 8, 9)
    assert (code, "times, 9, 5, are whole" in err) == (1, True)
    assert eres("convert", source, out, *options)[0] == 0
    assert_same(load_events(out), make_events([5000, 9000], [3, 1], [4, 2], [0, 1], 8, 9))
    assert "8x9 px as given, size not stored" in eres("info", source, *options)[1]
    code, _, err = eres("info", source, "--size", 2, 9, *options[3:])
    assert (code, "x is outside the sensor" in err) == (1, True)


OWN = """
import numpy as np
from sensor.formats import FORMATS, Format

def write(path, header, parts):
    return FORMATS["text"].write(path, header, parts)

MINE = Format("mine", "my rows", (), write, FORMATS["text"].read_header, FORMATS["text"].read)

def made():
    return MINE

WRONG = 3
"""


def test_a_format_of_ones_own_by_name(eres, tmp_path, monkeypatch):
    """Promise: --format package.module:Format takes an object or a function, from the folder."""
    (tmp_path / "own_event_format.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*sys.path])
    events = random_events(20)
    write_events("a.h5", events)
    for name in ("MINE", "made"):
        chosen = f"own_event_format:{name}"
        assert eres("convert", "a.h5", "a.rows", "--format", chosen, "--overwrite")[0] == 0
        assert eres("convert", "a.rows", f"{name}.npz", "--input-format", chosen)[0] == 0
        assert_same(load_events(f"{name}.npz"), events)
        assert "my rows" in eres("info", "a.rows", "--format", chosen)[1]
    for name, said in [
        ("own_event_format:WRONG", "TypeError"),
        ("own_event_format:missing", "AttributeError"),
        ("no_such_module:A", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("pathlib:Path", "found PosixPath, expected a sensor.formats.Format"),
    ]:
        code, _, err = eres("info", "a.rows", "--format", name)
        assert (code, f"format '{name}'" in err, said in err) == (1, True, True), err


@pytest.mark.parametrize("name", list(SUFFIXES))
def test_info(eres, tmp_path, name):
    """Promise: info prints format, size, count, time, rate and polarities of any file, and its
    model."""
    t, zeros = [1_000_000, 1_250_000, 1_500_000, 3_000_000], [0, 1, 2, 3]
    model = SensorModel(width=346, height=260, cutoff_hz=50.0)
    events = make_events(t, zeros, zeros, [1, 1, 1, 0], 346, 260, model)
    path = tmp_path / f"a{SUFFIXES[name]}"
    write_events(path, events, format=name, origin={"seed": 9})
    code, out, _ = eres("info", path)
    said = {}
    for line in out.strip().splitlines():
        title, text = line.split(None, 1)
        said.setdefault(title, text)  # the size comes before the "sensor model"
    assert code == 0
    assert said["format"].strip() == FORMATS[name].title
    assert said["sensor"].strip() == "346x260 px"
    assert said["events"].strip() == "4"
    assert said["time"].strip() == "1.000000 to 3.000000 s"
    assert said["rate"].strip() == "2e-06 Mev/s"
    assert said["brighter"].strip() == "75.00 % of the events"
    if name != "text":
        assert '"cutoff_hz": 50.0' in out
        assert said["seed"].strip() == "9"


def test_info_without_size_and_without_events(eres, tmp_path):
    """Promise: info needs no size, and describes an empty file too."""
    (tmp_path / "a.txt").write_text("0.5 3 4 1\n")
    assert "size not stored" in eres("info", tmp_path / "a.txt")[1]
    write_events(tmp_path / "b.npz", make_events([], [], [], []))
    code, out, _ = eres("info", tmp_path / "b.npz")
    assert (code, "640x480 px" in out) == (0, True)


def test_sensors(eres):
    """Promise: `eres sensors` lists every camera with its facts, in 80 columns."""
    code, out, _ = eres("sensors")
    assert code == 0
    listed, _ = out.split("\n\n")
    header, *rows = listed.splitlines()
    assert tuple(row.split()[0] for row in rows) == camera_names()
    assert max(map(len, out.splitlines())) <= 80
    assert header.split()[:2] == ["sensor", "pixels"]
    found = {row.split()[0]: " ".join(row.split()) for row in rows}
    assert found["gen4-cd"] == "gen4-cd 1280x720 4.86 77 % 11 min 0.36-3 lent leak 1066"
    assert found["dvs128"] == "dvs128 128x128 40 9.4 % 17 min 3 leak 1"
    assert found["v2e-noisy"] == "v2e-noisy - - - 22.1/18.1 3 lent leak, shot -"


def test_a_camera_is_shown_with_its_sources(eres):
    """Promise: `eres sensors NAME` says value, unit and source of each field, or its default."""
    code, out, _ = eres("sensors", "dvs128")
    lines = {line.split()[0]: line for line in out.splitlines() if line.split()}
    assert code == 0
    assert lines["cutoff"].split()[:4] == ["cutoff", "3000", "Hz", "published"]
    assert "Lichtsteiner" in lines["cutoff"]
    assert lines["width"].split()[:3] == ["width", "128", "px"]
    assert lines["hot_pixels"].split() == ["hot_pixels", "0", "default"]
    code, _, err = eres("sensors", "dvs129")
    assert (code, "did you mean 'dvs128'" in err) == (1, True)


SIMULATE = ["simulate", "{seq}", "--out", "{tmp}/a.h5", "--resolution", "8"]


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (
            ["simulate", "{seq}", "--out", "{tmp}/a.h5"],
            1,
            "the sensor has no size; give --sensor",
        ),
        ([*SIMULATE, "--sensor", "davis346"], 1, "give --sensor or --resolution, not both"),
        (["simulate", "{seq}", "--out", "{tmp}/a.h5", "--sensor", "davis34"], 1, "'davis346'?"),
        (["simulate", "{seq}", "--out", "{tmp}/a.h5", "--resolution", "65"], 1, "has 65x65"),
        ([*SIMULATE[:3], "{tmp}/a.da", "--resolution", "64"], 1, "'.da'"),
        ([*SIMULATE[:3], "{tmp}/a.dat", "--resolution", "64"], 1, "DAT can only be read"),
        (
            ["simulate", "{seq}", "--out", "{tmp}/no/a.h5", "--resolution", "64"],
            1,
            "no such folder",
        ),
        (["simulate", "{seq}", "--out", "{tmp}", "--resolution", "64"], 1, "extension ''"),
        (["simulate", "{tmp}/none", "--out", "{tmp}/a.h5", "--resolution", "9"], 1, "none"),
        (["simulate", "{seq}", "--resolution", "64"], 2, "--out"),
        (
            ["simulate", "{seq}", "--out", "{tmp}/a.h5", "--resolution", "8", "--speed", "0"],
            1,
            "speed: found 0",
        ),
        ([*SIMULATE, "--cutoff", "9", "--lux", "9"], 1, "give --lux or --cutoff, not both"),
        ([*SIMULATE, "--cutoff-follows-light"], 1, "--cutoff-follows-light: needs a cutoff"),
        ([*SIMULATE, "--lux", "0"], 1, "lux: found 0"),
        ([*SIMULATE, "--leak", "-1"], 1, "leak: found -1"),
        ([*SIMULATE, "--photoreceptor", "three_pole"], 2, ""),
        ([*SIMULATE, "--bus", "davis34"], 1, "did you mean 'davis346'"),
        (
            [*SIMULATE, "--bus", "foo"],
            1,
            "bus: found 'foo'; expected a number of Mev/s, 'unlimited', or one of atis",
        ),
        ([*SIMULATE, "--bus", "atis"], 1, "the bus of 'atis'"),
        ([*SIMULATE, "--bus", "0"], 1, "bus: found 0"),
        ([*SIMULATE, "--truth", "0"], 1, "step_s: found 0"),
        (["simulate", "{seq}", "--out", "{tmp}/a.h5", "--sensor", "dvs128"], 1, "has 128x"),
        (
            ["simulate", "{seq}", "--out", "{tmp}/a.npz", "--resolution", "8", "--truth", "1"],
            1,
            "only DSEC's format (.h5) can store truth",
        ),
        (["convert", "{tmp}/none.h5", "{tmp}/a.raw"], 1, "none.h5: No such file"),
        (["convert", "{tmp}/bad.raw", "{tmp}/a.h5"], 1, "bad.raw: byte 0"),
        (["convert", "{tmp}/bad.raw", "{tmp}/a.h5", "--input-format", "x"], 1, "found 'x'"),
        (["info", "{tmp}/bad.raw"], 1, "bad.raw: byte 0: found no header"),
    ],
)
def test_mistakes_get_one_clear_line(eres, sequence, tmp_path, arguments, code, said):
    """Promise: exit code 1 with one line, 2 for usage; nothing is left behind."""
    (tmp_path / "bad.raw").write_bytes(b"nothing of the kind")
    filled = [a.format(seq=sequence.folder, tmp=tmp_path) for a in arguments]
    got, out, err = eres(*filled)
    assert got == code
    assert said in out + err
    if code == 1:
        assert len(err.strip().splitlines()) == 1, err
        assert [p.name for p in tmp_path.iterdir()] == ["bad.raw"]


def test_a_damaged_frame_leaves_no_file(eres, sequence, tmp_path):
    """Promise: if the light ends half-way, so does the command, and no partial file is left."""
    folder = shutil.copytree(sequence.folder, tmp_path / "sequence")
    frame = sorted((folder / "frames").iterdir())[-1]
    frame.write_bytes(frame.read_bytes()[:100])
    out = tmp_path / "a.raw"
    code, _, err = eres("simulate", folder, "--out", out, "--resolution", 16)
    assert (code, frame.name in err) == (1, True)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["sequence"]
