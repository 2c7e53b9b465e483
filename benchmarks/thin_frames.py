"""Measure the events of footage with too few frames, and what motion compensation restores.

    python benchmarks/thin_frames.py [--width 346] [--frames 129] [SCENE ...]

Renders a stretch of each scene's path with half a pixel of motion from frame to frame, keeps every
second, 4th, 8th and 16th frame, and simulates an ideal sensor (C = 0.2) on these, on these with
frames in between (`eres simulate --interpolate auto`), and on all frames. Prints a Markdown table:
the measured motion from one frame to the next, the number of events over that of all frames, and
the share of the events of all frames that are found again: with the same polarity, in the same
block of 2x2 px, in the same 16th of the stretch.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eres_render import Renderer, list_scenes, load_scene
from sensor import Events, SensorModel, simulate
from tasks.footage import Footage
from tasks.footage.interpolation import interpolated, steps_for
from tasks.footage.motion import displacements_px

_THINNED, _STEP_PX = (1, 2, 4, 8, 16), 0.5
_HEADS = ("scene", "every", "motion, px", "events", "found", "interpolated: events", "found")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenes", nargs="*", default=list_scenes())
    parser.add_argument("--width", type=int, default=346, help="side of frames and sensor, px")
    parser.add_argument("--frames", type=int, default=129, help="frames; 1 more than 16 divides")
    chosen = parser.parse_args()
    print("| " + " | ".join(_HEADS) + " |\n" + "|---" * len(_HEADS) + "|")
    for name in chosen.scenes:
        for row in rows(name, chosen.width, chosen.frames):
            print("| " + " | ".join(row) + " |", flush=True)


def rows(name: str, width: int, count: int) -> list[list[str]]:
    """Return the rows of one scene."""
    renderer = Renderer(load_scene(name), width, 16)
    start_s = 0.4 * renderer.scene.duration_s
    step_s = 1e-3 * _STEP_PX / renderer.image_motion(start_s, start_s + 1e-3)
    t_s = step_s * np.arange(count)
    frames = np.stack([renderer.frame(one) for one in renderer.trajectory.pose(start_s + t_s)])
    model = SensorModel(width=width, height=width, dark_level=1e-3 * renderer.white_level)
    all_events = histogram(simulate(frames, t_s, model), t_s[-1])
    found = []
    for every in _THINNED:
        thin = Footage(
            path=Path(name),
            t_s=t_s[::every],
            t_offset_us=0,
            height=width,
            width=width,
            encoding="linear",
            white_level=renderer.white_level,
            frames=lambda every=every: iter(frames[::every]),
        )
        motion = displacements_px(thin)
        dense = interpolated(thin, steps_for(motion))
        cells = [name, str(every), f"{np.median(motion):.2f}"]
        for source in (thin, dense):
            seen = histogram(simulate(iter(source), source.t_s, model), t_s[-1])
            again = np.minimum(seen, all_events).sum() / all_events.sum()
            cells += [f"{seen.sum() / all_events.sum():.3f}", f"{again:.3f}"]
        found.append(cells)
    return found


def histogram(events: Events, end_s: float) -> NDArray[np.int64]:
    """Count the events by polarity, block of 2x2 px, and 16th of the stretch."""
    share = np.minimum((16e-6 / end_s * events.t_us).astype(int), 15)
    blocks = events.height // 2 + 1, events.width // 2 + 1
    cell = np.ravel_multi_index(
        (share, (events.p > 0).astype(int), events.y // 2, events.x // 2), (16, 2, *blocks)
    )
    return np.bincount(cell, minlength=32 * blocks[0] * blocks[1])


if __name__ == "__main__":
    main()
