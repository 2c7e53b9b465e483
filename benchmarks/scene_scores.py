"""Measure how well ideal events predict an image 50 ms ahead, at the paper's resolutions.

    python benchmarks/scene_scores.py [SCENE ...]

It takes ten pairs of frames along each camera path, at 1280 px and 50 ms apart. Events are the
whole number of thresholds (0.2) between the two images of a sensor, with each pixel's memory drawn
uniformly within one threshold; event integration adds them to the first frame. It prints a Markdown
table of the median PSNR, that of the first frame alone, the share of pixels below a tenth of white,
and the median of the radiance, of white.
"""

from __future__ import annotations

import sys

import numpy as np

from eres_render import Renderer, list_scenes, load_scene
from sensor.optics import integrate
from tasks.methods.event_integration import reconstruct
from tasks.reconstruction import ReconstructionSample, log_white_level, psnr_db

_WIDTH, _SPP = 1280, 16
_WIDTHS = (128, 240, 346, 640, 1280)
_PAIRS, _APART_S = 10, 0.05
_THRESHOLD = 0.2
_DARK = 1e-3  # of the white level


def main() -> None:
    heads = ["scene", "no events", *(f"{width} px" for width in _WIDTHS), "below a tenth", "median"]
    print("| " + " | ".join(heads) + " |")
    print("|---" * len(heads) + "|")
    for name in sys.argv[1:] or list_scenes():
        scene = load_scene(name)
        renderer, rng = Renderer(scene, _WIDTH, _SPP), np.random.default_rng(0)
        dark = _DARK * renderer.white_level
        scores, shares, medians = [], [], []
        for k in range(_PAIRS):
            t_s = 0.25 + k * scene.duration_s / _PAIRS
            pair = [renderer.frame(T) for T in renderer.trajectory.pose([t_s, t_s + _APART_S])]
            before, after = (np.log(frame.astype(np.float64) + dark) for frame in pair)
            white = log_white_level(after)
            shares.append(np.mean(after < white + np.log(0.1)))
            medians.append(np.exp(np.median(after) - white))
            row = [psnr_db(before, after, white)]
            for width in _WIDTHS:
                seen = [np.log(integrate(frame, width, width) + dark) for frame in pair]
                memory = rng.uniform(-_THRESHOLD, _THRESHOLD, seen[0].shape)
                events = np.trunc((seen[1] - seen[0] + memory) / _THRESHOLD)
                sample = ReconstructionSample(before, events, _THRESHOLD)
                row.append(psnr_db(reconstruct(sample), after, white))
            scores.append(row)
        cells = [f"{score:.1f}" for score in np.median(scores, axis=0)]
        cells += [f"{100 * np.mean(one):.0f} %" for one in (shares, medians)]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
