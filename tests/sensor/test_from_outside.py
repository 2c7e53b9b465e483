"""Sensors and event formats from outside need only public names and fewer than 20 lines each."""

import inspect

import numpy as np
import pytest

from sensor import EventCamera, Events, find_camera, simulate, write_camera
from sensor.formats import FORMATS, Format, Header, load_events, read_header, write_events

T_S = np.arange(30) * 1e-3
FRAMES = 1.1 + np.sin(np.arange(40) + 90 * T_S[:, None, None]) * np.ones((30, 30, 40))


def own_sensor():
    return EventCamera(name="event1", width=40, height=30, cutoff_hz=120.0, bus_hz=20e6)


def own_format():
    def write(path, header, parts):
        rows = [np.stack(part.columns, axis=1) for part in parts]
        np.savetxt(path, np.vstack([(header.width, header.height, 0, 0), *rows]), "%d")
        return sum(map(len, rows))

    def read_header(path):
        width, height, *_ = np.loadtxt(path, int, max_rows=1)
        return Header(int(width), int(height))

    def read(path, header):
        t_us, x, y, p = np.loadtxt(path, int, skiprows=1, ndmin=2).T
        columns = t_us, x.astype(np.uint16), y.astype(np.uint16), p.astype(np.int8)
        yield Events(*columns, header.width, header.height)

    return Format("rows", "a row for each event", (".rows",), write, read_header, read, False)


@pytest.mark.parametrize("written", [own_sensor, own_format])
def test_it_takes_less_than_20_lines(written):
    """Promise: a sensor or an event format from outside needs fewer than 20 lines of Python."""
    assert len(inspect.getsource(written).splitlines()) < 20


def test_a_sensor_from_outside_is_one_like_any_other(tmp_path):
    """Promise: a file gives it a name; it fires events, and files of events store it."""
    write_camera(tmp_path / "event1.toml", own_sensor())
    events = find_camera(tmp_path / "event1.toml").simulate(FRAMES, T_S, white=1.0)
    assert len(events) > 1000
    write_events(tmp_path / "events.h5", events)
    assert load_events(tmp_path / "events.h5").model == own_sensor().model()


def test_a_format_from_outside_is_one_like_any_other(monkeypatch, tmp_path, caplog):
    """Promise: an entry in FORMATS adds its extension, and a warning names lost data."""
    monkeypatch.setitem(FORMATS, "rows", own_format())
    events = simulate(FRAMES, T_S, own_sensor().model())
    file = tmp_path / "events.rows"
    assert write_events(file, events) == len(events) > 1000
    assert "a row for each event' cannot store sensor model" in caplog.text
    assert (read_header(file).width, read_header(file).height) == (40, 30)
    for column, written in zip(load_events(file).columns, events.columns, strict=True):
        np.testing.assert_array_equal(column, written)
