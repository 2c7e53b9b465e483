"""Damaged images of a scene cause one line that names the file; Mitsuba would end the process."""

import os
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


@pytest.mark.parametrize("damage", ["cut", "flipped"])
def test_a_damaged_image_is_named(tmp_path, damage):
    """Promise: exit code 1, our own line, and no other output."""
    image, xml, poses = (tmp_path / name for name in ("red.exr", "mine.xml", "poses.txt"))
    smooth = np.tile(np.linspace(0, 1, 64, dtype=np.float32)[:, None], (64, 1, 3))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
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
    command = [sys.executable, "-c", "from tasks.cli import main; main()", "render", xml]
    options = ["--trajectory", poses, "--out", tmp_path / "out", "--resolution", "8"]
    run = subprocess.run(
        [*command, *options, "--continuous"], capture_output=True, text=True, env=dict(os.environ)
    )
    assert (run.returncode, run.stdout) == (1, ""), run.stderr
    (line,) = run.stderr.splitlines()
    assert line.startswith(f"error: {image}: found {len(data)} bytes that OpenEXR cannot read")


def test_what_others_print_while_a_missing_image_is_looked_for_is_not_lost(tmp_path, monkeypatch):
    """Promise: a render looks for its next frames in threads, and silences the process, as OpenEXR
    prints its errors, only for files that exist."""
    monkeypatch.setattr(exr, "_silence", lambda: pytest.fail("the process was silent"))
    with pytest.raises(RenderError, match=r"lost\.exr: missing"):
        exr.read_luminance(tmp_path / "lost.exr")
