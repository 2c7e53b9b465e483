"""Times at which the light stepped up."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eres_render.errors import reading
from sensor.errors import EventError
from sensor.formats import read_triggers
from tasks.errors import TaskError

TRIGGERS = "triggers"


def read_steps(where: str, recording: Path, format: str | None = None) -> NDArray[np.int64]:
    """Read the times of steps.

    Parameters
    ----------
    where
        A text file with one time per line, microseconds; or "triggers", for the rising edges in the
        recording, with the number of their channel as in "triggers:1" if it has several.
    recording, format
        The recording, and its format; by default that of its extension or header.

    Returns
    -------
    (S,) microseconds, on the clock of the events.
    """
    if chosen := re.fullmatch(rf"{TRIGGERS}(?::(\d+))?", where):
        channel = None if chosen[1] is None else int(chosen[1])
        triggers = read_triggers(recording, format=format)
        try:
            return triggers.rising_us(channel)
        except EventError as error:
            raise TaskError(f"{recording}: {error}, as in --steps {TRIGGERS}:1") from None
    file = Path(where)
    with reading(file, "text", TaskError):
        lines = file.read_text(encoding="utf-8").splitlines()
    times = []
    for k, line in enumerate(lines, start=1):
        text = line.partition("#")[0].strip()
        if text:
            try:
                times.append(np.int64(round(float(text))))
            except (ValueError, OverflowError):
                raise TaskError(f"{file}:{k}: found {text!r}, expected a time in us") from None
    return np.array(times, np.int64)
