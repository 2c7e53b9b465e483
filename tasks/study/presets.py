"""Predefined studies."""

from __future__ import annotations

from eres_render.errors import nearest
from tasks.errors import StudyError
from tasks.evaluation.settings import Evaluate, Flow, Reconstruction, Tracking, Video
from tasks.study.settings import Render, Study

PRESETS = {
    "quick": Study(
        name="quick",
        scenes=("carpet",),
        render=Render(spp=4, max_displacement_px=1.0, samples=3),
        evaluate=Evaluate(flow=Flow(features=5), tracking=Tracking(max_events=50_000)),
    ),
    "paper": Study(
        name="paper",
        scenes=("carpet", "rocks", "room"),
        evaluate=Evaluate(
            flow=Flow(
                methods=(
                    "photometric_flow",
                    "photometric_flow_with_delay",
                    "contrast_maximization",
                    "initial_flow",
                ),
                native_patch=True,
                fast_methods=("contrast_maximization", "initial_flow"),
                fast_scenes=("carpet",),
            ),
            tracking=Tracking(
                methods=("photometric_tracking", "photometric_tracking_with_delay", "initial_path"),
                sigmas_mm=(20.0,),  # from 50 mm on most searches fail, slowly
                max_events=50_000,
            ),
            video=Video(
                methods=("high_pass_filter", "high_pass_filter_no_event_decay", "blank"),
                scenes=("carpet",),
            ),
        ),
    ),
    # What the paper leaves open, or does otherwise: claims print these numbers beside their own.
    "ablations": Study(
        name="ablations",
        scenes=("carpet", "rocks", "room"),
        render=Render(spp=4, max_displacement_px=1.0, samples=6),
        evaluate=Evaluate(
            reconstruction=Reconstruction(
                methods=(
                    "event_integration",
                    "event_integration_bilinear",
                    "event_integration_nearest",
                    "no_events",
                ),
            ),
            flow=Flow(
                methods=(
                    "photometric_flow",
                    "photometric_flow_unknown_contrast",
                    "photometric_flow_by_descent",
                    "initial_flow",
                ),
                features=10,
                fast_methods=(
                    "contrast_maximization",
                    "contrast_maximization_by_plain_variance",
                    "initial_flow",
                ),
                fast_scenes=("carpet",),
            ),
            tracking=Tracking(sigmas_mm=(20.0, 200.0), max_events=20_000),
            video=Video(
                methods=("high_pass_filter", "high_pass_filter_no_event_decay", "blank"),
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
        raise StudyError(f"preset: found {name!r}; {nearest(name, PRESETS)}")
    return PRESETS[name]
