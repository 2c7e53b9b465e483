"""Studies as data: settings, presets, and the names of computed files."""

from tasks.evaluation.settings import DenseFlow, Evaluate, Flow, Reconstruction, Tracking, Video
from tasks.study.changes import with_method, with_resolution, with_scenes, with_weights
from tasks.study.digest import STAGE_VERSIONS, digest
from tasks.study.presets import PRESETS, preset
from tasks.study.settings import Render, Simulate, Study, to_json

__all__ = [
    "PRESETS",
    "STAGE_VERSIONS",
    "DenseFlow",
    "Evaluate",
    "Flow",
    "Reconstruction",
    "Render",
    "Simulate",
    "Study",
    "Tracking",
    "Video",
    "digest",
    "preset",
    "to_json",
    "with_method",
    "with_resolution",
    "with_scenes",
    "with_weights",
]
