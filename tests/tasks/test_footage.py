"""Videos and folders of images become light, and events."""

import io
import logging
import re
import struct
import tracemalloc
from dataclasses import replace
from fractions import Fraction

import av
import cv2
import numpy as np
import OpenEXR
import pytest
from PIL import Image, TiffImagePlugin
from scipy.ndimage import gaussian_filter

from eres_render.storage.exr import write_luminance
from sensor import SensorModel, simulate, to_linear
from sensor.events import concatenate
from sensor.formats import load_events, read_events
from tasks.errors import TaskError
from tasks.events.footage_simulation import simulate_footage
from tasks.events.simulation import SimulationOptions
from tasks.footage import open_footage, video
from tasks.footage.images import list_images, read_images
from tasks.footage.interpolation import displacements_px, interpolated, optical_flow, steps_for

BT709 = np.array([0.2126, 0.7152, 0.0722])


def pictures(count=4, height=20, width=26, dtype=np.uint8, seed=0):
    """Return (count, height, width, 3) random colors."""
    rng = np.random.default_rng(seed)
    return rng.integers(0, np.iinfo(dtype).max, (count, height, width, 3), dtype, endpoint=True)


def write_folder(folder, images, suffix):
    """Write images in red, green, blue, numbered from 8: 8, 9, 10, ..."""
    folder.mkdir()
    for k, image in enumerate(images, start=8):
        assert cv2.imwrite(str(folder / f"frame{k}{suffix}"), image[..., ::-1])
    return folder


def write_video(
    path,
    planes,
    *,
    times=None,
    tick_s=Fraction(1, 1000),
    rate=1000,
    codec="ffv1",
    pixels="yuv444p",
    matrix=1,
    wide=1,
    **more,
):
    """Write (T, 3, H, W) planes as a lossless video with the given tags; times in ticks, or those
    of the rate."""
    tick_s = tick_s if times else 1 / Fraction(rate)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate, options=more)
        size = (planes.shape[1] * 2 // 3, planes.shape[2]) if pixels == "yuv420p" else None
        stream.height, stream.width = size or planes.shape[-2:]
        stream.pix_fmt = pixels
        stream.codec_context.time_base = tick_s
        stream.codec_context.colorspace = matrix
        stream.codec_context.color_range = wide
        for t, plane in zip(times or range(len(planes)), planes, strict=True):
            frame = av.VideoFrame.from_ndarray(plane, format=pixels)
            frame.colorspace, frame.color_range = matrix, wide
            frame.pts, frame.time_base = t, tick_s
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def test_images_are_in_the_order_of_their_numbers(tmp_path):
    """Promise: 10 follows 9, and names of one number have an order too, on any machine."""
    for name in ("a10", "a9", "a09", "b1", "a1"):
        (tmp_path / f"{name}.png").touch()
    found = [file.stem for file in list_images(tmp_path)]
    assert found == ["a1", "a09", "a9", "a10", "b1"]
    (tmp_path / "._a2.png").touch()  # as other systems leave them
    assert len(list_images(tmp_path)) == 5
    (tmp_path / "0.1.png").touch()
    (tmp_path / "0.05.png").touch()
    with pytest.raises(TaskError, match=r"0\.1\.png and 0\.05\.png have no clear order"):
        list_images(tmp_path)


def test_a_part_keeps_the_clock(tmp_path, eres):
    """Promise: --start and --end cut frames, and events keep the times of the whole."""
    folder = write_folder(tmp_path / "in", pictures(10), ".png")
    whole = open_footage(folder, fps=100)
    part = whole.between(0.02, 0.06)
    np.testing.assert_array_equal(list(part), list(whole)[2:6])
    np.testing.assert_allclose(1e-6 * part.t_offset_us + part.t_s, whole.t_s[2:6], atol=1e-9)
    assert len(whole.between(0.02, None)) == 8
    out = tmp_path / "events.h5"
    simulated = ("simulate", folder, "--fps", 100, "--out", out, "--start")
    assert eres(*simulated, 0.02, "--end", 0.06)[0] == 0
    t_us = load_events(out).t_us
    assert 20_000 < t_us[0] < t_us[-1] <= 50_000
    for start in (0.09, 0.5):
        code, _, err = eres(*simulated, start, "--overwrite")
        assert (code, f"--start {start:g}" in err) == (1, True)


def test_superscripts_in_names_are_no_numbers(tmp_path):
    """Promise: Python calls a superscript two a digit, but cannot convert it."""
    (tmp_path / "in").mkdir()
    for k in range(2):
        Image.new("L", (8, 8), 99).save(tmp_path / "in" / f"4m x 3\N{SUPERSCRIPT TWO}{k}.png")
    assert len(open_footage(tmp_path / "in", fps=10)) == 2


def test_transparency_is_said(tmp_path, caplog):
    """Promise: no silent events of pixels that nobody sees."""
    for k in range(2):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.zeros((4, 4, 4), np.uint8))
    open_footage(tmp_path, fps=10)
    assert "transparency is ignored" in caplog.text


def write_with_alpha(file):
    channels = {name: np.ones((4, 4), np.float32) for name in "RGBA"}
    with OpenEXR.File({"compression": OpenEXR.NO_COMPRESSION}, channels) as opened:
        opened.write(str(file))


@pytest.mark.parametrize("mode", ["P", "L", "RGB", "EXR"])
def test_one_transparent_color_is_transparency(tmp_path, caplog, mode):
    """Promise: PNG files without an alpha channel, and OpenEXR files with one, are named too."""
    for k in range(2):
        if mode == "EXR":
            write_with_alpha(tmp_path / f"{k}.exr")
        else:
            color = (0, 0, 0) if mode == "RGB" else 0
            Image.new(mode, (4, 4)).save(tmp_path / f"{k}.png", transparency=color)
    open_footage(tmp_path, fps=10)
    assert "transparency is ignored" in caplog.text


def test_a_sensor_finer_than_footage_is_refused_at_once(tmp_path):
    """Promise: the frames are not measured before."""
    folder = write_folder(tmp_path / "small", pictures(2, 8, 12), ".png")
    with pytest.raises(TaskError, match="24x16 px, but sees 12x8 px"):
        simulate_footage(
            open_footage(folder, fps=10),
            SensorModel(width=24, height=16),
            tmp_path / "never.h5",
            on_progress=lambda *_: pytest.fail("it was measured"),
        )


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(("suffix", "encoding"), [(".png", "srgb"), (".tif", "gamma:2.2")])
def test_colors_become_luminance_after_they_are_linear(tmp_path, suffix, encoding, dtype):
    """Physics: light adds up, encoded numbers do not; 8 and 16 bits."""
    images = pictures(dtype=dtype)
    folder = write_folder(tmp_path / "in", images, suffix)
    footage = open_footage(folder, fps=240, encoding=None if encoding == "srgb" else encoding)
    assert (footage.encoding, footage.white_level) == (encoding, 1.0)
    assert (footage.width, footage.height, len(footage)) == (26, 20, 4)
    np.testing.assert_allclose(footage.t_s, np.arange(4) / 240, atol=1e-9)
    np.testing.assert_allclose(list(footage), to_linear(images, encoding) @ BT709, rtol=1e-5)


def test_gray_and_transparent_images_have_the_same_light(tmp_path):
    """Promise: R = G = B is gray; alpha does not count."""
    gray = pictures()[..., 0]
    for name, image in (("gray", gray), ("alpha", np.stack([gray, gray, gray, gray // 2], 3))):
        folder = tmp_path / name
        folder.mkdir()
        for k, one in enumerate(image):
            cv2.imwrite(str(folder / f"{k}.png"), one)
        np.testing.assert_allclose(
            list(open_footage(folder, fps=1)), to_linear(gray, "srgb"), rtol=1e-6
        )


@pytest.mark.parametrize("mode", ["RGBA", "LA"])
def test_colors_of_a_tiff_are_those_beside_its_alpha(tmp_path, caplog, mode):
    """Promise: as in PNG, hidden pixels count as they are stored, and that is said; a file that
    ends early is refused by name."""
    gray = pictures(2)[..., 0]
    for k, one in enumerate(gray):
        alpha = np.where(np.arange(one.shape[1]) % 2, 128, 0) * np.ones_like(one)
        bands = [one] * (len(mode) - 1) + [alpha.astype(np.uint8)]
        Image.merge(mode, [Image.fromarray(band) for band in bands]).save(tmp_path / f"{k}.tif")
    footage = open_footage(tmp_path, fps=1)
    np.testing.assert_allclose(list(footage), to_linear(gray, "srgb"), rtol=1e-6)
    assert "transparency is ignored" in caplog.text
    file = tmp_path / "1.tif"
    file.write_bytes(file.read_bytes()[:600])
    with pytest.raises(TaskError, match=r"1.tif: could not be read as an image: .* truncated"):
        list(footage)


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_tiffs_with_alpha_are_turned_like_those_without(tmp_path, orientation):
    """Promise: by the EXIF orientation, compressed or not."""
    image = pictures(1)[0]
    rgba = np.dstack([image, np.full_like(image[..., :1], 255)])
    exif = Image.Exif()
    exif[0x0112] = orientation
    found = []
    for name, pixels, compression in (
        ("plain", image, None),
        ("alpha", rgba, None),
        ("packed", rgba, "tiff_lzw"),
    ):
        file = tmp_path / f"{name}.tif"
        Image.fromarray(pixels).save(file, exif=exif, compression=compression)
        found.append(next(read_images([file])))
    for other in found[1:]:
        np.testing.assert_array_equal(other, found[0])


def test_stacks_of_images_in_one_file_are_refused(tmp_path):
    """Promise: no frame is left out without a word; previews beside an image are."""
    image, preview = np.full((16, 24), 99, np.uint8), np.full((4, 6), 9, np.uint8)
    for k in range(2):
        first = Image.fromarray(image)
        first.save(tmp_path / f"{k}.tif", save_all=True, append_images=[Image.fromarray(preview)])
    with pytest.raises(TaskError, match=r"0\.tif: contains several images"):
        list(read_images(list_images(tmp_path)))
    reduced = TiffImagePlugin.ImageFileDirectory_v2()
    reduced[254] = 1
    for file in list_images(tmp_path):
        with TiffImagePlugin.AppendingTiffWriter(file, new=True) as pages:
            first.save(pages, "TIFF")
            pages.newFrame()
            Image.fromarray(preview).save(pages, "TIFF", tiffinfo=reduced)
    assert all(np.array_equal(each, image) for each in read_images(list_images(tmp_path)))


def test_damaged_tiffs_are_named(tmp_path):
    """Promise: sides that no image has are an error in one line, too."""
    rgba = np.full((8, 8, 4), 9, np.uint8)
    Image.fromarray(rgba).save(tmp_path / "0.tif")
    data = bytearray((tmp_path / "0.tif").read_bytes())
    sides = struct.pack("<HHII", 256, 4, 1, 8), struct.pack("<HHII", 257, 4, 1, 8)
    short = struct.pack("<HHIHH", 256, 3, 1, 8, 0), struct.pack("<HHIHH", 257, 3, 1, 8, 0)
    for tag, (long, small) in enumerate(zip(sides, short, strict=True), start=256):
        at = max(data.find(long), data.find(small))
        assert at > 0
        data[at : at + 12] = struct.pack("<HHII", tag, 4, 1, 200_000)
    (tmp_path / "0.tif").write_bytes(data)
    with pytest.raises(TaskError, match=r"0.tif: could not be read .*40000000000 pixels"):
        next(read_images([tmp_path / "0.tif"]))


@pytest.mark.parametrize(("first", "found"), [("u", "floats"), ("f", "integers")])
def test_floats_among_integers_are_refused(first, found, tmp_path):
    """Promise: frames of which some are linear and others encoded give an error, not events."""
    image = np.full((8, 10), 0.5, np.float32)
    one, other = (image, (255 * image).astype(np.uint8))[:: 1 if first == "f" else -1]
    for k, frame in enumerate((one, other)):
        cv2.imwrite(str(tmp_path / f"{k}.tif"), frame)
    with pytest.raises(TaskError, match=rf"1\.tif: found {found}, expected .* as in 0\.tif"):
        list(open_footage(tmp_path, fps=1))


def test_floats_are_linear(tmp_path):
    """Promise: EXR, as luminance or colors, and float TIFF hold light; white is its 99.9th
    percentile. BT.709 rounds its weights to 4 digits, and OpenEXR's come from the primaries."""
    light = np.random.default_rng(0).random((3, 20, 26, 3)).astype(np.float32) * 7
    for name in ("y", "rgb", "tiff"):
        (tmp_path / name).mkdir()
    for k, image in enumerate(light):
        write_luminance(tmp_path / "y" / f"{k}.exr", image @ BT709)
        channels = {one: np.ascontiguousarray(image[..., i]) for i, one in enumerate("RGB")}
        OpenEXR.File({}, channels).write(str(tmp_path / "rgb" / f"{k}.exr"))
        cv2.imwrite(str(tmp_path / "tiff" / f"{k}.tif"), image[..., ::-1])
    for name, tolerance in (("y", 1e-3), ("rgb", 2.5e-4), ("tiff", 1e-6)):
        footage = open_footage(tmp_path / name, fps=1)
        assert footage.encoding == "linear"
        np.testing.assert_allclose(list(footage), light @ BT709, rtol=tolerance)
        assert footage.white_level == pytest.approx(np.percentile(light[0] @ BT709, 99.9), 1e-3)
        with pytest.raises(TaskError, match="floats are linear; leave out --encoding srgb"):
            open_footage(tmp_path / name, fps=1, encoding="srgb")


def write_exr(file, image, **header):
    """Write gray as R, G and B."""
    header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    gray = np.asarray(image, np.float32)
    OpenEXR.File(header, dict.fromkeys("RGB", gray)).write(str(file))


def bad_frames(folder, *values, suffix=".exr"):
    """Write three frames of light from 1 to 2; the second has these values in its row 3."""
    light = 1 + np.random.default_rng(0).random((3, 6, 8)).astype(np.float32)
    bad = light.copy()
    bad[1, 3, 2 : 2 + len(values)] = values
    for k, image in enumerate(bad):
        if suffix == ".exr":
            write_exr(folder / f"{k}.exr", image)
        else:
            cv2.imwrite(str(folder / f"{k}.tif"), image)
    return light


@pytest.mark.parametrize("suffix", [".exr", ".tif"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -0.5])
def test_a_pixel_without_light_is_named_or_repaired(tmp_path, caplog, value, suffix):
    """Promise: it has the median of its neighbors, is counted once however often the frames are
    read, and nothing else changes."""
    light = bad_frames(tmp_path, value, suffix=suffix)
    with pytest.raises(TaskError, match=r"1\.\w+: .* at pixel x=2 y=3 .* 1 of 48 .*--repair"):
        list(open_footage(tmp_path, fps=10))
    footage = open_footage(tmp_path, fps=10, repair=True)
    around = light[1, 2:5, 1:4]
    light[1, 3, 2] = np.median(np.delete(around.ravel(), 4))
    np.testing.assert_allclose(list(footage), light, rtol=1e-6)
    simulate_footage(footage, SensorModel(width=8, height=6), tmp_path / "events.h5")
    assert "1 pixels in 1 frames were not finite or below 0, and get the median" in caplog.text


def test_pixels_without_light_are_filled_from_the_rim(tmp_path):
    """Promise: a group of them, in the first frame too, has values between those around it; frames
    without a valid pixel are refused."""
    bad_frames(tmp_path, *[np.nan] * 6)
    (tmp_path / "0.exr").unlink()
    block = np.ones((6, 8), np.float32)
    block[:4, :5] = np.nan
    write_exr(tmp_path / "0.exr", block)
    first, second, _ = open_footage(tmp_path, fps=10, repair=True)
    np.testing.assert_array_equal(first, 1)
    assert second.min() >= 1
    assert second.max() <= 2
    write_exr(tmp_path / "2.exr", np.full((6, 8), np.nan))
    with pytest.raises(TaskError, match=r"2\.exr: nan at pixel x=0 y=0 .* 48 of 48"):
        list(open_footage(tmp_path, fps=10, repair=True))
    write_exr(tmp_path / "0.exr", np.full((6, 8), np.nan))
    with pytest.raises(TaskError, match="first frame defines white, but is black or not finite"):
        open_footage(tmp_path, fps=10, repair=True)


def test_light_a_little_below_zero_is_black(tmp_path, caplog):
    """Promise: down to the dark level, a thousandth of white; it is counted."""
    light = bad_frames(tmp_path, -1.5e-3, -1e-6)
    light[1, 3, 2:4] = 0
    footage = open_footage(tmp_path, fps=10)
    assert 1.9e-3 < 1e-3 * footage.white_level < 2e-3
    np.testing.assert_allclose(list(footage), light, rtol=1e-6)
    simulate_footage(footage, SensorModel(width=8, height=6), tmp_path / "events.h5")
    assert "2 pixels in 1 frames were slightly below 0, and become black" in caplog.text


@pytest.mark.parametrize("suffix", [".exr", ".tif"])
def test_a_negative_channel_is_a_color(tmp_path, suffix):
    """Physics: a color outside Rec. 709 has one, and its luminance is light."""
    image = np.tile(np.array([-0.1, 1.0, 0.2], np.float32), (6, 8, 1))
    for k in range(2):
        if suffix == ".exr":
            channels = {name: np.ascontiguousarray(image[..., i]) for i, name in enumerate("RGB")}
            OpenEXR.File({}, channels).write(str(tmp_path / f"{k}.exr"))
        else:
            cv2.imwrite(str(tmp_path / f"{k}.tif"), image[..., ::-1])
    np.testing.assert_allclose(list(open_footage(tmp_path, fps=10)), 0.7084, rtol=1e-3)


def test_frames_share_a_display_window(tmp_path):
    """Promise: a picture whose window moves is refused, as its frames do not fit each other."""
    for k in range(2):
        place = np.array([k, 0], np.int32), np.array([k + 7, 5], np.int32)
        write_exr(tmp_path / f"{k}.exr", np.ones((6, 8)), dataWindow=place, displayWindow=place)
    with pytest.raises(TaskError, match=r"1\.exr: found a display window from x=1 y=0, .* x=0 y=0"):
        list(open_footage(tmp_path, fps=10))


def test_the_command_reads_a_layer_and_repairs_it(tmp_path, eres, caplog):
    """Promise: `eres simulate` asks which of two layers, and passes both options on."""
    (tmp_path / "in").mkdir()
    for k in range(3):
        light = np.full((6, 8), 0.5 * 1.5**k, np.float32)
        light[2, 3] = np.nan
        channels = {f"glow.{c}": np.ones_like(light) for c in "RGB"}
        channels |= {f"beauty.{c}": light for c in "RGB"}
        OpenEXR.File({}, channels).write(str(tmp_path / "in" / f"{k}.exr"))
    command = "simulate", tmp_path / "in", "--fps", 100, "--out", tmp_path / "events.h5"
    code, _, said = eres(*command)
    assert code == 1
    assert "found layers beauty, glow; choose one with --layer" in said
    code, _, said = eres(*command, "--layer", "beauty", "--repair")
    assert code == 0, said
    assert "3 pixels in 3 frames were not finite or below 0" in caplog.text
    events = concatenate(list(read_events(tmp_path / "events.h5")))
    assert len(events) > 0
    assert np.all(events.p == 1)


def test_layers_are_of_openexr(tmp_path):
    """Promise: an option that does nothing is refused."""
    folder = write_folder(tmp_path / "png", pictures(2), ".png")
    with pytest.raises(TaskError, match="--layer is only for OpenEXR"):
        open_footage(folder, fps=10, layer="beauty")


def rgb_of(planes, matrix, wide):
    """Decode Y'CbCr by the definition of ITU-R BT.601 or BT.709, full or studio range."""
    kr, kb = {1: (0.2126, 0.0722), 5: (0.299, 0.114)}[matrix]
    y, b, r = np.moveaxis(planes.astype(float), 1, 0)
    y, b, r = (
        (y / 255, (b - 128) / 255, (r - 128) / 255)
        if wide == 2
        else ((y - 16) / 219, (b - 128) / 224, (r - 128) / 224)
    )
    red, blue = y + 2 * (1 - kr) * r, y + 2 * (1 - kb) * b
    green = (y - kr * red - kb * blue) / (1 - kr - kb)
    return np.clip(np.stack([red, green, blue], -1), 0, 1)


@pytest.mark.parametrize("matrix", [1, 5])
@pytest.mark.parametrize("wide", [1, 2])
def test_videos_are_decoded_by_their_tags(tmp_path, matrix, wide):
    """Physics: the matrix and the range in a video's tags determine its light; FFmpeg's defaults
    differ."""
    planes = np.random.default_rng(1).integers(60, 180, (3, 3, 32, 48), np.uint8)
    video = write_video(tmp_path / "a.mkv", planes, matrix=matrix, wide=wide)
    footage = open_footage(video)
    assert footage.encoding == "rec709"
    expected = to_linear(rgb_of(planes, matrix, wide), "rec709") @ BT709
    np.testing.assert_allclose(list(footage), expected, atol=4e-3)


@pytest.mark.parametrize("wide", [1, 2])
def test_videos_with_coarse_colors_are_as_light_as_others(tmp_path, wide):
    """Physics: 4:2:0, the pixels of most videos, from black to white, where FFmpeg's usual table is
    up to 2.3 codes too dark."""
    luma = np.tile(np.arange(16, 236, dtype=np.uint8), (8, 1))
    planes = np.concatenate([luma, np.full((4, 220), 128, np.uint8)])
    path = write_video(tmp_path / "a.mkv", np.stack([planes] * 2), pixels="yuv420p", wide=wide)
    exact = (luma - 16.0) / 219 if wide == 1 else luma / 255.0
    light = next(iter(open_footage(path, encoding="linear")))
    np.testing.assert_allclose(light, exact, atol=0.51 / 255)


@pytest.mark.parametrize(("pixels", "step"), [("gray", 1), ("gray10le", 4)])
@pytest.mark.parametrize("wide", [1, 2])
def test_gray_videos_have_the_range_of_their_tags(tmp_path, pixels, step, wide):
    """Physics: black and white are at codes 16 and 235 of studio range, 0 and 255 of full range."""
    codes = np.array([0, 8, 16, 32, 128, 235, 252]) * step
    planes = np.broadcast_to(codes, (2, 32, 7)).astype(np.uint8 if step == 1 else np.uint16)
    path = write_video(tmp_path / "a.mkv", planes.copy(), pixels=pixels, wide=wide)
    black, white = (16 * step, 235 * step) if wide == 1 else (0, 256 * step - 1)
    expected = np.clip((codes - black) / (white - black), 0, 1)
    light = next(iter(open_footage(path, encoding="linear")))[0]
    np.testing.assert_allclose(light, expected, atol=3e-3)


def write_tagged(path, *, codec="ffv1", pixels="yuv444p", **tags):
    """Write a video whose codec has these tags."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=100)
        stream.height, stream.width, stream.pix_fmt = 32, 48, pixels
        for name, value in tags.items():
            setattr(stream.codec_context, name, value)
        for _ in range(2):
            frame = av.VideoFrame.from_ndarray(np.full((32, 48, 4), 99, np.uint8), format="rgba")
            container.mux(stream.encode(frame.reformat(format=pixels)))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize(("curve", "name"), [(16, "PQ"), (17, "SMPTE"), (18, "HLG")])
def test_videos_of_other_curves_are_refused(tmp_path, curve, name):
    """Promise: video for HDR screens does not become events of BT.709's contrast in silence."""
    path = write_tagged(tmp_path / "a.mkv", color_trc=curve)
    with pytest.raises(TaskError, match=rf"a.mkv: is encoded with {name}.*--encoding"):
        open_footage(path)
    assert open_footage(path, encoding="rec709").encoding == "rec709"


@pytest.mark.parametrize(
    ("curve", "encoding"),
    [(1, "rec709"), (6, "rec709"), (4, "gamma:2.2"), (5, "gamma:2.8"), (8, "linear"), (13, "srgb")],
)
def test_videos_have_the_transfer_function_of_their_tags(tmp_path, curve, encoding):
    """Promise: numbers of ITU-T H.273, Table 3."""
    path = write_tagged(tmp_path / "a.mkv", color_trc=curve)
    assert open_footage(path).encoding == encoding
    assert open_footage(path, encoding="gamma:2").encoding == "gamma:2"


def test_what_videos_have_beside_light_is_said(tmp_path, caplog):
    """Promise: transparency and pixels that are not square are named, not ignored in silence."""
    open_footage(write_tagged(tmp_path / "a.mkv"))
    assert not caplog.messages
    open_footage(write_tagged(tmp_path / "b.mkv", pixels="yuva444p"))
    assert "b.mkv: transparency is ignored" in caplog.text
    ratio = Fraction(4, 3)
    open_footage(write_tagged(tmp_path / "c.mkv", codec="libx264", sample_aspect_ratio=ratio))
    assert "c.mkv: pixels 4/3 times as wide as high are treated as square" in caplog.text


def test_a_matrix_with_two_tags_is_one_matrix(tmp_path):
    """Promise: BT.601 tagged as SMPTE 170M stays that in high definition, where untagged video
    would be BT.709."""
    planes = np.broadcast_to(np.uint8([[90], [120], [160]])[..., None], (2, 3, 720, 16)).copy()
    both = [
        next(iter(open_footage(write_video(tmp_path / f"{tag}.mkv", planes, matrix=tag))))
        for tag in (5, 6)
    ]
    np.testing.assert_array_equal(*both)


def test_videos_whose_pixels_are_unknown_are_refused(tmp_path):
    """Promise: an error that names the file, as for an animated WebP, unknown to FFmpeg."""
    frames = [Image.fromarray(image) for image in pictures(3)]
    frames[0].save(tmp_path / "a.webp", save_all=True, append_images=frames[1:], duration=40)
    with pytest.raises(TaskError, match=r"a\.webp: this FFmpeg cannot decode"):
        open_footage(tmp_path / "a.webp")


def test_names_of_videos_may_have_colons(tmp_path, monkeypatch):
    """Promise: a name such as 12:30.mkv is a file's, not that of a protocol of FFmpeg."""
    monkeypatch.chdir(tmp_path)
    for name in ("12:30.mkv", "file:1.mkv"):
        write_video(tmp_path / name, np.full((2, 3, 32, 48), 120, np.uint8))
        assert len(open_footage(name)) == 2


def test_frames_of_a_video_that_change_size_are_named(tmp_path, monkeypatch):
    """Promise: the sensor never sees the corner of a larger frame."""
    path = write_video(tmp_path / "a.mkv", np.full((3, 3, 32, 48), 120, np.uint8))
    real, seen = video._numbers, []

    def growing(frame):
        seen.append(frame)
        return np.repeat(real(frame), 2, axis=0) if len(seen) % 4 == 0 else real(frame)

    monkeypatch.setattr(video, "_numbers", growing)  # as a stream of another resolution would
    with pytest.raises(TaskError, match=r"a.mkv: frame 3 has 48x64 px"):
        list(open_footage(path))


def test_footage_of_floats_that_begins_black_is_refused(tmp_path):
    """Promise: the error names the file and the cause, which the sensor does not know."""
    (tmp_path / "fade").mkdir()
    for k in range(3):
        write_luminance(tmp_path / "fade" / f"{k}.exr", np.full((8, 8), float(k)))
    with pytest.raises(TaskError, match="fade: the first frame defines white, but is black"):
        open_footage(tmp_path / "fade", fps=100)


def test_video_with_ten_bits_keeps_them(tmp_path):
    """Promise: steps below 1/255 survive."""
    levels = np.arange(400, 500, dtype=np.uint16)
    planes = np.broadcast_to(levels, (2, 1, 16, 100))[:, 0].copy()
    video = write_video(tmp_path / "a.mkv", planes, pixels="gray10le", wide=2)
    light = next(iter(open_footage(video, encoding="linear")))[0]
    np.testing.assert_allclose(light, levels / 1023, atol=3e-4)


@pytest.mark.parametrize(
    ("matrix", "corners"),
    [  # a, b, c, d; where the corners A B / C D are shown
        ((1, 0, 0, 1), "AB/CD"),
        ((0, 1, -1, 0), "CA/DB"),  # a phone held upright
        ((-1, 0, 0, -1), "DC/BA"),
        ((0, -1, 1, 0), "BD/AC"),
        ((-1, 0, 0, 1), "BA/DC"),  # mirrored, as from a front camera
        ((0, 1, 1, 0), "AC/BD"),
        ((0, -2, -2, 0), "DB/CA"),
    ],
)
def test_videos_are_turned_as_they_are_shown(tmp_path, matrix, corners):
    """Promise: the display matrix of a video rotates and mirrors its frames."""
    levels = dict(zip("ABCD", (40, 90, 140, 190), strict=True))
    plain = np.kron([[levels[c] for c in row] for row in ("AB", "CD")], np.ones((16, 32)))
    video = mp4_shown_by(tmp_path, plain.astype(np.uint8), matrix)
    shown = np.array([[levels[c] for c in row] for row in corners.split("/")])
    sides = (32, 16) if matrix[0] == 0 else (16, 32)
    footage = open_footage(video, encoding="linear")
    assert (footage.height, footage.width) == (2 * sides[0], 2 * sides[1])
    for light in footage:
        np.testing.assert_allclose(255 * light, np.kron(shown, np.ones(sides)), atol=3)


def test_motion_jpeg_may_have_exif(tmp_path):
    """Promise: frames with Exif, which cameras write, are read, and turned as it says."""
    half = np.repeat(np.uint8([40, 200]), 24)[:, None].repeat(64, 1)  # dark above
    for orientation, expected in ((None, half), (2, half), (3, half[::-1]), (6, half.T[:, ::-1])):
        path = tmp_path / f"{orientation}.avi"
        with av.open(str(path), "w") as container:
            stream = container.add_stream("mjpeg", rate=25)
            stream.height, stream.width, stream.pix_fmt = *half.shape, "yuvj420p"
            for k in range(2):
                exif, data = Image.Exif(), io.BytesIO()
                exif[0x010F] = "a camera"
                if orientation is not None:
                    exif[0x0112] = orientation
                Image.fromarray(half).convert("RGB").save(data, "JPEG", exif=exif)
                packet = av.Packet(data.getvalue())
                packet.stream, packet.time_base = stream, Fraction(1, 25)
                packet.pts = packet.dts = k
                packet.is_keyframe = True
                container.mux(packet)
        light = next(iter(open_footage(path, encoding="linear")))
        np.testing.assert_allclose(255 * light, expected, atol=3)


def test_a_turn_by_no_right_angle_is_refused(tmp_path):
    """Promise: frames at an oblique angle are refused; the error gives the angle."""
    video = mp4_shown_by(tmp_path, np.full((32, 64), 99, np.uint8), (0.8, 0.6, -0.6, 0.8))
    with pytest.raises(TaskError, match=r"rotated by 36.9 degrees"):
        open_footage(video)


def mp4_shown_by(folder, gray, matrix):
    """Write two equal gray frames, and a, b, c, d of the display matrix into the track's header."""
    planes = np.stack([gray, *np.full((2, *gray.shape), 128, np.uint8)])
    video = write_video(folder / "a.mp4", np.stack([planes, planes]), codec="libx264", wide=2)
    data = bytearray(video.read_bytes())
    a, b, c, d = (round(65536 * one) for one in matrix)
    place = data.index(b"tkhd") + 44  # ISO/IEC 14496-12, 8.3.2
    data[place : place + 36] = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30)
    video.write_bytes(data)
    return video


def test_a_video_is_not_replaced_by_its_events(eres, tmp_path):
    """Promise: --overwrite does not replace what is read."""
    video = mp4_shown_by(tmp_path, np.full((32, 64), 99, np.uint8), (1.0, 0.0, 0.0, 1.0))
    before = video.read_bytes()
    args = ("--out", video, "--format", "npz", "--overwrite", "--resolution", 16)
    code, _, err = eres("simulate", video, *args)
    assert (code, "would overwrite the input" in err) == (1, True)
    assert video.read_bytes() == before


def test_an_image_is_not_replaced_by_the_events_of_its_folder(eres, tmp_path):
    """Promise: nor is one of the files of a folder that is read; others beside them are."""
    folder = write_folder(tmp_path / "in", pictures(3), ".png")
    before = (folder / "frame9.png").read_bytes()
    args = ("--fps", 30, "--format", "npz", "--overwrite", "--resolution", 16)
    code, _, err = eres("simulate", folder, "--out", folder / "frame9.png", *args)
    assert (code, "would overwrite the input" in err) == (1, True)
    assert (folder / "frame9.png").read_bytes() == before
    for _ in range(2):
        assert eres("simulate", folder, "--out", folder / "events.npz", *args)[0] == 0


def test_videos_keep_their_own_times(tmp_path):
    """Promise: a video of variable rate has its own times; --fps replaces them."""
    planes = np.full((5, 3, 16, 16), 128, np.uint8)
    video = write_video(tmp_path / "a.mkv", planes, times=[0, 10, 13, 40, 41])
    np.testing.assert_allclose(open_footage(video).t_s, [0, 0.010, 0.013, 0.040, 0.041])
    np.testing.assert_allclose(open_footage(video, fps=1000).t_s, np.arange(5) / 1000)


@pytest.mark.parametrize(
    ("suffix", "codec", "rate"),
    [
        *(("mkv", {}, rate) for rate in (30, Fraction(60000, 1001), 240, 960)),
        ("flv", {"codec": "flv", "pixels": "yuv420p"}, 960),
        ("gif", {"codec": "gif", "pixels": "gray"}, 30),
        ("ts", {"codec": "libx264", "pixels": "yuv420p"}, 960),
    ],
)
def test_an_even_rate_that_a_container_rounds_is_even_again(tmp_path, caplog, suffix, codec, rate):
    """Promise: times that the rate of the file explains to a tick are exact, and that is said."""
    caplog.set_level(logging.INFO)
    shape = (200, 16, 16) if suffix == "gif" else (200, 48, 32)
    planes = np.random.default_rng(0).integers(0, 255, shape, np.uint8)
    if not codec:
        planes = planes[:, None].repeat(3, 1)
    footage = open_footage(write_video(tmp_path / f"a.{suffix}", planes, rate=rate, **codec))
    exact = np.arange(200) / float(rate)
    np.testing.assert_allclose(footage.t_s - footage.t_s[0], exact, atol=2e-9)
    said = f"a.{suffix}: the .* times are rounded .* even times at {float(rate):.6g} frames per"
    assert re.search(said, caplog.text)


def uneven():
    """Return times in milliseconds: of a variable rate, and of 960 Hz without a frame."""
    rng = np.random.default_rng(0)
    apart = rng.integers(1, 5, 60), rng.integers(20, 50, 60)
    full = np.round(np.arange(60) / 0.96).astype(int)
    return [*(np.cumsum(one).tolist() for one in apart), np.delete(full, 31).tolist()]


@pytest.mark.parametrize("times", uneven())
@pytest.mark.parametrize("rate", [30, 500, 960])
@pytest.mark.parametrize("suffix", ["mkv", "mp4"])
def test_uneven_times_are_those_of_the_file(tmp_path, caplog, suffix, rate, times):
    """Promise: a variable rate is never taken as even, whatever rate the file states; ticks of more
    than a twentieth of an interval are said."""
    planes = np.full((len(times), 48, 32), 99, np.uint8)
    mp4 = {"codec": "libx264"} if suffix == "mp4" else {}
    path = tmp_path / f"a.{suffix}"
    write_video(path, planes, times=times, rate=rate, pixels="yuv420p", **mp4)
    footage = open_footage(path)
    np.testing.assert_allclose(
        footage.t_s - footage.t_s[0], 1e-3 * np.array(times) - 1e-3 * times[0], atol=1e-12
    )
    coarse = suffix == "mkv" and np.median(np.diff(times)) < 20
    assert ("fit no constant rate; events are up to 0.5 ms off" in caplog.text) == coarse


def test_a_video_that_counts_frames_has_no_coarse_times(tmp_path, caplog):
    """Promise: AVI's ticks are the intervals of its rate, so a missing frame is where it was."""
    planes = np.full((9, 48, 32), 99, np.uint8)
    kept = [0, 1, 2, 4, 5, 6, 7, 8, 9]
    video = tmp_path / "a.avi"
    write_video(video, planes, times=kept, tick_s=Fraction(1, 50), rate=50, pixels="yuv420p")
    np.testing.assert_allclose(open_footage(video).t_s, np.array(kept) / 50, atol=1e-12)
    assert not caplog.messages


OPEN = "open-gop=1:keyint=12:min-keyint=12:bframes=3:b-adapt=0:scenecut=0"


@pytest.mark.parametrize("suffix", ["mkv", "mp4"])
@pytest.mark.parametrize(
    ("codec", "options", "lost"),
    [
        ("libx264", {"x264-params": OPEN}, 3),
        ("libx265", {"x265-params": f"{OPEN}:log-level=none"}, 3),
        ("mpeg2video", {"g": "12", "bf": "2"}, 2),
        ("libx264", {"x264-params": "intra-refresh=1:keyint=12:bframes=0:scenecut=0"}, 2),
    ],
)
def test_a_clip_cut_from_a_video_has_the_times_of_what_it_shows(
    tmp_path, caplog, suffix, codec, options, lost
):
    """Promise: frames that need others from before the cut are left out, and the rest are at the
    times at which the whole video shows them; it is not called damaged."""
    caplog.set_level(logging.INFO)
    gray = np.repeat(np.arange(40, 200, 4, dtype=np.uint8), 48 * 64).reshape(40, 48, 64)
    planes = np.concatenate([gray, np.full((40, 24, 64), 128, np.uint8)], axis=1)
    whole, clip = (tmp_path / f"{name}.{suffix}" for name in ("whole", "clip"))
    write_video(whole, planes, rate=50, codec=codec, pixels="yuv420p", **options)
    with av.open(str(whole)) as read, av.open(str(clip), "w") as write:
        stream = write.add_stream_from_template(read.streams.video[0])
        keys = 0
        for packet in read.demux(video=0):
            keys += packet.is_keyframe
            if packet.size and keys > 1:
                packet.stream = stream
                write.mux(packet)
    assert len(list(open_footage(whole))) == 40
    assert not [said for said in caplog.messages if "left out" in said]
    footage = open_footage(clip, encoding="linear")
    frames = [255 * frame.mean() for frame in footage]  # which are brighter by 4 codes each
    t_s = footage.t_s + 1e-6 * footage.t_offset_us
    begun = t_s[0] * 50
    assert begun > 1
    np.testing.assert_allclose(t_s * 50, begun + np.arange(len(frames)), atol=1e-6)
    np.testing.assert_allclose(frames, (24 + 4 * 50 * t_s) * 255 / 219, atol=3)
    if suffix == "mkv":  # the edit list of an MP4 hides the frames of an open group
        assert f"clip.mkv: the first {lost} frames are skipped" in caplog.text


def test_command_turns_a_folder_into_events(tmp_path, eres):
    """Promise: the same events as `simulate` on the linear frames; the sensor has their size."""
    images = pictures(6)
    folder, out = write_folder(tmp_path / "in", images, ".png"), tmp_path / "e.npz"
    assert eres("simulate", folder, "--fps", 100, "--out", out)[0] == 0
    light = to_linear(images, "srgb").astype(np.float32) @ BT709.astype(np.float32)
    model = SensorModel(width=26, height=20, dark_level=1e-3)
    expected = simulate(light, np.arange(6) / 100, model)
    found = concatenate(list(read_events(out)))
    for name in ("t_us", "x", "y", "p"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert len(found) > 1000


def test_times_from_a_file(tmp_path):
    """Promise: times are exact in the stated or given unit; absolute times remain the clock."""
    folder = write_folder(tmp_path / "in", pictures(3), ".png")
    times = folder / "timestamps.txt"
    times.write_text("# unit: s\n1700000000.000001\n1700000000.000011\n\n1700000000.5 # late\n")
    footage = open_footage(folder)
    assert footage.t_offset_us == 1_700_000_000_000_001
    np.testing.assert_allclose(footage.t_s, [0, 1e-5, 0.499999], atol=1e-12)
    times.write_text("7\n8\n9\n")
    np.testing.assert_allclose(open_footage(folder, time_unit="ns").t_s, [7e-9, 8e-9, 9e-9])
    times.write_text("# unit: ns\n7\n8\n9\n", encoding="utf-8-sig")  # as other systems save it
    for unit in (None, "ns"):
        np.testing.assert_allclose(open_footage(folder, time_unit=unit).t_s, [7e-9, 8e-9, 9e-9])


@pytest.mark.parametrize(
    ("text", "unit", "error"),
    [
        ("1\n2\n3\n", None, "unit: found none, expected --time-unit s, ms, us or ns"),
        ("# unit: day\n1\n2\n3\n", None, "unit: found day"),
        ("1\n2\n", "s", "2 times for 3 images"),
        ("1\n3\n2\n", "s", "txt:3: found '2', expected a time after"),
        ("1\nx\n2\n", "s", "txt:2: found 'x'"),
        ("1\nnan\n2\n", "s", "txt:2: found 'nan'"),
        ("1\n1e11\n2\n", "s", "txt:2: found '1e11'"),
        ("1\n1e999999\n2\n", "s", "txt:2: found '1e999999'"),
        ("1 0.png\n2\n3\n", "s", "txt:1: found '1 0.png'"),
        ("# unit: ns\n1\n2\n3\n", "us", "txt: states the unit ns, but --time-unit is us"),
    ],
)
def test_times_are_checked(tmp_path, text, unit, error):
    """Promise: a unit is never guessed, and wrong times are named with their line."""
    folder = write_folder(tmp_path / "in", pictures(3), ".png")
    (folder / "timestamps.txt").write_text(text)
    with pytest.raises(TaskError, match=error):
        open_footage(folder, time_unit=unit)


def test_folders_are_checked(tmp_path):
    """Promise: errors name images that are missing, mixed, damaged or of another size."""
    with pytest.raises(TaskError, match="none: no such file"):
        open_footage(tmp_path / "none")
    (tmp_path / "empty").mkdir()
    with pytest.raises(TaskError, match="empty: found 0 images"):
        open_footage(tmp_path / "empty", fps=1)
    folder = write_folder(tmp_path / "in", pictures(5), ".png")
    with pytest.raises(TaskError, match=r"in: has no times; .*--fps.*timestamps.txt"):
        open_footage(folder)
    for fps in (0, 1e-12, 1e10, np.nan):
        with pytest.raises(TaskError, match=rf"fps: found {fps}, expected 0.001 to 1e\+08"):
            open_footage(folder, fps=fps)
    (folder / "frame10.png").rename(tmp_path / "kept.png")
    with pytest.raises(TaskError, match=r"frame11.png: uneven number after frame9.png"):
        open_footage(folder, fps=1)
    data = (tmp_path / "kept.png").read_bytes()
    (folder / "frame10.png").write_bytes(data[:-20])
    with pytest.raises(TaskError, match=r"frame10.png: is not a complete PNG .*\d+ bytes"):
        list(open_footage(folder, fps=1))
    (folder / "frame10.png").write_bytes(data + bytes(20_000))
    assert len(list(open_footage(folder, fps=1))) == 5
    cv2.imwrite(str(folder / "frame10.png"), np.zeros((7, 9), np.uint8))
    with pytest.raises(TaskError, match=r"frame10.png: found 9x7 px, expected 26x20 px, as in fr"):
        list(open_footage(folder, fps=1))
    (folder / "x.jpg").write_bytes(b"")
    with pytest.raises(TaskError, match="found jpeg and png, expected images of one kind"):
        open_footage(folder, fps=1)


@pytest.mark.parametrize("names", [("a1", "a2", "b1", "b2"), ("shot12-59-59", "shot13-00-00")])
def test_numbers_that_fall_are_refused_by_name(tmp_path, names):
    """Promise: two series in one folder are no gap between neighbors of one series."""
    (tmp_path / "in").mkdir()
    for name, image in zip(names, pictures(len(names)), strict=True):
        cv2.imwrite(str(tmp_path / "in" / f"{name}.png"), image)
    fall = len(names) // 2
    with pytest.raises(
        TaskError, match=f"{names[fall]}.png: uneven number after {names[fall - 1]}.png"
    ):
        open_footage(tmp_path / "in", fps=1)


def test_a_truncated_jpeg_is_refused(tmp_path):
    """Trap: decoders fill the rest of such an image with gray."""
    folder = write_folder(tmp_path / "in", pictures(2, 200, 200), ".jpg")
    assert len(list(open_footage(folder, fps=1))) == 2
    data = (folder / "frame9.jpg").read_bytes()
    (folder / "frame9.jpg").write_bytes(data + bytes(20_000))  # as phones append films
    assert len(list(open_footage(folder, fps=1))) == 2
    (folder / "frame9.jpg").write_bytes(data[:2] + b"\xff\xff" + data[2:])  # fill bytes
    assert len(list(open_footage(folder, fps=1))) == 2
    preview = b"\xff\xe1" + (len(data) + 2).to_bytes(2) + data  # has an end of its own
    assert len(data) < 65_000
    for cut in (len(data) // 2, len(data) - 2):
        for start in (b"", preview):
            (folder / "frame9.jpg").write_bytes(data[:2] + start + data[2:cut])
            with pytest.raises(TaskError, match=r"frame9.jpg: is not a complete JPEG .* bytes"):
                list(open_footage(folder, fps=1))


def test_sixteen_bits_whose_white_is_zero(tmp_path):
    """Promise: TIFF files may store light upside down; decoders turn it round for 8 bits only."""
    folder = write_folder(tmp_path / "in", pictures(2, dtype=np.uint16)[..., 0], ".tif")
    straight = list(read_images(list_images(folder)))
    photometric = [struct.pack("<HHIHH", 262, 3, 1, value, 0) for value in (1, 0)]
    for file in folder.iterdir():
        data = file.read_bytes()
        assert data.count(photometric[0]) == 1
        file.write_bytes(data.replace(*photometric))
    for one, other in zip(straight, read_images(list_images(folder)), strict=True):
        np.testing.assert_array_equal(other, 65535 - one)


def test_videos_are_checked(tmp_path):
    """Promise: errors name files that are no video or truncated, and options that do not apply."""
    text = tmp_path / "a.mp4"
    text.write_text("this is no video")
    with pytest.raises(TaskError, match=r"a.mp4: could not be read as a video"):
        open_footage(text)
    planes = np.random.default_rng(0).integers(0, 255, (20, 3, 64, 64), np.uint8)
    video = write_video(tmp_path / "b.mkv", planes)
    with pytest.raises(TaskError, match="--time-unit is only for"):
        open_footage(video, time_unit="s")


@pytest.mark.parametrize("suffix", ["mkv", "flv"])
@pytest.mark.parametrize("fps", [None, 24.0])
def test_videos_without_an_end_are_said(tmp_path, caplog, suffix, fps):
    """Promise: a truncated Matroska or Flash file, which can be read up to where it ends, is named
    with the times of its last frame and of its end; a whole one with an uneven rate is not."""
    planes = np.random.default_rng(0).integers(0, 255, (40, 96, 64), np.uint8)
    times = [*range(0, 1950, 50), 2040]
    codec = {"codec": "flv"} if suffix == "flv" else {}
    video = write_video(tmp_path / f"a.{suffix}", planes, times=times, pixels="yuv420p", **codec)
    assert len(list(open_footage(video, fps=fps))) == 40
    assert not caplog.messages
    video.write_bytes(video.read_bytes()[: video.stat().st_size // 2])
    count = len(list(open_footage(video, fps=fps)))
    assert 10 < count < 25
    (said,) = caplog.messages
    assert said.startswith(f"{video}: the frames end at {(count - 1) * 0.05:.3g} s, but the file ")
    assert said.endswith(": its end may be missing")


def test_reference_frames_of_vp8_are_no_images(tmp_path):
    """Promise: packets that show no picture, as two-pass encoders write them, are not counted."""
    planes = np.random.default_rng(0).integers(0, 255, (96, 64), np.uint8)[None].repeat(9, 0)
    whole = write_video(tmp_path / "a.webm", planes, codec="libvpx", pixels="yuv420p")
    hidden = tmp_path / "b.webm"
    with av.open(str(whole)) as read, av.open(str(hidden), "w") as write:
        stream = write.add_stream_from_template(read.streams.video[0])
        for k, packet in enumerate(one for one in read.demux(video=0) if one.size):
            data = bytearray(bytes(packet))
            data[0] &= 0xFF if k != 4 else ~0x10  # show_frame
            copy = av.Packet(bytes(data))
            copy.pts, copy.dts, copy.time_base = packet.pts, packet.dts, packet.time_base
            copy.is_keyframe, copy.stream = packet.is_keyframe, stream
            write.mux(copy)
    assert len(list(open_footage(whole))) == 9
    footage = open_footage(hidden)
    assert len(list(footage)) == len(footage) == 8


def waves(t_px, size=96):
    """Return a smooth texture, moved by (t_px, t_px / 2)."""
    y, x = np.mgrid[:size, :size].astype(float)
    x, y = x - t_px, y - t_px / 2
    return (
        2
        + np.sin(x / 3) * np.cos(y / 4)
        + 0.5 * np.sin(x / 7 + y / 5)
        + 0.3 * np.cos(x / 2 - y / 9)
    ).astype(np.float32)


def footage_of(tmp_path, frames, fps=100.0):
    """Return frames of light, stored as EXR."""
    folder = tmp_path / f"frames{len(list(tmp_path.iterdir()))}"
    folder.mkdir()
    for k, frame in enumerate(frames):
        write_luminance(folder / f"{k:03d}.exr", frame)
    return open_footage(folder, fps=fps)


def test_motion_is_measured(tmp_path):
    """Analytic: a texture that moves by (3, 1.5) px has displacements of 3.35 px."""
    footage = footage_of(tmp_path, [waves(t) for t in (0, 3, 6)])
    np.testing.assert_allclose(displacements_px(footage), np.hypot(3, 1.5), rtol=0.1)
    assert [*map(steps_for, (0.0, 0.4, 0.6, 5.0))] == [1, 1, 2, 10]


@pytest.mark.parametrize("size", [(256, 1280), (64, 1280), (32, 1280), (32, 48)])
def test_motion_in_strips_is_measured(tmp_path, size):
    """Analytic: a texture that moves by 2 px down a strip, which is measured stretched."""
    height, width = size
    rng = np.random.default_rng(0)
    texture = gaussian_filter(rng.normal(size=(300, width)), 5)
    texture = 0.5 + 0.1 * texture / texture.std()
    frames = [texture[2 * k : 2 * k + height].astype(np.float32) for k in range(3)]
    np.testing.assert_allclose(displacements_px(footage_of(tmp_path, frames)), 2, atol=0.3)


def test_only_motion_that_changes_the_light_counts(tmp_path):
    """Promise: noise on a plain wall does not move, and stripes move across themselves only."""
    rng = np.random.default_rng(0)
    ramp = np.linspace(0.2, 0.5, 240) * np.ones((180, 1))
    wall = [ramp + rng.uniform(-0.006, 0.006, ramp.shape) for _ in range(3)]
    np.testing.assert_array_equal(displacements_px(footage_of(tmp_path, wall)), 0)
    y, x = np.mgrid[:180, :240]
    profile = np.interp(np.arange(400), np.arange(0, 400, 8), rng.uniform(0.1, 1.0, 50))
    across = 0.8 * x + 0.6 * y
    stripes = [np.interp(across - 0.8 * k + 9, np.arange(400), profile) for k in range(3)]
    np.testing.assert_allclose(displacements_px(footage_of(tmp_path, stripes)), 0.8, atol=0.3)


@pytest.mark.parametrize("size", [(6, 200), (200, 6), (24, 200), (1, 40)])
def test_frames_of_a_few_rows_have_motion_too(size):
    """Promise: images of any size have optical flow, in their own pixels."""
    height, width = size
    y, x = np.mgrid[:height, :width]
    along = x if width > height else y
    light = [127 + 100 * np.sin(0.3 * (along - 2 * k)) for k in range(2)]
    flow = optical_flow(*(one.astype(np.uint8) for one in light))
    assert flow.shape == (height, width, 2)
    middle = flow[height // 4 : 3 * height // 4 + 1, width // 4 : 3 * width // 4 + 1]
    assert np.median(middle[..., 0 if width > height else 1]) == pytest.approx(2, abs=0.3)


def test_frames_in_between_follow_the_motion(tmp_path):
    """Analytic: halfway, the texture has moved half as far; the footage's own frames are kept."""
    footage = footage_of(tmp_path, [waves(0), waves(4), waves(8)])
    dense = interpolated(footage, [4, 1])
    np.testing.assert_allclose(dense.t_s, [0, 0.0025, 0.005, 0.0075, 0.01, 0.02])
    frames = list(dense)
    inside = slice(12, -12)  # what enters at the border was seen in one frame only
    for frame, t_px in zip(frames, (0, 1, 2, 3, 4, 8), strict=True):
        error = (frame - waves(t_px))[inside, inside]
        assert np.sqrt(np.mean(error**2)) < 0.02, t_px
    blended = 0.5 * (waves(0) + waves(4)) - waves(2)
    assert np.sqrt(np.mean(blended[inside, inside] ** 2)) > 0.15
    for own, k in ((0, 0), (1, 4), (2, 5)):
        np.testing.assert_array_equal(list(footage)[own], frames[k])


def test_interpolation_brings_events_back(tmp_path, caplog):
    """Promise: 9 px from frame to frame lose a third of the events, and the log says so; auto
    brings most of them back."""
    model = SensorModel(width=96, height=96, contrast_threshold=0.1)
    moments = np.arange(0, 49)
    every = simulate(np.stack([waves(0.5 * t) for t in moments]), moments * 1e-3, model)
    thin = footage_of(tmp_path, [waves(0.5 * t) for t in moments[::16]], fps=62.5)
    caplog.set_level(logging.INFO)
    few, _ = simulate_footage(thin, model, tmp_path / "few.npz")
    lost = re.search(r"moves by 8.9 px of the sensor from .* about (\d+) % of the ev", caplog.text)
    assert 0.01 * int(lost[1]) == pytest.approx(1 - few / len(every), abs=0.08)
    assert "4 frames of 96x96 px in 0.048 s, encoding linear" in caplog.text
    caplog.clear()
    many, _ = simulate_footage(thin, model, tmp_path / "many.npz", interpolate="auto")
    assert "frame to frame" not in caplog.text
    assert few < 0.65 * len(every)
    assert 0.85 * len(every) < many < 1.1 * len(every)
    for wrong in ("0", "1001", "1000000000", "-2", "2.5", "many"):
        with pytest.raises(TaskError, match=f"interpolate: found '{wrong}', expected 1 to"):
            simulate_footage(thin, model, tmp_path / "x.npz", interpolate=wrong)


@pytest.mark.parametrize("interpolate", [None, "2", "auto"])
def test_frames_are_read_once_whatever_is_between(tmp_path, interpolate):
    """Promise: motion is measured while events are made."""
    footage = footage_of(tmp_path, [waves(2 * t, 32) for t in range(3)])
    read, stages = [], []

    def frames():
        for frame in footage:
            read.append(frame)
            yield frame

    simulate_footage(
        replace(footage, frames=frames),
        SensorModel(width=32, height=32),
        tmp_path / "e.npz",
        interpolate=interpolate,
        on_progress=lambda *at: stages.append(at),
    )
    assert len(read) == 3
    assert stages == [("simulating", k, 3) for k in range(1, 4)]
    with pytest.raises(TaskError, match="speed: found 0, expected above 0"):
        SimulationOptions(speed=0)


def test_events_with_frames_between_are_those_of_these_frames(tmp_path):
    """Promise: `auto` simulates the frames of `interpolated` at half a pixel a step, to the bit."""
    footage = footage_of(tmp_path, [waves(t) for t in (0, 1.4, 6, 6)])
    model = SensorModel(width=96, height=96, cutoff_hz=200.0, leak_hz=5.0)
    simulate_footage(footage, model, tmp_path / "e.npz", interpolate="auto")
    dense = interpolated(footage, [*map(steps_for, displacements_px(footage))])
    assert len(dense) > 10
    events, expected = load_events(tmp_path / "e.npz"), simulate(iter(dense), dense.t_s, model)
    for column, other in zip(events.columns, expected.columns, strict=True):
        np.testing.assert_array_equal(column, other)


def test_memory_does_not_grow_with_the_footage(tmp_path):
    """Promise: only a few frames are in memory at a time."""
    footage = footage_of(tmp_path, [waves(t, 256) for t in range(12)])
    tracemalloc.start()
    count = sum(1 for _ in interpolated(footage, [4] * 11))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert count == 45
    assert peak < 40 * 4 * 256 * 256


def test_options_of_footage_are_refused_with_a_sequence(tmp_path, eres):
    """Promise: no option is silently ignored."""
    (tmp_path / "manifest.json").write_text("{}")
    out = tmp_path / "e.h5"
    code, _, said = eres("simulate", tmp_path, "--fps", 9, "--resolution", 8, "--out", out)
    assert code == 1
    assert "is a rendered sequence" in said
    folder = write_folder(tmp_path / "in", pictures(2), ".png")
    code, _, said = eres("simulate", folder, "--fps", 9, "--truth", 0.1, "--out", out)
    assert code == 1
    assert "--truth needs a rendered clip" in said
