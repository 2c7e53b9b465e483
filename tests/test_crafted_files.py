"""Files made to break a reader: one error names the file. Valid ones with odd texts are read."""

import json
import os
import struct
import time
import zipfile
import zlib
from itertools import pairwise

import av
import h5py
import numpy as np
import pytest

from eres_render import RenderError, load_scene
from eres_render.calibration import read_camera
from eres_render.scene import xml
from eres_render.storage.settings_reader import read_json, read_toml
from event_streams import random_events
from sensor import EventFormatError
from sensor import read_camera as read_event_camera
from sensor.errors import SensorError
from sensor.formats import load_events, read_header, write_events
from sensor.growth import check_growth
from tasks.errors import TaskError
from tasks.footage import images, video

DEEP = "[" * 5000 + "]" * 5000
MAX_S = 5.0  # a machine may be busy; a file that is not bounded takes minutes, or the memory
ERRORS = EventFormatError, SensorError, RenderError, TaskError


def refused(read, path):
    """Return the error of a reader without the file, which it starts with."""
    start = time.monotonic()
    with pytest.raises(ERRORS) as error:
        read(path)
    assert time.monotonic() - start < MAX_S
    assert str(error.value).startswith(f"{path}: ")
    return str(error.value).removeprefix(f"{path}: ")


def hdf5(path, count=100, **changes):
    """Write DSEC's layout, with other numbers; a hundred events are stored, and no other count."""
    with h5py.File(path, "w") as file:
        for name in "txyp":
            file.create_dataset(f"events/{name}", (count,), "u4", chunks=(64,))
            if count == 100:
                file[f"events/{name}"][:] = np.arange(count) // 50
        file["t_offset"] = changes.get("t_offset", 0)
        file.attrs["width"], file.attrs["height"] = changes.get("width", 64), 48
    return path


@pytest.mark.parametrize("name", ["width", "t_offset"])
def test_an_endless_number_of_an_hdf5_file_is_named(tmp_path, name):
    said = refused(read_header, hdf5(tmp_path / "a.h5", **{name: np.inf}))
    assert name in said
    assert "inf" in said


def test_hdf5_events_that_are_not_stored_are_refused(tmp_path):
    """Promise: 2^40 events of a few kilobytes are not read as zeros, nor are 2^40 triggers."""
    path = hdf5(tmp_path / "a.h5", 1 << 40)
    assert str(16 << 40) in refused(load_events, path)
    hdf5(path)
    assert len(load_events(path)) == 100


def test_growth_is_bounded_by_what_is_stored():
    """Promise: 500 bytes for each that is stored; the first 2^28 are free."""
    check_growth(1 << 28, 0)
    check_growth((1 << 28) + 500 * 7, 7)
    with pytest.raises(EventFormatError, match="stores 7"):
        check_growth((1 << 28) + 500 * 7 + 1, 7)


def npz(path, name, change):
    """Write an npz file with one entry changed."""
    write_events(path, random_events(100, 64, 48))
    with zipfile.ZipFile(path) as old:
        entries = {info: old.read(info) for info in old.infolist()}
    with zipfile.ZipFile(path, "w") as new:
        for info, data in entries.items():
            new.writestr(info.filename, change(data) if info.filename == name else data)
    return path


def with_header(text):
    """Return a change of an npy file to another header of as many bytes."""

    def change(data):
        size = struct.unpack_from("<H", data, 8)[0]
        return data[:10] + text.ljust(size - 1) + b"\n" + data[10 + size :]

    return change


@pytest.mark.parametrize("header", [b"{'descr': '<i8', 'shape': (100,  (", b"{1: 2, 'a': 3}"])
def test_a_damaged_npy_header_is_named(tmp_path, header):
    path = npz(tmp_path / "a.npz", "t_us.npy", with_header(header))
    assert refused(load_events, path).startswith("entry t_us: ")


def test_a_zip_bomb_is_refused(tmp_path):
    """Promise: an entry that declares 2^33 bytes of its few is not decompressed."""
    path = tmp_path / "a.npz"
    write_events(path, random_events(100, 64, 48))
    with zipfile.ZipFile(path, "a") as archive:
        archive.getinfo("t_us.npy").file_size = 1 << 33
        archive.writestr("more", b"")  # which writes the directory anew
    assert str(1 << 33) in refused(load_events, path)


@pytest.mark.parametrize("read", [read_toml, read_json])
def test_deep_settings_are_refused(tmp_path, read):
    path = tmp_path / "a.toml"
    for text in (DEEP, "[" * 102 + "]" * 102):
        path.write_text(f"x = {text}" if read is read_toml else text)
        assert "nested too deep" in refused(lambda file: read(dict, file, RenderError), path)
    path.write_text(f"x = {DEEP}")
    assert "nested too deep" in refused(read_event_camera, path)


def test_yaml_is_bounded(tmp_path):
    """Promise: deep YAML and aliases of 9^10 entries are refused; a few aliases are read."""
    path = tmp_path / "a.yaml"
    path.write_text(f"a: {'[' * 500}{']' * 500}\n")
    assert "nested too deep" in refused(read_camera, path)
    lines = ["a: &a [x,x,x,x,x,x,x,x,x]"]
    lines += [f"{b}: &{b} [{','.join(['*' + a] * 9)}]" for a, b in pairwise("abcdefghij")]
    path.write_text("\n".join([*lines, "camera_matrix: *j"]) + "\n")
    assert "aliases" in refused(read_camera, path)
    lines = ["a: &a [x]", *(f"b{k}: &b{k} [*b{k - 1}]" for k in range(1, 300))]
    path.write_text("\n".join([*lines, f"# {'x' * 50_000}"]).replace("*b0", "*a"))
    assert "nested too deep" in refused(read_camera, path)
    camera = "camera_model: pinhole\n  intrinsics: [400, 400, 32, 24]\n  resolution: *size\n"
    camera += "  distortion_model: radtan\n  distortion_coeffs: [0.1, 0, 0, 0]\n"
    path.write_text(f"size: &size [64, 48]\ncam0:\n  {camera}")
    assert read_camera(path).width == 64
    path.write_text(path.read_text().replace("0.1, 0, 0", "1.0e+308, 1.0e+308, 1.0e+308"))
    refused(read_camera, path)


def test_xml_is_bounded(tmp_path, monkeypatch):
    """Promise: 20,000 nested elements, which end Mitsuba's process, and defaults that double."""
    path = tmp_path / "a.xml"
    path.write_text('<scene version="3.0.0">' + "<bsdf>" * 20_000 + "</bsdf>" * 20_000 + "</scene>")
    assert "nested too deep" in refused(load_scene, path)
    doubled = '<default name="p0" value="xxxxxxxx"/>'
    doubled += "".join(f'<default name="p{k + 1}" value="$p{k}$p{k}"/>' for k in range(9))
    doubled += "".join(f'<default name="q{k + 1}" value="$q{k}$q{k}"/>' for k in range(60))
    path.write_text(f'<scene version="3.0.0">{doubled.replace("$q0", "$p9")}</scene>')
    assert "65536 characters" in refused(load_scene, path)
    monkeypatch.setattr(xml, "_MAX_FILES", 300)
    for k in range(20):
        twice = f'<include filename="{k + 1}.xml"/>' * 2
        (tmp_path / f"{k}.xml").write_text(f"<scene>{twice if k < 19 else ''}</scene>")
    with pytest.raises(RenderError, match="300 files"):
        load_scene(tmp_path / "0.xml")


def test_times_of_a_path_fit_into_whole_microseconds(tmp_path):
    path = tmp_path / "path.txt"
    path.write_text("".join(f"{t} 0 0 1 1 0 0 0\n" for t in ("0", "1e300")))
    with pytest.raises(RenderError, match=r"path\.txt: line 2: found time 1e\+300"):
        load_scene("carpet", path).trajectory()


def png(width, height):
    """Return a PNG file with these sides and no pixel."""
    body = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    chunks = [body, b"IDAT" + zlib.compress(b""), b"IEND"]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c)) for c in chunks
    )


BIG = struct.pack("<HHII", 256, 4, 1, 1 << 16) + struct.pack("<HHII", 257, 4, 1, 1 << 16)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.tif", b""),
        ("a.tif", b"II*\0"),
        ("a.tif", b"II+\0\x08\0\0\0" + struct.pack("<Q", 1 << 63)),
        ("a.tif", b"II*\0\x08\0\0\0\x02\0" + BIG + b"\0" * 4),
        ("a.png", png(1 << 16, 1 << 16)),
    ],
)
def test_images_that_none_is_are_named(tmp_path, name, data):
    """Promise: an empty TIFF, a BigTIFF whose images start at 2^63, and more than 2^30 pixels."""
    path = tmp_path / name
    path.write_bytes(data)
    refused(lambda file: next(images.read_images([file])), path)


def test_a_video_with_a_title_of_another_encoding_is_read(tmp_path):
    """Promise: tags in Latin-1, as of old programs, do not keep a video from being read."""
    path = tmp_path / "a.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=50)
        stream.height, stream.width, stream.pix_fmt = 32, 48, "yuv420p"
        container.metadata["title"] = "grXXe"
        for _ in range(2):
            frame = av.VideoFrame.from_ndarray(np.zeros((32, 48, 3), np.uint8), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    data = path.read_bytes()
    assert b"grXXe" in data
    path.write_bytes(data.replace(b"grXXe", "größe".encode("latin-1")))
    assert len(list(video.read_frames(path, len(video.times_ns(path, None))))) == 2


def test_names_of_another_encoding_are_shown(tmp_path, eres):
    """Promise: a file whose path, attributes and groups are in Latin-1 is described."""
    path = hdf5(tmp_path / os.fsdecode("größe.h5".encode("latin-1")))
    with h5py.File(path, "a") as file:
        space = h5py.h5s.create(h5py.h5s.SCALAR)
        h5py.h5a.create(file.id, "größe".encode("latin-1"), h5py.h5t.NATIVE_INT32, space)
        h5py.h5g.create(file.id, "maß".encode("latin-1"))
    code, out, _ = eres("info", path)
    assert (code, "gr\ufffd\ufffde, ma\ufffd" in out) == (0, True)
    path.write_bytes(b"")
    code, _, err = eres("info", path)
    assert (code, r"gr\udcf6\udcdfe.h5: could not be read as DSEC HDF5" in err) == (1, True)


def test_control_characters_of_a_file_never_reach_the_terminal(tmp_path, eres):
    """Promise: neither in tables nor in errors; lone surrogates are no traceback."""
    path = tmp_path / "a.raw"
    origin = json.dumps({"lens": "a\x1b[31m\ud800\u202e\x9b"})
    lines = f"% evt 3.0\n% geometry 64x48\n% origin {origin}\n% x\x1b[2J 3\n% end\n"
    path.write_text(lines)
    code, out, err = eres("info", path)
    assert (code, err) == (0, "")
    assert r"a\x1b[31m\ud800\u202e\x9b" in out
    assert r"x\x1b[2J" in out
    path.write_text(lines.replace("64x48", "\x1b[2J"))
    code, _, more = eres("info", path)
    (tmp_path / "b.toml").write_text('title = "x"\n["\\u001B[31m\\ntwo"]\nvalue = 3\n')
    _, _, last = eres("sensors", tmp_path / "b.toml")
    assert code == 1
    assert r"\x1b[31m\ntwo: unknown" in last
    assert not set(out + err + more + last) & {"\x1b", "\x9b", "\u202e", "\ud800"}
