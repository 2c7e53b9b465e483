"""Measure pose tracking on one thread: microseconds per event and pass, and seconds per fit.

    python benchmarks/bench_tracking.py [--width 1280] [--runs 3]

A texture moves along a diagonal by 7.7 px at 1280 px in 14 ms, that is at 550 px/s. An ideal sensor
with C = 0.2 sees it from 1.83 m. The initial control poses are 2 and 10 mm off. A pass is the work
of one step of the Levenberg-Marquardt search: the cost, gradient and Hessian of all events. The
result is the fastest run, with its user and system time. The frames are interpolated, so their blur
changes with time: the errors compare event counts, but do not show the accuracy of the method.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from bench_sensor import moving_texture
from process_times import Times, times_now

from eres_render import Camera, Plane
from sensor import SensorModel, simulate
from tasks.methods import photometric_tracking as eppt
from tasks.methods.photometric_tracking.accumulation import accumulate
from tasks.methods.photometric_tracking.residuals import join_events, problem_of
from tasks.tracking import path_at, perturbed, position_error_mm, tracking_sample

FRAMES, DURATION_S, DISTANCE_M, C = 17, 0.014, 1.83, 0.2
MAX_EVENTS = (20_000, 50_000, 100_000, 300_000, 1_000_000)


def fastest(call: Callable[[], object], runs: int) -> Times:
    """Return the times of the fastest of several runs."""
    measured = []
    for _ in range(runs):
        start = times_now()
        call()
        measured.append(times_now() - start)
    return min(measured)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--width", type=int, default=1280, help="sensor side in pixels")
    parser.add_argument("--runs", type=int, default=3, help="runs of each kind; the least counts")
    args = parser.parse_args()
    width = args.width
    camera = Camera(width, width, math.radians(60))
    plane = Plane((0.0, 0.0, 1.0), DISTANCE_M)
    step_px = 7.7 * width / 1280 / (FRAMES - 1)
    frames = moving_texture(width, FRAMES, step_px)
    model = SensorModel(width=width, height=width, contrast_threshold=C, dark_level=0.0)
    events = simulate(frames, np.linspace(0.0, DURATION_S, FRAMES), model, threads=1)
    log_image = np.log(frames[0].astype(np.float64))
    print(f"{width} px, {len(events)} events in 14 ms, 1 thread, minimum of {args.runs}")

    def pose(t_s: np.ndarray) -> np.ndarray:
        """Return the poses of a camera that sees the texture's motion."""
        T = np.tile(np.eye(4), (len(t_s), 1, 1))
        moved_px = step_px * (FRAMES - 1) / DURATION_S * t_s[:, None]
        T[:, :2, 3] = moved_px / math.sqrt(2) * DISTANCE_M / camera.focal_px
        return T

    truth = path_at(pose, 0.0)
    print(
        "max events    used  us/event and pass  user  system  sigma mm  passes  s a fit   user"
        "  system  error mm"
    )
    for max_events in MAX_EVENTS:
        for sigma_m in (0.002, 0.01):
            sample = tracking_sample(
                events,
                0,
                log_image=log_image,
                contrast_threshold=C,
                camera=camera,
                plane=plane,
                T_0=np.eye(4),
                initial=perturbed(truth, sigma_m, 0),
                initial_sigma_m=sigma_m,
                max_events=max_events,
            )
            problem = join_events(problem_of(sample, 14_000)[0], 1)
            (view,) = eppt.pyramid(log_image, camera.K, 0.0)
            answer = eppt.estimate(sample)  # also compiles
            one = fastest(
                lambda p=problem, v=view, s=sample: accumulate(p, v, s.initial),
                args.runs,
            )
            # A copy each time: the method keeps the coarse search of its latest sample.
            fit = fastest(lambda s=sample: eppt.estimate(replace(s)), args.runs)
            error_mm = position_error_mm(answer.path, pose, 0.0, DURATION_S)
            found = answer.failure or f"{error_mm:.3f}"
            used = len(sample.t_us)
            wall_us, user_us, system_us = (1e6 * t_s / used for t_s in one)
            print(
                f"{max_events:10} {used:7} {wall_us:18.2f} {user_us:5.2f} {system_us:7.2f} "
                f"{1e3 * sigma_m:9.0f} {answer.diagnostics.passes:7} {fit.wall_s:8.2f} "
                f"{fit.user_s:6.2f} {fit.system_s:7.2f}  {found}"
            )
        if len(events) <= max_events:
            return


if __name__ == "__main__":
    main()
