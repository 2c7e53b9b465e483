"""Measure the CPU time of footage: of its frames, of frames in between, and of the whole job.

    python benchmarks/bench_footage.py [--size 1920x1080] [--motion 5] [--frames 13] [--runs 3]

Writes an H.264 video of a textured background and a textured disc before it, which move by `motion`
px a frame in different directions, and makes events of it with a sensor of its size, C = 0.2:
`eres simulate` with and without `--interpolate auto`. User and system time of all threads, the
least of the runs, after one that compiles.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import av
import cv2
import numpy as np
from process_times import times_now

from sensor import SensorModel
from tasks.events.footage_simulation import simulate_footage
from tasks.events.simulation import SimulationOptions
from tasks.footage import open_footage
from tasks.footage.interpolation import displacements_px, interpolated, steps_for

_OCTAVES = 2, 4, 8, 16, 32, 64


def main() -> None:
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", default="1920x1080", help="of the frames, px")
    parser.add_argument("--motion", type=float, default=5.0, help="px a frame")
    parser.add_argument("--frames", type=int, default=13)
    parser.add_argument("--runs", type=int, default=3)
    args = parser.parse_args()
    width, height = map(int, args.size.split("x"))
    with tempfile.TemporaryDirectory() as folder:
        clip = write_clip(Path(folder) / "clip.mp4", width, height, args.motion, args.frames)
        out = Path(folder) / "events.h5"
        footage = open_footage(clip)
        steps = [*map(steps_for, displacements_px(footage))]
        model = SensorModel(width=width, height=height)
        options = SimulationOptions(overwrite=True)

        def simulated(interpolate: str | None) -> object:
            return simulate_footage(footage, model, out, options, interpolate=interpolate)

        kinds: dict[str, tuple[int, Callable[[], object]]] = {
            "read a frame": (len(footage), lambda: sum(1 for _ in footage)),
            "a frame in between": (
                sum(steps) + 1 - len(footage),
                lambda: sum(1 for _ in interpolated(footage, steps)),
            ),
            "eres simulate": (1, lambda: simulated(None)),
            "eres simulate --interpolate auto": (1, lambda: simulated("auto")),
        }
        print(
            f"{len(footage)} frames of {args.size} px, {args.motion:g} px apart; {steps[0]} steps"
        )
        for name, (count, work) in kinds.items():
            least = min(cpu_s(work) for _ in range(args.runs + 1))
            print(f"{name:34}{1e3 * least / count:8.1f} ms")


def cpu_s(work: Callable[[], object]) -> float:
    """Return the user and system time of a call."""
    start = times_now()
    work()
    return (times_now() - start).cpu_s


def write_clip(path: Path, width: int, height: int, motion_px: float, count: int) -> Path:
    """Write the video."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=60, options={"crf": "12"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for image in pictures(width, height, motion_px, count):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray")))
        container.mux(stream.encode())
    return path


def pictures(width: int, height: int, motion_px: float, count: int) -> Iterator[np.ndarray]:
    """Yield the images, (H, W) uint8."""
    rng = np.random.default_rng(0)
    margin = int(motion_px * count) + 2
    behind = texture(rng, width + margin, height + margin)
    side = height // 2
    before = texture(rng, side, side)
    y, x = np.mgrid[:side, :side] - side / 2
    disc = np.clip(side / 2 - 2 - np.hypot(x, y), 0, 1).astype(np.float32)
    for k in range(count):
        shift = motion_px * k
        large, small = (
            cv2.warpAffine(image, np.array([[1, 0, dx], [0, 1, dy]]), (width, height))
            for image, dx, dy in (
                (behind, -0.8 * shift, -0.6 * shift),
                (np.dstack([disc * before, disc]), side / 4 + shift, side / 2),
            )
        )
        light = large * (1 - small[..., 1]) + small[..., 0]
        yield (255 * light + 0.5).astype(np.uint8)


def texture(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """Return noise in octaves from 2 to 64 px, from 0 to 1."""
    total = np.zeros((height, width), np.float32)
    for px in _OCTAVES:
        noise = rng.normal(size=(height // px + 3, width // px + 3)).astype(np.float32)
        total += px**0.4 * cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.clip(0.5 + 0.2 * total / total.std(), 0.02, 0.98)


if __name__ == "__main__":
    main()
