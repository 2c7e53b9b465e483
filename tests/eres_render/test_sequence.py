"""Sequences on disk: the reader refuses every kind of damage and names the file and the finding."""

import hashlib
import json
import shutil
import subprocess
import sys

import numpy as np
import OpenEXR
import pytest

from eres_render import SequenceError, Trajectory, open_sequence
from eres_render.sequence.manifest import FORMAT_VERSION, Manifest
from eres_render.sequence.sequence import SequenceWriter
from eres_render.storage.exr import RenderError, write_luminance

T_S = (0.1, 0.11, 0.125)
KNOTS_S = 0.1 * np.arange(-1.0, 4.0)


@pytest.fixture(scope="module")
def pristine(tmp_path_factory):
    """Write a sequence of three 6 x 4 frames with known values."""
    folder = tmp_path_factory.mktemp("sequences") / "pristine"
    manifest = Manifest(
        version=FORMAT_VERSION,
        complete=False,
        scene="carpet",
        scene_source="carpet",
        scene_digest="0" * 64,
        light_digest="1" * 64,
        clip=0,
        width=6,
        height=4,
        fov_rad=1.0,
        t_s=T_S,
        window_s=(0.11, 0.125),
        white_level=0.9,
        spp=16,
        seed=0,
        max_displacement_px=0.5,
        integrator="baked",
        variant="llvm_ad_mono",
        mitsuba="3.9.1",
    )
    controls = np.tile(np.eye(4), (5, 1, 1))
    controls[:, 0, 3] = KNOTS_S  # it moves along x at 1 m/s
    writer = SequenceWriter(folder, manifest, Trajectory(KNOTS_S, controls))
    for i in range(3):
        assert writer.read(i) is None
        writer.write(i, np.full((4, 6), i + 0.5, np.float16))
        assert np.array_equal(writer.read(i), np.full((4, 6), i + 0.5))
    writer.finish()
    return folder


@pytest.fixture
def folder(pristine, tmp_path):
    """Copy the sequence, for a test to damage."""
    shutil.copytree(pristine, tmp_path / "sequence")
    return tmp_path / "sequence"


def overwrite(folder, i, radiance):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels = {"Y": np.asarray(radiance, dtype=np.float16)}
    OpenEXR.File(header, channels).write(str(folder / "frames" / f"{i:06d}.exr"))


def edit_manifest(folder, **changes):
    file = folder / "manifest.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))


def test_a_sequence_reads_back_as_written(folder):
    sequence = open_sequence(folder)
    assert len(sequence) == 3
    np.testing.assert_array_equal(sequence.t_s, T_S)
    assert sequence.t_s.dtype == np.float64
    assert (sequence.camera.width, sequence.camera.height) == (6, 4)
    assert (sequence.white_level, sequence.window_s) == (0.9, (0.11, 0.125))
    np.testing.assert_allclose(sequence.T_world_cam[:, 0, 3], T_S, atol=1e-15)
    assert not sequence.is_continuous
    edit_manifest(folder, window_s=[T_S[0], T_S[-1]])
    assert not open_sequence(folder).is_continuous  # a clip without a warm-up, not from time 0
    frames = list(sequence)
    assert all(frame.shape == (4, 6) and frame.dtype == np.float32 for frame in frames)
    assert [float(frame[0, 0]) for frame in frames] == [0.5, 1.5, 2.5]
    with pytest.raises(IndexError):
        sequence.frame(3)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.nan, r"000001\.exr: found nan at pixel \(2, 3\), and 1 bad values in all"),
        (np.inf, r"000001\.exr: found inf at pixel \(2, 3\)"),
        (-0.25, r"000001\.exr: found -0\.25 at pixel \(2, 3\)"),
    ],
)
def test_values_that_are_no_radiance_are_refused(folder, value, message):
    radiance = np.ones((4, 6))
    radiance[3, 2] = value
    overwrite(folder, 1, radiance)
    sequence = open_sequence(folder)
    sequence.frame(0)
    with pytest.raises(SequenceError, match=message):
        sequence.frame(1)


def test_a_damaged_frame_is_named_even_if_it_still_decodes(folder):
    overwrite(folder, 1, np.full((4, 6), 1.25))
    sequence = open_sequence(folder)
    sequence.frame(0)
    with pytest.raises(SequenceError, match=r"000001\.exr: has changed since it was rendered"):
        sequence.frame(1)


def test_checksums_are_those_of_sha256sum(folder):
    lines = (folder / "SHA256SUMS").read_text().splitlines()
    names = [f"frames/{i:06d}.exr" for i in range(3)]
    expected = [f"{hashlib.sha256((folder / n).read_bytes()).hexdigest()}  {n}" for n in names]
    assert lines == expected
    (folder / "SHA256SUMS").write_text("\n".join(lines[:2]) + "\n" + lines[2][:70])  # torn
    with pytest.raises(SequenceError, match=r"SHA256SUMS: has no line for frames/000002\.exr"):
        open_sequence(folder)


def test_damaged_checksums_are_an_error_that_names_the_frame(folder):
    """Promise: bytes that are no text lose their line, not the program."""
    sums = folder / "SHA256SUMS"
    damaged = bytearray(sums.read_bytes())
    damaged[damaged.index(b"000001.exr")] = 0xFF
    sums.write_bytes(damaged)
    with pytest.raises(SequenceError, match=r"SHA256SUMS: has no line for frames/000001\.exr"):
        open_sequence(folder)


def test_the_path_between_the_frames_is_kept(folder):
    path = open_sequence(folder).trajectory
    assert path.duration_s == pytest.approx(0.2)
    np.testing.assert_allclose(path.pose(0.117)[:3, 3], [0.117, 0, 0], atol=1e-15)
    text = (folder / "path.txt").read_text()
    (folder / "path.txt").write_text(text.replace("\n0.1 0.1 ", "\n0.1 0.2 "))
    with pytest.raises(SequenceError, match=r"path\.txt: the path misses the poses"):
        open_sequence(folder)
    (folder / "path.txt").unlink()
    with pytest.raises(SequenceError, match=r"path\.txt: no such file"):
        open_sequence(folder)


def test_a_frame_of_another_size_is_refused(folder):
    overwrite(folder, 2, np.ones((6, 4)))
    with pytest.raises(SequenceError, match=r"000002\.exr: found 4x6 pixels, expected 6x4"):
        list(open_sequence(folder))


@pytest.mark.parametrize("kept_bytes", [0, 4, 100, -5])
def test_a_truncated_frame_is_refused(folder, kept_bytes):
    file = folder / "frames" / "000001.exr"
    file.write_bytes(file.read_bytes()[:kept_bytes])
    with pytest.raises(SequenceError, match=r"000001\.exr: found \d+ bytes that OpenEXR cannot"):
        open_sequence(folder).frame(1)


def test_only_we_say_that_a_frame_is_damaged(folder):
    """Promise: OpenEXR's own messages about damage do not appear next to our error."""
    for i, kept_bytes in ((1, 4), (2, -5)):
        file = folder / "frames" / f"00000{i}.exr"
        file.write_bytes(file.read_bytes()[:kept_bytes])
    code = (
        "import sys; from eres_render import open_sequence, SequenceError\n"
        "print('before')\n"
        "for i in (1, 2):\n"
        "    try: open_sequence(sys.argv[1]).frame(i)\n"
        "    except SequenceError: print('refused')\n"
        "print('after', file=sys.stderr)\n"
    )
    run = subprocess.run([sys.executable, "-c", code, folder], capture_output=True, text=True)
    assert (run.stdout, run.stderr) == ("before\nrefused\nrefused\n", "after\n")


def test_a_color_image_is_no_radiance_frame(folder):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    red = np.ones((4, 6), dtype=np.float16)
    OpenEXR.File(header, {"R": red}).write(str(folder / "frames" / "000001.exr"))
    with pytest.raises(SequenceError, match="found channels R, expected Y, or R, G and B"):
        open_sequence(folder).frame(1)


def test_a_missing_frame_is_named_at_once(folder):
    (folder / "frames" / "000001.exr").unlink()
    with pytest.raises(SequenceError, match=r"000001\.exr: missing .*1 of 3"):
        open_sequence(folder)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t_s": [0.1, 0.125, 0.11]}, r"t_s: found \[0\.125, 0\.11\] at frame 1, .*increasing"),
        ({"t_s": [0.1, 0.1, 0.125]}, r"t_s: found \[0\.1, 0\.1\] at frame 0"),
        ({"t_s": [0.1, "x", 0.125]}, r"t_s\[1\]: found 'x', expected a number"),
        ({"t_s": [0.1, 0.111, 0.125]}, r"poses\.txt: its 3 poses have other times"),
        ({"version": 1}, r"manifest\.json: version: found 1, expected 2; render it again"),
        ({"version": 3, "moon": 1}, "version: found 3, expected 2; update eres to read it"),
        ({"complete": False}, "the render is unfinished"),
        ({"white_level": 0.0}, r"white_level: found 0\.0"),
        ({"window_s": [0.11, 0.2]}, r"window_s: found \(0\.11, 0\.2\), expected a stretch within"),
        ({"color": "red"}, r"manifest\.json: color: unknown"),
        ({"width": "6"}, r"manifest\.json: width: found '6', expected an integer"),
    ],
)
def test_a_manifest_that_cannot_be_is_refused(folder, changes, message):
    edit_manifest(folder, **changes)
    with pytest.raises(SequenceError, match=message):
        open_sequence(folder)


def test_missing_and_damaged_text_files_are_refused(folder, tmp_path):
    with pytest.raises(SequenceError, match=r"nowhere/manifest\.json: no such file"):
        open_sequence(tmp_path / "nowhere")
    footage = tmp_path / "footage"
    footage.mkdir()
    (footage / "0.png").touch()
    with pytest.raises(SequenceError, match=r"footage: found images, .* `eres simulate`"):
        open_sequence(footage)
    (folder / "poses.txt").unlink()
    with pytest.raises(SequenceError, match=r"poses\.txt: no such file"):
        open_sequence(folder)
    (folder / "manifest.json").write_text('{"version": 2')
    with pytest.raises(SequenceError, match=r"manifest\.json: could not be read as JSON"):
        open_sequence(folder)


def test_radiance_beyond_half_precision_is_refused_not_clipped(tmp_path):
    with pytest.raises(RenderError, match=r"pixel x=\d+ y=\d+: found .* the limit of half-floats"):
        write_luminance(tmp_path / "bright.exr", np.full((2, 2), 1e6))
    assert list(tmp_path.iterdir()) == []
