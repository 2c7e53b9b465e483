"""Damaged images of a scene cause one line that names the file; Mitsuba would end the process."""

import subprocess
import sys

import numpy as np
import OpenEXR
import pytest

from eres_render import RenderError
from eres_render.storage import exr

SCENE = """<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="50"/></sensor>
<emitter type="constant"/><shape type="rectangle" id="wall"><bsdf type="diffuse">
<texture type="bitmap" name="reflectance"><string name="filename" value="red.exr"/></texture>
</bsdf></shape></scene>"""
POSES = "0 0 0 3 1 0 0 0\n0.1 0.05 0 3 1 0 0 0\n0.2 0.1 0 3 1 0 0 0\n"


# Commands, one after the other in one process; if Mitsuba ends it, the codes are not printed.
COMMANDS = """
import sys
from tasks import cli

codes = []
for scene, poses in zip(sys.argv[1::2], sys.argv[2::2], strict=True):
    options = ["--trajectory", poses, "--out", scene + ".out", "--resolution", "8", "--continuous"]
    sys.argv = ["eres", "render", scene, *options]
    try:
        cli.main()
        codes.append(0)
    except SystemExit as stop:
        codes.append(stop.code)
print(codes)
"""


@pytest.mark.slow
def test_a_damaged_image_is_named(tmp_path):
    """Promise: exit code 1, our own line, and no other output, for a truncated file and for one
    with changed bytes."""
    smooth = np.tile(np.linspace(0, 1, 64, dtype=np.float32)[:, None], (64, 1, 3))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    arguments, said = [], []
    for damage in ("cut", "flipped"):
        folder = tmp_path / damage
        folder.mkdir()
        image, xml, poses = (folder / name for name in ("red.exr", "mine.xml", "poses.txt"))
        OpenEXR.File(header, {"RGB": smooth}).write(str(image))
        data = bytearray(image.read_bytes())
        if damage == "cut":
            del data[-9:]
        else:
            for i in range(len(data) // 2, len(data) // 2 + 40):
                data[i] ^= 0xFF
        image.write_bytes(data)
        xml.write_text(SCENE)
        poses.write_text(POSES)
        arguments += [xml, poses]
        said.append(f"error: {image}: found {len(data)} bytes that OpenEXR cannot read")
    run = subprocess.run(
        [sys.executable, "-c", COMMANDS, *arguments], capture_output=True, text=True
    )
    assert (run.returncode, run.stdout) == (0, "[1, 1]\n"), run.stderr
    lines = run.stderr.splitlines()
    assert len(lines) == len(said)
    assert all(map(str.startswith, lines, said)), lines


def test_what_others_print_while_a_missing_image_is_looked_for_is_not_lost(tmp_path, monkeypatch):
    """Promise: a render looks for its next frames in threads, and silences the process, because
    OpenEXR prints its errors, only for files that exist."""
    monkeypatch.setattr(exr, "_silence", lambda: pytest.fail("the process was silent"))
    with pytest.raises(RenderError, match=r"lost\.exr: missing"):
        exr.read_luminance(tmp_path / "lost.exr")
