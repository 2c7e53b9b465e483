"""This process computes the jobs, one after another, each on all cores."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from eres_render.cores import cores
from eres_render.progress import Progress
from eres_render.rendering.backend import select_variant
from tasks.provenance import environment
from tasks.study.run.compile_ahead import compiling_ahead
from tasks.study.run.compute import ComputedJob, compute_job
from tasks.study.run.jobs import QueuedJob

# Start of each stage and its share of a job's time; only for the progress bar.
_STAGES = {"simulating": (0.0, 0.7), "scoring": (0.7, 0.3)}


class ThisProcess:
    """Computes jobs in this process, in the given order."""

    @property
    def cores(self) -> int:
        """Number of cores that this process may use."""
        return cores()

    def environment(self) -> dict[str, str]:
        """As `Scheduler.environment`."""
        return environment(select_variant())

    def compute(
        self, jobs: Sequence[QueuedJob], on_progress: Progress
    ) -> Iterator[tuple[QueuedJob, ComputedJob]]:
        """As `Scheduler.compute`."""
        tasks = [each for queued in jobs for each in queued.job.evaluate.items()]
        with compiling_ahead(tasks):
            for k, queued in enumerate(jobs):

                def on_job(stage: str, done: float, of: float, /, k: int = k) -> None:
                    begin, share = _STAGES.get(stage, (0.0, 0.0))
                    on_progress(
                        f"{stage} {done:g}/{of:g}", k + begin + share * done / of, len(jobs)
                    )

                on_progress(f"loading {queued.job.scene.name}", k, len(jobs))
                computed = compute_job(queued.job, on_job, with_highlights=queued.with_highlights)
                yield queued, computed
        on_progress("done", len(jobs), len(jobs))
