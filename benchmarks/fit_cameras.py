"""Fit random simulated cameras, and count the values that are outside of their intervals.

Run: python benchmarks/fit_cameras.py [--cameras 20]

Takes about 15 s per camera. Each sees a 1/f texture in steady motion, as 400 frames 1 ms apart. The
fit gets the events and every fourth frame.
"""

import argparse
import math
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from sensor import EventCamera, plain_camera
from tasks.fitting.fit import Evidence, Found, fit
from tasks.recording.frames import open_frames

WIDTH, HEIGHT, FRAMES, STEP_S, EVERY = 128, 96, 400, 1e-3, 4


def random_camera(rng: np.random.Generator) -> EventCamera:
    """Return a camera with a cutoff of 30 to 300 Hz."""
    cutoff_hz = float(np.exp(rng.uniform(math.log(30), math.log(300))))
    latency_s, threshold = float(rng.uniform(1e-4, 2e-3)), float(rng.uniform(0.12, 0.35))
    return replace(
        plain_camera(WIDTH, HEIGHT),
        cutoff_hz=cutoff_hz,
        latency_s=latency_s,
        contrast_threshold=threshold,
        contrast_threshold_off=float(threshold * rng.uniform(0.8, 1.25)),
        dark_share=float(np.exp(rng.uniform(math.log(1e-3), math.log(3e-2)))),
        threshold_mismatch=0.02,
        random_start=True,
    )


def moving_texture(rng: np.random.Generator, speed_px_s: float) -> np.ndarray:
    """Return (FRAMES, HEIGHT, WIDTH) radiance with white at 1."""
    fy, fx = np.fft.fftfreq(256)[:, None], np.fft.fftfreq(256)
    spectrum = np.fft.fft2(rng.standard_normal((256, 256))) / np.maximum(np.hypot(fy, fx), 1 / 256)
    shift = -2j * np.pi * fx * speed_px_s * STEP_S
    views = [np.fft.ifft2(spectrum * np.exp(k * shift)).real for k in range(FRAMES)]
    light = np.exp(np.array(views)[:, :HEIGHT, :WIDTH] / np.std(views[0])).astype(np.float32)
    return light / np.percentile(light[0], 99.9)


def fitted(camera: EventCamera, light: np.ndarray) -> Found:
    """Return the fit of a camera to its events and every fourth frame."""
    events = camera.simulate(light, np.arange(FRAMES) * STEP_S, white=1.0)
    with TemporaryDirectory() as name:
        lines = ["t_us_start,t_us_end,file"]
        for k in range(0, FRAMES, EVERY):
            cv2.imwrite(f"{name}/{k:03}.tiff", light[k])
            lines.append(f"{1000 * k},{1000 * k},{k:03}.tiff")
        Path(name, "frames.csv").write_text("\n".join(lines))
        return fit(events, Evidence(frames=open_frames(Path(name)), motion=True))


def main() -> None:
    """Print one line per camera, and the number of values outside of their intervals."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cameras", type=int, default=20, help="how many; default: 20")
    parser.add_argument("--seed", type=int, default=100, help="of the first; default: 100")
    options = parser.parse_args()
    outside: dict[str, int] = {}
    for seed in range(options.seed, options.seed + options.cameras):
        rng = np.random.default_rng(seed)
        camera = random_camera(rng)
        found = fitted(camera, moving_texture(rng, rng.uniform(100, 400)))
        line = f"{seed}:"
        for name, true, estimate in (
            ("ON", camera.contrast_threshold, found.thresholds.on),
            ("OFF", camera.contrast_threshold_off, found.thresholds.off),
            ("dark", camera.dark_share, found.dark),
            ("cutoff_hz", camera.cutoff_hz, found.motion.cutoff_hz),
            ("latency_s", camera.latency_s, found.motion.latency_s),
        ):
            missed = not estimate.low <= true <= estimate.high
            outside[name] = outside.get(name, 0) + missed
            line += f" {name} {true:.4g} [{estimate.low:.4g}, {estimate.high:.4g}]{'!' * missed}"
        print(line, flush=True)
    print(f"outside of their intervals, of {options.cameras}: {outside}")


if __name__ == "__main__":
    main()
