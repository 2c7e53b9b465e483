"""The tasks and their methods: all other code reads them here.

A new task needs a scorer and an entry in `TASKS`; a new method needs a function and an entry in its
task's `methods`. Places are strings, so that listing tasks and methods imports none of them.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial
from pkgutil import resolve_name
from typing import Any, Literal

from eres_render.errors import suggestion
from sensor.own_modules import WithInstalled, installed
from tasks.errors import TaskError
from tasks.metric import Metric

Need = Literal["threshold", "light", "guess"]

NATIVE_PATCH = "61 px patch"
"""Variant of flow, as rows have it: patches of 61 px of the sensor, whatever its width."""


@dataclass(frozen=True, slots=True)
class ShareColumn:
    """The column of a table that shows how often a method failed or succeeded."""

    head: str
    meaning: str
    of_successes: bool = False


@dataclass(frozen=True, slots=True)
class Cost:
    """How long a method takes, in seconds of one core; the estimate of a study's cost uses it.

    The values are rough means over the scenes and lights of the runs in docs/results, on two
    virtual servers: `python benchmarks/study_costs.py RUN STUDY` prints them. The values of
    networks come from `python benchmarks/bench_networks.py`.

    Attributes
    ----------
    answer_s
        For one answer at 1280 px, or one image of a video. It is proportional to the number of
        pixels.
    window_s
        For one window at 1280 px, of networks for video.
    path_s, event_s
        For one path from the nearest of the study's starts: a fixed part, and a part for each
        event.
    """

    answer_s: float = 0.0
    window_s: float = 0.0
    path_s: float = 0.0
    event_s: float = 0.0


@dataclass(frozen=True, slots=True)
class MethodSpec:
    """One method of a task.

    Attributes
    ----------
    place
        Place of the function or class, "module:name".
    label
        Name in words, where it differs from the name without underscores.
    version
        Raise it when results change: studies then recompute the jobs that use the method.
    role
        A "baseline" does not use the events; a "diagnostic" gets the truth, and bounds what others
        can reach.
    ours
        Whether this is our variant of a method of the paper.
    network
        Place of the function that reads a file of weights, for a method that needs one.
    needs
        "threshold": the contrast threshold. "light": the image at the start of each window.
        "guess": a start near the answer, as the method searches for the nearest minimum.
    on_recordings
        Whether it runs on a recording by default.
    delay
        Whether it estimates the delay of events, which needs events after the end of the path.
    cost
        How long it takes; None for the mean of the task's other methods.
    """

    place: str
    _: KW_ONLY
    label: str = ""
    version: int = 1
    role: Literal["baseline", "method", "diagnostic"] = "method"
    ours: bool = False
    network: str = ""
    needs: tuple[Need, ...] = ("threshold",)
    on_recordings: bool = True
    delay: bool = False
    cost: Cost | None = None


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
        The methods by name: each a `MethodSpec`, or its place alone.
    metric
        The metric of its scores.
    baseline
        Name of the method that does not use the events; others are compared with it.
    scorer
        Place of the class that turns events into scores: a `Scorer`, made from a `Source` and the
        settings.
    needs
        What a source must have: "frames", "poses", "a plane", "a threshold", or "a change", which
        is what an event is worth between two frames. For recordings the last two are estimated.
    settings
        Place of the class of its settings: `TaskSettings`, or a class derived from it.
    sample
        Place of the class of a method's first argument, which identifies the method's task. None if
        methods are classes that events are pushed to.
    share_column
        How tables show failures. None where a method cannot fail.
    """

    title: str
    methods: Mapping[str, MethodSpec | str]
    metric: Metric
    baseline: str
    scorer: str
    needs: tuple[str, ...] = ()
    settings: str = "tasks.evaluation.settings:TaskSettings"
    sample: str | None = None
    share_column: ShareColumn | None = None
    summary: str = ""

    def method(self, name: str) -> MethodSpec:
        """Return the facts about a method; a ``module:function`` has only its place."""
        spec = self.methods.get(name, name)
        return MethodSpec(spec) if isinstance(spec, str) else spec

    def is_own(self, name: str) -> bool:
        """Whether a method's code is outside of eres."""
        return not self.method(name).place.startswith("tasks.")

    def label(self, method: str) -> str:
        """Return a method's name in words; a ``module:function`` stays as it is."""
        words = method if ":" in method else method.replace("_", " ")
        return self.method(method).label or words

    def cost(self, method: str) -> Cost:
        """Return the cost of a method, or an estimate from the other methods of the task."""
        if (known := self.method(method).cost) is not None:
            return known
        costs = [cost for name in self.methods if (cost := self.method(name).cost)]
        answers_s = [cost.answer_s for cost in costs if cost.answer_s]
        return Cost(sum(answers_s) / len(answers_s)) if answers_s else costs[0]

    @property
    def networks(self) -> tuple[str, ...]:
        """Names of the methods that need weights."""
        return tuple(name for name in self.methods if self.method(name).network)

    def usual(self, with_weights: Collection[str] = ()) -> tuple[str, ...]:
        """Return the methods that run by default: no diagnostics, and networks only with weights.

        Networks whose weights come with eres run only if they are named or given other weights.
        """
        absent = {*self.networks} - {*with_weights}
        listed = {name: self.method(name).role for name in self.methods if name not in absent}
        return tuple(name for name, role in listed.items() if role != "diagnostic")


class _Tasks(dict[str, TaskSpec]):
    def __missing__(self, name: str) -> TaskSpec:
        raise TaskError(f"no task {name!r}, {suggestion(name, self)}")


TASKS = _Tasks()

_SCORERS = "tasks.evaluation.scorers"
_SETTINGS = "tasks.evaluation.settings"
_OURS = "tasks.learned.ours"

_PSNR = Metric("psnr_db", "PSNR", "dB", higher_is_better=True, negligible=0.1, decimals=2)
_RNEPE = Metric("rnepe_px", "RNEPE", "px", False, 0.05, decimals=2, reference_width_px=1280)
_FAILURES = ShareColumn("fail", "share of features that failed")


def _method(place: str, **facts: Any) -> MethodSpec:
    return MethodSpec(f"tasks.methods.{place}", **facts)


_NEAR: tuple[Need, ...] = ("light", "guess")
_baseline = partial(_method, role="baseline", needs=(), cost=Cost())
_diagnostic = partial(_method, role="diagnostic", needs=())
_extension = partial(_method, ours=True)
_near = partial(_method, needs=("threshold", *_NEAR))
_with_delay = partial(_near, version=3, ours=True, delay=True)
_contrast = partial(_method, version=2, needs=())
_e2vid = partial(_method, "e2vid:E2vid", needs=())
_video_net = partial(
    _method, "our_reconstruction:OurReconstruction", version=2, cost=Cost(window_s=2.9)
)
_flow_net = partial(_method, "eraft:estimate", needs=())

TASKS["reconstruction"] = TaskSpec(
    title="reconstruction",
    summary="PSNR of the image at the end of the window",
    methods={
        "event_integration": _method("event_integration:reconstruct"),
        "event_integration_nearest": _extension("event_integration:reconstruct_nearest"),
        "event_integration_bilinear": _extension("event_integration:reconstruct_bilinear"),
        "no_events": _baseline("baselines:keyframe"),
    },
    metric=_PSNR,
    baseline="no_events",
    scorer=f"{_SCORERS}.reconstruction:ReconstructionScorer",
    needs=("frames", "a change"),
    settings=f"{_SETTINGS}:Reconstruction",
    sample="tasks.reconstruction:ReconstructionSample",
)
TASKS["video"] = TaskSpec(
    title="video reconstruction",
    summary="PSNR of images along a continuous sequence",
    methods={
        "high_pass_filter": _method(
            "high_pass_filter:HighPassFilter", label="high-pass filter", cost=Cost(0.24)
        ),
        "high_pass_filter_no_event_decay": _extension(
            "high_pass_filter:without_event_decay",
            label="high-pass filter without event decay",
            cost=Cost(0.24),
        ),
        "e2vid": _e2vid(
            label="E2VID", version=2, network="tasks.learned.e2vid:load", cost=Cost(window_s=9.1)
        ),
        "firenet": _e2vid(
            label="FireNet", network="tasks.learned.firenet:firenet", cost=Cost(window_s=2.4)
        ),
        "firenet_plus": _e2vid(
            label="FireNet+", network="tasks.learned.firenet:firenet_plus", cost=Cost(window_s=2.4)
        ),
        "our_reconstruction_ideal_light": _video_net(
            label="our network, ideal light", network=f"{_OURS}:reconstruction_ideal_light"
        ),
        "our_reconstruction_all_light": _video_net(
            label="our network, all light", network=f"{_OURS}:reconstruction_all_light"
        ),
        "late_truth": _diagnostic("true_video:LateTruth"),
        "filtered_truth": _diagnostic("true_video:FilteredTruth"),
        "blank": _baseline("baselines:BlankVideo"),
    },
    metric=_PSNR,
    baseline="blank",
    scorer=f"{_SCORERS}.video:VideoScorer",
    needs=("frames", "a threshold"),
    settings=f"{_SETTINGS}:Video",
)
TASKS["flow"] = TaskSpec(
    title="optical flow",
    summary="end-point error of 20 patches",
    methods={
        "photometric_flow": _near("photometric_flow:estimate", version=3, cost=Cost(0.04)),
        "photometric_flow_unknown_contrast": _extension(
            "photometric_flow:estimate_unknown_contrast", version=3, needs=_NEAR, cost=Cost(0.015)
        ),
        "photometric_flow_by_descent": _extension(
            "photometric_flow:estimate_by_descent", version=2, needs=_NEAR, cost=Cost(0.05)
        ),
        "photometric_flow_with_delay": _with_delay(  # clocks and exposures of recordings hide it
            "photometric_flow:estimate_with_delay", on_recordings=False, cost=Cost(0.03)
        ),
        "contrast_maximization": _contrast("contrast_maximization:estimate", cost=Cost(0.012)),
        "contrast_maximization_by_gradient": _contrast(
            "contrast_maximization:estimate_by_gradient", ours=True, cost=Cost(0.017)
        ),
        "contrast_maximization_by_plain_variance": _contrast(
            "contrast_maximization:estimate_by_plain_variance", ours=True, cost=Cost(0.0035)
        ),
        "initial_flow": _baseline("baselines:initial_flow"),
    },
    metric=_RNEPE,
    baseline="initial_flow",
    scorer=f"{_SCORERS}.flow:FlowScorer",
    needs=("a threshold",),
    settings=f"{_SETTINGS}:Flow",
    sample="tasks.flow:FlowSample",
    share_column=_FAILURES,
)
TASKS["dense_flow"] = TaskSpec(
    title="dense optical flow",
    summary="end-point error of a flow of all pixels from two windows, at 20 features",
    methods={
        "eraft": _flow_net(label="E-RAFT", network="tasks.learned.eraft:load", cost=Cost(20.0)),
        "our_flow_ideal_light": _flow_net(
            label="our network, ideal light", network=f"{_OURS}:flow_ideal_light", cost=Cost(3.2)
        ),
        "our_flow_all_light": _flow_net(
            label="our network, all light", network=f"{_OURS}:flow_all_light", cost=Cost(3.2)
        ),
        "zero_flow": _baseline("baselines:zero_flow"),
        "initial_flow": _baseline(  # on recordings, where nothing is known, it is zero_flow
            "baselines:initial_flow_everywhere", on_recordings=False
        ),
    },
    metric=_RNEPE,
    baseline="zero_flow",
    scorer=f"{_SCORERS}.dense_flow:DenseFlowScorer",
    settings=f"{_SETTINGS}:DenseFlow",
    sample="tasks.dense_flow:DenseFlowSample",
    share_column=_FAILURES,
)
TASKS["tracking"] = TaskSpec(
    title="pose tracking",
    summary="position error over the first 14 ms, in planar scenes",
    methods={
        "photometric_tracking": _near(
            "photometric_tracking:estimate", version=2, cost=Cost(path_s=0.06, event_s=1.1e-6)
        ),
        "photometric_tracking_with_delay": _with_delay(
            "photometric_tracking:estimate_with_delay", cost=Cost(path_s=0.1, event_s=1.9e-6)
        ),
        "initial_path": _baseline("baselines:initial_path"),
    },
    metric=Metric("position_error_mm", "position error", "mm", False, 0.1, decimals=2, digits=3),
    baseline="initial_path",
    scorer=f"{_SCORERS}.tracking:TrackingScorer",
    needs=("poses", "a plane", "a threshold"),
    settings=f"{_SETTINGS}:Tracking",
    sample="tasks.tracking:TrackingSample",
    share_column=ShareColumn("ok", "share of trials that succeed", of_successes=True),
)


for _task, _spec in TASKS.items():
    _more = partial(installed, "eres.methods", f"{_task}.")
    TASKS[_task] = replace(_spec, methods=WithInstalled(_spec.methods, _more))


def load(place: str) -> Any:
    """Import the object at a place, "module:name"."""
    return resolve_name(place)


def equalization_variant(name: str) -> str:
    """Return the variant of video whose images are compared with another equalization."""
    return f"equalization {name}"


def sigma_variant(sigma_mm: float) -> str:
    """Return the variant of tracking whose start is off by a standard deviation, mm."""
    return f"sigma {sigma_mm:g} mm"


def sigma_mm(variant: str) -> float | None:
    """Return the standard deviation in mm of a variant such as "sigma 2 mm"; None for others."""
    match = re.fullmatch(r"sigma ([0-9.e+-]+) mm", variant)
    return float(match[1]) if match else None
