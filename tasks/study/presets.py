"""Predefined studies."""

from __future__ import annotations

import math

from eres_render.errors import suggestion
from sensor.cameras import EventCamera
from tasks.errors import StudyError
from tasks.evaluation.settings import Evaluate, Flow, Reconstruction, Tracking, Video
from tasks.study.results.slider import FIELD_PX, PAPER_SIGMA_MM, PRINTS
from tasks.study.settings import AREA, Render, Simulate, Study

SLIDER_LUX = (300.0, 67.0, 17.0)
"""Illuminance of the prints in the preset "slider", lux; the paper does not state its own."""

CHIP_UM = 1280 * 4.86
"""Width of the chip in the preset "chip", um: that of a Gen4."""

CHIP_LUX = (math.inf, 200 / 3, 50 / 3)
"""Illuminance in it, lux: its pixels of 640 px have cutoffs of 200 and 50 Hz."""


def _designs() -> tuple[EventCamera, ...]:
    """Return sensors that fill one chip: cutoffs grow with the pixel's area to a power."""
    day_hz, day_lux = 200.0, CHIP_LUX[1]
    buses = {"": math.inf, ", 165 Mev/s": 165e6}
    return tuple(
        EventCamera(
            name=f"{width} px {AREA}{power:g}{bus}",
            width=width,
            height=width,
            pitch_um=CHIP_UM / width,
            cutoff_hz=day_hz * (640 / width) ** (2 * power),
            illuminance_lux=day_lux,
            leak_hz=0.1,
            bus_hz=bus_hz,
        )
        for bus, bus_hz in buses.items()
        for power in (0.0, 0.5, 1.0)
        for width in (128, 240, 346, 640, 1280)
    )


_FLOW = "photometric_flow", "photometric_flow_with_delay", "contrast_maximization", "initial_flow"
_TRACKING = "photometric_tracking", "photometric_tracking_with_delay", "initial_path"
_VIDEO = "high_pass_filter", "high_pass_filter_no_event_decay", "blank"

_UPSAMPLINGS = "event_integration", "event_integration_bilinear", "event_integration_nearest"
_SEARCHES = "photometric_flow_unknown_contrast", "photometric_flow_by_descent"
_CONTRAST = "contrast_maximization", "contrast_maximization_by_plain_variance"

PRESETS = {
    "quick": Study(
        name="quick",
        question="Which resolution does a carpet need?",
        scenes=("carpet",),
        render=Render(spp=4, max_displacement_px=1.0, samples=2),
        evaluate=Evaluate(flow=Flow(features=5), tracking=Tracking(max_events=20_000)),
    ),
    "paper": Study(
        name="paper",
        question="Are high-resolution event cameras really needed?",
        scenes=("carpet", "rocks", "room"),
        simulate=Simulate(photoreceptors=("two_pole", "v2e")),
        evaluate=Evaluate(
            flow=Flow(
                methods=_FLOW,
                native_patch=True,
                fast_methods=("photometric_flow", "contrast_maximization", "initial_flow"),
                fast_scenes=("carpet",),
            ),
            tracking=Tracking(
                methods=_TRACKING,
                sigmas_mm=(20.0,),  # from 50 mm on most searches fail, slowly
                max_events=50_000,
            ),
            video=Video(methods=_VIDEO, scenes=("carpet",)),
        ),
    ),
    # With the program that the paper used, whose steps and time stamps are not a pixel's.
    "paper-v2e": Study(
        name="paper-v2e",
        question="What does v2e's program decide?",
        scenes=("carpet", "rocks", "room"),
        render=Render(samples=10),
        simulate=Simulate(simulators=("v2e-A", "v2e"), frame_steps_px=(0.5, 1.0, 2.0)),
        evaluate=Evaluate(
            flow=Flow(
                native_patch=True,
                fast_methods=("contrast_maximization", "initial_flow"),
                fast_scenes=("carpet",),
            ),
            tracking=Tracking(methods=()),
            video=Video(methods=("high_pass_filter", "blank"), scenes=("carpet",), duration_s=1.2),
        ),
    ),
    # Claims about scenes: of each, five textures with a path each, and fewer samples of every path.
    "paper-seeds": Study(
        name="paper-seeds",
        question="Do the paper's claims hold for other textures and paths?",
        scenes=tuple(
            f"{scene}@{seed}" if seed else scene
            for scene in ("carpet", "rocks", "room")
            for seed in range(5)
        ),
        render=Render(samples=10),
        evaluate=Evaluate(
            flow=Flow(methods=tuple(name for name in _FLOW if name != "contrast_maximization")),
            tracking=Tracking(methods=_TRACKING, sigmas_mm=(20.0,), max_events=50_000, starts=5),
        ),
    ),
    "slider": Study(
        name="slider",
        question="Does a camera on a slider need its full resolution?",
        scenes=PRINTS,
        render=Render(
            resolution=FIELD_PX[-1][0], height=FIELD_PX[-1][1], window_s=0.03, every_s=0.15
        ),
        simulate=Simulate(
            widths=tuple(width for width, _ in FIELD_PX),
            illuminance_lux=(math.inf, *SLIDER_LUX),
            speeds=(1.0, 2.0, 3.0),
            same_lens=True,
            warm_up_s=6 * 3 / (2 * math.pi * 51),  # of the slowest sensor at the highest speed
        ),
        evaluate=Evaluate(
            flow=Flow(methods=_FLOW, native_patch=True),
            tracking=Tracking(
                methods=_TRACKING,
                # 2.5 mm at 24 cm is about the same angle as 20 mm at 1.8 m in "paper".
                sigmas_mm=(2.5, PAPER_SIGMA_MM),
                max_events=50_000,
                tracking_window_s=0.072,  # 24 ms at 0.6 m/s: the path and the largest delay
            ),
            video=Video(methods=_VIDEO, duration_s=1.2, run_in_s=0.6, every_s=0.03),
        ),
    ),
    # One chip behind one lens, divided into fewer or more pixels.
    "chip": Study(
        name="chip",
        question="Into how many pixels should a chip be divided?",
        scenes=("carpet", "rocks", "room"),
        render=Render(samples=10),
        simulate=Simulate(
            widths=(), sensors=_designs(), illuminance_lux=CHIP_LUX, speeds=(1.0, 2.0)
        ),
        evaluate=Evaluate(
            tracking=Tracking(methods=()),
            video=Video(methods=()),
        ),
    ),
    # Choices that the paper leaves open or makes differently; claims print their numbers as well.
    "ablations": Study(
        name="ablations",
        scenes=("carpet", "rocks", "room"),
        render=Render(spp=4, max_displacement_px=1.0, samples=6),
        evaluate=Evaluate(
            reconstruction=Reconstruction(methods=(*_UPSAMPLINGS, "no_events")),
            flow=Flow(
                methods=("photometric_flow", *_SEARCHES, "initial_flow"),
                features=10,
                fast_methods=(*_CONTRAST, "initial_flow"),
                fast_scenes=("carpet",),
            ),
            tracking=Tracking(sigmas_mm=(20.0, 200.0), max_events=20_000),
            video=Video(
                methods=_VIDEO,
                scenes=("carpet",),
                duration_s=1.2,
                other_equalizations=("none", "clahe"),
            ),
        ),
    ),
}


def preset(name: str) -> Study:
    """Return a preset study.

    Raises
    ------
    StudyError
        The name is unknown; the message suggests the nearest one.
    """
    if name not in PRESETS:
        raise StudyError(f"preset: found {name!r}; {suggestion(name, PRESETS)}")
    return PRESETS[name]
