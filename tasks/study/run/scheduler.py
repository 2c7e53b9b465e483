"""What computes the jobs of a study: this process, or the workers of a Dask cluster."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from eres_render.cores import cores
from eres_render.progress import Progress
from eres_render.rendering.backend import select_variant
from tasks.cluster import connected
from tasks.provenance import environment
from tasks.study.run.cluster import Cluster
from tasks.study.run.compile_ahead import compiling_ahead
from tasks.study.run.compute import ComputedJob, compute_job
from tasks.study.run.estimate import JobEstimate, estimate_job
from tasks.study.run.jobs import QueuedJob

_log = logging.getLogger(__name__)


@contextmanager
def open_scheduler(address: str | None) -> Iterator[ThisProcess | Cluster]:
    """Open the Dask scheduler at an address; with None, this process computes the jobs."""
    if address is None:
        yield ThisProcess()
        return
    with connected(address) as client:
        cluster = Cluster(client)
        if cluster.cores:
            _log.info("workers at %s: %d", address, cluster.cores)
        else:
            _log.warning("no workers at %s yet; waiting for one", address)
        yield cluster


class ThisProcess:
    """Computes jobs in this process, in the given order."""

    @property
    def cores(self) -> int:
        """Number of cores that this process may use."""
        return cores()

    def environment(self) -> dict[str, str]:
        """Return what is known about the machine, as `tasks.provenance.environment` does."""
        return environment(select_variant())

    def compute(
        self, jobs: Sequence[QueuedJob], on_progress: Progress
    ) -> Iterator[tuple[QueuedJob, ComputedJob]]:
        """Yield every job with its result, as soon as it is done.

        Parameters
        ----------
        on_progress
            Called with a text, and the estimated core seconds of what is done and of all jobs.
        """
        tasks = [each for queued in jobs for each in queued.job.evaluate.items()]
        estimates = [estimate_job(queued.job) for queued in jobs]
        total_s = sum(estimate.core_s for estimate in estimates)
        before_s = 0.0
        with compiling_ahead(tasks):
            for queued, estimate in zip(jobs, estimates, strict=True):
                on_progress(f"loading {queued.job.scene.name}", before_s, total_s)
                on_job = _within(on_progress, estimate, before_s, total_s)
                computed = compute_job(queued, on_job)
                before_s += estimate.core_s
                yield queued, computed
        on_progress("done", total_s, total_s)


def _within(on_progress: Progress, job: JobEstimate, before_s: float, total_s: float) -> Progress:
    """Return what reports the stages of a job among all jobs."""
    stages = {"simulating": (0.0, job.frames_s), "scoring": (job.frames_s, job.samples_s)}
    reached_s = before_s  # sensors of another shape go through the stages again
    end_s = before_s + job.core_s  # rounded as where the next job begins

    def on_job(stage: str, done: float, of: float, /) -> None:
        nonlocal reached_s
        begin_s, length_s = stages.get(stage, (0.0, 0.0))
        reached_s = max(reached_s, min(before_s + begin_s + length_s * done / of, end_s))
        on_progress(f"{stage} {done:g}/{of:g}", reached_s, total_s)

    return on_job
