"""The folder of a run: what earlier starts have finished, and what this one adds.

Claims and report read the folder of a run on recorded events like any other.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Collection, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from eres_render.storage.atomic import write_bytes, write_text
from eres_render.storage.settings_reader import read_json
from tasks.errors import ResultError, StudyError
from tasks.evaluation.timings import timings_file
from tasks.provenance import check_renderer, command, environment, together
from tasks.row import Row, read_rows, write_rows
from tasks.study.results.previews import INDEX_NAME, Preview
from tasks.study.results.scaling import Scaling
from tasks.study.run.compute import ComputedJob
from tasks.study.run.jobs import Job, QueuedJob

_log = logging.getLogger(__name__)

_REPLACED = ("rows.parquet", "tables.csv", "report.html")  # at the end, never before study.json


class RunFolder:
    """The files of a run; `mix` allows another Mitsuba or device than the run started with."""

    def __init__(self, folder: Path, jobs: Mapping[str, Job], *, mix: bool) -> None:
        if folder.exists() and not folder.is_dir():
            raise StudyError(f"{folder}: found a file, expected a folder for the run")
        others = [name for name in _REPLACED if (folder / name).exists()]
        if others and not (folder / "study.json").exists():
            raise StudyError(
                f"{folder}: contains {' and '.join(others)} without study.json; choose a new "
                "folder, or the folder of a run"
            )
        self._folder, self._jobs, self._mix = folder, jobs, mix
        self._index = folder / "previews" / INDEX_NAME
        self._rows_of = _rows_so_far(_rows_folder(folder), jobs)
        self._environment = _environment_so_far(folder)
        self._has_other_rows = False  # than the folder's rows.parquet
        self._first: dict[str, str] = {}  # job of each scene, which makes its highlights
        for key, job in jobs.items():
            self._first.setdefault(job.scene.name, key)

    @property
    def finished(self) -> Collection[str]:
        """Keys of the jobs whose rows are there."""
        return self._rows_of.keys()

    def to_do(self) -> list[QueuedJob]:
        """Return the jobs that the folder lacks, and those whose highlights it lacks."""
        queue = []
        for key, job in self._jobs.items():
            is_first = key == self._first[job.scene.name]
            if key not in self._rows_of or (is_first and not self._has_highlights(job)):
                queue.append(QueuedJob(job, key, is_first))
        return queue

    def check(self, environment: Mapping[str, str]) -> None:
        """Check that Mitsuba and the device are those of the finished jobs."""
        if not self._mix:
            check_renderer(self._environment, environment)

    def describe(self, study: Mapping[str, Any]) -> None:
        """Write study.json, unless there are rows, which it describes."""
        if not (self._folder / "rows.parquet").exists():
            self._write("study.json", study)

    def keep(self, queued: QueuedJob, computed: ComputedJob) -> None:
        """Write what a job returned."""
        self.check(computed.environment)  # workers of a cluster differ
        if queued.with_highlights:  # the list may be of another study's pictures, by these names
            self._index.unlink(missing_ok=True)
        timings = {f"costs/{queued.key}.json": timings_file(computed.timings)}
        for name, data in (timings | computed.files).items():
            write_bytes(self._folder / name, data)
        self._environment = together([self._environment, computed.environment])
        self._write("environment.json", self._environment)
        write_rows(_rows_folder(self._folder) / f"{queued.key}.parquet", computed.rows)
        self._rows_of[queued.key] = computed.rows
        self._has_other_rows = True

    def finish(self, study: Mapping[str, Any]) -> list[Row]:
        """Write the rows of all jobs, and what describes them."""
        files = [file for name in self._first if (file := self._previews_of(name)).exists()]
        if files:
            lists = (read_json(tuple[dict[str, Any], ...], file, ResultError) for file in files)
            every = chain.from_iterable(lists)
            pictures = [entry for entry in every if (self._index.parent / entry["file"]).exists()]
            self._write(f"previews/{INDEX_NAME}", pictures)
        else:  # they may be deleted
            self._index.unlink(missing_ok=True)
        rows = list(chain.from_iterable(self._rows_of[key] for key in self._jobs))
        write_rows(self._folder / "rows.parquet", rows)
        file = self._folder / "study.json"
        described = file.exists() and file.read_bytes() == _json(study)
        if self._has_other_rows or not self._environment or not described:
            self._write("environment.json", {**self._environment, "command": command()})
        self._write("study.json", study)
        return rows

    def _has_highlights(self, job: Job) -> bool:
        """Return whether this job made its scene's highlights; previews may be deleted."""
        previews = self._previews_of(job.scene.name)
        scaling = self._folder / "scaling" / f"{job.scene.name}.json"
        try:
            if previews.exists():
                read_json(tuple[Preview, ...], previews, ResultError)
            return read_json(Scaling, scaling, ResultError).job == job.key
        except ResultError:
            return False

    def _previews_of(self, scene_name: str) -> Path:
        return self._folder / "previews" / f"{scene_name}.json"

    def _write(self, name: str, value: Any) -> None:
        write_bytes(self._folder / name, _json(value))


def _json(value: Any) -> bytes:
    return json.dumps(value, indent=1).encode()


def _rows_folder(folder: Path) -> Path:
    """Return the folder of the rows of each job, which older runs call `parts`."""
    return folder / ("parts" if (folder / "parts").is_dir() else "jobs")


def _rows_so_far(folder: Path, work: Mapping[str, Job]) -> dict[str, list[Row]]:
    """Return the rows of finished jobs by key; warn of damaged and of unused files."""
    rows_of = {}
    for key, job in work.items():
        file = folder / f"{key}.parquet"
        if not file.exists():
            continue
        try:
            rows = read_rows(file)
            if others := {row.scene for row in rows} - {job.scene.name}:  # a key has no names
                raise ResultError(
                    f"{file}: has rows of scene {', '.join(sorted(others))}, expected scene "
                    f"{job.scene.name}, which has the same content"
                )
            rows_of[key] = rows
        except ResultError as error:
            _log.warning("%s; the job is computed again", error)
    if strangers := {file.stem for file in folder.glob("*.parquet")} - set(work):
        count = f"{len(strangers)} job{'s' * (len(strangers) > 1)}"
        _log.warning("%s: ignored %s of another study or version", folder, count)
    return rows_of


def _environment_so_far(folder: Path) -> dict[str, str]:
    """Return the environment of all jobs in the folder, those of other studies too, and the command
    that its rows are from."""
    file = folder / "environment.json"
    if not file.exists() or not any(_rows_folder(folder).glob("*.parquet")):
        return {}
    try:
        return read_json(dict[str, str], file, ResultError)
    except ResultError as error:
        _log.warning("%s; the versions and machines of the finished jobs are lost", error)
        return {}


def check_recorded(out: Path) -> None:
    """Refuse to write into the folder of a rendered study."""
    file = out / "study.json"
    if file.exists() and "recorded" not in read_json(dict[str, Any], file, StudyError):
        raise StudyError(f"{file}: belongs to a rendered study; choose another --out")


def write_recorded(out: Path, recordings: Sequence[Path], settings: Mapping[str, Any]) -> None:
    """Write study.json and environment.json of a run on recordings; the caller adds rows.parquet.

    `recordings` are the folders of the events.
    """
    config = {
        "name": "rig",
        "question": "Which distance from the print is best?",
        "recorded": [str(folder.absolute()) for folder in recordings],
        "evaluate": dict(settings),
    }
    versions = {"command": command(), **environment()}
    for name, content in (("study.json", config), ("environment.json", versions)):
        write_text(out / name, json.dumps(content, indent=1) + "\n")
