"""Long sequences need constant memory, free it at the end, and check first that it is available."""

from pathlib import Path

import pytest

from another_process import run_python
from eres_render import Renderer, RenderError, load_scene
from eres_render.camera import Camera
from eres_render.rendering import memory
from eres_render.rendering import renderer as render
from eres_render.rendering.backend import select_variant

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

def told(stage, done, total):
    at["total"] = total
    at["during"] = resident_kib()
    if done == early:
        at["early"] = at["during"]

renderer = Renderer(load_scene(sys.argv[1]), 64, 4)
stretch = continuous_stretch(renderer.scene, float(sys.argv[3]))
render_clip(renderer, stretch, Path(sys.argv[2]), 0.09, told)
print(at["total"], at["early"], at["during"], resident_kib())
"""
)


def memory_kib(folder, duration_s, early_frame):
    """Render a 64 px carpet sequence in a process; return its frames, and the memory at an early
    frame, at the last one and after it."""
    load_scene("carpet").texture_files()  # made here, not in the process that is measured
    run = run_python(RENDER, "carpet", folder, duration_s, early_frame)
    return map(int, run.stdout.split())


@pytest.fixture(scope="module")
def of_a_few_hundred_frames(tmp_path_factory):
    return tuple(memory_kib(tmp_path_factory.mktemp("clip") / "s", 0.7, 80))


@pytest.mark.slow
def test_memory_does_not_grow_over_a_few_hundred_frames(of_a_few_hundred_frames):
    total, early_kib, late_kib, _ = of_a_few_hundred_frames
    assert total > 200
    assert late_kib < 1.05 * early_kib


@pytest.mark.slow
def test_memory_does_not_grow_over_two_thousand_frames(tmp_path):
    """Promise: memory at the end is within 5 % of that at frame 200."""
    total, early_kib, late_kib, _ = memory_kib(tmp_path / "s", 7.0, 200)
    assert total >= 2000
    assert late_kib < 1.05 * early_kib


@pytest.mark.slow
def test_what_rendering_no_longer_needs_goes_back_to_the_system(of_a_few_hundred_frames):
    """Promise: after a clip, nothing keeps the memory that loading the carpet needed, 98 MB."""
    if select_variant().startswith("scalar"):
        pytest.skip("keeps nothing for later")
    _, _, during_kib, after_kib = of_a_few_hundred_frames
    assert after_kib < during_kib - 60_000


PEAK = """
import sys
from pathlib import Path
from eres_render import *

def peak_kib():
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(l for l in lines if l.startswith("VmHWM")).split()[1])

renderer = Renderer(load_scene(sys.argv[1]), 16, 1)
renderer.white_level
before_kib = peak_kib()
renderer = Renderer(renderer.scene, int(sys.argv[2]), int(sys.argv[3]))
renderer.frame(renderer.trajectory.pose(0.1))
renderer.white_level
print(peak_kib() - before_kib)
"""


@pytest.mark.slow
@pytest.mark.parametrize("spp", [4, 16])
def test_the_least_that_an_image_needs_is_what_it_takes(small_carpet, spp, monkeypatch):
    """Promise: peak memory, without that of a tiny image, is between one and two times the
    estimate. So eres never refuses a render that fits, and with half of the needed memory it
    refuses."""
    if not select_variant().startswith("llvm"):
        pytest.skip("samples are not in the machine's memory")
    small_carpet.texture_files()
    took_kib = int(run_python(PEAK, small_carpet.folder, 1280, spp).stdout)
    camera = Camera(1280, 1280, 1.0)
    for there, fits in ((took_kib * 1024, True), (took_kib * 512, False)):
        monkeypatch.setattr(memory, "memory_bytes", lambda there=there: there)
        if fits:
            memory.check_render_memory(camera, spp, "baked", "llvm_ad_mono")
        else:
            with pytest.raises(RenderError):
                memory.check_render_memory(camera, spp, "baked", "llvm_ad_mono")


@pytest.mark.parametrize(
    ("arguments", "needed"),
    [
        (
            ["--integrator", "path"],
            "4960.0 GB",
        ),  # 4e10 px of 60 bytes, and 4 for each of 16 samples
        (["--spp", "1", "--continuous"], "2560.0 GB"),
    ],
)
def test_an_image_larger_than_memory_is_refused_at_once(
    eres, small_carpet, tmp_path, monkeypatch, arguments, needed
):
    """Promise: the error comes before any loading, baking or writing, and has both numbers."""
    if not select_variant().startswith("llvm"):
        pytest.skip("samples are not in the machine's memory")
    for loads in ("load_mi_scene", "baked_scene", "has_lightmaps"):
        monkeypatch.setattr(render, loads, None)  # none of them is called
    monkeypatch.setattr(memory, "memory_bytes", lambda: 64 * 10**9)
    out = tmp_path / "out"
    code, _, err = eres(
        "render", small_carpet.folder, "--out", out, "--resolution", "200000", *arguments
    )
    assert code == 1
    assert "resolution: found 200000x200000 px at " in err
    assert f"need {needed} of memory, but this machine has 64.0 GB; choose a lower" in err
    assert err.count("\n") == 1
    assert not out.exists()


def test_more_samples_never_need_more_than_there_is(small_carpet, monkeypatch):
    """Promise: an existing renderer also refuses more samples than fit into memory."""
    renderer = Renderer(small_carpet, 64, 1)
    if not renderer.variant.startswith("llvm"):
        pytest.skip("samples are not in the machine's memory")
    monkeypatch.setattr(memory, "memory_bytes", lambda: 64 * 64 * (60 + 12 * 16))
    assert renderer.at(spp=16).spp == 16
    with pytest.raises(RenderError, match="found 64x64 px at 25 samples per pixel, which need"):
        renderer.at(spp=25)


@pytest.mark.parametrize(("variant", "spp"), [("llvm_ad_mono", 16), ("cuda_ad_mono", 16)])
def test_samples_beyond_32_bits_are_refused_wherever_memory_is_plenty(monkeypatch, variant, spp):
    """Promise: Dr.Jit counts samples in 32 bits. 16384 x 16384 px at 16 samples are one too many
    and cause our error, not a TypeError. The scalar variant has no such limit and renders them."""
    monkeypatch.setattr(memory, "memory_bytes", lambda: 1 << 50)
    camera = Camera(16384, 16384, 1.0)
    with pytest.raises(
        RenderError, match=r"at 16 samples per pixel, expected at most 2\^32 - 1 samples"
    ):
        memory.check_render_memory(camera, spp, "baked", variant)
    memory.check_render_memory(camera, spp - 1, "baked", variant)
    memory.check_render_memory(camera, spp, "baked", "scalar_rgb")


def test_the_memory_of_this_machine_is_known():
    """Promise: the memory is that of the system, or less in a container."""
    lines = Path("/proc/meminfo").read_text().splitlines()
    total_kib = int(next(line for line in lines if line.startswith("MemTotal")).split()[1])
    assert 1e8 < memory.memory_bytes() <= 1.001 * total_kib * 1024
