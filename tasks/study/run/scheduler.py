"""What computes the jobs of a study: this process, or the workers of a Dask cluster."""

from __future__ import annotations

import logging
import pickle
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import version
from itertools import islice
from typing import TYPE_CHECKING, Any

from eres_render import load_scene
from eres_render.cores import cores
from eres_render.errors import RenderError
from eres_render.progress import Progress, silent
from eres_render.rendering.backend import select_variant
from eres_render.scene.settings import TumPath
from sensor.errors import EventError, SensorError
from tasks import DISTRIBUTION
from tasks.cluster import connected, outcome
from tasks.errors import StudyError, TaskError
from tasks.evaluation.settings import check_methods
from tasks.methods import versions
from tasks.provenance import environment
from tasks.study.config import STAGE_VERSIONS
from tasks.study.run.compile_ahead import compiling_ahead
from tasks.study.run.compute import ComputedJob, compute_job
from tasks.study.run.estimate import JobEstimate, estimate_job
from tasks.study.run.jobs import Job, QueuedJob, check_weights, weight_digests

if TYPE_CHECKING:
    from distributed import Client, Future

_log = logging.getLogger(__name__)

_RETRIES = 2  # of a job that failed for a reason that may pass, such as a full disk


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
        """Yield every job with its result, once done; progress is in estimated core seconds."""
        tasks = [each for queued in jobs for each in queued.job.evaluate.items()]
        estimates = [estimate_job(queued.job) for queued in jobs]
        total_s = sum(estimate.core_s for estimate in estimates)
        before_s = 0.0
        with compiling_ahead(tasks):
            for queued, estimate in zip(jobs, estimates, strict=True):
                on_progress(f"loading {queued.job.scene.name}", before_s, total_s)
                computed = compute_job(queued, _within(on_progress, estimate, before_s, total_s))
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


class Cluster:
    """Computes jobs on the workers of a Dask scheduler, one at a time on each."""

    def __init__(self, client: Client) -> None:
        self._client = client

    @property
    def cores(self) -> int:
        """Number of workers now; they may come and go."""
        return len(self._client.scheduler_info(n_workers=-1)["workers"])

    def environment(self) -> dict[str, str]:
        """Return no machine, as workers come and go."""
        return {}

    def compute(
        self, jobs: Sequence[QueuedJob], on_progress: Progress
    ) -> Iterator[tuple[QueuedJob, ComputedJob]]:
        """Yield every job with its result, in any order; else as `ThisProcess.compute`."""
        from distributed import as_completed

        lengths_s = {queued.key: estimate_job(queued.job).core_s for queued in jobs}
        # The longest first, so that none is last; idle workers take what arrives.
        queued_of: dict[Future, QueuedJob] = {
            self._client.submit(
                _entry(),
                pickle.dumps(queued),
                _versions(),
                key=f"eres-{queued.key}-{'highlights' if queued.with_highlights else 'rows'}",
                priority=lengths_s[queued.key],
                retries=_RETRIES,
            ): queued
            for queued in sorted(jobs, key=lambda queued: lengths_s[queued.key], reverse=True)
        }
        done_s, shown_s, total_s = 0.0, 0.0, sum(lengths_s.values())
        on_progress(f"workers: {self.cores}", done_s, total_s)
        for future in as_completed(queued_of, loop=self._client.loop):
            queued = queued_of.pop(future)
            yield queued, _result(future, queued.job)
            future.release()
            done_s += lengths_s[queued.key]
            workers = self.cores
            begun = islice(queued_of.values(), workers)  # half done, as far as is known here
            begun_s = sum(lengths_s[other.key] for other in begun)
            shown_s = max(shown_s, done_s + begun_s / 2)  # not less if workers leave
            on_progress(f"workers: {workers}", shown_s, total_s)


def _versions() -> dict[str, Any]:
    return {"eres": version(DISTRIBUTION), **STAGE_VERSIONS, **versions()}


def _entry() -> Callable[[bytes, dict[str, Any]], Any]:
    """Return the function that a worker runs.

    Dask sends the code of a local function, so a worker without eres can run it and report that.
    """

    def compute(order: bytes, versions: dict[str, Any]) -> Any:
        try:
            from tasks.study.run.scheduler import compute_order
        except ImportError as error:
            import distributed

            return f"worker {distributed.get_worker().address}: eres is not installed: {error}"
        return compute_order(order, versions)

    return compute


def compute_order(order: bytes, versions: dict[str, Any]) -> ComputedJob | str:
    """Compute a job on a worker."""
    from distributed import get_worker

    worker = get_worker()
    try:
        if worker.state.nthreads != 1:
            raise StudyError(f"has {worker.state.nthreads} threads; start it with --nthreads 1")
        if _versions() != versions:
            raise StudyError(f"has versions {_versions()}, expected {versions}")
        queued = pickle.loads(order)
        job = _as_found_here(queued.job, queued.key)
        weights = weight_digests(job.evaluate)
        computed = compute_job(replace(queued, job=job), silent)
        check_weights(job.evaluate, weights)
        return computed
    except (RenderError, SensorError, EventError, TaskError) as error:
        if isinstance(error.__cause__, OSError):  # a full disk may pass
            raise
        return f"worker {worker.address} on {socket.gethostname()}: {error}"


def _as_found_here(job: Job, key: str) -> Job:
    """Return the job with this machine's scene; refuse it if the scene or a method differs."""
    check_methods(job.evaluate)
    scene = load_scene(job.scene.source, job.scene.given_path)
    path = job.scene.settings.path
    if isinstance(path, TumPath):  # may be the study's; the digest has the file's content
        scene = replace(scene, settings=replace(scene.settings, path=path))
    if scene.digest != job.scene.digest:  # the client computed it before it pickled the scene
        raise StudyError(
            f"scene {job.scene.source}: its files differ from the files of the study (digest "
            f"{scene.digest[:12]} here, {job.scene.digest[:12]} in the study)"
        )
    here = replace(job, scene=scene)
    if here.key != key:
        raise StudyError("your own method or weights are not the same here as in the study")
    return here


def _result(future: Future, job: Job) -> ComputedJob:
    name = f"{job.scene.name}, clip {job.clip.index}"
    try:
        result = outcome(future, name)
    except (OSError, RenderError) as error:
        raise StudyError(f"{name}: failed {_RETRIES + 1} times on workers: {error}") from None
    if isinstance(result, str):
        raise StudyError(result)
    return result
