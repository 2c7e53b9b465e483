"""Refuse images that need more memory than this machine has, before anything is loaded."""

from __future__ import annotations

from pathlib import Path

import psutil

from eres_render.camera import Camera
from eres_render.errors import RenderError

# Five float32 frames for the white level, their stack, and its sorted copy.
_BYTES_A_PIXEL = 60
# Radiance; and without reflected light, the position in the image, kept from frame to frame.
_BYTES_A_SAMPLE = {"path": 4, "baked": 8, "baked-full": 12, "emission": 8}
_MAX_SAMPLES = (1 << 32) - 1  # Dr.Jit counts them in 32 bits


def check_render_memory(camera: Camera, spp: int, integrator: str, variant: str) -> None:
    """Refuse an image that needs more memory than this machine has, by a lower bound.

    Measured at 1280 and 2560 px, a render takes 1.1 to 1.8 times as much, plus its scene.
    """
    pixels = camera.width * camera.height
    size = f"resolution: found {camera.width}x{camera.height} px at {spp} samples per pixel"
    needed = _BYTES_A_PIXEL * pixels
    if variant.startswith("llvm"):  # a GPU has its own memory; the scalar variant renders tiles
        needed += _BYTES_A_SAMPLE[integrator] * pixels * spp
    if needed > (available := memory_bytes()):
        raise RenderError(
            f"{size}, which need {needed / 1e9:.1f} GB of memory, but this machine has "
            f"{available / 1e9:.1f} GB; choose a lower resolution or fewer samples"
        )
    if not variant.startswith("scalar") and pixels * spp > _MAX_SAMPLES:
        raise RenderError(
            f"{size}, expected at most 2^32 - 1 samples per image; choose a lower "
            "resolution or fewer samples"
        )


def memory_bytes() -> int:
    """Return the memory of this machine, or of the container if that has less."""
    physical = int(psutil.virtual_memory().total)
    try:
        return min(physical, int(Path("/sys/fs/cgroup/memory.max").read_text(encoding="utf-8")))
    except (OSError, ValueError):  # no such file, or "max"
        return physical
