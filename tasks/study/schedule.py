"""Who computes the parts of a study: this process, or the workers of a Dask cluster."""

from __future__ import annotations

import logging
import os
import re
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import TYPE_CHECKING, Protocol

from eres_render import load_scene
from eres_render.errors import RenderError
from sensor.errors import EventError, SensorError
from tasks.errors import StudyError, TaskError
from tasks.study.compute_part import ComputedPart, compute_part
from tasks.study.config import STAGE_VERSIONS
from tasks.study.parts import Part, check_methods

if TYPE_CHECKING:
    from distributed import Client, Future

_log = logging.getLogger(__name__)

_CONNECT_S = 5.0
_RETRIES = 2  # of a part that failed by what may not come again, such as a full disk

# Where each stage begins in a part's time, and its share of it; for the progress bar alone.
_STAGES = {"rendering": (0.0, 0.5), "simulating": (0.5, 0.2), "scoring": (0.7, 0.3)}


@dataclass(frozen=True, slots=True)
class Task:
    """A part to compute, and whether the report shows it."""

    part: Part
    shown: bool


# Called with how many tasks are done, in part too, and what is being done.
OnTasks = Callable[[float, str], None]


class Schedule(Protocol):
    """Computes tasks on so many cores, and yields each as soon as it is done."""

    @property
    def cores(self) -> int: ...

    def compute(
        self, tasks: Sequence[Task], on_progress: OnTasks
    ) -> Iterator[tuple[Part, ComputedPart]]:
        """Yield every task's part and what came of it, in any order."""
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
        _log.info("%d workers at %s", cluster.cores, address)
        yield cluster


class _Here:
    """This process, one part after another, each on all cores."""

    @property
    def cores(self) -> int:
        return len(os.sched_getaffinity(0))

    def compute(
        self, tasks: Sequence[Task], on_progress: OnTasks
    ) -> Iterator[tuple[Part, ComputedPart]]:
        for k, task in enumerate(tasks):

            def on_part(stage: str, done: int, of: int, k: int = k) -> None:
                begin, share = _STAGES[stage]
                on_progress(k + begin + share * done / of, f"{stage} {done}/{of}")

            on_progress(k, f"loading {task.part.scene.name}")
            yield task.part, compute_part(task.part, on_part, shown=task.shown)
        on_progress(len(tasks), "done")


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    try:
        from distributed import Client
    except ImportError:
        raise StudyError(
            "--scheduler: Dask is not installed: pip install 'eres[distributed]'"
        ) from None
    if not re.fullmatch(r"(tcp|tls|ws|wss)://.+:\d+", address):
        raise StudyError(f"--scheduler: found {address!r}, expected tcp://HOST:PORT")
    try:
        client = Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise StudyError(
            f"--scheduler: found no Dask scheduler at {address}: {str(error).splitlines()[0]}"
        ) from None
    with client:
        yield client


class _Cluster:
    """Workers of a Dask scheduler, one part at a time each."""

    def __init__(self, client: Client) -> None:
        self._client = client

    @property
    def cores(self) -> int:
        """How many workers there are now; more may come and go."""
        return max(1, len(self._client.scheduler_info(n_workers=-1)["workers"]))

    def compute(
        self, tasks: Sequence[Task], on_progress: OnTasks
    ) -> Iterator[tuple[Part, ComputedPart]]:
        from distributed import as_completed

        part_of = {self._submit(task, -k): task.part for k, task in enumerate(tasks)}
        on_progress(0, f"{self.cores} workers")
        for done, future in enumerate(as_completed(part_of, loop=self._client.loop), start=1):
            part = part_of.pop(future)
            yield part, _result(future, part)
            future.release()
            on_progress(done, f"{self.cores} workers")

    def _submit(self, task: Task, priority: int) -> Future:
        key = task.part.key
        return self._client.submit(
            _on_worker,
            _Order(task, key, version("eres"), STAGE_VERSIONS),
            key=f"eres-{key}-{'shown' if task.shown else 'rows'}",
            priority=priority,
            retries=_RETRIES,
        )


@dataclass(frozen=True, slots=True)
class _Order:
    """A task, and whose: a worker with other code or another scene must not compute it."""

    task: Task
    part_key: str
    eres: str
    stage_versions: dict[str, int]


@dataclass(frozen=True, slots=True)
class _Refusal:
    """Why a part cannot be computed, on this worker or any other."""

    reason: str


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
    if isinstance(result, _Refusal):
        raise StudyError(result.reason)
    return result


def _on_worker(order: _Order) -> ComputedPart | _Refusal:
    from distributed import get_worker

    worker = get_worker()
    try:
        threads = worker.state.nthreads
        if threads != 1:
            raise StudyError(f"found {threads} threads, expected 1: start it with --nthreads 1")
        part = _as_found_here(order)
        return compute_part(part, lambda stage, done, of: None, shown=order.task.shown)
    except (RenderError, SensorError, EventError, TaskError) as error:
        return _Refusal(f"worker {worker.address} on {socket.gethostname()}: {error}")


def _as_found_here(order: _Order) -> Part:
    """The ordered part with the scene as this machine has it; refused if that is another one."""
    here = {"eres": version("eres"), **STAGE_VERSIONS}
    asked = {"eres": order.eres, **order.stage_versions}
    if here != asked:
        raise StudyError(f"found code of versions {here}, expected {asked}")
    part = order.task.part
    check_methods(part.evaluate)
    scene = load_scene(part.scene.source)
    # Pickled with the scene goes its digest, if it has been asked for.
    if scene.digest != part.scene.digest:
        raise StudyError(
            f"scene {part.scene.source}: found files of digest {scene.digest[:12]}, expected "
            f"{part.scene.digest[:12]}, as where the study was started"
        )
    part = replace(part, scene=scene)
    if part.key != order.part_key:
        raise StudyError("found other code of a method of your own than where the study started")
    return part
