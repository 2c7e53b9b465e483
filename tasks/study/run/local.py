"""This process as a scheduler: one job after another, each on all cores."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from eres_render.cores import cores
from eres_render.progress import Progress
from tasks.study.run.compute import ComputedJob, compute_job
from tasks.study.run.jobs import QueuedJob

# Where each stage begins in a job's time, and its share of it; for the progress bar alone.
_STAGES = {"rendering": (0.0, 0.5), "simulating": (0.5, 0.2), "scoring": (0.7, 0.3)}


class ThisProcess:
    """Computes jobs here, in the order in which they are given."""

    @property
    def cores(self) -> int:
        """Cores that this process may use."""
        return cores()

    def compute(
        self, jobs: Sequence[QueuedJob], on_progress: Progress
    ) -> Iterator[tuple[QueuedJob, ComputedJob]]:
        """As `Scheduler.compute`."""
        for k, queued in enumerate(jobs):

            def on_job(stage: str, done: float, of: float, /, k: int = k) -> None:
                begin, share = _STAGES.get(stage, (0.0, 0.0))
                on_progress(f"{stage} {done:g}/{of:g}", k + begin + share * done / of, len(jobs))

            on_progress(f"loading {queued.job.scene.name}", k, len(jobs))
            computed = compute_job(queued.job, on_job, with_highlights=queued.with_highlights)
            yield queued, computed
        on_progress("done", len(jobs), len(jobs))
