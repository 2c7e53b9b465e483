"""All sequences of a dataset, each in a folder that has its name only when it is complete."""

from __future__ import annotations

import logging
import os
import shutil
from pathlib import Path

from eres_render.progress import Progress, silent
from eres_render.storage.locks import locked
from tasks.errors import TaskError
from tasks.generation.estimate import estimate
from tasks.generation.sequence import make_sequence
from tasks.generation.settings import DatasetSettings, claim_folder

_log = logging.getLogger(__name__)

_UNFINISHED = ".unfinished"  # folder of the sequences that are being made


def make_dataset(
    settings: DatasetSettings, out: Path, count: int, on_progress: Progress = silent
) -> list[Path]:
    """Make sequences of random scenes, except for those that there are.

    Sequence k is the folder `out/00000k`; see `make_sequence`. It is under that name only when it
    is complete. What is unfinished lies in `out/.unfinished`, and is continued.

    Parameters
    ----------
    settings
        What decides the sequences; `out/dataset.json` holds it.
    out
        Folder of the dataset.
    count
        Number of sequences. More can be added later.
    on_progress
        Called as the sequences proceed; those that there were count as done.

    Returns
    -------
    folders
        All `count` sequences.

    Raises
    ------
    TaskError
        The folder holds a dataset with other settings or other files, or another process writes
        into it.
    RenderError, SensorError, OSError
        As rendering and simulation raise them. Finished sequences stay.
    """
    if count < 1:
        raise TaskError(f"count: found {count}, expected at least 1")
    claim_folder(settings, out)
    folders = [out / f"{number:06d}" for number in range(count)]
    try:
        with locked(out / ".lock", wait=False):
            missing = [number for number, folder in enumerate(folders) if not folder.is_dir()]
            if missing:
                _log.info("%s", estimate(settings, len(missing)))
            for done, number in enumerate(missing, start=count - len(missing)):

                def on_sequence(stage: str, share: float, of: float, /, done: int = done) -> None:
                    text = f"sequence {done + 1} of {count}: {stage}"
                    on_progress(text, done + share / of, count)

                on_progress(f"sequence {done + 1} of {count}", done, count)
                work = out / _UNFINISHED / folders[number].name
                make_sequence(settings, number, work, on_sequence)
                os.replace(work, folders[number])
            shutil.rmtree(out / _UNFINISHED, ignore_errors=True)
    except BlockingIOError:
        raise TaskError(f"{out}: another process makes this dataset; wait for it") from None
    return folders
