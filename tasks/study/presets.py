"""Predefined studies."""

from __future__ import annotations

from eres_render.errors import nearest
from tasks.errors import StudyError
from tasks.evaluation.settings import Evaluate, Flow, Tracking, Video
from tasks.study.settings import Render, Study

PRESETS = {
    "quick": Study(
        name="quick",
        question="Which resolution does a carpet need?",
        scenes=("carpet",),
        render=Render(spp=4, max_displacement_px=1.0, samples=3),
        evaluate=Evaluate(flow=Flow(features=5), tracking=Tracking(max_events=50_000)),
    ),
    "paper": Study(
        name="paper",
        question="Are high-resolution event cameras really needed?",
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
