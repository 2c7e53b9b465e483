"""Textures: reproducible, physical, and with detail at every scale."""

from itertools import pairwise

import numpy as np
import pytest

from eres_render import SceneError
from eres_render.interior.pieces import PIECES
from eres_render.scene.texture_recipes import TEXTURES, TextureRecipe
from eres_render.storage.exr import read_luminance
from eres_render.textures.carpet import bokhara
from eres_render.textures.forest import forest
from eres_render.textures.nature import garden_view
from eres_render.textures.pebble_print import pebble_print
from eres_render.textures.relief import lit
from eres_render.textures.split_rocks import split_rocks
from eres_render.textures.stones import SUN, pebble_bed, unlit_bed

PLANES = {
    "carpet": bokhara,
    "stone_bed": pebble_bed,
    "stones": pebble_print,
    "forest": forest,
    "split_rocks": split_rocks,
}


@pytest.fixture(scope="module", params=PLANES)
def reflectance(request):
    return PLANES[request.param](512, 512, 0.0012, 5)


def test_reflectance_is_physical(reflectance):
    assert reflectance.shape == (512, 512)
    assert reflectance.dtype == np.float32
    assert reflectance.min() >= 0.02
    assert reflectance.max() <= 0.85
    assert 0.15 < reflectance.mean() < 0.35


@pytest.mark.parametrize("make", PLANES.values())
def test_one_seed_one_texture(make):
    first, again, other = (make(192, 192, 0.0012, seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(again, first)
    assert not np.array_equal(other, first)


def test_every_octave_of_scale_has_contrast_down_to_the_texel(reflectance):
    """Amplitude times frequency, flat for a 1/f spectrum, stays within a factor of eight.

    It rises toward the texel: the shadows between tufts and the grains of sand are strong by
    design.
    """
    log_r = np.log(reflectance) - np.log(reflectance).mean()
    window = np.hanning(len(log_r))
    power = abs(np.fft.fft2(log_r * np.outer(window, window))) ** 2
    f = np.fft.fftfreq(len(log_r))
    radius = np.hypot(f[:, None], f)
    edges = 2.0 ** np.arange(-8, 0)
    scaled = [
        np.sqrt(power[(radius >= low) & (radius < high)].mean()) * low
        for low, high in pairwise(edges)
    ]
    assert max(scaled) / min(scaled) < 8


def test_neighboring_texels_differ_strongly(reflectance):
    """Grain: a step to the next texel usually causes an event (threshold 0.2)."""
    assert np.diff(np.log(reflectance)).std() > 0.2


def correlation(image, texels, axis):
    """Return the correlation of an image with itself, moved along an axis."""
    image = image - image.mean()
    first = np.take(image, np.arange(image.shape[axis] - texels), axis)
    second = np.take(image, np.arange(texels, image.shape[axis]), axis)
    return np.mean(first * second) / image.var()


def test_the_carpet_is_of_yarn():
    """Promise: tufts hold together over some texels, more along the pile than across it, and the
    yarn keeps its shade along a row; the spectrum falls as that of things, not of noise."""
    log_r = np.log(bokhara(1024, 1024, 0.0012, 5))
    for texels, least in ((1, 0.6), (4, 0.3)):
        along, across = (correlation(log_r, texels, axis) for axis in (1, 0))
        assert across > least, texels
        assert along > across + 0.03, texels
    coarse = log_r.reshape(512, 2, 512, 2).mean(axis=(1, 3))  # about a 1280-px view's pixels
    power = abs(np.fft.rfft2((coarse - coarse.mean()) * np.outer(*2 * [np.hanning(512)]))) ** 2
    frequency = np.hypot(np.fft.fftfreq(512)[:, None], np.fft.rfftfreq(512))
    edges = np.geomspace(1 / 128, 1 / 4, 12)
    rings = [(frequency >= a) & (frequency < b) for a, b in pairwise(edges)]
    amplitude = [0.5 * np.log(power[ring].mean()) for ring in rings]
    slope = np.polyfit(0.5 * np.log(edges[1:] * edges[:-1]), amplitude, 1)[0]
    assert -1.1 < slope < -0.7


def test_shadows_of_stones_darken_what_they_fall_on():
    """Promise: where the relief hides the sun, the bed is darker than its rock alone says, and
    shadows fall away from the sun."""
    arguments = (512, 512, 0.001, 3)
    rock, relief = unlit_bed(*arguments)
    shade = np.log(pebble_bed(*arguments)) - rock
    seen = lit(relief, *SUN)
    assert 0.05 < np.mean(seen == 0) < 0.6
    assert shade[seen == 1].mean() > shade[seen == 0].mean() + 0.2
    # On the side of a shadow that is nearer to the sun the ground is higher: what casts it.
    down, right = (int(np.sign(-part)) * 6 for part in (SUN[1], SUN[0]))
    before = np.roll(relief, (down, right), axis=(0, 1)) - relief
    assert np.median(before[seen == 0]) > 3


def test_planes_need_not_be_square():
    for make in PLANES.values():
        assert make(192, 64, 0.002, 1).shape == (64, 192)


@pytest.mark.parametrize("texel_m", [0.05, 0.5])
@pytest.mark.parametrize("make", [*PLANES.values(), garden_view])
def test_texels_may_be_coarser_than_what_they_show(make, texel_m):
    """Promise: a small study's texture is coarse, never NaN and never a traceback."""
    reflectance = make(4, 4, texel_m, 1)
    assert np.all((reflectance > 0) & (reflectance < 1))


@pytest.mark.parametrize("side", [1, 2, 3, 5])
@pytest.mark.parametrize("make", [*PLANES.values(), garden_view])
def test_textures_may_have_a_few_texels(make, side):
    assert make(side, side, 0.01, 1).shape == (side, side)


def test_a_recipe_makes_its_file_once(tmp_path, monkeypatch):
    monkeypatch.setenv("ERES_CACHE", str(tmp_path))
    recipe = TextureRecipe("carpet", 128, 0.01, 2, height_px=64)
    file = recipe.file()
    assert tmp_path in file.parents
    made = file.stat().st_ino
    assert recipe.file() == file
    assert file.stat().st_ino == made
    assert recipe.make().shape == (64, 128)
    np.testing.assert_array_equal(read_luminance(file), recipe.make().astype(np.float16))
    assert TextureRecipe("carpet", 128, 0.01, 3, height_px=64).file() != file
    assert TextureRecipe("carpet", 128, 0.01, 2).file() != file


@pytest.mark.parametrize("kept", [0, 100])
def test_a_damaged_file_in_the_cache_is_made_again(tmp_path, monkeypatch, kept):
    monkeypatch.setenv("ERES_CACHE", str(tmp_path))
    recipe = TextureRecipe("carpet", 64, 0.01, 2)
    whole = recipe.file().read_bytes()
    recipe.file().write_bytes(whole[:kept])
    assert recipe.file().read_bytes() == whole


def test_unknown_texture_is_named():
    with pytest.raises(SceneError, match=r"found 'marble', expected one of .*'carpet'"):
        TextureRecipe("marble", 128, 0.01, 2)


def test_a_piece_of_the_room_has_the_size_of_its_atlas():
    with pytest.raises(SceneError, match=r"stool: found size_px 99 .*expected 1024 and 944"):
        TextureRecipe("stool", 99, 0.00125, 0).make()
    with pytest.raises(SceneError, match=r"stool: found texel_m 0\.1, expected 0\.00125"):
        TextureRecipe("stool", 1024, 0.1, 0, height_px=944).make()


GOLDEN = {
    "carpet": (4, 0.2636, -0.0244, -0.0101),
    "stone_bed": (1, 0.2546, 0.0035, -0.0033),
    "stones": (3, 0.2469, 0.0027, -0.0035),
    "garden_view": (2, 0.3214, 0.0069, -0.0838),
    "forest": (1, 0.1926, -0.0073, -0.0039),
    "split_rocks": (1, 0.1135, -0.0044, 0.0073),
    "floor": (1, 0.2913, -0.0009, 0.0000),
    "ceiling": (1, 0.7780, 0.0012, -0.0017),
    "beams": (1, 0.3841, 0.0309, -0.0530),
    "walls": (1, 0.4777, 0.0028, -0.0180),
    "joinery": (1, 0.5503, -0.0146, 0.0167),
    "table": (1, 0.3312, 0.0045, -0.0090),
    "coffee_table": (1, 0.2462, 0.0229, 0.0179),
    "chairs": (1, 0.2811, 0.0168, 0.0091),
    "sofa": (1, 0.2775, 0.0356, 0.0034),
    "rug": (1, 0.1656, 0.0051, 0.0047),
    "bookcase": (1, 0.3580, 0.0319, 0.0157),
    "books": (1, 0.3428, 0.0078, 0.0490),
    "sideboard": (1, 0.3084, 0.0238, 0.0182),
    "stool": (1, 0.3218, 0.0192, 0.0066),
    "pictures": (1, 0.3161, 0.0220, 0.0052),
    "curtains": (1, 0.4815, 0.0096, -0.0028),
    "floor_lamp": (1, 0.3485, 0.0547, 0.0791),
    "plant": (1, 0.2678, 0.0256, -0.0184),
    "lamps": (1, 0.5072, 0.0292, 0.0552),
    "things": (1, 0.4462, 0.0029, 0.0302),
}


@pytest.mark.parametrize("kind", TEXTURES)
def test_changing_a_texel_must_change_the_version(kind):
    """The cache has textures by recipe and version: if this fails, raise the version in TEXTURES.

    Expected: the mean, and its gradients along u and along v.
    """
    version, *golden = GOLDEN[kind]
    assert TEXTURES[kind].version == version
    np.testing.assert_allclose(_moments(kind), golden, atol=2e-3)


def _moments(kind):
    flat = PLANES | {"garden_view": garden_view}
    texels = flat[kind](96, 64, 0.02, 0) if kind in flat else PIECES[kind].atlas().paint(4, 0)
    v, u = (np.linspace(-1, 1, n) for n in texels.shape)
    return texels.mean(), (texels * u).mean(), (texels * v[:, None]).mean()


def test_every_texture_is_in_the_golden_list():
    assert set(GOLDEN) == set(TEXTURES)
