"""All sequences of a dataset, each in a folder that gets its name only when it is complete."""

from __future__ import annotations

import logging
import socket
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

from eres_render.errors import check_positive
from eres_render.progress import Progress, silent
from eres_render.storage.locks import LockedError, locked
from tasks import DISTRIBUTION
from tasks.cluster import connected, outcome
from tasks.errors import TaskError
from tasks.generation.sequence import UNFINISHED, complete_sequence, part, sequence_folder
from tasks.generation.settings import FILE_NAME, DatasetSettings, claim_folder, estimate

_log = logging.getLogger(__name__)


def make_dataset(
    settings: DatasetSettings,
    out: str | Path,
    count: int,
    scheduler: str | None = None,
    on_progress: Progress = silent,
) -> list[Path]:
    """Make the sequences of a dataset that do not exist yet.

    Sequence k is the folder `out/00000k`; see `make_sequence`. It gets that name only when it is
    complete. Unfinished sequences are in `out/.unfinished`; the next call continues them.

    Parameters
    ----------
    settings
        Settings of the sequences; `out/dataset.json` holds them.
    out
        Folder of the dataset.
    count
        Number of sequences. More can be added later.
    scheduler
        Address of a Dask scheduler whose workers make the sequences; they must see the folder under
        the same path. None makes them in this process.
    on_progress
        Called as the sequences proceed; existing sequences count as done.

    Returns
    -------
    folders
        All `count` sequences.

    Raises
    ------
    TaskError
        The count is less than 1, the folder holds a dataset with other settings or other files,
        another process writes into it, or the cluster cannot be used.
    RenderError, SensorError, OSError
        As rendering and simulation raise them. Finished sequences are kept.
    """
    out = Path(out)
    check_positive("count", count, TaskError)
    is_new = not (out / FILE_NAME).exists()
    claim_folder(settings, out)
    folders = [sequence_folder(out, number) for number in range(count)]
    try:
        with locked(out / ".lock", wait=False):
            claim_folder(settings, out)  # others may have done so at the same time
            missing = [number for number, folder in enumerate(folders) if not folder.is_dir()]

            def counted(stage: str, done: float, of: float, /) -> None:
                done += count - len(missing)
                on_progress(f"{int(done)} of {count} sequences, {stage}", done, count)

            if missing:
                _log.info("%s", estimate(settings, len(missing)))
                if scheduler is None:
                    _make_here(settings, missing, out, counted)
                else:
                    _make_on_workers(scheduler, settings, missing, out, counted)
            with suppress(OSError):  # it holds what a call for more sequences has begun
                (out / UNFINISHED).rmdir()
    except LockedError:
        raise TaskError(f"{out}: another process is making this dataset; wait for it") from None
    except Exception:
        if is_new and not any(folder.is_dir() for folder in (*folders, out / UNFINISHED)):
            (out / FILE_NAME).unlink(missing_ok=True)  # nothing was begun with these settings
        raise
    return folders


def _make_here(
    settings: DatasetSettings, numbers: list[int], out: Path, on_progress: Progress
) -> None:
    """Make sequences one after another, each on all cores."""
    for k, number in enumerate(numbers):
        complete_sequence(settings, number, out, part(on_progress, k, 1, len(numbers)))
        on_progress("next", k + 1, len(numbers))


def _make_on_workers(
    address: str, settings: DatasetSettings, numbers: list[int], out: Path, on_progress: Progress
) -> None:
    """Make sequences on the workers of a Dask scheduler."""
    with connected(address) as client:
        from distributed import as_completed

        place, code = str(out.resolve()), version(DISTRIBUTION)
        number_of = {
            client.submit(_complete, settings, number, place, code, pure=False): number
            for number in numbers
        }
        for done, future in enumerate(as_completed(number_of, loop=client.loop), start=1):
            outcome(future, f"sequence {number_of[future]}")
            on_progress("next", done, len(numbers))


def _complete(settings: DatasetSettings, number: int, place: str, code: str) -> None:
    """Make a sequence on a worker, if it has the same code and sees the same folder."""
    out, here = Path(place), version(DISTRIBUTION)
    if here != code:
        raise TaskError(f"worker on {socket.gethostname()}: has eres {here}, expected {code}")
    if not (out / FILE_NAME).is_file():
        raise TaskError(f"worker on {socket.gethostname()}: cannot see the folder {out}")
    if sequence_folder(out, number).is_dir():  # by a worker that died before it said so
        return
    claim_folder(settings, out)
    complete_sequence(settings, number, out)
