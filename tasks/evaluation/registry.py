"""The tasks, each described once: what is asked of a task elsewhere is read here.

A new task is a file of its problem, a scorer, its settings in `tasks.evaluation.settings`, and an
entry here. Modules are named in strings, so that listing the tasks loads none of them.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ShareColumn:
    """The column of a table that says how often a method failed, or how often it did not."""

    head: str
    meaning: str
    of_successes: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskSpec:
    """One task.

    Attributes
    ----------
    title
        Name in words.
    baseline
        The method that does nothing with the events.
    scorer
        "module:class" of what turns a sensor's events into scores; a `Scorer`.
    sample
        "module:class" of what a method takes first. None where a method is a class that events are
        pushed to.
    planar_only
        Whether the scene must be a plane.
    share_column
        How tables show failures. None where a method cannot fail.
    """

    title: str
    baseline: str
    scorer: str
    sample: str | None
    planar_only: bool = False
    share_column: ShareColumn | None = None


_SCORERS = "tasks.evaluation.scorers"

TASKS = {
    "reconstruction": TaskSpec(
        title="reconstruction",
        baseline="no_events",
        scorer=f"{_SCORERS}.reconstruction:ReconstructionScorer",
        sample="tasks.reconstruction:ReconstructionSample",
    ),
    "video": TaskSpec(
        title="video reconstruction",
        baseline="blank",
        scorer=f"{_SCORERS}.video:VideoScorer",
        sample=None,
    ),
    "flow": TaskSpec(
        title="optical flow",
        baseline="initial_flow",
        scorer=f"{_SCORERS}.flow:FlowScorer",
        sample="tasks.flow:FlowSample",
        share_column=ShareColumn("fail", "share of features that failed"),
    ),
    "tracking": TaskSpec(
        title="pose tracking",
        baseline="initial_path",
        scorer=f"{_SCORERS}.tracking:TrackingScorer",
        sample="tasks.tracking:TrackingSample",
        planar_only=True,
        share_column=ShareColumn("ok", "share of trials that succeed", of_successes=True),
    ),
}
