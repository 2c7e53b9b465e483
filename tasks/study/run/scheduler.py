"""What computes the jobs of a study: this process, or the workers of a Dask cluster."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

from eres_render.progress import Progress
from tasks.cluster import connected
from tasks.study.run.cluster import Cluster
from tasks.study.run.compute import ComputedJob
from tasks.study.run.jobs import QueuedJob
from tasks.study.run.local import ThisProcess

_log = logging.getLogger(__name__)


class Scheduler(Protocol):
    """Computes jobs on its cores, and yields each as soon as it is done."""

    @property
    def cores(self) -> int:
        """Number of cores that share the work."""
        ...

    def environment(self) -> dict[str, str]:
        """Return what is known about the machine, as `tasks.provenance.environment` does."""
        ...

    def compute(
        self, jobs: Sequence[QueuedJob], on_progress: Progress
    ) -> Iterator[tuple[QueuedJob, ComputedJob]]:
        """Yield every job with its result, in any order.

        Parameters
        ----------
        jobs
            The jobs.
        on_progress
            Called with a text, and the estimated core seconds of what is done and of all jobs.

        Returns
        -------
        An iterator over jobs and results.
        """
        ...


@contextmanager
def open_scheduler(address: str | None) -> Iterator[Scheduler]:
    """Open the Dask scheduler at an address; with None, this process computes the jobs."""
    if address is None:
        yield ThisProcess()
        return
    with connected(address) as client:
        cluster = Cluster(client)
        count = cluster.worker_count()
        if count:
            _log.info("workers at %s: %d", address, count)
        else:
            _log.warning("no workers at %s yet; waiting for one", address)
        yield cluster
