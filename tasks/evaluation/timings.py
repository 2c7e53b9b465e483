"""Measured work and time of a run's jobs, by stage and by method, in one JSON file for each job."""

from __future__ import annotations

import json
import time
from collections import defaultdict
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from eres_render.storage.settings_reader import read_json
from tasks.errors import ResultError


class Stopwatch:
    """Adds up wall-clock seconds by stage: `with stopwatch("reading"): ...`."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Add the time spent in this context to a stage."""
        started_s = time.perf_counter()
        yield
        self.seconds[stage] += time.perf_counter() - started_s


@dataclass(frozen=True, slots=True)
class MethodTimings:
    """Work and time of one method on one sensor, over all settings.

    `estimates` counts answers: images, flows, patches or paths. `cpu_s` is the CPU time of all
    answers, `median_cpu_s` its median over them, which the compilation in the first answer does not
    affect. What both trackers need counts for the tracker that is first. Runs of older versions
    lack `sensor`.
    """

    task: str
    method: str
    variant: str
    width: int
    estimates: int
    events: int
    cpu_s: float
    median_cpu_s: float
    sensor: str = ""


@dataclass(frozen=True, slots=True)
class JobTimings:
    """Work and time of one job. Times are wall-clock times with all cores at work.

    Time in which frames render while sensors and scorers work on earlier frames counts half for
    rendering and half for the others, so all stages add up to the time of the job. `reading_s` is
    spent waiting for frames to be read or written, `collecting_s` waiting for scorers to take in
    events (video methods run there), and `scoring_s` is the time from samples to scores, methods
    included. `frames` were read; `rendered_frames` were not in the cache. `pixel_frames`, pixels
    times frames, and `events` are sums over all sensors, warm-up included. `resolution` is the
    width of the frames, px; `height` is 0 if they are square, as in older files. Jobs for different
    tasks may share `scene` and `sample`.
    """

    scene: str
    sample: int
    cores: int
    frames: int
    resolution: int
    spp: int
    reading_s: float
    sensors: int
    pixel_frames: int
    events: int
    simulating_s: float
    collecting_s: float
    scoring_s: float
    methods: tuple[MethodTimings, ...]
    rendered_frames: int = 0
    rendering_s: float = 0.0
    height: int = 0

    @property
    def core_s(self) -> float:
        """Core seconds of all stages."""
        stages = self.rendering_s, self.reading_s, self.simulating_s, self.collecting_s
        return self.cores * (sum(stages) + self.scoring_s)


def split_shared_time(
    rendering_s: float, waiting_s: float, simulating_s: float, collecting_s: float
) -> dict[str, float]:
    """Split the time in which frames render while sensors and scorers work on earlier frames.

    Half of it counts for rendering, half for the others, so that the results add up to the elapsed
    time. The times in which the sensors wait for frames, simulate, and wait for the scorers do not
    overlap.
    """
    working_s = simulating_s + collecting_s
    shared_s = min(max(0.0, rendering_s - waiting_s), working_s)
    left = 1.0 - 0.5 * shared_s / working_s
    return {
        "rendering_s": rendering_s - 0.5 * shared_s,
        "reading_s": max(0.0, waiting_s - rendering_s),
        "simulating_s": left * simulating_s,
        "collecting_s": left * collecting_s,
    }


def timings_file(timings: JobTimings) -> bytes:
    """Return the content of a job's file, in which times have four digits."""
    exact = json.dumps(asdict(timings))
    rounded = json.loads(exact, parse_float=lambda text: float(f"{float(text):.4g}"))
    return json.dumps(rounded, separators=(",", ":")).encode()


def read_timings(folder: Path, jobs: Collection[str] | None = None) -> list[JobTimings]:
    """Read the timings of jobs from a folder; files of other keys than `jobs` are left out."""
    files = [f for f in sorted(folder.glob("*.json")) if jobs is None or f.stem in jobs]
    timings = [read_json(JobTimings, file, ResultError) for file in files]
    return sorted(timings, key=lambda job: (job.scene, job.sample, len(job.methods)))
