"""Measure the error of looked-up light by samples per pixel, and with prefiltered textures.

Run: python benchmarks/light_error.py [SCENE ...]

Prints a Markdown table: rms difference of log radiance from the mean of four renders with 1024
samples and other seeds, over three views of 256 px whose pixels are as large as those of a 1280 px
image. The last column has 16 samples and textures averaged over two texels along each axis, the
least that a mipmap can do. The logarithm is that of the sensors, with a dark level of a thousandth
of white.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

from eres_render import Camera, Renderer, list_scenes, load_scene

_SPP, _REFERENCE_SPP, _SEEDS, _SIDE_PX = (4, 16, 64, 256), 1024, (101, 102, 103, 104), 256
_DARK = 1e-3  # of white


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenes", nargs="*", default=list_scenes())
    heads = ["scene", *(f"{spp} spp" for spp in _SPP), "16 spp, prefiltered"]
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    for name in parser.parse_args().scenes:
        cells = [name, *(f"{error:.1e}" for error in errors(name))]
        print("| " + " | ".join(cells) + " |", flush=True)


def errors(name: str) -> list[float]:
    """Return the errors of one scene."""
    scene = load_scene(name)
    fov_rad = 2 * np.arctan(0.5 * _SIDE_PX / scene.camera(1280).fx)
    camera = Camera(_SIDE_PX, _SIDE_PX, float(fov_rad))
    renderer = Renderer(scene, spp=16, camera=camera, integrator="baked")
    fine = renderer.at(spp=_REFERENCE_SPP)
    poses = scene.trajectory().pose(np.array([0.2, 0.5, 0.8]) * scene.duration_s)
    truth = np.array([np.mean([fine.frame(T, k) for k in _SEEDS], 0) for T in poses])
    dark = _DARK * renderer.white_level

    def error(one: Renderer) -> float:
        seen = np.array([one.frame(T) for T in poses])
        return float(np.sqrt(np.mean(np.log((seen + dark) / (truth + dark)) ** 2)))

    found = [error(renderer.at(spp=spp)) for spp in _SPP]
    assert renderer._look_up is not None
    for texels in renderer._look_up._surfaces.textures:
        prefilter(texels.view(np.float16))
    return [*found, error(renderer)]


def prefilter(texels: NDArray[np.float16]) -> None:
    """Average over two texels along each axis, in place, without a shift."""
    smooth = texels.astype(np.float32)
    for axis in (0, 1):
        beside = np.roll(smooth, 1, axis) + np.roll(smooth, -1, axis)
        smooth = 0.5 * smooth + 0.25 * beside
    texels[...] = smooth


if __name__ == "__main__":
    main()
