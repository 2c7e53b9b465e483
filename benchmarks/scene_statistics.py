"""Measure the scenes' images: contrast, spectrum, and the fall of slopes with pixel size.

    python benchmarks/scene_statistics.py [SCENE ...]

It takes 10 moments along each camera path, with two frames of 1280 px, 0.5 ms apart (about a
quarter pixel of motion), and prints a Markdown table:

- log contrast: standard deviation of log radiance, mean over the moments;
- spectral slope: of the amplitude of log radiance against frequency, radially averaged, from 1/320
  to 1/4 cycles per pixel, by least squares in logarithms (white noise has 0, 1/f noise -1);
- gamma: |L_t| ~ p^-gamma for pixels of p = 1, 3, 5, 7, 9 px (1280 to 142 px across the image), over
  all of the image and at its edges (the 5 % with the steepest slopes at p = 1), with a 95 %
  interval from a bootstrap over blocks of the image.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from eres_render import Renderer, list_scenes, load_scene
from sensor.statistics import fit_power_law, slopes_by_pixel_size

_WIDTH = 1280
_SPP = 16
_MOMENTS = 10
_APART_S = 5e-4
_SIZES_PX = (1, 3, 5, 7, 9)
_DARK = 1e-3  # of the white level


def spectral_slope(log_radiance: NDArray[np.float64]) -> float:
    """Return the exponent of the radially averaged amplitude spectrum."""
    side = len(log_radiance)
    window = np.outer(np.hanning(side), np.hanning(side))
    power = abs(np.fft.rfft2((log_radiance - log_radiance.mean()) * window)) ** 2
    frequency = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side))
    edges = np.geomspace(1 / 320, 1 / 4, 25)
    ring = np.digitize(frequency, edges).ravel()
    mean = np.bincount(ring, power.ravel()) / np.bincount(ring)
    middle = 0.5 * (np.log(edges[1:]) + np.log(edges[:-1]))
    return float(np.polyfit(middle, 0.5 * np.log(mean[1 : len(edges)]), 1)[0])


def main() -> None:
    print("| scene | log contrast | spectral slope | gamma, everywhere | gamma, edges |")
    print("|---|---|---|---|---|")
    for name in sys.argv[1:] or list_scenes():
        scene = load_scene(name)
        renderer = Renderer(scene, _WIDTH, _SPP)
        dark = _DARK * renderer.white_level
        contrasts, slopes, everywhere, edges, weights = [], [], [], [], []
        for k in range(_MOMENTS):
            t_s = (k + 0.5) * scene.duration_s / _MOMENTS
            first, second = (
                renderer.frame(T) for T in renderer.trajectory.pose([t_s, t_s + _APART_S])
            )
            log_radiance = np.log(first.astype(np.float64) + dark)
            contrasts.append(log_radiance.std())
            slopes.append(spectral_slope(log_radiance))
            found = slopes_by_pixel_size(first, second, _APART_S, dark, sizes_px=_SIZES_PX)
            everywhere.append(found.everywhere)
            edges.append(found.edges)
            weights.append(found.edge_weights)
        sizes = np.array(_SIZES_PX)
        all_over = fit_power_law(sizes, np.concatenate(everywhere))
        at_edges = fit_power_law(sizes, np.concatenate(edges), np.concatenate(weights))
        print(
            f"| {name} | {np.mean(contrasts):.2f} | {np.mean(slopes):.2f} | "
            + " | ".join(
                f"{law.exponent:.2f} [{law.low:.2f}, {law.high:.2f}]"
                for law in (all_over, at_edges)
            )
            + " |",
            flush=True,
        )


if __name__ == "__main__":
    main()
