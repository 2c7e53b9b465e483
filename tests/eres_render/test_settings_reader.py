"""TOML and JSON into dataclasses: old names of fields, numbers that may be inf, refused files."""

import json
import math
from dataclasses import dataclass, field

import pytest

from eres_render.errors import RenderError
from eres_render.storage.settings_reader import FloatOrInf, formerly, read_json, read_toml


@dataclass(frozen=True)
class Lamp:
    color: str = field(metadata=formerly("colour", "tint"))
    power_w: FloatOrInf = 1.0


@dataclass(frozen=True)
class Room:
    lamps: tuple[Lamp, ...]


def read(tmp_path, text):
    file = tmp_path / "room.toml"
    file.write_text(text)
    return read_toml(Room, file, ValueError)


@pytest.mark.parametrize("word", ["color", "colour", "tint"])
def test_a_field_is_read_under_its_old_names(tmp_path, word):
    assert read(tmp_path, f'lamps = [{{{word} = "red"}}]') == Room((Lamp("red"),))


@pytest.mark.parametrize("words", [("color", "colour"), ("tint", "color"), ("colour", "tint")])
def test_a_field_is_given_once(tmp_path, words):
    text = ", ".join(f'{word} = "red"' for word in words)
    with pytest.raises(ValueError, match=r"room\.toml: lamps\[0\]\.color: found twice, once under"):
        read(tmp_path, f"lamps = [{{{text}}}]")


def test_errors_name_the_word_in_the_file(tmp_path):
    with pytest.raises(ValueError, match=r"lamps\[0\]\.colour: found 3, expected a string"):
        read(tmp_path, "lamps = [{colour = 3}]")
    with pytest.raises(ValueError, match=r"lamps\[0\]\.hue: unknown; choose from: color"):
        read(tmp_path, "lamps = [{hue = 3}]")
    with pytest.raises(ValueError, match=r"lamps\[0\]\.powr_w: unknown; did you mean 'power_w'"):
        read(tmp_path, "lamps = [{powr_w = 3}]")


@pytest.mark.parametrize(("said", "power_w"), [("inf", math.inf), ("20", 20.0), (3, 3.0)])
def test_json_says_inf_as_a_text(tmp_path, said, power_w):
    file = tmp_path / "lamp.json"
    file.write_text(json.dumps({"color": "red", "power_w": said}))
    assert read_json(Lamp, file, ValueError) == Lamp("red", power_w)


@pytest.mark.parametrize("said", ["bright", "nan", True, None, [1.0], 10**400])
def test_a_number_or_inf_is_nothing_else(tmp_path, said):
    file = tmp_path / "lamp.json"
    file.write_text(json.dumps({"color": "red", "power_w": said}))
    with pytest.raises(ValueError, match=r"power_w: found .*, expected a number or inf"):
        read_json(Lamp, file, ValueError)


def test_files_that_cannot_be_read_are_named(tmp_path):
    file = tmp_path / "lamp.json"
    with pytest.raises(RenderError, match=r"lamp\.json: no such file"):
        read_json(Lamp, file, RenderError)
    with pytest.raises(RenderError, match=r": cannot be read: Is a directory"):
        read_json(Lamp, tmp_path, RenderError)
    file.write_bytes(b"\xff")
    with pytest.raises(RenderError, match=r"lamp\.json: could not be read as JSON: 'utf-8' codec"):
        read_json(Lamp, file, RenderError)
    file.write_text("[]")
    with pytest.raises(RenderError, match=r"lamp\.json: found \[\], expected a table"):
        read_json(Lamp, file, RenderError)
