"""Films of the previews: the events of each sensor over the frames, in a bounded file."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from eres_render.storage.settings_reader import read_typed
from sensor import Events, SensorModel
from tasks.errors import ResultError
from tasks.evaluation.sensor_setting import Setting
from tasks.study.results.asked import CutoffInLux, SensorId, sensor_of
from tasks.study.results.previews import FILM_PICTURES, FILM_S, Preview
from tasks.study.run import highlights
from tasks.study.run.highlights import (
    BRIGHTER,
    DARKER,
    MAX_FILM_BYTES,
    NONE,
    Film,
    central_area,
    film_strip,
    preview_files,
)
from tasks.study.run.jobs import QueuedJob

END_US = 5_000_000


def some_events(width: int, height: int, count: int) -> Events:
    """Events of all pixels, some before and after the film."""
    random = np.random.default_rng(5)
    t_us = np.sort(random.integers(END_US - 60_000, END_US + 5_000, count))
    x, y = random.integers(0, width, count), random.integers(0, height, count)
    p = random.choice([-1, 1], count)
    columns = t_us, x.astype(np.uint16), y.astype(np.uint16), p.astype(np.int8)
    return Events(*columns, width=width, height=height)


@pytest.mark.parametrize(("width", "height"), [(64, 64), (80, 60), (160, 20)])
def test_each_event_is_in_the_picture_of_its_time(width: int, height: int) -> None:
    """A slow reference, event by event; a film of two parts of the events is that of all."""
    events = some_events(width, height, 4000)
    top, left, side = central_area(height, width)
    expected = np.zeros((FILM_PICTURES, side, side), int)
    for t_us, x, y, p in zip(events.t_us, events.x, events.y, events.p, strict=True):
        for picture in range(FILM_PICTURES):
            start_us = END_US - 1e6 * FILM_S * (1 - picture / FILM_PICTURES)
            shown = start_us <= t_us < start_us + 1e6 * FILM_S / FILM_PICTURES
            if shown and top <= y < top + side and left <= x < left + side:
                expected[picture, y - top, x - left] += p
    assert np.abs(expected).sum() > 100
    film = Film(SensorModel(width=width, height=height), 4 * height, 4 * width)
    half = END_US - 30_000
    for part in (events.between(0, half), events.between(half, 2 * END_US)):
        film.add(part, END_US)
    np.testing.assert_array_equal(film.sums, expected)


def test_sensors_of_all_shapes_show_the_same_part_of_the_frame() -> None:
    """A spot at the corner of the frame's center is at the corner of each film: a portrait sensor
    sees the frame's whole height with fewer pixels, a wide one its whole width."""
    frame = np.zeros((64, 64), np.float32)
    frame[24, 24] = 1.0
    job = SimpleNamespace(
        scene=SimpleNamespace(name="hall"),
        simulate=SimpleNamespace(speeds=(1.0,)),
        render=SimpleNamespace(resolution=64),
    )
    films = {}
    for width, height in ((64, 64), (24, 32), (32, 16)):
        films[SensorId(width), 50.0] = film = Film(SensorModel(width=width, height=height), 64, 64)
        assert film.part_px == 16
        assert film.sums.shape[1] == (16 if width == 64 else 8)
    files = preview_files(job, [frame] * FILM_PICTURES, films)
    for ((width, _), _), film in films.items():
        strip = np.asarray(Image.open(io.BytesIO(files[f"hall_events_{width}_50.webp"])))
        first = strip[:, : film.sums.shape[1], 0]
        assert np.unravel_index(first.argmax(), first.shape) == (0, 0)
        assert (first > first[-1, -1]).sum() == 1


def test_films_are_over_whole_frames(monkeypatch) -> None:
    """Promise: a first sensor that sees a strip leaves the background of the other films as it is;
    scaling is measured on what it sees."""
    whole, strip = (
        SimpleNamespace(
            t_s=np.linspace(0.0, 1.0, 50),
            window_s=(0.0, 1.0),
            frame=lambda i, shape=shape: np.ones(shape, np.float32),
        )
        for shape in ((64, 64), (8, 64))
    )
    shapes, measured = [], []

    @dataclass
    class Measured:
        job: str = ""

    def measure(sequence, *_):
        measured.append(sequence)
        return Measured(), None

    def preview(job, frames, films):
        shapes.extend(frame.shape for frame in frames)
        return {}

    monkeypatch.setattr(highlights, "preview_files", preview)
    monkeypatch.setattr(highlights, "measure_scaling", measure)
    monkeypatch.setattr(highlights, "scaling_files", lambda *_: {})
    job = SimpleNamespace(
        simulate=SimpleNamespace(speeds=(1.0,)),
        render=SimpleNamespace(resolution=64, height_at=lambda width: 64),
    )
    reference = SimpleNamespace(sequence=strip, log_white=lambda model: 0.0)
    first = Setting(SensorModel(width=64, height=8, dark_level=1e-3), 1.0, 0, 9)
    highlights.Highlights(QueuedJob(job, "k", True), [first]).result(reference, whole)
    assert set(shapes) == {(64, 64)}
    assert measured == [strip]


def test_a_narrow_sensor_shows_what_it_sees() -> None:
    """A sensor that sees less than the center of a frame shows all its columns there."""
    film = Film(SensorModel(width=8, height=64), 64, 64)
    assert (film.sums.shape[1], film.part_px) == (8, 8)


def test_events_are_drawn_over_the_frame() -> None:
    """Pictures side by side in their order: blue where brighter, red where darker, else the frame,
    whose white is the light gray of no events and whose black is 0.4 of it."""
    lights = np.zeros((2, 4, 4), np.float32)
    lights[1] = 1.0
    sums = np.zeros((2, 4, 4), np.int16)
    sums[0, 0, 1], sums[1, 3, 2] = 3, -1
    strip = np.asarray(Image.open(io.BytesIO(film_strip(lights, sums))))
    assert strip.shape == (4, 8, 3)
    for row in range(4):
        for column in range(8):
            frame = [round(0.4 * c) for c in NONE] if column < 4 else list(NONE)
            expected = {(0, 1): BRIGHTER, (3, 6): DARKER}.get((row, column), frame)
            assert strip[row, column].tolist() == list(expected)


def test_a_film_is_bounded_and_keeps_every_event() -> None:
    """Promise: the film of the finest sensor, of noise over noise, has at most `MAX_FILM_BYTES`;
    it loses gray levels for that, and no event."""
    random = np.random.default_rng(1)
    lights = random.random((FILM_PICTURES, 320, 320), np.float32)
    sums = random.choice(np.array([-1, 0, 1], np.int16), lights.shape)
    data = film_strip(lights, sums)
    assert 100_000 < len(data) <= MAX_FILM_BYTES
    strip = np.asarray(Image.open(io.BytesIO(data)))
    pictures = strip.reshape(320, FILM_PICTURES, 320, 3).swapaxes(0, 1)
    assert (pictures[sums == 1] == BRIGHTER).all()
    assert (pictures[sums == -1] == DARKER).all()
    assert (pictures[sums == 0] == NONE).all()


def test_the_files_of_a_scene_are_listed() -> None:
    """A frame and a film for each sensor, two of one width and one light included, with entries
    that the report reads; the frame is the last one, tone-mapped with a gamma of 2.2."""
    job = SimpleNamespace(
        scene=SimpleNamespace(name="hall"),
        simulate=SimpleNamespace(speeds=(1.5,)),
        render=SimpleNamespace(resolution=64),
    )
    frames = [np.full((64, 64), i / 10, np.float32) for i in range(FILM_PICTURES)]
    sensors = SensorId(16), SensorId(64, "a/b"), SensorId(64, "b"), SensorId(64)
    films = {
        (one, cutoff_hz): Film(SensorModel(width=one.width, height=one.width), 64, 64)
        for one in sensors
        for cutoff_hz in (np.inf, 50.0)
    }
    files = preview_files(job, frames, films)
    entries = read_typed(tuple[Preview, ...], json.loads(files["hall.json"]), Path(), ResultError)
    assert [one.file for one in entries] + ["hall.json"] == list(files)
    assert [one.shows_film for one in entries] == [False, *[True] * 8]
    assert [sensor_of(one) for one in entries[1::2]] == [*sensors]
    assert [one.caption for one in entries[1::2]] == ["16 px", "a/b", "b", "64 px"]
    assert {(one.scene, one.speed) for one in entries} == {("hall", 1.5)}
    frame = np.asarray(Image.open(io.BytesIO(files["hall_frame_64_inf.png"])))
    assert (frame == int(255 * 0.7 ** (1 / 2.2))).all()


def test_entries_say_the_light_to_the_last_digit() -> None:
    """Promise: a light in lux is listed with its illuminance, and no cutoff is rounded."""
    job = SimpleNamespace(
        scene=SimpleNamespace(name="hall"),
        simulate=SimpleNamespace(speeds=(1.0,)),
        render=SimpleNamespace(resolution=64),
    )
    lights = [np.inf, CutoffInLux(1234.567), 123.45678]
    film = Film(SensorModel(width=16, height=16), 64, 64)
    frames = [np.ones((64, 64), np.float32)] * FILM_PICTURES
    files = preview_files(job, frames, {(SensorId(16), light): film for light in lights})
    entries = read_typed(tuple[Preview, ...], json.loads(files["hall.json"]), Path(), ResultError)
    shown = [(one.cutoff_hz, one.illuminance_lux) for one in entries if one.shows_film]
    assert shown == [(np.inf, 0.0), (float(lights[1]), 1234.567), (123.45678, 0.0)]
