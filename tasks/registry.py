"""The tasks and their methods: all other code reads them here.

A new task needs a scorer and an entry in `TASKS`; a new method needs a function and a line in its
task's `methods`. Places are strings, so that listing tasks and methods imports none of them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from eres_render.errors import nearest
from tasks.errors import TaskError
from tasks.metric import Metric


@dataclass(frozen=True, slots=True)
class ShareColumn:
    """The column of a table that shows how often a method failed or succeeded."""

    head: str
    meaning: str
    of_successes: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskSpec:
    """One task. A place is "module:name".

    Attributes
    ----------
    title
        Name in words.
    summary
        What is scored, for `eres evaluate --help`.
    methods
        Places of the methods, by name.
    metric
        The metric of its scores.
    baseline
        Name of the method that does not use the events; others are compared with it.
    other_baselines
        Names of further methods that do not use the events.
    scorer
        Place of the class that turns events into scores: a `Scorer`, made from a `Source` and the
        settings.
    needs
        What a source must have: "frames", "poses", "a plane", "a threshold", or "a change", what an
        event is worth between two frames. Recordings have the latter two estimated.
    settings
        Place of the class of its settings: `TaskSettings`, or a class derived from it.
    sample
        Place of the class of a method's first argument, which identifies the method's task. None if
        methods are classes that events are pushed to.
    share_column
        How tables show failures. None where a method cannot fail.
    extensions
        Names of the methods that are our variants of the paper's.
    networks
        Places of the functions that read a file of weights, by the names of the methods that need
        them.
    diagnostics
        Names of the methods that get the truth: they bound what others can reach.
    without_threshold
        Names of the methods that do not use the contrast threshold: for these alone, a recording
        needs no estimate of it.
    labels
        Names of methods in words, where they differ from the name without underscores.
    """

    title: str
    methods: Mapping[str, str]
    metric: Metric
    baseline: str
    scorer: str
    needs: tuple[str, ...] = ()
    settings: str = "tasks.evaluation.settings:TaskSettings"
    sample: str | None = None
    share_column: ShareColumn | None = None
    other_baselines: tuple[str, ...] = ()
    extensions: tuple[str, ...] = ()
    networks: Mapping[str, str] = field(default_factory=dict)
    diagnostics: tuple[str, ...] = ()
    without_threshold: tuple[str, ...] = ()
    labels: Mapping[str, str] = field(default_factory=dict)
    summary: str = ""

    def label(self, method: str) -> str:
        """Return a method's name in words; a ``module:function`` stays as it is."""
        words = method if ":" in method else method.replace("_", " ")
        return self.labels.get(method, words)

    def usual(self, with_weights: Collection[str] = ()) -> tuple[str, ...]:
        """Return the methods that run by default: no diagnostics, and networks only with weights.

        Networks whose weights come with eres run only if they are named or given other weights.
        """
        absent = {*self.diagnostics, *self.networks} - {*with_weights}
        return tuple(name for name in self.methods if name not in absent)


_METHODS = "tasks.methods"
_SCORERS = "tasks.evaluation.scorers"
_SETTINGS = "tasks.evaluation.settings"
_NETWORKS = "tasks.learned"

_PSNR = Metric("psnr_db", "PSNR", "dB", higher_is_better=True, negligible=0.1, decimals=2)
_RNEPE = Metric(
    *("rnepe_px", "RNEPE", "px"), False, negligible=0.05, decimals=2, reference_width_px=1280
)
_POSITION_ERROR = Metric(
    *("position_error_mm", "position error", "mm"), False, negligible=0.1, decimals=2, digits=3
)

_TASKS = {
    "reconstruction": TaskSpec(
        title="reconstruction",
        summary="PSNR of the image at the end of the window",
        methods={
            "event_integration": f"{_METHODS}.event_integration:reconstruct",
            "event_integration_nearest": f"{_METHODS}.event_integration:reconstruct_nearest",
            "event_integration_bilinear": f"{_METHODS}.event_integration:reconstruct_bilinear",
            "no_events": f"{_METHODS}.no_events:reconstruct",
        },
        metric=_PSNR,
        baseline="no_events",
        scorer=f"{_SCORERS}.reconstruction:ReconstructionScorer",
        needs=("frames", "a change"),
        settings=f"{_SETTINGS}:Reconstruction",
        sample="tasks.reconstruction:ReconstructionSample",
        extensions=("event_integration_nearest", "event_integration_bilinear"),
        without_threshold=("no_events",),
    ),
    "video": TaskSpec(
        title="video reconstruction",
        summary="PSNR of images along a continuous sequence",
        methods={
            "high_pass_filter": f"{_METHODS}.high_pass_filter:HighPassFilter",
            "high_pass_filter_no_event_decay": f"{_METHODS}.high_pass_filter:without_event_decay",
            "e2vid": f"{_METHODS}.e2vid:E2vid",
            "our_reconstruction_ideal_light": f"{_METHODS}.our_reconstruction:OurReconstruction",
            "our_reconstruction_all_light": f"{_METHODS}.our_reconstruction:OurReconstruction",
            "late_truth": f"{_METHODS}.true_video:LateTruth",
            "filtered_truth": f"{_METHODS}.true_video:FilteredTruth",
            "blank": f"{_METHODS}.blank_video:BlankVideo",
        },
        metric=_PSNR,
        baseline="blank",
        scorer=f"{_SCORERS}.video:VideoScorer",
        needs=("frames", "a threshold"),
        settings=f"{_SETTINGS}:Video",
        extensions=("high_pass_filter_no_event_decay",),
        networks={
            "e2vid": f"{_NETWORKS}.e2vid:load",
            "our_reconstruction_ideal_light": f"{_NETWORKS}.ours:reconstruction_ideal_light",
            "our_reconstruction_all_light": f"{_NETWORKS}.ours:reconstruction_all_light",
        },
        diagnostics=("late_truth", "filtered_truth"),
        without_threshold=("e2vid", "late_truth", "filtered_truth", "blank"),
        labels={
            "e2vid": "E2VID",
            "our_reconstruction_ideal_light": "our network, ideal light",
            "our_reconstruction_all_light": "our network, all light",
            "high_pass_filter": "high-pass filter",
            "high_pass_filter_no_event_decay": "high-pass filter without event decay",
        },
    ),
    "flow": TaskSpec(
        title="optical flow",
        summary="end-point error of 20 patches",
        methods={
            "photometric_flow": f"{_METHODS}.photometric_flow:estimate",
            "photometric_flow_unknown_contrast": (
                f"{_METHODS}.photometric_flow:estimate_unknown_contrast"
            ),
            "photometric_flow_by_descent": f"{_METHODS}.photometric_flow:estimate_by_descent",
            "photometric_flow_with_delay": f"{_METHODS}.photometric_flow:estimate_with_delay",
            "contrast_maximization": f"{_METHODS}.contrast_maximization:estimate",
            "contrast_maximization_by_gradient": (
                f"{_METHODS}.contrast_maximization:estimate_by_gradient"
            ),
            "contrast_maximization_by_plain_variance": (
                f"{_METHODS}.contrast_maximization:estimate_by_plain_variance"
            ),
            "initial_flow": f"{_METHODS}.initial_flow:estimate",
        },
        metric=_RNEPE,
        baseline="initial_flow",
        scorer=f"{_SCORERS}.flow:FlowScorer",
        needs=("a threshold",),
        settings=f"{_SETTINGS}:Flow",
        sample="tasks.flow:FlowSample",
        share_column=ShareColumn("fail", "share of features that failed"),
        extensions=(
            *("photometric_flow_unknown_contrast", "photometric_flow_by_descent"),
            "photometric_flow_with_delay",
            *("contrast_maximization_by_gradient", "contrast_maximization_by_plain_variance"),
        ),
        without_threshold=(
            *("photometric_flow_unknown_contrast", "photometric_flow_by_descent"),
            *("contrast_maximization", "contrast_maximization_by_gradient"),
            *("contrast_maximization_by_plain_variance", "initial_flow"),
        ),
    ),
    "dense_flow": TaskSpec(
        title="dense optical flow",
        summary="end-point error of a flow of all pixels from two windows, at 20 features",
        methods={
            "eraft": f"{_METHODS}.eraft:estimate",
            "our_flow_ideal_light": f"{_METHODS}.eraft:estimate",
            "our_flow_all_light": f"{_METHODS}.eraft:estimate",
            "zero_flow": f"{_METHODS}.zero_flow:estimate",
            "initial_flow": f"{_METHODS}.initial_flow:estimate_everywhere",
        },
        metric=_RNEPE,
        baseline="zero_flow",
        scorer=f"{_SCORERS}.dense_flow:DenseFlowScorer",
        settings=f"{_SETTINGS}:DenseFlow",
        sample="tasks.dense_flow:DenseFlowSample",
        share_column=ShareColumn("fail", "share of features that failed"),
        other_baselines=("initial_flow",),
        networks={
            "eraft": f"{_NETWORKS}.eraft:load",
            "our_flow_ideal_light": f"{_NETWORKS}.ours:flow_ideal_light",
            "our_flow_all_light": f"{_NETWORKS}.ours:flow_all_light",
        },
        labels={
            "eraft": "E-RAFT",
            "our_flow_ideal_light": "our network, ideal light",
            "our_flow_all_light": "our network, all light",
        },
    ),
    "tracking": TaskSpec(
        title="pose tracking",
        summary="position error over the first 14 ms, in planar scenes",
        methods={
            "photometric_tracking": f"{_METHODS}.photometric_tracking:estimate",
            "photometric_tracking_with_delay": (
                f"{_METHODS}.photometric_tracking:estimate_with_delay"
            ),
            "initial_path": f"{_METHODS}.initial_path:estimate",
        },
        metric=_POSITION_ERROR,
        baseline="initial_path",
        scorer=f"{_SCORERS}.tracking:TrackingScorer",
        needs=("poses", "a plane", "a threshold"),
        settings=f"{_SETTINGS}:Tracking",
        sample="tasks.tracking:TrackingSample",
        share_column=ShareColumn("ok", "share of trials that succeed", of_successes=True),
        extensions=("photometric_tracking_with_delay",),
    ),
}


class _Tasks(dict[str, TaskSpec]):
    def __missing__(self, name: str) -> TaskSpec:
        raise TaskError(f"no task {name!r}, {nearest(name, self)}")


TASKS = _Tasks(_TASKS)


def load(place: str) -> Any:
    """Import the object at a place, "module:name"."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)
