"""Measure the sensor: M pixel-frames per second with sorted output, and a NumPy logarithm.

    python benchmarks/bench_sensor.py [--size 1280] [--frames 60] [--runs 3] [--threads 1 2]
        [--pause 0]

A texture with a natural spectrum and edges moves by 0.97 px per frame, with frames 1 ms apart and C
= 0.2. "dense" fires about 0.2 events per pixel and frame, "sparse" a tenth of that (frames 0.1 ms
apart), "very dense" about one (12 px per frame). Events come from `stream`, in parts: `simulate`
also allocates memory for all of them, which on a virtual machine can take as long as the rest. The
result is the run with the least wall-clock time, with its user and system time in ns per pixel and
frame; the kinds take turns, so other load affects all of them equally. In a pause before each run
the system may take free memory back. To compare with another commit, let processes take turns that
have PYTHONPATH set to a worktree of it, or to this one. The NumPy column is the speed over that of
reading the same frames once and computing `np.log(frame + dark)`.

The second table compares nine settings that share the frames with nine runs: with the frames in
memory, and with OpenEXR files that each run reads. Times are those of the fastest run together.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from pathlib import Path

import numpy as np
from process_times import Times, times_now

from eres_render.storage.exr import read_luminance, write_luminance
from sensor import SensorModel, simulate, stream, stream_bank

# Shift from frame to frame, px, and time between frames, s.
SCENES = {"dense": (0.97, 1e-3), "sparse": (0.097, 1e-4), "very dense": (12.0, 1e-3)}


def moving_texture(size: int, frames: int, shift_px: float, seed: int = 0) -> np.ndarray:
    """Return radiance (frames, size, size) float32 of a texture that moves along a diagonal."""
    rng = np.random.default_rng(seed)
    n = 2 * size
    fy, fx = np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n)[None]
    radius = np.hypot(fy, fx)
    radius[0, 0] = 1.0
    spectrum = np.fft.rfft2(rng.standard_normal((n, n))) / radius**1.25
    smooth = np.fft.irfft2(spectrum, (n, n))
    smooth /= smooth.std()
    edges = np.sign(np.roll(smooth, 500, axis=0))
    texture = np.exp(0.65 * smooth + 0.25 * edges).astype(np.float32)
    step = shift_px / math.sqrt(2)
    frames = min(frames, 1 + int((size - 1) / step))  # the texture is two sensors wide
    views = np.empty((frames, size, size), np.float32)
    for k in range(frames):
        whole = math.floor(k * step)
        part = np.float32(k * step - whole)
        window = texture[whole : whole + size + 1, whole : whole + size + 1]
        along = (1 - part) * window[:, :-1] + part * window[:, 1:]
        views[k] = (1 - part) * along[:-1] + part * along[1:]
    return views


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--size", type=int, default=1280, help="sensor and frame side in pixels")
    parser.add_argument("--frames", type=int, default=60, help="frames in the sequence")
    parser.add_argument("--runs", type=int, default=3, help="runs of each kind; the least counts")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2], help="numbers of threads")
    parser.add_argument("--pause", type=float, default=0.0, help="seconds before each run")
    args = parser.parse_args()
    size = args.size
    scenes = {}
    for name, (shift_px, interval_s) in SCENES.items():
        frames = moving_texture(size, args.frames, shift_px)
        scenes[name] = frames, np.arange(len(frames)) * interval_s

    def model(cutoff_hz: float) -> SensorModel:
        return SensorModel(width=size, height=size, cutoff_hz=cutoff_hz)

    kinds = {}
    for name, (frames, t_s) in scenes.items():
        for cutoff_hz in (math.inf, 200.0, 50.0):
            for threads in args.threads:
                kinds[name, f"{cutoff_hz:g} Hz", threads] = (
                    lambda f=frames, t=t_s, c=cutoff_hz, n=threads: sum(
                        map(len, stream(f, t, model(c), threads=n))
                    )
                )
        kinds[name, "numpy log", 1] = lambda f=frames: sum(
            0 * len(np.log(frame + np.float32(1e-3))) for frame in f
        )
    for cutoff_hz in (math.inf, 200.0):  # compile first
        simulate(frames[:2], t_s[:2], model(cutoff_hz))
    runs: dict[tuple[str, str, int], list[Times]] = {kind: [] for kind in kinds}
    fired = dict.fromkeys(kinds, 0)
    for _ in range(args.runs):
        for kind, work in kinds.items():
            time.sleep(args.pause)
            start = times_now()
            fired[kind] = work()
            runs[kind].append(times_now() - start)
    best = {kind: min(measured) for kind, measured in runs.items()}

    print(f"{size}x{size} px, up to {args.frames} frames, minimum of {args.runs}")
    print(
        "scene      setting    threads  Mpx-frames/s  user ns  sys ns  Mev/s  ev/px/frame  of "
        "numpy's"
    )
    for (scene, setting, threads), (seconds, user_s, system_s) in best.items():
        count = len(scenes[scene][1])
        work = size * size * (count - 1)
        numpy_rate = size * size * count / best[scene, "numpy log", 1][0]
        print(
            f"{scene:10} {setting:10} {threads:7} {work / seconds / 1e6:13.1f} "
            f"{user_s / work * 1e9:8.2f} {system_s / work * 1e9:7.2f} "
            f"{fired[scene, setting, threads] / seconds / 1e6:6.1f} "
            f"{fired[scene, setting, threads] / work:12.3f} {work / seconds / numpy_rate:11.2f}"
        )
    compare_bank(*scenes["dense"], args.runs)


def compare_bank(frames: np.ndarray, t_s: np.ndarray, runs: int) -> None:
    """Measure nine settings, three cutoffs by three speeds, together and one by one."""
    frames, t_s = frames[:17], t_s[:17]
    speeds = [1.0, 4 / 3, 2.0] * 3
    print("\nbank of 9 settings, 1 thread: one by one / together, median of the runs' ratios")
    print("          frames in memory" + " " * 40 + "frames as OpenEXR on disk")
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"{k}.exr" for k in range(len(frames))]
        for file, frame in zip(files, frames, strict=True):
            write_luminance(file, frame)
        for width in (128, 240, 346, 640, 1280):
            if width > frames.shape[1]:
                continue
            models = [
                SensorModel(width=width, height=width, cutoff_hz=cutoff_hz)
                for cutoff_hz in (math.inf, 200.0, 50.0)
                for _ in range(3)
            ]
            cells = []
            for frames_again in (lambda: frames, lambda: map(read_luminance, files)):
                ratios, together = [], []
                for _ in range(runs):
                    start = times_now()
                    for model, speed in zip(models, speeds, strict=True):
                        for _ in stream(frames_again(), t_s / speed, model, threads=1):
                            pass
                    middle = times_now()
                    for _ in stream_bank(frames_again(), t_s, models, speeds=speeds, threads=1):
                        pass
                    together.append(times_now() - middle)
                    ratios.append((middle - start).wall_s / together[-1].wall_s)
                wall_s, user_s, system_s = min(together)
                cells.append(
                    f"{np.median(ratios):5.2f}x  together {wall_s:6.3f} s: "
                    f"{user_s:6.3f} user + {system_s:5.3f} system"
                )
            print(f"{width:5} px  {cells[0]}   {cells[1]}")


if __name__ == "__main__":
    main()
