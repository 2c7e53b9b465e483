"""The room with varnish: the room itself but for six materials, whose highlights move."""

import math
import xml.etree.ElementTree as ElementTree

import pytest

from eres_render import Renderer, list_scenes, load_scene
from eres_render.trajectory.generators import look_at

WOOD = {"floor", "table", "coffee_table", "chairs", "sideboard", "stool"}

FLOOR = """<scene version="3.0.0">
  <sensor type="perspective"><float name="fov" value="4"/></sensor>
  <shape type="rectangle" id="floor">
    <transform name="to_world"><scale value="3"/></transform>{material}
  </shape>
  <shape type="rectangle" id="lamp">
    <transform name="to_world">
      <scale x="0.6" y="0.25"/><rotate x="1" angle="180"/><translate z="2.645"/>
    </transform>
    <emitter type="area"><rgb name="radiance" value="28"/></emitter>
  </shape>
</scene>"""


def shapes(name):
    root = ElementTree.parse(load_scene(name).xml_file).getroot()
    return {shape.get("id"): shape for shape in root.iter("shape")}


def text(element):
    whole = ElementTree.canonicalize(ElementTree.tostring(element), strip_text=True)
    return whole.replace("../../room/", "")


def test_it_is_the_room_but_for_the_wood():
    """Promise: meshes, textures, lamps and path are the room's; only `load_scene` finds it."""
    matte, varnished = shapes("room"), shapes("varnished_room")
    assert list(matte) == list(varnished)
    different = {name for name in matte if text(matte[name]) != text(varnished[name])}
    assert different == WOOD
    for name in WOOD:
        (coat,) = varnished[name].iter("bsdf")
        assert coat.get("type") == "roughplastic"
        coat.set("type", "diffuse")
        for one in coat.findall("float"):
            coat.remove(one)
        coat.find("texture").set("name", "reflectance")
        assert text(varnished[name]) == text(matte[name])
    room, variant = load_scene("room").settings, load_scene("varnished_room").settings
    assert (variant.path, variant.textures) == (room.path, room.textures)
    assert "varnished_room" not in list_scenes()


@pytest.mark.parametrize("varnish", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_highlight_moves_with_the_camera(tmp_path, varnish):
    """Promise: varnish shows the lamp in the mirror direction; matte wood looks the same from all
    sides."""
    (coat,) = shapes("varnished_room" if varnish else "room")["floor"].iter("bsdf")
    texture = coat.find("texture")
    coat.append(coat.makeelement("rgb", {"name": texture.get("name"), "value": "0.3"}))
    coat.remove(texture)
    file = tmp_path / "floor.xml"
    file.write_text(FLOOR.format(material=ElementTree.tostring(coat, "unicode")))
    renderer = Renderer(load_scene(file), 4, 256, integrator="path")
    point, up = (0.8, 0.0, 0.0), (0.0, 1.0, 0.0)
    # As far on the other side of the point's normal as the lamp; and a quarter turn from there.
    eyes = ((1.6, 0.0, 2.645), (0.8, 0.8, 2.645))
    mirrored, aside = (renderer.frame(look_at(eye, point, up)).mean() for eye in eyes)
    # A point under a small lamp: radiance times area times both cosines, over distance squared.
    squared_m = 0.8**2 + 2.645**2
    matte = 0.3 / math.pi * 28 * (1.2 * 0.5) * 2.645**2 / squared_m**2
    if varnish:
        assert mirrored > 2 * aside
        assert aside < 1.1 * matte  # what the coat mirrors does not reach the wood
    else:
        assert mirrored == pytest.approx(aside, rel=0.02)
        assert aside == pytest.approx(matte, rel=0.05)
