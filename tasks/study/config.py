"""Studies as data: settings, presets, and the names of computed files."""

from eres_render.sequence.manifest import RENDER_VERSION
from eres_render.storage.digest import digest as whole_digest
from tasks.evaluation.settings import DenseFlow, Evaluate, Flow, Reconstruction, Tracking, Video
from tasks.study.changes import with_method, with_resolution, with_scenes, with_weights
from tasks.study.settings import Render, Simulate, Study, to_json
from tasks.study.study_file import preset, preset_names

__all__ = [
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
    "preset_names",
    "to_json",
    "with_method",
    "with_resolution",
    "with_scenes",
    "with_weights",
]

# Raise the number of a stage when its results change, so that older files are not reused.
STAGE_VERSIONS = {"render": RENDER_VERSION, "simulate": 1, "evaluate": 3}


def digest(values: dict[str, object]) -> str:
    """Return the name of a file that these values determine, 20 hexadecimal digits."""
    return whole_digest(values)[:20]
