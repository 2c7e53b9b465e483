"""Pictures, videos, a page and recordings of events and rendered clips."""

import base64
import io
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from browser import LOW_CONTRAST, watched
from eres_render import Camera, ground_truth, load_scene, open_sequence, render_scene
from eres_render.progress import silent
from event_streams import make_events, random_events
from light_scenes import small_carpet_folder
from moving_objects import FLOOR, SPHERE, folder_of, moved, write_path
from sensor import SensorModel, to_linear
from sensor.formats import Header, load_events, read_header, write_events
from tasks.errors import TaskError
from tasks.events.reading import AS_STORED
from tasks.recording.recording import Recording, open_recording
from tasks.view.clip import ClipFrames, DepthSource, FlowSource
from tasks.view.drawing import (
    PALETTES,
    depth_colors,
    draw_events,
    flow_colors,
    plain,
    resized,
    tone_mapped,
)
from tasks.view.files import possible_fps, write_mp4
from tasks.view.layout import Layout, Panel
from tasks.view.look import Look
from tasks.view.player import pack_frames
from tasks.view.subject import EventSource, _rendered, last_events, open_subject
from tasks.view.view import _small_enough

COLORS = PALETTES["blue-red"]
WAYPOINTS = """[path]
kind = "waypoints"
seed = 0
duration_s = 0.02
mean_speed_mps = 0.5
min_clearance_m = 0.1
up = [0.0, 1.0, 0.0]
sway_m = [0.0, 0.0, 0.0]
turn_deg = [0.0, 0.0, 0.0]
waypoints = [
  { position_m = [0.0, 0.0, 3.0], target_m = [0.0, 0.0, 0.0] },
  { position_m = [1.0, 0.0, 3.0], target_m = [1.0, 0.0, 0.0] },
]"""


def mixed(color, ground, strength):
    return [round(c * strength + g * (1 - strength)) for c, g in zip(color, ground, strict=True)]


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """Return the folder of 0.2 s of a small carpet."""
    folder = tmp_path_factory.mktemp("view")
    scene = load_scene(small_carpet_folder(folder / "carpet"))
    options = {"resolution": 48, "spp": 1, "max_displacement_px": 1.0, "continuous": True}
    (sequence,) = render_scene(scene, folder / "clip", duration_s=0.2, **options)
    return sequence.folder


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Return a file of 4000 events of 64x48 px in 200 ms."""
    file = tmp_path_factory.mktemp("events") / "events.h5"
    write_events(file, random_events(4000, 64, 48, mean_us=50.0))
    return file


# Drawing


@pytest.mark.parametrize("palette", PALETTES.values(), ids=PALETTES)
def test_a_pixel_has_the_color_of_the_sum_of_its_polarities(palette):
    """Promise: brighter and darker have their colors, more opaque up to a sum of 3; what cancels
    and what did not fire shows the ground."""
    x = [0] + [1] * 2 + [2] * 3 + [3] * 5 + [4] * 2 + [0] * 3
    y = [0] * 13 + [1] * 3
    p = [1] + [1] * 2 + [1] * 3 + [1] * 5 + [1, 0] + [1, 0, 0]
    picture = draw_events(
        make_events(range(16), x, y, p, 6, 2), plain(6, 2, palette.ground), palette
    )
    brighter = [mixed(palette.brighter, palette.ground, s) for s in (0.65, 0.85, 1.0, 1.0)]
    darker = mixed(palette.darker, palette.ground, 0.65)
    nothing = list(palette.ground)
    assert picture.tolist() == [[*brighter, nothing, nothing], [darker] + 5 * [nothing]]


def test_events_are_drawn_over_a_picture():
    ground = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    picture = draw_events(make_events([5], [1], [0], [0], 2, 2), ground, COLORS)
    assert picture[0, 1].tolist() == mixed(COLORS.darker, ground[0, 1].tolist(), 0.65)
    picture[0, 1] = ground[0, 1]
    np.testing.assert_array_equal(picture, ground)


@pytest.mark.parametrize("size", [(2, 3), (1, 1), (3, 3)])
def test_a_picture_of_another_size_is_refused(size):
    """Promise: no event is drawn outside of the picture, nor at another place in it."""
    events = make_events([5], [2], [1], [0], 3, 2)
    with pytest.raises(TaskError, match=r"ground: .* \(2, 3, 3\)"):
        draw_events(events, plain(*size, COLORS.ground), COLORS)


def test_light_has_a_gamma_and_ends_at_white():
    light = np.array([[0, 0.5, 1, 9]], np.float32)
    assert tone_mapped(light, 1.0)[0, :, 0].tolist() == [0, round(255 * 0.5 ** (1 / 2.2)), 255, 255]


def test_depth_is_even_in_its_inverse_and_nothing_is_black():
    """Promise: the ends of the scale have the end colors of viridis."""
    picture = depth_colors(np.array([[4.0, 1.0, 1.6, np.inf, 99.0]]), 1.0, 4.0)[0].tolist()
    assert picture[0] == [68, 1, 84]
    assert picture[1] == [253, 231, 37]
    assert picture[2] == [33, 145, 140]  # 1 / 1.6 is in the middle of 1 / 4 and 1
    assert picture[3] == [0, 0, 0]
    assert picture[4] == picture[0]


def test_flow_has_its_direction_as_hue_and_its_length_as_saturation():
    flow = np.array([[[2, 0], [-2, 0], [0, 0], [1, 0], [9, 0], [-1, 3**0.5]]], float)
    assert flow_colors(flow, 2.0)[0].tolist() == [
        [255, 0, 0],
        [0, 255, 255],
        [255, 255, 255],
        [255, 128, 128],
        [255, 0, 0],
        [0, 255, 0],  # 120 degrees
    ]


def test_pixels_become_squares_or_means():
    picture = np.array([[[0] * 3, [200] * 3]], np.uint8)
    assert resized(picture, 4, 2)[..., 0].tolist() == 2 * [[0, 0, 200, 200]]
    assert resized(picture, 1, 1)[0, 0, 0] == 100


def test_captions_change_and_the_page_keeps_its_size():
    """Promise: videos need it; longer numbers are cut off, never drawn over the next picture."""
    layout = Layout([(40, 30), (40, 30)], (500, 500), COLORS, height=61)
    picture = plain(40, 30, COLORS.ground)
    first = layout.draw([Panel(picture, "a", "1"), Panel(picture, "b", "2")], "now")
    later = layout.draw([Panel(picture, "a" * 99, "1" * 99), Panel(picture, "", "")], "now " * 9)
    assert first.shape == later.shape
    assert all(side % 2 == 0 for side in first.shape[:2])
    rows = slice(61 + 4, 61 + 4 + 2 * 17)  # two lines of captions
    assert (later[rows, :77] != 255).any()
    assert np.all(later[rows, 81:] == 255)


# Windows


def test_a_number_of_events_ends_before_its_time():
    events = make_events([10, 20, 20, 30], *np.zeros((3, 4)))
    found = [part.t_us.tolist() for part in last_events([events], [5, 20, 31], 3)]
    assert found == [[], [10], [20, 20, 30]]


@given(
    times=st.lists(st.integers(0, 60), max_size=40).map(sorted),
    cuts=st.lists(st.integers(0, 40), max_size=5).map(sorted),
    ends=st.lists(st.integers(0, 80), max_size=12).map(sorted),
    count=st.integers(1, 30),
)
def test_windows_do_not_depend_on_the_parts_of_a_file(times, cuts, ends, count):
    """Promise: any division of the stream gives the last events before each time."""
    events = make_events(times, *np.zeros((3, len(times))))
    bounds = [0, *(min(cut, len(times)) for cut in cuts), len(times)]
    parts = [events[a:b] for a, b in pairwise(bounds)]
    found = [part.t_us.tolist() for part in last_events(parts, ends, count)]
    assert found == [[t for t in times if t < end][-count:] for end in ends]


def test_the_span_counts_events_from_start_to_before_end(tmp_path):
    file = tmp_path / "few.npz"
    write_events(file, make_events([3, 5, 5, 9, 12], *np.zeros((3, 5))))
    for span_us, expected in (((-99, 99), (3, 13, 5)), ((5, 12), (5, 10, 3))):
        part = open_recording(file, span_us=span_us)
        assert (part.start_us, part.end_us, part.count) == expected
        assert sum(map(len, part.parts())) == part.count
    with pytest.raises(TaskError, match="has no events"):
        open_recording(file, span_us=(13, 99))


# Files


def test_a_png_is_one_picture_at_its_time(eres, tmp_path):
    """Promise: a window ends at --at; small sensors grow by an integer factor; captions below."""
    file, out = tmp_path / "few.npz", tmp_path / "few.png"
    write_events(
        file, make_events([0, 9999, 10000, 20000], [0, 1, 2, 3], [0] * 4, [1, 0, 1, 1], 8, 6)
    )
    assert eres("view", file, "--out", out, "--at", "0.01")[0] == 0
    picture = np.asarray(Image.open(out))
    assert picture.shape[1] == 8 * 60
    row = picture[30, 30 : 8 * 60 : 60].tolist()
    blue, red = (mixed(c, COLORS.ground, 0.65) for c in (COLORS.brighter, COLORS.darker))
    assert row == [blue, red, *(6 * [list(COLORS.ground)])]
    assert picture.shape[0] > 360
    assert np.all(picture[357:360, 3] == COLORS.ground)
    assert np.all(picture[360, :] == COLORS.page)
    assert (picture[360:] < 128).any()


def test_events_before_the_start_are_left_out(eres, tmp_path):
    """Promise: windows do not reach back over --start, whether a length or a number of events."""
    file = tmp_path / "few.npz"
    write_events(file, make_events([0, 9000, 12_000], [0, 1, 2], [0] * 3, [1, 1, 1], 8, 6))
    for name, window in (("length", ["--window", 50]), ("count", ["--count", 9])):
        out = tmp_path / f"{name}.png"
        code, _, err = eres("view", file, "--out", out, "--start", 0.01, "--at", 0.012001, *window)
        assert code == 0, err
        row = np.asarray(Image.open(out))[30, 30 : 8 * 60 : 60].tolist()
        blue, none = mixed(COLORS.brighter, COLORS.ground, 0.65), list(COLORS.ground)
        assert row == [none, none, blue, *(5 * [none])]


def test_a_file_of_one_event_shows_it(eres, tmp_path):
    """Promise: the middle of the file lies after its only event."""
    file, out = tmp_path / "one.h5", tmp_path / "one.png"
    write_events(file, make_events([5000], [1], [0], [1], 3, 2))
    assert eres("view", file, "--out", out)[0] == 0
    picture = np.asarray(Image.open(out))[90, [90, 270, 450]].tolist()
    ground = list(COLORS.ground)
    assert picture == [ground, mixed(COLORS.brighter, COLORS.ground, 0.65), ground]


def test_names_of_videos_may_have_colons(tmp_path, monkeypatch):
    """Promise: a name such as 12:30.mp4 is a file's, not that of a protocol of FFmpeg."""
    monkeypatch.chdir(tmp_path)
    write_mp4(Path("12:30.mp4"), iter([np.zeros((32, 48, 3), np.uint8)] * 2), 25)
    assert os.listdir() == ["12:30.mp4"]


def test_no_picture_is_shorter_than_browsers_show():
    """Promise: of shorter ones they make 100 ms, ten times too long."""
    found = [possible_fps(kind, 300) for kind in (".gif", ".webp", ".mp4")]
    assert found == [50, pytest.approx(90.9, abs=0.1), 300]


@pytest.mark.parametrize(("kind", "fps"), [(".gif", 30), (".gif", 300), (".webp", 60)])
def test_the_pace_is_that_of_the_rate_that_a_file_has(eres, tmp_path, recording, kind, fps):
    """Promise: 0.1 s of events, 10 times slower, play for a second, also if the wanted rate is not
    a whole number of the file's ticks."""
    out = tmp_path / f"out{kind}"
    options = ("--start", 0.05, "--end", 0.15, "--window", 1, "--slow", 10, "--fps", fps)
    code, _, err = eres("view", recording, "--out", out, *options, "--height", 16)
    assert code == 0, err
    with Image.open(out) as loop:
        lasted_ms = 0
        for k in range(loop.n_frames):
            loop.seek(k)
            loop.load()
            lasted_ms += loop.info["duration"]
    assert 960 <= lasted_ms <= 1020


def test_sources_are_side_by_side_at_one_height(eres, tmp_path, recording):
    """Promise: each keeps its aspect ratio, with a gap between them."""
    other = tmp_path / "wide.npz"
    write_events(other, random_events(4000, 300, 100, mean_us=50.0))
    out = tmp_path / "two.png"
    assert eres("view", recording, other, "--out", out, "--height", 96)[0] == 0
    picture = np.asarray(Image.open(out))
    assert picture.shape[1] == 128 + 8 + 288
    assert np.all(picture[:96, 128:136] == COLORS.page)
    grounds = np.all(picture[:96] == COLORS.ground, axis=2)
    assert grounds[:, :128].mean() > 0.5
    assert grounds[:, 136:].mean() > 0.5


def test_an_mp4_plays_in_slow_motion(eres, tmp_path, recording):
    """Promise: --slow and --fps decide the number of pictures; H.264 keeps their colors."""
    out = tmp_path / "events.mp4"
    options = ("--slow", 10, "--fps", 20, "--start", 0.05, "--end", 0.1, "--height", 101)
    assert eres("view", recording, "--out", out, *options)[0] == 0
    with av.open(str(out)) as video:
        stream = video.streams.video[0]
        assert (stream.codec_context.name, stream.pix_fmt) == ("h264", "yuv420p")
        assert stream.average_rate == 20
        pictures = [frame.to_ndarray(format="rgb24") for frame in video.decode(stream)]
    assert len(pictures) == 9  # 60 to 100 ms, 5 ms apart: the first window begins at the start
    assert all(side % 2 == 0 for side in pictures[0].shape[:2])
    median = np.median(pictures[4][:101, :134], axis=(0, 1))
    assert np.abs(median - COLORS.ground).max() <= 3


@pytest.mark.parametrize("kind", ["gif", "webp"])
def test_a_loop_has_its_pictures_and_times(eres, tmp_path, recording, kind):
    out = tmp_path / f"events.{kind}"
    assert eres("view", recording, "--out", out, "--slow", 5, "--height", 96)[0] == 0
    with Image.open(out) as loop:
        assert (loop.n_frames, loop.info["loop"]) == (24, 0)
        for k in range(loop.n_frames):
            loop.seek(k)
            loop.load()
            assert loop.info["duration"] == 40
        shown = np.asarray(loop.convert("RGB"))[:96, :128]
    ground = np.abs(shown.astype(int) - COLORS.ground).max(axis=2) < 12
    assert 0.5 < ground.mean() < 0.99


def test_a_loop_has_colors_that_its_first_pictures_lack(eres, tmp_path):
    """Promise: one palette has both colors of events, also if a polarity comes late."""
    rng = np.random.default_rng(0)
    t_us = np.sort(rng.integers(0, 1_000_000, 4000))
    x, y = rng.integers(0, 64, 4000), rng.integers(0, 48, 4000)
    write_events(tmp_path / "a.h5", make_events(t_us, x, y, t_us < 500_000, 64, 48))
    out = tmp_path / "a.gif"
    args = ("--fps", 10, "--slow", 1, "--window", 20, "--height", 48)
    assert eres("view", tmp_path / "a.h5", "--out", out, *args)[0] == 0
    with Image.open(out) as loop:
        loop.seek(loop.n_frames - 1)
        shown = np.asarray(loop.convert("RGB"))[:48, :64].reshape(-1, 3)
    faintest = 0.65 * np.array(COLORS.darker) + 0.35 * np.array(COLORS.ground)
    assert np.abs(shown - faintest).max(axis=1).min() <= 2
    assert np.count_nonzero(np.ptp(shown, axis=1) > 60) > 20


def test_a_video_of_any_length_plays_a_few_seconds(eres, tmp_path):
    """Promise: the default slow motion suits milliseconds and minutes."""
    for seconds in (0.02, 7.0):
        file, out = tmp_path / "any.npz", tmp_path / "any.mp4"
        count = 200
        write_events(file, random_events(count, 32, 24, mean_us=1e6 * seconds / count))
        options = "--fps", 5, "--height", 48, "--overwrite"
        assert eres("view", file, "--out", out, *options)[0] == 0
        with av.open(str(out)) as video:
            assert 3 <= video.duration * 1e-6 <= 14


# Rendered clips


def test_frames_are_those_of_the_sensor_and_its_clock(clip):
    """Promise: behind events is the last frame up to their time, cropped as the sensor sees it."""
    sequence = open_sequence(clip)
    frames = ClipFrames(sequence, speed=2.0)
    t_us = round(sequence.t_s[3] / 2 * 1e6) + 2
    expected = tone_mapped(sequence.frame(3), sequence.white_level)
    np.testing.assert_array_equal(frames.at(t_us), expected)
    seen = frames.seen_by(24, 12, t_us).astype(float)
    blocks = expected[12:36].reshape(12, 2, 24, 2, 3).mean(axis=(1, 3))
    assert np.abs(seen - blocks).max() <= 1  # Pillow rounds after rows and after columns


@pytest.mark.parametrize("options", [(), ("--fps", 250.0)])
@pytest.mark.parametrize(
    ("ending", "look"), [("webp", ("--slow", 1, "--height", 32)), ("html", ())]
)
def test_events_are_over_the_footage_they_are_of(eres, tmp_path, options, ending, look):
    """Promise: behind events is the last frame of the video up to their time, at the frame rate for
    which they were simulated."""
    levels, fps = np.arange(40, 200, 16), options[1] if options else 25.0
    video, events, out = (tmp_path / name for name in ("gray.mp4", "gray.h5", f"gray.{ending}"))
    write_mp4(video, (np.full((32, 48, 3), level, np.uint8) for level in levels), 25.0)
    assert eres("simulate", video, "--out", events, "--resolution", 48, *options)[0] == 0
    subject = open_subject(
        [events], Look(), over=video, show="frames", reading=AS_STORED, format=None,
        on_progress=silent,
    )  # fmt: skip
    (source,) = subject.event_sources
    times_us = [round(1e6 * (k + 0.5) / fps) for k in (0, 3, 4, 9, 2)]
    shown = [source.frames.at(t_us)[5, 5].tolist() for t_us in times_us]
    linear = to_linear(levels[[0, 3, 4, 9, 2]].astype(np.uint8), "rec709")
    expected = 255 * linear ** (1 / 2.2)
    np.testing.assert_allclose(shown, np.repeat(expected[:, None], 3, axis=1), atol=3)
    assert eres("view", events, "--over", video, "--out", out, *look)[0] == 0


@pytest.mark.parametrize("show", ["frames", "depth", "flow"])
def test_clips_and_events_beside_them(eres, tmp_path, clip, show):
    out = tmp_path / "clip.png"
    file = tmp_path / "events.h5"
    model = SensorModel(width=48, height=36, cutoff_hz=200.0)
    write_events(file, random_events(2000, 48, 36, mean_us=25.0, model=model))
    code, _, err = eres(
        *("view", clip, file, "--over", clip, "--show", show, "--out", out, "--height", 96)
    )
    assert code == 0, err
    picture = np.asarray(Image.open(out))[:96].astype(int)
    assert picture.shape[1] == 96 + 8 + 128
    left, right = picture[:, :96], picture[:, 104:]
    gray = [np.ptp(part, axis=2).max(axis=(0, 1)) == 0 for part in (left, right)]
    assert gray == [show == "frames", False]
    assert len(np.unique(left.reshape(-1, 3), axis=0)) > 10


def test_flow_at_the_end_of_a_path_that_goes_on(tmp_path):
    """Promise: flow at the last frame is seen backwards; the camera's spline goes on to the next
    waypoint there, and the ball's path has ended."""
    folder = folder_of(tmp_path / "ball", FLOOR, SPHERE)
    tum = 'path = { kind = "tum", file = "camera.txt", min_clearance_m = 0.1 }'
    toml = (folder / "scene.toml").read_text()
    assert tum in toml
    (folder / "scene.toml").write_text(toml.replace(tum, WAYPOINTS))
    write_path(folder / "ball.txt", (0.0, 0.02), moved(), moved(0.01))
    options = {"resolution": 16, "spp": 1, "integrator": "emission", "continuous": True}
    (sequence,) = render_scene(load_scene(folder), tmp_path / "clip", **options)
    assert sequence.trajectory.duration_s > 1.0
    source = FlowSource(ClipFrames(sequence), ground_truth(sequence))
    middle, end = (source.flow(t_us) for t_us in (19_000, 20_000))
    np.testing.assert_allclose(middle, end, atol=0.1)
    assert abs(end).max() > 1.0


@pytest.mark.parametrize(("width", "height"), [(8, 6), (32, 3), (3, 32)])
def test_a_legend_that_does_not_fit_is_left_out(tmp_path, width, height):
    """Promise: depth and flow of a few pixels are pictures, not a traceback."""
    scene = load_scene(folder_of(tmp_path / "ball", FLOOR, SPHERE))
    camera = Camera(width, height, 0.8)
    options = {"spp": 1, "integrator": "emission", "continuous": True, "duration_s": 0.1}
    options |= {"camera": camera, "max_displacement_px": 4.0}
    (sequence,) = render_scene(scene, tmp_path / "clip", **options)
    for kind in (DepthSource, FlowSource):
        source = kind(ClipFrames(sequence), ground_truth(sequence))
        pictures = [panel.picture for panel in source.panels([0, 50_000])]
        assert [picture.shape[:2] for picture in pictures] == [(height, width)] * 2


def test_events_that_were_shifted_are_beside_their_frames(eres, tmp_path, clip):
    """Promise: `eres convert --shift-us` moves the clip's clock, too; events that outlast the clip
    stay with its last depth and flow."""
    options = ["--resolution", 24, "--latency", 0.02]
    assert eres("simulate", clip, "--out", tmp_path / "a.h5", *options)[0] == 0
    assert eres("convert", tmp_path / "a.h5", tmp_path / "b.h5", "--shift-us", 30_000)[0] == 0
    found = []
    for name, at in (("a", 0.1), ("b", 0.13)):
        out = tmp_path / f"{name}.png"
        args = (tmp_path / f"{name}.h5", clip, "--over", clip, "--at", at, "--out", out)
        code, _, err = eres("view", *args)
        assert code == 0, err
        found.append(np.asarray(Image.open(out))[:360])
    np.testing.assert_array_equal(*found)
    part = tmp_path / "part.h5"  # of a stretch of the same path, whose clock is that of the path
    header = read_header(tmp_path / "a.h5")
    window = {"window_start_us": 50_000, "window_end_us": 100_000}
    events = load_events(tmp_path / "a.h5").between(50_000, 100_000)
    write_events(part, events, origin={**header.origin, **window})
    assert ClipFrames(open_sequence(clip)).path_s(90_000) == pytest.approx(0.09)
    found = [
        _rendered(open_sequence(clip), {part: read_header(file)}).path_s(90_000)
        for file in (tmp_path / "a.h5", tmp_path / "b.h5", part)
    ]
    assert found == pytest.approx([0.09, 0.06, 0.09])
    headers = {tmp_path / name: read_header(tmp_path / name) for name in ("a.h5", "b.h5")}
    with pytest.raises(TaskError, match=r"clip.*shifted by 0 us; .*shifted by 30000 us"):
        _rendered(open_sequence(clip), headers)
    for show in ("depth", "flow"):
        args = (tmp_path / "a.h5", clip, "--show", show, "--out", tmp_path / f"{show}.gif")
        code, _, err = eres("view", *args, "--start", 0.19, "--fps", 10, "--height", 48)
        assert code == 0, err


def test_times_beyond_nanoseconds_are_refused_for_rerun(eres, tmp_path):
    """Promise: what int64 nanoseconds do not hold is an error; it wrapped to other times."""
    file, out = tmp_path / "late.npz", tmp_path / "late.rrd"
    write_events(file, random_events(20, 48, 36).later(1 << 62))
    code, _, err = eres("view", file, "--out", out)
    assert (code, "late.rrd: cannot store 46116" in err) == (1, True)
    assert not out.exists()


def test_a_recording_for_rerun_has_one_clock(eres, tmp_path, clip):
    """Promise: frames, pose, depth and flow of a clip, and pictures and points of events."""
    pytest.importorskip("rerun")
    file, out = tmp_path / "events.h5", tmp_path / "all.rrd"
    write_events(file, random_events(2000, 48, 36, mean_us=25.0))
    code, _, err = eres("view", clip, file, "--out", out, "--slow", 2)
    assert code == 0, err
    rerun = Path(sys.executable).with_name("rerun")
    run = [str(rerun), "rrd"]
    assert subprocess.run([*run, "verify", out], capture_output=True).returncode == 0
    said = subprocess.run([*run, "print", "-v", out], capture_output=True, text=True).stdout
    places = ("camera", "camera/frames", "camera/depth", "camera/flow", "path")
    for place in [f"clips/{clip.name}/{name}" for name in places]:
        assert f"/{place}" in said
    for name in ("image", "points"):
        assert f"/events/events.h5/{name}" in said.replace("\\", "")


def test_files_of_one_name_have_their_own_places_in_a_recording(eres, tmp_path):
    """Promise: in a recording for Rerun, no source hides another, whatever their names."""
    pytest.importorskip("rerun")
    files = [tmp_path / folder / "my events!.h5" for folder in "ab"]
    for file in files:
        file.parent.mkdir()
        write_events(file, random_events(300, 16, 12, mean_us=100.0))
    out = tmp_path / "both.rrd"
    code, _, err = eres("view", *files, "--out", out, "--slow", 1)
    assert code == 0, err
    rerun = [str(Path(sys.executable).with_name("rerun")), "rrd", "print", "-v", out]
    said = subprocess.run(rerun, capture_output=True, text=True).stdout.replace("\\", "")
    for k in (1, 2):
        assert f"/events/my events!.h5/{k}/points" in said


def test_events_of_another_time_are_not_beside_a_clip(eres, tmp_path, clip):
    """Promise: a clip without frames in the time of the events is refused, not shown as a still."""
    file, out = tmp_path / "later.h5", tmp_path / "out.png"
    write_events(file, random_events(99, 48, 36, start_us=3_000_000))
    for sources in ((file, clip), (file, "--over", clip)):
        code, _, err = eres("view", *sources, "--out", out)
        assert (code, "time to show is 3.0000" in err, out.exists()) == (1, True, False)


def test_a_speed_that_is_no_number_matters_only_beside_a_clip(eres, tmp_path, clip):
    """Promise: the origin of a file may hold anything; its speed is checked only if it is used."""
    file, out = tmp_path / "own.npz", tmp_path / "out.png"
    write_events(file, random_events(99, 48, 36, mean_us=25.0), origin={"speed": "fast"})
    assert eres("view", file, "--out", out)[0] == 0
    for sources in ((file, clip), (file, "--over", clip)):
        code, _, err = eres("view", *sources, "--out", out, "--overwrite")
        assert (code, "origin, speed: found 'fast'" in err) == (1, True)


# Mistakes


@pytest.mark.parametrize(
    ("args", "text"),
    [
        (
            ["{events}", "--out", "{tmp}/o.png", "--window", "5", "--count", "100"],
            "give --window or --count, not both",
        ),
        (
            ["{clip}", "--out", "{tmp}/o.mp4", "--window", "5"],
            "--window: only for files of events",
        ),
        (
            ["{clip}", "--out", "{tmp}/o.rrd", "--count", "5"],
            "--count: only for files of events",
        ),
        (["{events}", "--out", "{tmp}/o.avi"], "found extension '.avi', expected one of .mp4"),
        (["{events}", "--out", "{tmp}/file.mp4"], "already exists; add --overwrite"),
        (["{events}", "--out", "{tmp}/file.mp4/o.mp4"], "found a file, expected a folder"),
        (["{tmp}/none.h5", "--out", "{tmp}/o.mp4"], "none.h5: No such file"),
        (["{tmp}/file.mp4", "--out", "{tmp}/o.mp4"], "found extension '.mp4'"),
        (["{tmp}", "--out", "{tmp}/o.mp4"], "manifest.json"),
        (["{events}", "--out", "{tmp}/o.mp4", "--start", "9"], "no events in the time"),
        (
            ["{events}", "--out", "{tmp}/o.mp4", "--start", "2", "--end", "1"],
            "--start 2 is not before --end 1",
        ),
        (["{events}", "--out", "{tmp}/o.png", "--at", "9"], "at: found 9.0"),
        (["{events}", "--out", "{tmp}/o.mp4", "--fps", "0"], "fps: found 0"),
        (["{events}", "--out", "{tmp}/o.gif", "--slow", "1000"], "exceed the 300"),
        (
            ["{events}", "--out", "{tmp}/o.mp4", "--end", "1e8"],
            "exceed the 1000000",
        ),
        (["{events}", "--out", "{tmp}/o.mp4", "--start", "nan"], "start: found nan, expected"),
        (["{events}", "--out", "{tmp}/o.png", "--at", "inf"], "at: found inf, expected"),
        (
            ["{events}", "--out", "{tmp}/o.mp4", "--at", "0.1"],
            "--at 0.1 does not apply to a .mp4 file",
        ),
        (["{events}", "--out", "{tmp}/o.html", "--count", "9"], "--count 9 does not apply"),
        (["{events}", "--out", "{tmp}/o.html", "--fps", "9"], "--fps 9.0 does not apply"),
        (["{events}", "--out", "{tmp}/o.png", "--fps", "25"], "--fps 25.0 does not apply"),
        (["{clip}", "--out", "{tmp}/o.mp4", "--start", "9"], "the time to show is 9.000000"),
        (
            ["{clip}", "--out", "{tmp}/o.mp4", "--end", "-1"],
            "to -1.000000 s",
        ),
        (["{clip}", "--out", "{tmp}/o.html"], "rendered clip"),
        (
            ["{events}", "--show", "flow", "--out", "{tmp}/o.mp4"],
            "--show flow: only for rendered clips",
        ),
        (
            ["{clip}", "--over", "{clip}", "--out", "{tmp}/o.mp4"],
            "--over: only for files of events",
        ),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(eres, tmp_path, recording, clip, args, text):
    (tmp_path / "file.mp4").write_text("in the way")
    code, _, err = eres(
        "view", *[a.format(tmp=tmp_path, events=recording, clip=clip) for a in args]
    )
    assert (code, err.startswith("error: "), text in err) == (1, True, True), err
    assert len(err.strip().splitlines()) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["file.mp4"]


@pytest.mark.parametrize(("kind", "most"), [(".mp4", 16384), (".webp", 16383), (".gif", 65535)])
def test_pictures_that_no_encoder_takes_are_refused(kind, most):
    """Promise: an error in one line, not a traceback of the encoder."""
    for shape, fits in (((2, most, 3), True), ((most + 1, 2, 3), False)):
        pictures = iter([np.broadcast_to(np.uint8(0), shape)])
        if fits:
            assert len(list(_small_enough(pictures, kind))) == 1
        else:
            with pytest.raises(TaskError, match=f"^2x{most + 1} px exceed the {most} px"):
                list(_small_enough(pictures, kind))


def test_a_damaged_file_leaves_no_video(eres, tmp_path, monkeypatch):
    """Promise: errors while drawing name the file of events, and leave no output."""
    file, out = tmp_path / "events.txt", tmp_path / "out.mp4"
    write_events(file, random_events(3000, 16, 12, mean_us=50.0))
    found = Recording(file, read_header(file), 0, 150_000, 3000)
    monkeypatch.setattr("tasks.view.subject.open_recording", lambda *_, **__: found)
    file.write_text(file.read_text() + "not an event\n")
    code, _, err = eres("view", file, "--out", out, "--fps", 5, "--height", 48)
    assert (code, "events.txt" in err) == (1, True)
    assert [p.name for p in tmp_path.iterdir()] == ["events.txt"]


def test_a_size_that_a_file_does_not_store_is_asked_for(eres, tmp_path):
    file, out = tmp_path / "bare.txt", tmp_path / "bare.png"
    file.write_text("0.001 2 1 1\n")
    code, _, err = eres("view", file, "--out", out)
    assert (code, f"{file}: the file does not store the sensor's size" in err) == (1, True)
    assert eres("view", file, "--out", out, "--size", 4, 2)[0] == 0


def test_a_camera_of_a_file_without_one(eres, tmp_path):
    """Promise: --sensor names the size and the camera of a recording; in the caption of a page."""
    file, out = tmp_path / "a.csv", tmp_path / "a.html"
    file.write_text("t_us,x,y,p\n0,1,2,1\n900,345,259,0\n")
    assert eres("view", file, "--out", out)[0] == 1
    code, _, err = eres("view", file, "--out", out, "--sensor", "davis346")
    assert (code, err, "davis346" in out.read_text()) == (0, "", True)
    code, _, err = eres("view", file, "--out", out, "--sensor", "davis364", "--overwrite")
    assert (code, "did you mean 'davis346'" in err) == (1, True)


def test_a_file_is_read_as_the_options_say(eres, tmp_path):
    """Promise: size, unit of time and sorting reach the reader; the picture is that of a file that
    needs none of them. Rendered clips do not ignore them."""
    file, stored = tmp_path / "bare.txt", tmp_path / "stored.h5"
    file.write_text("30000 2 1 1\n10000 3 0 1\n20000 1 1 0\n")
    write_events(
        stored, make_events([10_000, 20_000, 30_000], [3, 1, 2], [0, 1, 1], [1, 0, 1], 4, 2)
    )
    pictures = []
    for source, options in ((stored, ()), (file, ("--size", 4, 2, "--time-unit", "us", "--sort"))):
        out = tmp_path / f"{source.stem}.png"
        code, _, err = eres(
            "view", source, "--out", out, "--at", 0.030001, "--window", 30, *options
        )
        assert code == 0, err
        pictures.append(np.asarray(Image.open(out))[:360, :720])
    assert len(np.unique(pictures[0].reshape(-1, 3), axis=0)) == 3
    np.testing.assert_array_equal(*pictures)
    code, _, err = eres("view", file, "--out", tmp_path / "o.png", "--size", 4, 2)
    assert (code, "give their unit" in err) == (1, True)
    code, _, err = eres("view", tmp_path, "--out", tmp_path / "o.png", "--sort")
    assert (code, "--sort, --topic: only for files of events" in err) == (1, True)


def test_without_h264_another_file_is_named(eres, tmp_path, recording, monkeypatch):
    monkeypatch.setattr("av.codecs_available", {"mpeg4"})
    code, _, err = eres("view", recording, "--out", tmp_path / "o.mp4")
    assert (code, "no encoder for H.264" in err) == (1, True)
    assert not list(tmp_path.iterdir())


# The page


def row(page):
    """Return the colors of the first row of the canvas."""
    address = page.locator("canvas").evaluate("(canvas) => canvas.toDataURL()")
    picture = Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2])))
    return np.asarray(picture.convert("RGB"))[0].tolist()


@pytest.mark.slow
def test_the_page_plays_events(eres, tmp_path, chromium):
    """Promise: the slider, the keys and the window show the events that a picture shows."""
    file, out = tmp_path / "few.npz", tmp_path / "few.html"
    t_us = [0, 4000, 5000, 9000, 20000, 20000]
    events = make_events(t_us, [0, 1, 2, 3, 4, 4], [0] * 6, [1, 0, 1, 1, 1, 1], 8, 6)
    write_events(file, events)
    assert eres("view", file, "--out", out, "--window", 3)[0] == 0
    page = chromium.new_page()
    complaints = watched(page)
    page.goto(out.as_uri())
    page.wait_for_selector("html[data-ready]")
    assert page.locator("#window").input_value() == "3.0"  # which is no usual choice
    page.locator("#window").select_option("5")
    page.locator("#time").fill("5000")
    none, blue, red = (
        list(COLORS.ground),
        mixed(COLORS.brighter, COLORS.ground, 0.65),
        mixed(COLORS.darker, COLORS.ground, 0.65),
    )
    assert row(page) == [blue, red, *(6 * [none])]  # from 0 to 5 ms, without its end
    page.locator("#time").fill("9000")
    assert row(page) == [none, red, blue, *(5 * [none])]
    assert page.locator("#clock").inner_text() == "0.009000 s"
    page.keyboard.press("ArrowUp")  # 10 ms
    assert row(page)[:4] == [blue, red, blue, none]
    page.keyboard.press("ArrowRight")
    assert page.locator("#time").input_value() == "14000"
    assert row(page)[:5] == [none, red, blue, blue, none]
    page.locator("#window").select_option("1")
    page.locator("#time").fill("20001")
    assert row(page)[4] == mixed(COLORS.brighter, COLORS.ground, 0.85)
    slowest = page.locator("#slow option").last.get_attribute("value")
    page.locator("#slow").select_option(slowest)
    page.locator("#time").fill("0")
    page.keyboard.press(" ")
    page.locator("#time").fill("9000")  # it goes on from there while it plays
    page.evaluate("() => new Promise((done) => setTimeout(done, 200))")
    assert 9000 <= int(page.locator("#time").input_value()) < 19_000
    page.keyboard.press(" ")
    page.locator("#time").fill("0")
    page.locator("#slow").select_option("1")
    page.keyboard.press(" ")
    page.wait_for_function("document.getElementById('time').value === '20001'")
    assert page.get_by_role("button", name="Play").is_visible()
    page.close()
    assert complaints == []


@pytest.mark.slow
def test_the_page_shows_frames_behind_events(eres, tmp_path, clip, chromium):
    """Promise: a pixel without events shows the frame of its time, one with events their color, as
    opaque as in a picture; frames are scaled down and thinned out, so that a page stays small."""
    file, out = tmp_path / "few.h5", tmp_path / "few.html"
    write_events(file, make_events([0, 150_000], [3, 5], [0, 0], [1, 0], 48, 48))
    assert eres("view", file, "--over", clip, "--out", out, "--window", 10)[0] == 0
    page = chromium.new_page()
    complaints = watched(page)
    page.goto(out.as_uri())
    page.wait_for_selector("html[data-ready]")
    page.locator("#time").fill("150001")
    sequence = open_sequence(clip)
    shown = tone_mapped(sequence.frame(_index(sequence, 0.150001)), sequence.white_level)[0]
    expected = shown.astype(float)
    expected[5] = mixed(COLORS.darker, shown[5].tolist(), 0.65)
    found = np.array(row(page), float)
    page.close()
    assert complaints == []
    assert np.abs(found - expected).max() < 30  # of lossy pictures
    assert np.abs(found - expected).mean() < 5
    assert np.abs(found[5] - expected[5]).max() < 12


def _index(sequence, t_s):
    return int(np.searchsorted(sequence.t_s, t_s, side="right")) - 1


def test_the_frames_of_a_page_are_bounded(clip, recording, monkeypatch):
    """Promise: of too many frames every k-th is kept, frames of wide sensors are scaled down, and
    together they have no more pixels than a browser holds; each has the time of its start."""
    frames = ClipFrames(open_sequence(clip))
    source = EventSource(Recording(recording, Header(64, 48), 0, 1, 1), Look(), frames)
    every = frames.times_us(0, 200_000)
    assert len(every) >= 4
    for t_us in every:
        np.testing.assert_array_equal(frames.at(t_us), frames.at(t_us + 1))
    (all_of_them,) = pack_frames([source], (0, 200_000))
    assert all_of_them["t_us"] == every
    assert frames.times_us(every[1], every[2]) == every[1:2]
    assert frames.times_us(every[1] - 1, every[2] + 1) == every[:3]
    monkeypatch.setattr("tasks.view.player._MAX_PX", 32)
    monkeypatch.setattr("tasks.view.player.MAX_PIXELS", 2 * 32 * 24 * 3)
    for packed in pack_frames([source, source], (0, 200_000)):
        assert packed["t_us"] == every[::2]
        assert len(packed["images"]) == len(packed["t_us"])
        picture = Image.open(io.BytesIO(base64.b64decode(packed["images"][0])))
        assert (picture.format, picture.size) == ("WEBP", (32, 24))


@pytest.mark.slow
@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_fits_and_needs_no_network(eres, tmp_path, recording, chromium, width, scheme):
    out = tmp_path / "page.html"
    assert eres("view", recording, recording, "--out", out)[0] == 0
    page = chromium.new_page(viewport={"width": width, "height": 844}, color_scheme=scheme)
    complaints, addresses = watched(page), set()
    page.on("request", lambda request: addresses.add(request.url))
    page.goto(out.as_uri())
    page.wait_for_selector("html[data-ready]")
    assert addresses == {out.as_uri()}
    assert page.evaluate("document.documentElement.scrollWidth") == width
    assert page.evaluate(LOW_CONTRAST) == []
    for control in ("Time", "Window", "Slow motion"):
        assert page.get_by_label(control, exact=True).is_visible()
    page.close()
    assert complaints == []


@pytest.mark.parametrize("kind", [".html", ".png", ".rrd"])
def test_a_file_whose_name_is_not_utf_8_is_shown(eres, tmp_path, kind):
    """Promise: any kind of output; a page has the name with U+FFFD."""
    file, out = tmp_path / os.fsdecode(b"caf\xe9.npz"), tmp_path / f"out{kind}"
    write_events(file, make_events([5, 900], [1, 2], [0, 1], [0, 1], 4, 4))
    code, _, err = eres("view", file, "--out", out)
    assert (code, err) == (0, "")
    if kind == ".html":
        assert "<title>caf\N{REPLACEMENT CHARACTER}.npz" in out.read_text(encoding="utf-8")


def test_a_page_of_many_events_keeps_some_of_them(eres, tmp_path, recording, monkeypatch, caplog):
    """Promise: of too many events every k-th is kept; a message and the page say so."""
    monkeypatch.setattr("tasks.view.player.MAX_EVENTS", 1500)
    out = tmp_path / "some.html"
    assert eres("view", recording, "--out", out)[0] == 0
    assert "keeps one of every 3 events" in caplog.text
    text = out.read_text()
    assert '"count": 1334' in text
    assert "one of every 3 events" in text


@pytest.mark.parametrize("options", [[], ["--rerun", "--out", "o.mp4"]])
def test_a_file_or_the_viewer_is_asked_for(eres, recording, options):
    """Promise: it is a mistake in the command, exit code 2, before anything is read."""
    code, _, err = eres("view", recording, *options)
    assert (code, "give --out FILE" in err, "or --rerun, but not both" in err) == (2, True, True)
