"""Measure the methods on one thread: events per second, and fits per second for flow.

    python benchmarks/bench_methods.py [--runs 5] [--patches 20]

A texture with a natural spectrum and edges moves along a diagonal. An ideal sensor with C = 0.2
sees it for 50 ms. It moves by 13.75 px at 640 px and by 27.5 px at 1280 px, which is 550 px/s at
1280 px. EI and HF get the events of a whole sensor, and EI also enlarges its sum to 1280 px. Flow
methods get patches at random places, and initial flows with the study's errors. The result is the
fastest of the runs, with its user and system time; the methods take turns, so other load affects
all of them equally.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from bench_sensor import moving_texture
from process_times import Times, times_now

from sensor import Events, SensorModel, simulate
from tasks.flow import FlowSample, flow_sample, initial_sigma_px, patch_px
from tasks.methods import load_method
from tasks.reconstruction import ReconstructionSample
from tasks.registry import TASKS

WINDOW_S, C, FRAMES = 0.05, 0.2, 56
RENDER_PX = 1280


@dataclass(frozen=True, slots=True)
class Kind:
    """One measurement.

    Parameters
    ----------
    name, where
        Names of the method and of its input.
    events
        Number of events that one call processes.
    fits
        Number of solutions that one call finds; 0 for methods that find none.
    call
        Runs it.
    """

    name: str
    where: str
    events: int
    fits: int
    call: Callable[[], object]


def window(size: int, flow_px: float) -> tuple[Events, np.ndarray]:
    """Return the events of a window and the log intensity at its start, on a sensor of `size`
    px."""
    frames = moving_texture(size, FRAMES, flow_px / (FRAMES - 1))
    model = SensorModel(width=size, height=size, contrast_threshold=C, dark_level=0.0)
    events = simulate(frames, np.linspace(0, WINDOW_S, FRAMES), model)
    return events, np.log(frames[0].astype(np.float64))


def flow_samples(width: int, count: int, seed: int = 0) -> list[FlowSample]:
    """Return patches of a sensor of `width` px, from a 240 px wide part of its view."""
    size, flow_px = 240, 27.5 * width / RENDER_PX
    events, log_image = window(size, flow_px)
    rng = np.random.default_rng(seed)
    side_px, sigma_px = patch_px(width), initial_sigma_px(width)
    truth = np.full(2, -flow_px / math.sqrt(2))
    return [
        flow_sample(
            events,
            0,
            round(WINDOW_S * 1e6),
            log_image=log_image,
            contrast_threshold=C,
            center_px=rng.uniform(side_px, size - side_px, 2),
            side_px=side_px,
            initial=truth + rng.normal(0, sigma_px, 2),
            initial_sigma_px=sigma_px,
        )
        for _ in range(count)
    ]


def reconstruction_kinds() -> Iterator[Kind]:
    """Yield event integration and the high-pass filter on whole sensors."""
    for width in (346, RENDER_PX):
        events, _ = window(width, 27.5 * width / RENDER_PX)
        end_us = round(WINDOW_S * 1e6)
        keyframe = np.zeros((RENDER_PX, RENDER_PX))
        integrate = load_method("reconstruction", "event_integration")

        def ei(events=events, keyframe=keyframe, integrate=integrate):
            total = events.polarity_sum().astype(np.float64)
            return integrate(ReconstructionSample(keyframe, total, C))

        def hf(name, events=events, width=width, end_us=end_us):
            method = load_method("video", name)(width, width, C)
            method.push(events)
            return method.image(end_us)

        yield Kind("event_integration", f"{width} px", len(events), 0, ei)
        for name in TASKS["video"].methods:
            if name.startswith("high_pass"):
                yield Kind(name, f"{width} px", len(events), 0, lambda n=name, f=hf: f(n))


def flow_kinds(patches: int) -> Iterator[Kind]:
    """Yield every flow method on patches of two sensors."""
    for width in (640, RENDER_PX):
        samples = flow_samples(width, patches)
        events = sum(len(sample.t) for sample in samples)
        where = f"{patch_px(width)} px of {width}"
        for name in TASKS["flow"].methods:
            if name == "initial_flow":
                continue
            method = load_method("flow", name)
            yield Kind(
                name,
                where,
                events,
                patches,
                lambda s=samples, m=method: [m(sample) for sample in s],
            )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=5, help="runs of each kind; the least counts")
    parser.add_argument("--patches", type=int, default=20, help="patches of each sensor")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    kinds = [*reconstruction_kinds(), *flow_kinds(args.patches)]
    for kind in kinds:  # compile first
        kind.call()
    runs: list[list[Times]] = [[] for _ in kinds]
    for _ in range(args.runs):
        for kind, measured in zip(kinds, runs, strict=True):
            start = times_now()
            kind.call()
            measured.append(times_now() - start)
    print(
        f"{'method':36s} {'on':>14s} {'k events':>9s} {'Mev/s':>8s} {'fits/s':>8s}"
        f" {'user s':>8s} {'system s':>8s}"
    )
    for kind, measured in zip(kinds, runs, strict=True):
        seconds, user_s, system_s = min(measured)
        fits = f"{kind.fits / seconds:8.1f}" if kind.fits else f"{'-':>8s}"
        thousands = kind.events / max(kind.fits, 1) / 1e3
        rate = kind.events / seconds / 1e6
        print(
            f"{kind.name:36s} {kind.where:>14s} {thousands:9.1f} {rate:8.2f} {fits}"
            f" {user_s:8.3f} {system_s:8.3f}"
        )


if __name__ == "__main__":
    main()
