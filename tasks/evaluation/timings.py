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

    Parameters
    ----------
    task, method, variant
        As in a `Row`.
    width
        Width of the sensor, px.
    estimates
        Number of answers: images, flows, patches or paths.
    events
        Number of events that the method got, over all answers.
    cpu_s, median_cpu_s
        CPU time of the method, seconds: the sum over all answers, and their median, which the
        compilation in the first one does not affect. What both trackers need is counted for the one
        that is first.
    sensor
        As in a `Row`. Runs of older versions lack it.
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

    Frames render while sensors simulate earlier frames, and scorers take in the events of still
    earlier ones. Time in which frames render while others work counts half for rendering and half
    for the others, so all stages add up to the time of the job.

    Parameters
    ----------
    scene, sample
        Scene and sample of the job; jobs for different tasks may share them.
    cores
        Number of cores.
    frames, resolution, spp
        Number of frames that were read, their width in px, and samples per pixel.
    reading_s
        Time spent waiting for frames to be read or written, not rendered.
    sensors
        Number of sensors.
    pixel_frames, events
        Number of pixels times frames, and of events, over all sensors, warm-up included.
    simulating_s
        Time spent simulating events.
    collecting_s
        Time spent waiting for scorers to take in events; video methods run there.
    scoring_s
        Time from samples to scores, methods included.
    methods
        Work and time of each method.
    rendered_frames, rendering_s
        Number of frames that were not in the cache, and their rendering time.
    height
        Height of the frames, px; 0 if they are square, as in older files.
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
    """Split the time in which frames render while sensors and scorers work on earlier ones.

    Half of it counts for rendering, half for the others, so that the results add up to the elapsed
    time.

    Parameters
    ----------
    waiting_s, simulating_s, collecting_s
        Times in which the sensors waited for frames, in which they simulated, and in which they
        waited for the scorers; these do not overlap.
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
    """Read the timings of jobs from a folder.

    Parameters
    ----------
    jobs
        Keys of the jobs; the files of others, of earlier studies, are left out. None for all.
    """
    files = [f for f in sorted(folder.glob("*.json")) if jobs is None or f.stem in jobs]
    timings = [read_json(JobTimings, file, ResultError) for file in files]
    return sorted(timings, key=lambda job: (job.scene, job.sample, len(job.methods)))
