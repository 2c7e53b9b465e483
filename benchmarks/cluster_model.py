"""Estimate the time of preset `paper` on many workers, from `tasks.study.run.estimate`.

    python benchmarks/cluster_model.py

Workers have one core each, take the longest tasks first, and wait only for each other. The second
table splits the jobs further, which eres does not: workers render ten frames at a time, and when a
clip is complete, each task simulates and scores one sensor on it.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import replace
from itertools import product

from eres_render import load_scene
from tasks.study.config import Simulate, preset
from tasks.study.run.estimate import estimate_job
from tasks.study.run.jobs import Job, jobs_of

WORKERS = (1, 2, 8, 32, 81, 1000)
FRAMES_AT_A_TIME = 10


def render_s(job: Job) -> float:
    """Return the core seconds of a job's frames."""
    blind = replace(job, simulate=replace(job.simulate, widths=()), evaluate={})
    return estimate_job(blind).core_s


def simulate_s(job: Job) -> float:
    """Return the core seconds of a job's sensors."""
    return estimate_job(replace(job, evaluate={})).core_s - render_s(job)


def single_sensors(sensors: Simulate) -> list[Simulate]:
    """Return one `Simulate` for each sensor at each speed."""
    axes = (sensors.widths, sensors.cutoffs_hz, sensors.contrast_thresholds, sensors.speeds)
    return [
        replace(
            sensors,
            widths=(width,),
            cutoffs_hz=(cutoff,),
            contrast_thresholds=(threshold,),
            speeds=(speed,),
            photoreceptors=(photoreceptor,),
        )
        for width, cutoff, threshold, speed in product(*axes)
        # An ideal photoreceptor is the same in every reading.
        for photoreceptor in (sensors.photoreceptors if cutoff < math.inf else ("two_pole",))
    ]


def longest_first_s(tasks_s: list[float], workers: int) -> float:
    """Return the time when the last task ends."""
    free_s = [0.0] * workers
    for task_s in sorted(tasks_s, reverse=True):
        heapq.heappush(free_s, heapq.heappop(free_s) + task_s)
    return max(free_s)


def main() -> None:
    study = preset("paper")
    work = [job for name in study.scenes for job in jobs_of(study, load_scene(name))]
    total_s = sum(estimate_job(job).core_s for job in work)

    kinds: dict[tuple[str, str], list[Job]] = {}
    for job in work:
        fast = "fast samples" if job.simulate.speeds != study.simulate.speeds else "samples"
        kind = "video" if "video" in job.evaluate else fast
        kinds.setdefault((job.scene.name, kind), []).append(job)
    print("core minutes of one job            jobs  frames    GB  render  simulate  score    all")
    for (scene, kind), found in kinds.items():
        one = estimate_job(found[0])
        stages = render_s(found[0]), simulate_s(found[0])
        minutes = (*stages, one.core_s - sum(stages), one.core_s)
        print(
            f"{scene:10s} {kind:22s} {len(found):5d} {one.frames:7d} {one.frame_bytes / 1e9:5.2f}"
            + "".join(f"{s / 60:{w}.1f}" for s, w in zip(minutes, (8, 10, 7, 7), strict=True))
        )

    whole_s = [estimate_job(job).core_s for job in work]
    chunks_s, sensors_s, read_bytes = [], [], 0.0
    for job in work:
        one = estimate_job(job)
        chunks = -(-one.frames // FRAMES_AT_A_TIME)
        chunks_s += [render_s(job) / chunks] * chunks
        for sensor in single_sensors(job.simulate):
            alone = replace(job, simulate=sensor)
            sensors_s.append(estimate_job(alone).core_s - render_s(job))
            read_bytes += one.frame_bytes
    print(f"\n{total_s / 3600:.1f} core hours; longest task {max(whole_s) / 60:.0f} min")
    print(
        f"split: {len(chunks_s)} tasks render, then {len(sensors_s)} simulate and score: up to "
        f"{max(sensors_s) / 60:.1f} min each; {read_bytes / 1e9:.0f} GB of frames are read in all\n"
    )
    print("workers   jobs: hours  times as fast    split: hours  times as fast")
    for n in WORKERS:
        at_once_s = longest_first_s(whole_s, n)
        split_s = longest_first_s(chunks_s, n) + longest_first_s(sensors_s, n)
        print(
            f"{n:7d}  {at_once_s / 3600:12.2f} {total_s / at_once_s:14.1f}"
            f"  {split_s / 3600:14.2f} {total_s / split_s:14.1f}"
        )


if __name__ == "__main__":
    main()
