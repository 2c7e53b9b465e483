"""Paths on the clock of the day: their start is stored exactly, everywhere."""

import json
from decimal import Decimal

import h5py
import numpy as np
import pytest

from eres_render import load_scene, open_sequence, render_scene
from eres_render.trajectory.spline import path_through
from eres_render.trajectory.tum import read_tum, read_tum_from_start, tum_text
from event_streams import SUFFIXES, assert_same, random_events
from light_scenes import small_carpet_folder
from sensor.formats import load_events, read_header, write_events

START = Decimal("1600000000.123457")  # seconds since 1970; float64 has steps of 0.24 us there
OFFSET_US = 1_600_000_000_123_457
T_S = [Decimal(text) for text in ("0", "0.1000001", "0.23", "0.3333333333333333", "0.4")]


def write_path(file, start):
    """Return the first 0.4 s of the carpet's path as poses that start at a time."""
    poses = load_scene("carpet").trajectory().pose([float(t) for t in T_S])
    lines = tum_text(np.arange(len(T_S)), poses).splitlines()[1:]
    rest = (line.split(" ", 1)[1] for line in lines)
    file.write_text("".join(f"{start + t} {r}\n" for t, r in zip(T_S, rest, strict=True)))
    return file


@pytest.fixture(scope="module")
def sequences(tmp_path_factory):
    """Render the same clip on the clock of the day and from 0."""
    folder = tmp_path_factory.mktemp("clock")
    carpet = small_carpet_folder(folder / "carpet")
    found = []
    for name, start in (("day", START), ("zero", Decimal(0))):
        scene = load_scene(carpet, write_path(folder / f"{name}.txt", start))
        options = {"resolution": 32, "spp": 1, "max_displacement_px": 1.0, "continuous": True}
        found += render_scene(scene, folder / name, **options)
    return found


@pytest.mark.parametrize("offset_us", [0, OFFSET_US, -3, 10**18])
def test_times_and_offset_make_the_round_trip(tmp_path, offset_us):
    """Promise: a time of 17 digits with an offset is read back to the last bit."""
    t_s = np.array([0.0, 1e-9, 0.1, 1 / 3, np.nextafter(0.5, 1), 1234.567890123456])
    (tmp_path / "a.txt").write_text(tum_text(t_s, np.tile(np.eye(4), (6, 1, 1)), offset_us))
    np.testing.assert_array_equal(read_tum(tmp_path / "a.txt", offset_us)[0], t_s)
    first = Decimal((tmp_path / "a.txt").read_text().splitlines()[1].split()[0])
    assert first == Decimal(offset_us) / 10**6
    assert read_tum_from_start(tmp_path / "a.txt")[0] == offset_us


def test_a_path_is_the_same_at_any_time_of_day(tmp_path):
    """Promise: float64 would round poses since 1970 by 0.2 us; the reader does not."""
    day = read_tum_from_start(write_path(tmp_path / "day.txt", START))
    zero = read_tum_from_start(write_path(tmp_path / "zero.txt", Decimal(0)))
    assert (day[0], zero[0]) == (OFFSET_US, 0)
    np.testing.assert_array_equal(day[1], zero[1])
    np.testing.assert_array_equal(zero[1], [float(t) for t in T_S])
    path = path_through(*day[1:], OFFSET_US)
    assert path.t_offset_us == OFFSET_US
    np.testing.assert_array_equal(path.knots_s, path_through(*zero[1:]).knots_s)


def test_a_sequence_keeps_when_it_started(eres, sequences, tmp_path):
    """Promise: manifest, poses.txt, `eres info` and `eres truth` have it; frames do not change.

    A sequence from 0 does not change either.
    """
    day, zero = sequences
    assert (day.t_offset_us, zero.t_offset_us) == (OFFSET_US, 0)
    assert json.loads((day.folder / "manifest.json").read_text())["t_offset_us"] == OFFSET_US
    assert "t_offset_us" not in json.loads((zero.folder / "manifest.json").read_text())
    np.testing.assert_array_equal(day.t_s, zero.t_s)
    np.testing.assert_array_equal(np.stack(list(day)), np.stack(list(zero)))
    for name in ("poses.txt", "path.txt"):
        lines = [(s.folder / name).read_text().splitlines()[1:] for s in sequences]
        for on_day, from_zero in zip(*lines, strict=True):
            (t, *pose), (t_zero, *pose_zero) = on_day.split(), from_zero.split()
            assert Decimal(t) - Decimal(t_zero) == START
            assert pose == pose_zero
    assert open_sequence(day.folder).trajectory.t_offset_us == OFFSET_US

    assert "time 0 is 1600000000.123457 s" in eres("info", day.folder)[1]
    assert "time 0 is" not in eres("info", zero.folder)[1]
    assert eres("truth", day.folder, "--out", tmp_path / "t", "--width", 8, "--step", 0.2)[0] == 0
    lines = (tmp_path / "t" / "poses.txt").read_text().splitlines()[1:]
    found = [Decimal(line.split()[0]) - START for line in lines]
    assert found == [Decimal("0.0"), Decimal("0.2"), Decimal("0.4")]


@pytest.mark.parametrize("name", list(SUFFIXES))
def test_events_keep_when_they_happened(eres, sequences, tmp_path, name):
    """Promise: to the microsecond, in any format and its conversions, together with their truth."""
    day, zero = (tmp_path / f"{which}{SUFFIXES[name]}" for which in ("day", "zero"))
    options = ["--format", name, "--resolution", 16, "--speed", 2, "--threshold", 0.1]
    options += ["--truth", 0.1] if name == "dsec" else []
    for sequence, out in zip(sequences, (day, zero), strict=True):
        assert eres("simulate", sequence.folder, "--out", out, *options)[0] == 0
    events = load_events(zero)
    assert len(events) > 100
    moved = load_events(day)
    np.testing.assert_array_equal(moved.t_us - OFFSET_US, events.t_us)
    np.testing.assert_array_equal(moved.x, events.x)
    said = eres("info", day)[1]
    assert f"1600000000.{123457 + events.t_us[0]:06} to" in said
    if name != "text":
        ends = [read_header(out).origin["window_end_us"] for out in (day, zero)]
        assert ends == [OFFSET_US + 200_000, 200_000]
    if name in ("dsec", "evt2", "evt3"):
        assert read_header(day).t_offset_us == OFFSET_US
        assert "clock starts at 1600000000.123457 s" in " ".join(said.split())
    if name == "dsec":
        with h5py.File(day) as file, h5py.File(zero) as from_zero:
            assert (file["t_offset"][()], from_zero["t_offset"][()]) == (OFFSET_US, 0)
            np.testing.assert_array_equal(file["events/t"], from_zero["events/t"])
            np.testing.assert_array_equal(file["ms_to_idx"], from_zero["ms_to_idx"])
            t_us = file["truth/t_us"][:] - OFFSET_US
            np.testing.assert_array_equal(t_us, from_zero["truth/t_us"])
        assert eres("convert", day, tmp_path / "a.raw")[0] == 0
        assert eres("convert", tmp_path / "a.raw", tmp_path / "b.h5")[0] == 0
        assert_same(load_events(tmp_path / "b.h5"), moved)
        assert read_header(tmp_path / "b.h5").t_offset_us == OFFSET_US


def test_an_offset_that_does_not_suit_the_events_is_not_taken(tmp_path):
    """Promise: t_offset is at most 2^31 us before the first event, and never after it."""
    for start_us in (OFFSET_US - 100, OFFSET_US + (1 << 31)):
        events = random_events(50, start_us=start_us)
        write_events(tmp_path / "a.h5", events, t_offset_us=OFFSET_US)
        assert_same(load_events(tmp_path / "a.h5"), events)
        offset_us = read_header(tmp_path / "a.h5").t_offset_us
        assert offset_us != OFFSET_US
        assert 0 <= events.t_us[0] - offset_us < 1000
