"""Who computes the parts of a study: this process, or the workers of a Dask cluster."""

from __future__ import annotations

import logging
import os
import pickle
import re
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Protocol

from eres_render import load_scene
from eres_render.errors import RenderError
from sensor.errors import EventError, SensorError
from tasks import DISTRIBUTION
from tasks.errors import StudyError, TaskError
from tasks.evaluation.settings import check_methods
from tasks.methods import METHOD_VERSIONS
from tasks.study.config import STAGE_VERSIONS
from tasks.study.run.compute import ComputedPart, compute_part
from tasks.study.run.estimate import cost
from tasks.study.run.jobs import Part

if TYPE_CHECKING:
    from distributed import Client, Future

_log = logging.getLogger(__name__)

_CONNECT_S = 5.0
_RETRIES = 2  # of a part that failed by what may not come again, such as a full disk

# Where each stage begins in a part's time, and its share of it; for the progress bar alone.
_STAGES = {"rendering": (0.0, 0.5), "simulating": (0.5, 0.2), "scoring": (0.7, 0.3)}


@dataclass(frozen=True, slots=True)
class Task:
    """A part to compute.

    Parameters
    ----------
    part, key
        The key is the part's from when the study began, should a method be edited meanwhile.
    shown
        Whether the report shows it.
    """

    part: Part
    key: str
    shown: bool


# Called with how many tasks are done, in part too, and what is being done.
OnTasks = Callable[[float, str], None]


class Schedule(Protocol):
    """Computes tasks on so many cores, and yields each as soon as it is done."""

    @property
    def cores(self) -> int: ...

    def compute(
        self, tasks: Sequence[Task], on_progress: OnTasks
    ) -> Iterator[tuple[Task, ComputedPart]]:
        """Yield every task and what came of it, in any order."""
        ...


@contextmanager
def schedule(address: str | None) -> Iterator[Schedule]:
    """Open the Dask scheduler at an address, or, with none, stay in this process.

    Raises
    ------
    StudyError
        No scheduler answers there within seconds, or Dask is not installed.
    """
    if address is None:
        yield _Here()
        return
    with _connected(address) as client:
        cluster = _Cluster(client)
        count = cluster.worker_count()
        if count:
            _log.info("workers at %s: %d", address, count)
        else:
            _log.warning("no workers at %s yet; waiting for some", address)
        yield cluster


class _Here:
    """This process, one part after another, each on all cores."""

    @property
    def cores(self) -> int:
        return len(os.sched_getaffinity(0))

    def compute(
        self, tasks: Sequence[Task], on_progress: OnTasks
    ) -> Iterator[tuple[Task, ComputedPart]]:
        for k, task in enumerate(tasks):

            def on_part(stage: str, done: float, of: float, /, k: int = k) -> None:
                begin, share = _STAGES.get(stage, (0.0, 0.0))
                on_progress(k + begin + share * done / of, f"{stage} {done:g}/{of:g}")

            on_progress(k, f"loading {task.part.scene.name}")
            yield task, compute_part(task.part, on_part, shown=task.shown)
        on_progress(len(tasks), "done")


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    try:
        from distributed import Client
    except ImportError:
        raise StudyError(
            "--scheduler: Dask is not installed; it comes with the extra `distributed`, in a "
            "checkout by: pip install '.[distributed]'"
        ) from None
    if not re.fullmatch(r"(tcp|tls|ws|wss)://.+:\d+", address):
        raise StudyError(f"--scheduler: found {address!r}, expected tcp://HOST:PORT")
    with _quiet("distributed", "distributed.client"):  # our errors say it in a line
        try:
            client = Client(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            reason = str(error).partition("\n")[0] or f"no answer within {_CONNECT_S:g} s"
            raise StudyError(
                f"--scheduler: found no Dask scheduler at {address}: {reason}"
            ) from None
        with client:
            yield client


@contextmanager
def _quiet(*names: str) -> Iterator[None]:
    levels = {name: logging.getLogger(name).level for name in names}
    try:
        for name in names:
            logging.getLogger(name).setLevel(logging.CRITICAL)
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


class _Cluster:
    """Workers of a Dask scheduler, one part at a time each."""

    def __init__(self, client: Client) -> None:
        self._client = client

    def worker_count(self) -> int:
        """How many workers there are now; they may come and go."""
        return len(self._client.scheduler_info(n_workers=-1)["workers"])

    @property
    def cores(self) -> int:
        return max(1, self.worker_count())

    def compute(
        self, tasks: Sequence[Task], on_progress: OnTasks
    ) -> Iterator[tuple[Task, ComputedPart]]:
        from distributed import as_completed

        task_of = {self._submit(task): task for task in tasks}
        on_progress(0, f"workers: {self.worker_count()}")
        for done, future in enumerate(as_completed(task_of, loop=self._client.loop), start=1):
            task = task_of.pop(future)
            yield task, _result(future, task.part)
            future.release()
            on_progress(done, f"workers: {self.worker_count()}")

    def _submit(self, task: Task) -> Future:
        return self._client.submit(
            _entry(),
            _order(task),
            _versions(),
            key=f"eres-{task.key}-{'shown' if task.shown else 'rows'}",
            priority=round(cost([task.part]).seconds),  # the longest first, so that none is last
            retries=_RETRIES,
        )


def _order(task: Task) -> bytes:
    return pickle.dumps(task)


def _versions() -> dict[str, Any]:
    return {"eres": version(DISTRIBUTION), **STAGE_VERSIONS, **METHOD_VERSIONS}


def _entry() -> Callable[[bytes, dict[str, Any]], Any]:
    """What a worker is sent. Made here, it is sent as code, which a worker without eres can run."""

    def compute(order: bytes, versions: dict[str, Any]) -> Any:
        try:
            from tasks.study.run.scheduler import compute_order
        except ImportError as error:
            import distributed

            return f"worker {distributed.get_worker().address}: this eres is not there: {error}"
        return compute_order(order, versions)

    return compute


def compute_order(order: bytes, versions: dict[str, Any]) -> ComputedPart | str:
    """Compute a part on a worker; returns why not, if no retry could.

    Parameters
    ----------
    order
        The task, pickled.
    versions
        Of the code that pickled it.
    """
    from distributed import get_worker

    worker = get_worker()
    try:
        if worker.state.nthreads != 1:
            raise StudyError(
                f"found {worker.state.nthreads} threads, expected 1: start it with --nthreads 1"
            )
        if _versions() != versions:
            raise StudyError(f"found code of versions {_versions()}, expected {versions}")
        task = pickle.loads(order)
        part = _as_found_here(task.part, task.key)
        return compute_part(part, lambda stage, done, of: None, shown=task.shown)
    except (RenderError, SensorError, EventError, TaskError) as error:
        return f"worker {worker.address} on {socket.gethostname()}: {error}"


def _as_found_here(part: Part, key: str) -> Part:
    """The part with the scene that this machine has, refused if that or a method is another one."""
    check_methods(part.evaluate)
    scene = load_scene(part.scene.source)
    if scene.digest != part.scene.digest:  # which was asked for before, and is pickled with it
        raise StudyError(
            f"scene {part.scene.source}: found files of digest {scene.digest[:12]}, expected "
            f"{part.scene.digest[:12]}, as where the study was started"
        )
    here = replace(part, scene=scene)
    if here.key != key:
        raise StudyError("found other code of a method of your own than where the study started")
    return here


def _result(future: Future, part: Part) -> ComputedPart:
    from distributed import KilledWorker
    from distributed.client import FutureCancelledError

    named = f"{part.scene.name}, clip {part.clip.index}"
    try:
        result = future.result()
    except KilledWorker as error:
        raise StudyError(
            f"{named}: one worker after another died while computing it, short of memory perhaps; "
            f"the last was {error.last_worker.address}"
        ) from None
    except FutureCancelledError:
        raise StudyError(f"{named}: the Dask scheduler is gone, or gave the part up") from None
    except OSError as error:
        raise StudyError(f"{named}: failed {_RETRIES + 1} times on workers: {error}") from None
    if isinstance(result, str):
        raise StudyError(result)
    return result
