"""Measure the events of footage with too few frames or with noise, and the estimates of both.

    python benchmarks/thin_frames.py [--width 346] [--frames 129] [SCENE ...]

Renders a stretch of each scene's path with half a pixel of motion from frame to frame, keeps every
second, 4th, 8th and 16th frame, and simulates an ideal sensor (C = 0.2) on these, on these with
frames in between (`eres simulate --interpolate auto`), and on all frames. Prints a Markdown table:
the measured motion from one frame to the next, the number of events over that of all frames, the
share of the events of all frames that are found again (with the same polarity, in the same block of
2x2 px, in the same 16th of the stretch), and the share that `eres simulate` says is lost.

A second table has noise of the frames: still frames, every 4th frame beside a part that is still,
and every 4th frame, in 8 bits with white noise whose deviation is a share of white in the dark and
sqrt(2) of that in white. Cells have three shares of the events, in percent: that of noise, known
from the same frames without it, that which `eres simulate` finds, and that which it says is lost.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eres_render import Renderer, list_scenes, load_scene
from sensor import Events, SensorModel, simulate, to_linear
from sensor.encoding import to_srgb
from tasks.events.footage_check import FootageCheck
from tasks.footage import Footage
from tasks.footage.interpolation import displacements_px, interpolated, steps_for

_THINNED, _STEP_PX = (1, 2, 4, 8, 16), 0.5
_HEADS = (
    *("scene", "every", "motion, px", "events", "found", "interpolated: events", "found"),
    *("lost, %", "estimated, %"),
)
_NOISE = 0.01, 0.03, 0.1
_NOISE_HEADS = "scene", "moving", *(f"noise {100 * one:g} %" for one in _NOISE)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenes", nargs="*", default=list_scenes())
    parser.add_argument("--width", type=int, default=346, help="side of frames and sensor, px")
    parser.add_argument("--frames", type=int, default=129, help="frames; 1 more than 16 divides")
    chosen = parser.parse_args()
    stretches = {name: stretch(name, chosen.width, chosen.frames) for name in chosen.scenes}
    for heads, rows_of in ((_HEADS, thin_rows), (_NOISE_HEADS, noise_rows)):
        print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
        for name, clip in stretches.items():
            for row in rows_of(clip):
                print("| " + " | ".join([name, *row]) + " |", flush=True)
        print()


def stretch(name: str, width: int, count: int) -> Footage:
    """Render frames of a scene."""
    renderer = Renderer(load_scene(name), width, 16)
    start_s = 0.4 * renderer.scene.duration_s
    step_s = 1e-3 * _STEP_PX / renderer.image_motion(start_s, start_s + 1e-3)
    t_s = step_s * np.arange(count)
    frames = [renderer.frame(one) for one in renderer.trajectory.pose(start_s + t_s)]
    return footage_of(frames, t_s, renderer.white_level)


def footage_of(
    frames: Sequence[NDArray[np.float32]], t_s: NDArray[np.float64], white_level: float
) -> Footage:
    """Return frames in memory as footage."""
    return Footage(
        path=Path("memory"),
        t_s=t_s,
        t_offset_us=0,
        height=frames[0].shape[0],
        width=frames[0].shape[1],
        encoding="linear",
        white_level=white_level,
        frames=lambda: iter(frames),
    )


def checked(clip: Footage) -> tuple[Events, FootageCheck]:
    """Return the events of a clip with what `eres simulate` estimates of them."""
    model = SensorModel(width=clip.width, height=clip.height, dark_level=1e-3 * clip.white_level)
    check = FootageCheck(clip, (slice(None), slice(None)), model, 1.0, with_between=False)
    events = simulate(iter(check.watched()), clip.t_s, model)
    check.count(events)
    return events, check


def thin_rows(clip: Footage) -> Iterator[list[str]]:
    """Yield the rows of a scene in the first table."""
    frames, end_s = list(clip), clip.t_s[-1]
    every_event = checked(clip)[0]
    all_events = histogram(every_event, end_s)
    for every in _THINNED:
        thin = footage_of(frames[::every], clip.t_s[::every], clip.white_level)
        motion = displacements_px(thin)
        events, check = checked(thin)
        dense = interpolated(thin, [*map(steps_for, motion)])
        cells = [str(every), f"{np.median(motion):.2f}"]
        for seen in (histogram(one, end_s) for one in (events, checked(dense)[0])):
            again = np.minimum(seen, all_events).sum() / all_events.sum()
            cells += [f"{seen.sum() / all_events.sum():.3f}", f"{again:.3f}"]
        lost = 1 - len(events) / len(every_event)
        yield [*cells, f"{100 * lost:.0f}", f"{100 * check.lost:.0f}"]


def noise_rows(clip: Footage) -> Iterator[list[str]]:
    """Yield the rows of a scene in the second table."""
    frames, t_s = list(clip)[::4], clip.t_s[::4]
    rng = np.random.default_rng(0)
    for moving in (0.0, 0.25, 1.0):
        columns = slice(round(clip.width * (1 - moving)), None)
        light = np.repeat(np.float32(frames[:1]), len(frames), axis=0)
        light[:, :, columns] = np.stack(frames)[:, :, columns]
        clean = len(checked(footage_of(light, t_s, clip.white_level))[0])
        cells = []
        for deviation in _NOISE:
            share = light / clip.white_level
            noisy = share + deviation * np.sqrt(1 + share) * rng.normal(size=share.shape)
            codes = np.round(255 * to_srgb(np.clip(noisy, 0, 1))).astype(np.uint8)
            events, check = checked(footage_of(to_linear(codes, "srgb"), t_s, 1.0))
            shares = 1 - clean / len(events), check.noise, check.lost
            cells.append(" / ".join(f"{100 * one:.0f}" for one in shares))
        yield [f"{100 * moving:.0f} %", *cells]


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
