"""Write a tone-mapped picture of a scene, from a moment on its camera path.

    python benchmarks/scene_preview.py SCENE T_S FILE.png [SIDE_PX]

It divides the radiance by the picture's own 99th percentile, compresses values above 0.8 of it, and
applies the sRGB curve. It renders at 1280 px or more and box-filters to SIDE_PX (default 512).
"""

from __future__ import annotations

import sys

import cv2
import numpy as np

from eres_render import Renderer, load_scene


def main() -> None:
    name, t_s, file, *rest = sys.argv[1:]
    side_px = int(rest[0]) if rest else 512
    factor = -(-1280 // side_px)
    renderer = Renderer(load_scene(name), factor * side_px, 16)
    radiance = renderer.frame(renderer.trajectory.pose(float(t_s)))
    small = cv2.resize(radiance, (side_px, side_px), interpolation=cv2.INTER_AREA)
    tone = small / np.percentile(small, 99)
    tone = np.where(tone > 0.8, 0.8 + 0.2 * np.tanh((tone - 0.8) / 0.2), tone)
    srgb = np.where(tone > 0.0031308, 1.055 * tone ** (1 / 2.4) - 0.055, 12.92 * tone)
    best = [cv2.IMWRITE_PNG_COMPRESSION, 9]
    cv2.imwrite(file, np.round(255 * np.clip(srgb, 0, 1)).astype(np.uint8), best)


if __name__ == "__main__":
    main()
