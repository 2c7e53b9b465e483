"""The pace of a machine: how many times as long its jobs take as their estimates say.

The cache keeps it, so that estimates of the next study follow a slow machine from the start.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from eres_render.errors import RenderError
from eres_render.storage.atomic import write_bytes
from eres_render.storage.cache import cache_dir
from eres_render.storage.settings_reader import read_json
from tasks.errors import ResultError
from tasks.evaluation.timings import JobTimings
from tasks.provenance import VARIANT
from tasks.study.run.estimate import JobEstimate

_KEPT_S = 4 * 3600.0  # of the latest jobs, as other work on a machine comes and goes
_PRIOR_S = 60.0  # as if so much were done as estimated, so that small jobs decide little

_Sums = dict[str, tuple[float, float]]  # estimated and measured core seconds, by machine


def pace_of(environment: Mapping[str, str]) -> float | None:
    """Return the pace of a machine.

    Returns
    -------
    Measured core seconds of the machine's latest jobs over the estimated ones; None if the cache
    knows of none.
    """
    sums = _read().get(_machine(environment))
    return None if sums is None else (sums[1] + _PRIOR_S) / (sums[0] + _PRIOR_S)


def add_job(environment: Mapping[str, str], estimate: JobEstimate, timings: JobTimings) -> None:
    """Let a job count for the pace of its machine.

    Parameters
    ----------
    estimate
        Its estimated work; only the share of the frames counts that was not in the cache.
    """
    cached = 1.0 - min(1.0, timings.rendered_frames / estimate.frames)
    sums, machine = _read(), _machine(environment)
    told_s, took_s = sums.get(machine, (0.0, 0.0))
    told_s += estimate.core_s - cached * estimate.render_s
    took_s += timings.core_s
    share = min(1.0, _KEPT_S / told_s)
    sums[machine] = share * told_s, share * took_s
    with suppress(RenderError):  # a study does not fail for it
        write_bytes(_file(), json.dumps(sums, indent=1).encode())


def _machine(environment: Mapping[str, str]) -> str:
    return ", ".join(environment.get(name, "") for name in ("processor", "cores", VARIANT))


def _read() -> _Sums:
    with suppress(ResultError):  # missing, or damaged
        return read_json(_Sums, _file(), ResultError)
    return {}


def _file() -> Path:
    return cache_dir() / "pace.json"
