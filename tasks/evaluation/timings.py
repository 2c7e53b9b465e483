"""What a run's jobs took: measured stage by stage and method by method, a JSON file a job."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from eres_render.progress import Progress
from eres_render.storage.settings_reader import read_json
from tasks.errors import ResultError


@dataclass(frozen=True, slots=True)
class MethodTimings:
    """What one method took on the sensors of one width.

    Parameters
    ----------
    task, method, variant
        As in a `Row`.
    width
        Of the sensors, px.
    estimates
        How often it was asked: images, patches or paths.
    events
        That it was given, over all estimates.
    cpu_s, median_cpu_s
        Of the method alone on its one core: over all estimates, and of the middle one, on which the
        first one's compilation does not tell.
    """

    task: str
    method: str
    variant: str
    width: int
    estimates: int
    events: int
    cpu_s: float
    median_cpu_s: float


@dataclass(frozen=True, slots=True)
class JobTimings:
    """What one job took. Times are of the clock on the wall, with all cores at work.

    Parameters
    ----------
    scene, sample
        Which job: a scene may have several of one sample, for different tasks.
    cores
        At work.
    frames, resolution, spp
        That were read, their side, px, and the samples of a pixel.
    reading_s
        Spent waiting until they were read and decoded.
    sensors
        How many looked at them.
    pixel_frames, events
        That the sensors went through, and that they fired, warm-up included.
    simulating_s
        Of the sensors alone.
    collecting_s
        Until tasks had kept what they need of the events; video is reconstructed here.
    scoring_s
        From samples to scores: methods, and all that is around them.
    methods
        What each method took of that.
    rendered_frames, rendering_s
        Frames that were not in the cache yet, and how long those took.
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


class FrameTimer:
    """Passes progress on, and times the frames that are rendered from its making on."""

    def __init__(self, on_progress: Progress) -> None:
        self.frames = 0
        self.seconds = 0.0
        self._on_progress = on_progress
        self._started = time.perf_counter()

    def __call__(self, stage: str, done: float, of: float, /) -> None:
        """Note a frame if that is what was done."""
        if stage == "rendering":
            self.frames += 1
            self.seconds = time.perf_counter() - self._started
        self._on_progress(stage, done, of)


def timings_file(costs: JobTimings) -> bytes:
    """Content of the file of a job."""
    return json.dumps(asdict(costs), indent=1).encode()


def read_timings(folder: Path) -> list[JobTimings]:
    """Read the timings of all jobs in a folder, by scene, sample and number of methods.

    None if it does not exist.

    Raises
    ------
    ResultError
        A file is not JSON, or its fields are others.
    """
    found = [read_json(JobTimings, file, ResultError) for file in sorted(folder.glob("*.json"))]
    return sorted(found, key=lambda one: (one.scene, one.sample, len(one.methods)))
