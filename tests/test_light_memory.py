"""Long sequences render in memory that does not grow, and that is given back."""

from pathlib import Path

import pytest

from another_process import run_python
from eres_render import load_scene
from eres_render.backend import select_variant

pytestmark = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads /proc")

RESIDENT = """
import sys
from pathlib import Path
from eres_render import *

def resident_kib():
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(l for l in lines if l.startswith("RssAnon")).split()[1])  # without files
"""

RENDER = (
    RESIDENT
    + """
at = {}
early = int(sys.argv[4])

def told(done, total):
    at["total"] = total
    if done == early:
        at["early"] = resident_kib()

renderer = Renderer(load_scene(sys.argv[1]), 64, 4)
stretch = continuous_stretch(renderer.scene, float(sys.argv[3]))
render_clip(renderer, stretch, Path(sys.argv[2]), 0.09, told)
print(at["total"], at["early"], resident_kib())
"""
)

GIVE_BACK = (
    RESIDENT
    + """
during = []
renderer = Renderer(load_scene("room"), 64, 4)
clip = Clip(0, 1.0, 1.0, 1.001)
render_clip(renderer, clip, Path(sys.argv[1]), 0.25, lambda *_: during.append(resident_kib()))
print(during[-1], resident_kib())
"""
)


def growth(folder, duration_s, early_frame):
    """Number of frames of a 64 px carpet sequence, and memory at its end over that early on."""
    load_scene("carpet").texture_files()
    run = run_python(RENDER, "carpet", folder, duration_s, early_frame)
    total, early_kib, end_kib = map(int, run.stdout.split())
    return total, end_kib / early_kib


def test_memory_does_not_grow_over_a_few_hundred_frames(tmp_path):
    total, ratio = growth(tmp_path / "s", 0.7, 80)
    assert total > 200
    assert ratio < 1.05


@pytest.mark.slow
def test_memory_does_not_grow_over_two_thousand_frames(tmp_path):
    """Promise: at the end within 5 % of what it was at frame 200."""
    total, ratio = growth(tmp_path / "s", 7.0, 200)
    assert total >= 2000
    assert ratio < 1.05


def test_what_rendering_no_longer_needs_goes_back_to_the_system(tmp_path):
    """Promise: once a clip is rendered, what loading the room took is not kept for later use."""
    if select_variant().startswith("scalar"):
        pytest.skip("keeps nothing for later")
    load_scene("room").texture_files()  # whoever made them would have more on its heap
    during_kib, after_kib = map(int, run_python(GIVE_BACK, tmp_path / "s").stdout.split())
    assert after_kib < during_kib - 300_000
