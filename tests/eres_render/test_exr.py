"""OpenEXR files of other programs become luminance on their display window."""

import numpy as np
import OpenEXR
import pytest

from eres_render import RenderError
from eres_render.storage.exr import find_layer, read_luminance

REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
XYZ = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)
ACES_AP0 = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
# ITU-R BT.709 and SMPTE ST 2065-1 name these rows of Y.
ROWS = {REC709: (0.2126, 0.7152, 0.0722), ACES_AP0: (0.3439664498, 0.7281660966, -0.0721325464)}
# From linear Rec. 709 to XYZ (IEC 61966-2-1, four digits more).
TO_XYZ = np.array(
    [
        [0.41239080, 0.35758434, 0.18048079],
        [0.21263901, 0.71516868, 0.07219232],
        [0.01933082, 0.11919478, 0.95053215],
    ]
)


def colors(seed=0, shape=(6, 8)):
    return np.random.default_rng(seed).random((*shape, 3)).astype(np.float32)


def channels_of(image, layer=""):
    return {layer + name: np.ascontiguousarray(image[..., k]) for k, name in enumerate("RGB")}


def write(path, *parts):
    """Write parts, each a header and channels."""
    made = [OpenEXR.Part({"type": OpenEXR.scanlineimage, **header}, dict(c)) for header, c in parts]
    OpenEXR.File(made).write(str(path))
    return path


def corners(left, top, right, bottom):
    return np.array([left, top], np.int32), np.array([right, bottom], np.int32)


@pytest.mark.parametrize(
    "display", [(0, 0, 7, 5), (-3, 2, 9, 9), (2, 1, 5, 3), (100, 100, 103, 101)]
)
@pytest.mark.parametrize("data", [(0, 0, 7, 5), (1, -2, 8, 3)])
def test_the_picture_is_the_display_window(tmp_path, display, data):
    """Physics: a pixel's place counts from the display window, and what has no data is black."""
    light = np.random.default_rng(1).random((6, 8)).astype(np.float32)
    windows = {"dataWindow": corners(*data), "displayWindow": corners(*display)}
    file = write(tmp_path / "a.exr", (windows, {"Y": light}))
    left, top, right, bottom = display
    expected = np.zeros((bottom - top + 1, right - left + 1))
    for (row, column), value in np.ndenumerate(light):
        y, x = row + data[1] - top, column + data[0] - left
        if 0 <= y < expected.shape[0] and 0 <= x < expected.shape[1]:
            expected[y, x] = value
    np.testing.assert_array_equal(read_luminance(file), expected)
    assert find_layer(file).corner == display[:2]


def test_a_small_file_does_not_become_a_large_picture(tmp_path):
    """Promise: a display window may be larger than the data, but not without bound."""
    light = {"Y": np.ones((4, 4), np.float32)}
    large, endless = (
        write(
            tmp_path / f"{side}.exr", ({"displayWindow": corners(0, 0, side - 1, side - 1)}, light)
        )
        for side in (4096, 100_000)
    )
    assert read_luminance(large).sum() == 16
    with pytest.raises(RenderError, match=r"100000\.exr: found \d+ bytes"):
        read_luminance(endless)


@pytest.mark.parametrize("primaries", ROWS)
def test_luminance_has_the_weights_of_the_primaries(tmp_path, primaries):
    """Physics: weights follow from the primaries and white; a negative one is no error."""
    image = colors()
    file = write(tmp_path / "a.exr", ({"chromaticities": primaries}, channels_of(image)))
    np.testing.assert_allclose(read_luminance(file), image @ np.array(ROWS[primaries]), atol=5e-5)


def test_one_picture_has_one_luminance_in_any_primaries(tmp_path):
    """Physics: Rec. 709, named or not, and XYZ describe the same light."""
    image = colors()
    plain = write(tmp_path / "plain.exr", ({}, channels_of(image)))
    named = write(tmp_path / "named.exr", ({"chromaticities": REC709}, channels_of(image)))
    in_xyz = (image @ TO_XYZ.T).astype(np.float32)
    xyz = write(tmp_path / "xyz.exr", ({"chromaticities": XYZ}, channels_of(in_xyz)))
    light = read_luminance(plain)
    np.testing.assert_allclose(read_luminance(named), light, rtol=1e-6)
    np.testing.assert_allclose(read_luminance(xyz), light, rtol=1e-6)


def test_luminance_and_chroma_are_read_as_luminance(tmp_path):
    """Promise: Y is the light, and half-size RY and BY beside it are left out."""
    light = np.ascontiguousarray(colors()[..., 0])
    zero = np.zeros_like(light)  # of which the library writes every second row and column
    chroma = {name: OpenEXR.Channel(name, zero, 2, 2) for name in ("RY", "BY")}
    file = write(tmp_path / "a.exr", ({}, {"Y": OpenEXR.Channel("Y", light), **chroma}))
    np.testing.assert_array_equal(read_luminance(file), light)


LAYERS = ["", "diffuse.", "ViewLayer.Combined.", "ViewLayer.DiffDir."]


@pytest.mark.parametrize(
    ("layers", "read"),
    [
        (LAYERS, 0),  # channels without a layer
        (LAYERS[1:2], 1),  # the only one
        (LAYERS[1:], 2),  # Blender's
    ],
)
def test_the_layer_with_the_picture_is_read(tmp_path, layers, read):
    """Promise: the picture is found among layers of color, and alpha is that of its layer."""
    channels = {"ViewLayer.Depth.Z": np.ones((6, 8), np.float32)}
    for layer in layers:
        channels |= channels_of(colors(LAYERS.index(layer)), layer)
    file = write(tmp_path / "a.exr", ({}, channels))
    expected = write(tmp_path / "b.exr", ({}, channels_of(colors(read))))
    np.testing.assert_array_equal(read_luminance(file), read_luminance(expected))
    assert not find_layer(file).has_alpha
    channels[LAYERS[read] + "A"] = np.ones((6, 8), np.float32)
    assert find_layer(write(file, ({}, channels))).has_alpha
    if "diffuse." in layers:
        one = write(tmp_path / "b.exr", ({}, channels_of(colors(1))))
        np.testing.assert_array_equal(read_luminance(file, layer="diffuse"), read_luminance(one))


def test_the_part_with_the_picture_is_read(tmp_path):
    """Promise: parts are chosen like layers, never just the first; Blender repeats their names."""
    depth = {"name": "depth"}, {"Z": np.ones((6, 8), np.float32)}
    beauty = {"name": "beauty"}, channels_of(colors(1))
    glow = {"name": "glow"}, channels_of(colors(2))
    expected = read_luminance(write(tmp_path / "b.exr", ({}, beauty[1])))
    np.testing.assert_array_equal(
        read_luminance(write(tmp_path / "a.exr", depth, beauty)), expected
    )
    both = write(tmp_path / "c.exr", depth, glow, beauty)
    with pytest.raises(RenderError, match=r"c\.exr: found layers glow, beauty; .*--layer"):
        read_luminance(both)
    np.testing.assert_array_equal(read_luminance(both, layer="beauty"), expected)
    with pytest.raises(RenderError, match="found layers glow, beauty; none is 'haze'"):
        read_luminance(both, layer="haze")
    combined = {**beauty[0], "name": "Scene.Combined"}, channels_of(colors(1), "Scene.Combined.")
    other = {"name": "Scene.Emit"}, channels_of(colors(2), "Scene.Emit.")
    blender = write(tmp_path / "d.exr", other, combined)
    np.testing.assert_array_equal(read_luminance(blender), expected)


def test_files_without_light_are_named(tmp_path):
    """Promise: depth alone and deep pixels are an error that lists the channels."""
    file = write(tmp_path / "z.exr", ({}, {"Z": np.ones((2, 2), np.float32)}))
    with pytest.raises(RenderError, match=r"z\.exr: found channels Z, expected Y, or R, G and B"):
        read_luminance(file)
    deep = np.empty((2, 2), object)
    deep.fill(np.ones(2, np.float32))
    header = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    file = write(tmp_path / "deep.exr", (header, {"Y": deep}))
    with pytest.raises(RenderError, match=r"deep\.exr: found channels Y, expected .* one value"):
        read_luminance(file)


def test_a_damaged_part_is_not_replaced_by_another(tmp_path):
    """Promise: the library leaves out parts that it cannot read, and what is left is not taken for
    the picture."""
    parts = [({"name": name}, channels_of(colors(), f"{name}.")) for name in ("Emit", "Combined")]
    file = write(tmp_path / "a.exr", *parts)
    file.write_bytes(file.read_bytes()[:-5])
    with pytest.raises(RenderError, match="bytes that OpenEXR cannot read, expected a whole image"):
        read_luminance(file)
