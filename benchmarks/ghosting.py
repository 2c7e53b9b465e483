"""Draw what a high resolution and a slow photoreceptor do to images, as Fig. 5 of the paper.

    python benchmarks/ghosting.py docs/figures/ghosting [--scene carpet] [--weights firenet=FILE]

writes PNG and SVG: a patch of 256 of 1280 px at the center of the scene, true and as event
integration and networks reconstruct it from pixels of 1280 and of 240 px, by day (200 Hz) and at
night (50 Hz). Night is also day at four times the speed. The window is the same, the last 50 ms of
0.55 s. Gray levels are ranks within the patch, as in the scores of videos, which are above each
picture. The pictures show 192 px of it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from eres_render import load_scene, render_scene
from sensor import Events, SensorModel, simulate
from sensor.levels import DARK_SHARE
from tasks.methods import load_method
from tasks.methods.event_integration import reconstruct
from tasks.methods.networks import named_weights
from tasks.psnr import psnr_db
from tasks.reconstruction import ReconstructionSample
from tasks.registry import TASKS
from tasks.video import log_light, picture

FRAME_PX, PATCH_PX, FINE, COARSE = 1280, 256, 1280, 240
PATCH = 2 * (slice((FRAME_PX - PATCH_PX) // 2, (FRAME_PX + PATCH_PX) // 2),)
SHOWN, GRAYS = (slice(192), slice(64, 256)), 16
LIGHTS = {"day": 200.0, "night": 50.0}
START_S, END_S = 0.5, 0.55
OURS = "our_reconstruction_ideal_light"


def images(
    events: Events, log_start: np.ndarray, weights: dict[str, str], C: float
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield each method's name and log image at the end of the window."""
    start_us, end_us = round(1e6 * START_S), round(1e6 * END_S)
    changes = np.zeros((events.height, events.width))
    inside = events.between(start_us, end_us)
    np.add.at(changes, (inside.y, inside.x), inside.p)
    yield "event integration", reconstruct(ReconstructionSample(log_start, changes, C))
    for name in (OURS, *weights):
        method = load_method("video", name, weights)(events.width, events.height, C)
        method.push(events.between(0, end_us))
        yield TASKS["video"].method(name).label, method.image(end_us)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path, help="file without its extension")
    parser.add_argument("--scene", default="carpet")
    parser.add_argument("--weights", nargs="*", default=[], metavar="METHOD=FILE")
    given = parser.parse_args()
    weights = named_weights(given.weights, TASKS["video"].networks)
    with TemporaryDirectory() as folder:
        (sequence,) = render_scene(
            load_scene(given.scene), folder, resolution=FRAME_PX, spp=4, max_displacement_px=1.0,
            continuous=True, duration_s=END_S,
        )  # fmt: skip
        dark = DARK_SHARE * sequence.white_level
        log_start, log_end = (log_light(sequence, t_s, dark)[PATCH] for t_s in (START_S, END_S))
        frames = np.stack([frame[PATCH] for frame in sequence])
        t_s = sequence.t_s
    truth = picture(log_end, log_end.shape, "global")
    drawn: dict[str, list[tuple[str, np.ndarray]]] = {}
    for light, cutoff_hz in LIGHTS.items():
        for width in (FINE, COARSE):
            side = PATCH_PX * width // FRAME_PX
            model = SensorModel(width=side, height=side, cutoff_hz=cutoff_hz, dark_level=dark)
            events = simulate(frames, t_s, model)
            for name, image in images(events, log_start, weights, model.contrast_threshold):
                made = picture(image, truth.shape, "global")
                title = f"{width} px, {light}\n{psnr_db(made, truth):.1f} dB"
                drawn.setdefault(name, []).append((title, made))
    figure = Figure(figsize=(8.6, 1.95 * len(drawn)), layout="constrained")
    grid = figure.subplots(len(drawn), 1 + len(LIGHTS) * 2, squeeze=False)
    for row, (name, pictures) in zip(grid, drawn.items(), strict=True):
        row[0].set_ylabel(name, fontsize=9)
        for axes, (title, image) in zip(row, [("truth\n", truth), *pictures], strict=True):
            grays = np.round((GRAYS - 1) * image[SHOWN])
            axes.imshow(grays, cmap="gray", vmin=0, vmax=GRAYS - 1, interpolation="none")
            axes.set_title(title, fontsize=9)
            axes.set_xticks([])
            axes.set_yticks([])
    figure.savefig(given.out.with_suffix(".svg"), metadata={"Date": None})
    file = given.out.with_suffix(".png")
    figure.savefig(file, dpi=110)
    with Image.open(file) as colored:
        gray = colored.convert("L").quantize(GRAYS, dither=Image.Dither.NONE)
    gray.save(file, optimize=True)


if __name__ == "__main__":
    main()
