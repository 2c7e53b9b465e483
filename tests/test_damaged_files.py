"""Every reader on mutations of a valid file: it reads, or one error names the file, in bounds."""

import json
import re
import resource
import time
import warnings

import av
import cv2
import faery
import numpy as np
import pytest
from PIL import Image

from bags import write_bag
from eres_render import RenderError, Trajectory, load_scene, open_sequence
from eres_render.calibration import read_camera, write_camera
from eres_render.camera import Camera
from eres_render.scene.ply import check_faces
from eres_render.sequence.manifest import FORMAT_VERSION, Manifest
from eres_render.sequence.sequence import SequenceWriter
from eres_render.storage.exr import read_luminance, write_channels
from eres_render.trajectory.tum import tum_text
from event_streams import random_events
from light_scenes import room_folder
from sensor import EventError, SensorError, SensorModel
from sensor import read_camera as read_event_camera
from sensor.formats import Triggers, write_events
from sensor.formats.dsec_reader import DsecReader
from tasks.errors import TaskError
from tasks.events.description import describe
from tasks.events.reading import AS_STORED
from tasks.exposures import read_exposures
from tasks.fitting.response import read_steps
from tasks.footage import images, video
from tasks.recording.frames import open_frames
from tasks.recording.video import read_calibration
from tasks.rig.markers import Detections, read_detections, write_detections
from tasks.rig.slider import Slider, read_slider, slider_text
from tasks.row import Row, read_rows, write_rows
from tasks.study.results.run_files import read_config
from tasks.study.study_file import read_study

pytestmark = pytest.mark.slow

SEED = 11
MUTATIONS = 300
MAX_S = 20.0  # a machine may be busy; a reader that hangs takes longer
MAX_BYTES = 1 << 30
NUMBERS = (
    *(b"inf", b"-inf", b"nan", b"1e300", b"-1e300", b"1e999", b"1e-300", b"0", b"-1", b"-0.0"),
    *(b"9223372036854775808", b"18446744073709551616", b"1" + b"0" * 400, b"1099511627776", b""),
)
WORDS = (
    b"\x00" * 8,
    b"\xff" * 8,
    b"\xff" * 7 + b"\x7f",
    b"\x00" * 7 + b"\x80",
    b"\x00\x00\xf0\x7f",
)
MODEL = SensorModel(width=64, height=48, cutoff_hz=200.0)


def mutated(data, rng):
    """Return the bytes with one or two changes."""
    for _ in range(rng.integers(1, 3)):
        at = int(rng.integers(0, len(data) + 1))
        length = int(rng.choice([1, 2, 4, 8, 64, 512]))
        match rng.integers(0, 7):
            case 0:  # flipped bits
                flips = rng.integers(0, 256, length, np.uint8).tobytes()
                part = bytes(a ^ b for a, b in zip(data[at : at + length], flips, strict=False))
                data = data[:at] + part + data[at + length :]
            case 1:
                data = data[:at]
            case 2:
                data = data[:at] + rng.integers(0, 256, length, np.uint8).tobytes() + data[at:]
            case 3:
                data = data[:at] + data[at + length :]
            case 4:
                data = data[:at] + data[at : at + length] * 2 + data[at + length :]
            case 5:
                word = WORDS[rng.integers(len(WORDS))]
                data = data[:at] + word + data[at + len(word) :]
            case 6:
                found = list(re.finditer(rb"\d+(\.\d+)?(e-?\d+)?", data))
                if found:
                    one = found[rng.integers(len(found))]
                    number = NUMBERS[rng.integers(len(NUMBERS))]
                    data = data[: one.start()] + number + data[one.end() :]
    return data


def events_file(name, format=None):
    def make(folder):
        triggers = Triggers(np.array([50, 90]), np.zeros(2, np.uint8), np.array([1, -1], np.int8))
        events = random_events(300, 64, 48, model=MODEL)
        kept = {"origin": {"seed": 3, "lens": "8 mm"}}
        if format != "text":
            kept["triggers"] = triggers
        write_events(folder / name, events, format=format, **kept)
        return folder / name

    return make


def csv_events(folder):
    lines = (
        f"{t},{x},{y},{p}" for t, x, y, p in zip(*random_events(200, 64, 48).columns, strict=True)
    )
    (folder / "a.csv").write_text("t_us,x,y,p\n" + "\n".join(lines) + "\n")
    return folder / "a.csv"


def aedat3_events(folder):
    events = random_events(200, 346, 260)
    head = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: DAVIS346B\r\n#!END-HEADER\r\n"
    packet = np.array([1 << 16 | 1, 8, 4, 0, 200, 200, 200], "<i4").tobytes()
    words = events.x.astype("<u4") << 17 | events.y.astype("<u4") << 2 | (events.p > 0) * 2 + 1
    each = np.stack([words, events.t_us.astype("<u4")], axis=1).astype("<u4")
    (folder / "a.aedat").write_bytes(head + packet + each.tobytes())
    return folder / "a.aedat"


def faery_events(kind):
    def make(folder):
        events = random_events(300, 64, 48, mean_us=30)
        packet = np.empty(len(events), faery.EVENTS_DTYPE)
        packet["t"], packet["x"], packet["y"] = events.t_us, events.x, events.y
        packet["on"] = events.p > 0
        faery.events_stream_from_array(packet, (64, 48)).to_file(folder / f"a.{kind}")
        return folder / f"a.{kind}"

    return make


def bag_events(folder):
    return write_bag(folder / "a.bag", {"/dvs/events": random_events(200, 64, 48, mean_us=30)})


def windows(path):
    with DsecReader(path) as reader:
        for start_us in range(0, 200, 50):
            reader.between(start_us, start_us + 50)


def text_file(name, text):
    def make(folder):
        (folder / name).write_text(text)
        return folder / name

    return make


def one_row(**changes):
    return Row(
        *("carpet", "reconstruction", "event_integration"),
        **{"width": 346, "cutoff_hz": 200.0, "contrast_threshold": 0.2, "speed": 1.0, "sample": 0},
        **{"metric": "psnr_db", "value": 17.7, "event_rate_hz": 3.1e6},
        **changes,
    )


def rows(folder):
    write_rows(folder / "rows.parquet", [one_row() for _ in range(20)])
    return folder / "rows.parquet"


def detections(folder):
    corners = np.arange(40.0).reshape(5, 4, 2)
    found = Detections(np.arange(5), np.arange(5), corners, np.full(5, 0.3), "frame")
    write_detections(folder / "a.parquet", found)
    return folder / "a.parquet"


def slider(folder):
    readings = Slider(np.arange(0.0, 9e5, 1e5), np.arange(9.0) / 100)
    (folder / "slider.csv").write_text(slider_text(readings))
    return folder / "slider.csv"


def calibrated(kind):
    def make(folder):
        write_camera(folder / "a.yaml", Camera(640, 480, fx=400.0, fy=410.0), kind)
        return folder / "a.yaml"

    return make


def path_file(folder):
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, 2, 3], poses[:, 0, 3] = 1.0, np.arange(5) / 10
    poses[:, 1, 1] = poses[:, 2, 2] = -1.0
    (folder / "path.txt").write_text(tum_text(np.arange(5) / 4, poses))
    return folder / "path.txt"


def walk(file):
    path = load_scene("carpet", file).trajectory()
    path.pose(np.linspace(0.0, path.duration_s, 7))


def scene(name):
    def make(folder):
        ball = '<shape type="sphere" id="ball">'
        mesh = '<shape type="ply"><string name="filename" value="$mesh.ply"/></shape>'
        ply(folder)
        room_folder(folder, (ball, f'<default name="mesh" value="a"/>{mesh}{ball}'))
        return folder / name

    return make


def sequence(name):
    def make(folder):
        t_s = np.array([0.0, 0.1, 0.125])
        manifest = Manifest(
            version=FORMAT_VERSION,
            complete=False,
            **dict.fromkeys(("scene", "scene_source"), "carpet"),
            **dict.fromkeys(("scene_digest", "light_digest"), "0" * 64),
            **{"clip": 0, "width": 6, "height": 4, "fov_rad": 1.0, "t_s": tuple(t_s.tolist())},
            **{"window_s": (0.1, 0.125), "white_level": 0.9, "spp": 16, "seed": 0},
            **{"max_displacement_px": 0.5, "integrator": "baked", "variant": "scalar_mono"},
            mitsuba="3.9.1",
        )
        controls = np.tile(np.eye(4), (5, 1, 1))
        controls[:, 0, 3] = np.linspace(-0.1, 0.3, 5)
        writer = SequenceWriter(folder, manifest, Trajectory(controls[:, 0, 3], controls))
        for k in range(3):
            writer.write(k, np.full((4, 6), k + 0.5, np.float16))
        writer.finish()
        return folder / name

    return make


def whole_sequence(file):
    opened = open_sequence(file.parent if file.parent.name != "frames" else file.parents[1])
    assert len(list(opened)) == 3


def ply(folder):
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 4\n"
    head += "".join(f"property float {name}\n" for name in "xyz")
    head += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    faces = b"".join(b"\x03" + np.array(f, "<i4").tobytes() for f in ([0, 1, 2], [0, 2, 3]))
    (folder / "a.ply").write_bytes(head.encode() + np.arange(12, dtype="<f4").tobytes() + faces)
    return folder / "a.ply"


def exr(folder):
    light = np.random.default_rng(0).random((9, 12)).astype(np.float16)
    write_channels(folder / "a.exr", dict.fromkeys("RGB", light))
    return folder / "a.exr"


def picture(name, shape=(16, 24, 3), kind=np.uint8):
    def make(folder):
        codes = np.random.default_rng(0).integers(0, 200, shape).astype(kind)
        if shape[2:] == (4,):
            Image.fromarray(codes).save(folder / name)
        else:
            cv2.imwrite(str(folder / name), codes)
        return folder / name

    return make


def see(file):
    next(images.read_images([file]))
    images.has_transparency(file)


def clip(name, codec, pixels):
    def make(folder):
        with av.open(str(folder / name), "w") as container:
            stream = container.add_stream(codec, rate=50)
            stream.height, stream.width, stream.pix_fmt = 32, 48, pixels
            container.metadata["title"] = "made by a test"
            for k in range(5):
                codes = np.full((32, 48, 3), 40 * k, np.uint8)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(codes, format="rgb24")))
            container.mux(stream.encode())
        return folder / name

    return make


def watch(file):
    video.tagged_encoding(file, None)
    for _ in video.read_frames(file, len(video.times_ns(file, None))):
        pass


def frames_of(name, text):
    def make(folder):
        for k in range(2):
            cv2.imwrite(str(folder / f"{k}.png"), np.full((8, 8), 99, np.uint8))
        return text_file(name, text)(folder)

    return make


def checkpoint(folder):
    torch = pytest.importorskip("torch")
    torch.save({"network": {"weight": torch.ones(3, 4)}, "step": 3}, folder / "a.pt")
    return folder / "a.pt"


def weights(file):
    from tasks.learned.checkpoint import read_checkpoint, tensors_of

    tensors_of(read_checkpoint(file)["network"], file)


def study(folder):
    config = {"render": {"spp": 16, "resolution": 1280}, "simulate": {"widths": [128, 346]}}
    text = json.dumps({"name": "a", "jobs": ["a"], "title": "\ud800", **config})
    (folder / "study.json").write_text(text)
    return folder / "study.json"


CAMERA = """title = "mine"
[threshold_on]
value = 0.1
unit = "log"
source = "measured"
[cutoff]
value = 0.2
unit = "kHz"
source = "measured"
interval = [0.1, 0.3]
"""
STUDY = """scenes = ["carpet", "rocks"]
[render]
resolution = 1280
spp = 16
[simulate]
widths = [128, 346]
cutoffs_hz = [inf, 50.0]
speeds = [1.0, 2]
[evaluate.flow]
"""
PATHS = {"a": "t_us_start,t_us_end,file\n0,10,0.png\n20,30,1.png\n"}


def info(path):
    describe(path, format=None, reading=AS_STORED)


READERS = {
    "dsec": (events_file("a.h5"), info),
    "dsec windows": (events_file("a.h5"), windows),
    "evt3": (events_file("a.raw"), info),
    "evt2": (events_file("a.raw", "evt2"), info),
    "npz": (events_file("a.npz"), info),
    "text": (events_file("a.txt", "text"), info),
    "csv": (csv_events, info),
    "aedat3": (aedat3_events, info),
    "aedat4": (faery_events("aedat4"), info),
    "dat": (faery_events("dat"), info),
    "es": (faery_events("es"), info),
    "bag": (bag_events, info),
    "camera": (text_file("a.toml", CAMERA), read_event_camera),
    "study": (text_file("a.toml", STUDY), read_study),
    "study of a run": (study, lambda file: read_config(file.parent)),
    "rows": (rows, read_rows),
    "detections": (detections, read_detections),
    "slider": (slider, read_slider),
    "opencv": (calibrated("opencv"), read_camera),
    "kalibr": (calibrated("kalibr"), read_camera),
    "path": (path_file, walk),
    "scene.xml": (scene("scene.xml"), lambda file: load_scene(file.parent)),
    "scene.toml": (scene("scene.toml"), lambda file: load_scene(file.parent)),
    "manifest": (sequence("manifest.json"), whole_sequence),
    "poses": (sequence("poses.txt"), whole_sequence),
    "knots": (sequence("path.txt"), whole_sequence),
    "frame": (sequence("frames/000001.exr"), whole_sequence),
    "ply": (ply, check_faces),
    "exr": (exr, read_luminance),
    "exr image": (exr, see),
    "png": (picture("a.png"), see),
    "png 16": (picture("a.png", (16, 24), np.uint16), see),
    "jpeg": (picture("a.jpg"), see),
    "tiff": (picture("a.tif"), see),
    "tiff alpha": (picture("a.tif", (16, 24, 4)), see),
    "mkv": (clip("a.mkv", "ffv1", "yuv444p"), watch),
    "mp4": (clip("a.mp4", "mpeg4", "yuv420p"), watch),
    "exposures": (text_file("frames.csv", PATHS["a"]), lambda file: read_exposures(file.parent)),
    "list": (
        frames_of("images.txt", "0.0 0.png\n0.1 1.png\n"),
        lambda file: open_frames(file.parent, time_unit="s"),
    ),
    "times": (
        frames_of("timestamps.txt", "# unit: us\n0\n100\n"),
        lambda file: open_frames(file.parent),
    ),
    "calibration": (
        text_file("calib.txt", "200 200 31 23 0.1 0.01 0 0 0\n"),
        lambda file: read_calibration(file, (64, 48)),
    ),
    "steps": (text_file("steps.txt", "10\n200 # second\n"), lambda f: read_steps(str(f), f)),
    "checkpoint": (checkpoint, weights),
}


@pytest.mark.parametrize("name", READERS)
def test_a_mutated_file_reads_or_is_named(name, tmp_path):
    """Promise: no mutation of a file is a traceback, or takes more than seconds and a gigabyte."""
    make, read = READERS[name]
    path = make(tmp_path)
    data = path.read_bytes()
    read(path)
    rng = np.random.default_rng(SEED)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for k in range(MUTATIONS):
        path.write_bytes(mutated(data, rng))
        start = time.monotonic()
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            try:
                read(path)
            except (SensorError, EventError, RenderError, TaskError, OSError) as error:
                said = str(error)
                assert str(path.parent) in said or path.name in said, (k, said)
        # Pillow warns of odd tags.
        ours = [str(one.message) for one in warned if one.category is not UserWarning]
        assert not ours, (k, ours)
        assert time.monotonic() - start < MAX_S, k
        grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak)
        assert grown < MAX_BYTES, (k, grown)
