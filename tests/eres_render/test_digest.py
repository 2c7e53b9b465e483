"""Digests depend on values only, not on names of classes, order, comments and spelling."""

import dataclasses
import enum
import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eres_render import load_scene
from eres_render.scene.settings import ObjectSettings
from eres_render.scene.texture_recipes import TEXTURES
from eres_render.storage.checksums import sha256
from eres_render.storage.digest import digest
from light_scenes import edit_scene
from sensor import EventCamera, find_camera, write_camera
from tasks.study.config import Simulate, Study, preset
from tasks.study.run.jobs import jobs_of


class Shade(enum.Enum):
    DARK = "dark"


@dataclasses.dataclass(frozen=True)
class Lamp:
    power_w: float
    shades: tuple[str, ...] = ()
    label: str | None = None


def changes(value):
    """Yield the value with each of its leaves changed, one at a time, and the leaf's place."""
    if dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            found, name, kind = getattr(value, field.name), field.name, str(field.type)
            inner = changes(found)
            if "EventCamera" in kind:
                inner = [((find_camera("davis346"),), "")]
            elif found is None and "tuple" in kind:
                inner = [((1.0,), "")]
            for changed, place in inner:
                yield dataclasses.replace(value, **{name: changed}), f".{name}{place}"
    elif isinstance(value, dict):
        for name in value:
            for changed, place in changes(value[name]):
                yield {**value, name: changed}, f"[{name}]{place}"
    elif isinstance(value, tuple) and value:
        yield value[1:], " shortened"
        for i in range(len(value)):
            for changed, place in changes(value[i]):
                yield (*value[:i], changed, *value[i + 1 :]), f"[{i}]{place}"
    else:
        yield changed_leaf(value), ""


def changed_leaf(value: Any) -> Any:
    if isinstance(value, bool):
        return not value
    if isinstance(value, float):
        return 1.0 if math.isinf(value) else math.nextafter(value, math.inf)
    if isinstance(value, int):
        return value + 1
    if value in ((), None):
        return ("x",) if value == () else 1
    if value in TEXTURES:  # the kind must be known
        return "stones" if value != "stones" else "carpet"
    if value == "scene.xml":  # a file that is there
        return "scene.toml"
    return f"{value}x"


def test_names_of_classes_and_order_are_free():
    """Promise: renamed classes and mappings keep their digest, and so do new fields that are
    None."""
    renamed = dataclasses.make_dataclass("Light", [("shades", tuple), ("power_w", float)])
    expected = digest(Lamp(2.0, ("a",)))
    assert digest(renamed(("a",), 2.0)) == expected
    assert digest({"shades": ["a"], "power_w": 2}) == expected
    assert digest({"power_w": np.float64(2), "shades": ("a",), "label": None}) == expected
    assert digest(Shade.DARK) == digest("dark")


def test_values_that_look_alike_differ():
    values = [0, 1, True, False, None, "", "1", "True", (), ("",), ("", ""), ("ab",), ("a", "b")]
    values += [{}, {"a": 1}, {"a": "1"}, [["a", 1]], ((),), 0.1, "0.1", math.inf, "inf", -1]
    values += [np.zeros(2), np.zeros((2, 1)), np.zeros(2, np.float32), np.zeros(2, ">f8"), (0.0, 0)]
    found = [digest(value) for value in values]
    assert len(set(found)) == len(values)
    assert digest(2**60) != digest(2**60 + 1)  # also where float64 is too coarse


@pytest.mark.parametrize(
    "value", [len, object(), {1, 2}, Path("x"), b"x", Lamp, {1: 2}, np.array([None]), [1j]]
)
def test_anything_else_is_refused(value):
    """Promise: a digest never uses a value's repr."""
    with pytest.raises(TypeError, match="expected settings or data"):
        digest({"a": (value,)})


def test_every_value_of_a_part_is_in_its_key():
    """Promise: each field of light, sensors and tasks changes it, except the number of samples,
    and what the clip and the cameras hold: the least warm-up and the exponents of the area."""
    for job in (jobs_of(preset("paper"), load_scene("carpet"))[k] for k in (0, 20, 40)):
        anchor_s = 0.5 * (job.clip.t_start_s + job.clip.t_window_start_s)
        keys = {job.key}
        job = dataclasses.replace(job, clip=dataclasses.replace(job.clip, t_anchor_s=anchor_s))
        assert job.key not in keys
        keys.add(job.key)
        for section in ("clip", "render", "simulate"):
            for changed, place in changes(getattr(job, section)):
                found = dataclasses.replace(job, **{section: changed}).key
                elsewhere = place in (".samples", ".warm_up_s", ".area_exponents")
                assert (found in keys) == elsewhere, f"{section}{place}"
                keys.add(found)
        for task, settings in job.evaluate.items():
            for changed, place in changes(settings):
                if "methods" in place or place == ".weights":
                    continue  # what does not exist has no content to be hashed
                evaluate = job.evaluate | {task: changed}
                found = dataclasses.replace(job, evaluate=evaluate).key
                assert found not in keys, f"{task}{place}"
                keys.add(found)


MINE = EventCamera(
    name="mine",
    width=64,
    height=64,
    pitch_um=18.5,
    fill_factor=0.22,
    contrast_threshold_off=0.3,
    photoreceptor="one_pole",
    area_exponent=0.5,
    shot_noise_hz=1.0,
    hot_pixel_fraction=0.1,
    bus_hz=1e6,
)
MEASURED = dataclasses.replace(MINE, cutoff_hz=300.0, illuminance_lux=100.0)
WORDS = ("title", "supplier", "year", "interface", "sources")


def test_every_value_of_a_camera_is_in_the_key_of_its_jobs(tmp_path):
    """Promise: each value that decides events changes it, whether the camera's cutoff is lent or
    its own, and a queue of its own before the bus of the study too; words about it do not."""
    lender = dataclasses.replace(MEASURED, name="lender")
    write_camera(tmp_path / "lender.toml", lender)
    others = {"photoreceptor": "v2e", "like": str(tmp_path / "lender.toml"), "sources": {}}
    simulate = Simulate(widths=(), sensors=(MINE,), illuminance_lux=(67.0,), bus_mev_s=2.0)
    study = Study(name="mine", scenes=("carpet",), simulate=simulate)
    job = jobs_of(study, load_scene("carpet"))[0]

    def key(camera, **changed):
        asked = dataclasses.replace(simulate, sensors=(camera,), **changed)
        return dataclasses.replace(job, simulate=asked).key

    for field in dataclasses.fields(EventCamera):
        found = set()
        for camera in (MINE, MEASURED):
            value = getattr(camera, field.name)
            if field.name in others:
                value = others[field.name]
            elif isinstance(value, float):
                value = 1.25 * value if 0 < value < math.inf else 0.125
            else:
                value = 2017 if field.name == "year" else changed_leaf(value)
            changed = dataclasses.replace(camera, **{field.name: value})
            found.add(key(camera) == key(changed))
        assert (False in found) == (field.name not in WORDS), field.name
    late = [
        dataclasses.replace(MINE, bus_hz=math.inf, **own)
        for own in ({}, {"fifo": 9}, {"row_overhead_s": 1e-6})
    ]
    assert len({key(one) for one in late}) == 3
    assert key(MINE, area_exponents=(0.0,)) != key(MINE, area_exponents=(1.0,))
    assert key(MEASURED, area_exponents=(0.0,)) == key(MEASURED)


@pytest.mark.parametrize("name", ["carpet", "room"])
def test_every_value_of_a_scene_is_in_its_digest(name, monkeypatch):
    """Promise: each field of scene.toml except title and license changes it; the digest of the
    light has only the fields that the light depends on."""
    monkeypatch.setattr("eres_render.scene.scene.sha256", functools.cache(sha256))
    scene = load_scene(name)
    still = scene.digest, scene.light_digest
    moving = {"ball": ObjectSettings(shapes=("a", "b"), trajectory="scene.xml")}
    settings = dataclasses.replace(scene.settings, objects=moving)
    scene = dataclasses.replace(scene, settings=settings)
    assert still[0] != scene.digest
    assert still[1] != scene.light_digest
    found, light = {scene.digest}, {scene.light_digest}
    for settings, place in changes(scene.settings):
        changed = dataclasses.replace(scene, settings=settings)
        assert (changed.digest in found) == (place in (".title", ".license")), place
        of_light = place.startswith((".textures", ".bake", ".objects"))
        assert (changed.light_digest in light) != of_light, place
        found.add(changed.digest)
        light.add(changed.light_digest)


def test_comments_order_and_old_words_of_a_scene_are_free(tmp_path):
    scene = load_scene(edit_scene(tmp_path / "plain"))
    other = edit_scene(tmp_path / "other", ("license =", "licence ="))
    toml, xml = (other / "scene.toml").read_text(), (other / "scene.xml").read_text()
    head, *tables = toml.split("\n[")
    (other / "scene.toml").write_text("\n[".join([f"# mine\n{head}", *reversed(tables)]))
    spaced = xml.replace("\n", "\n\n  ").replace("</scene", "<!-- mine --></scene")
    (other / "scene.xml").write_text(spaced)
    assert load_scene(other).light_digest == scene.light_digest
    assert load_scene(other).digest == scene.digest


def test_the_poses_of_a_path_count_not_their_file(tmp_path):
    poses = "0 0 0 2 1 0 0 0\n1 0.5 0 2 1 0 0 0\n2 1 0 2 1 0 0 0\n"
    digests = []
    for name, text in (("a", poses), ("b", poses), ("c", poses.replace("0.5", "0.6"))):
        file = tmp_path / name
        file.write_text(text)
        digests.append(load_scene("carpet", file).digest)
    assert digests[0] == digests[1] != digests[2]
