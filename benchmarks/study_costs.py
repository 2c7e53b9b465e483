"""Compare the estimate of a study's cost with the times of a finished run; list those of methods.

The constants of `tasks.study.run.estimate` and of methods' `Cost` come from these tables.
Times are in core seconds: elapsed time counts once for each core. Stages overlap, so only their sum
is exact, and scores take the time of their methods and of much else.

    python benchmarks/study_costs.py docs/results/ablations ablations
    python benchmarks/study_costs.py docs/results/twins docs/studies/twins.toml
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace
from functools import reduce
from pathlib import Path

from eres_render import load_scene
from tasks.evaluation.settings import share_of_1280
from tasks.evaluation.timings import JobTimings, read_timings
from tasks.registry import TASKS
from tasks.study.config import preset, with_method
from tasks.study.run.estimate import estimate_job
from tasks.study.run.jobs import Job, jobs_of
from tasks.study.study_file import read_study

Kind = tuple[str, str]  # scene and tasks


def kind_of(scene: str, tasks: Iterable[str]) -> Kind:
    """Return what the jobs have in common."""
    found = set(tasks)
    return scene, "+".join(task for task in TASKS if task in found)


def told_s(jobs: Iterable[Job]) -> tuple[float, float, float]:
    """Return the estimates of rendering, simulating and scoring, core seconds."""
    render = simulate = all_stages = 0.0
    for job in jobs:
        unscored = replace(job, evaluate={})
        unseen = replace(unscored, simulate=replace(job.simulate, speeds=()))
        one, two, three = (estimate_job(x).core_s for x in (unseen, unscored, job))
        render, simulate, all_stages = render + one, simulate + two, all_stages + three
    return render, simulate - render, all_stages - simulate


def took_s(jobs: Iterable[JobTimings]) -> tuple[float, float, float]:
    """Return the times of rendering, simulating and scoring, core seconds."""
    jobs = list(jobs)
    return (
        sum(one.cores * (one.rendering_s + one.reading_s) for one in jobs),
        sum(one.cores * one.simulating_s for one in jobs),
        sum(one.cores * (one.collecting_s + one.scoring_s) for one in jobs),
    )


def methods_of(jobs: Iterable[JobTimings]) -> dict[tuple[str, str], list[float]]:
    """Return answers, answers weighted by the pixels of square sensors, and CPU seconds of each."""
    found: dict[tuple[str, str], list[float]] = defaultdict(lambda: [0.0, 0.0, 0.0])
    for method in (method for job in jobs for method in job.methods):
        share = share_of_1280(method.width, method.width)
        sums = method.estimates, method.estimates * share, method.cpu_s
        before = found[method.task, method.method]
        found[method.task, method.method] = [a + b for a, b in zip(before, sums, strict=True)]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="folder of the finished run")
    parser.add_argument("study", help="its study: name of a preset, or a TOML file")
    parser.add_argument("--method", nargs="+", default=[], help="as for `eres study`")
    parser.add_argument("--samples", type=int, help="number of samples, if not the study's")
    args = parser.parse_args()
    study = read_study(args.study) if args.study.endswith(".toml") else preset(args.study)
    study = reduce(with_method, args.method, study)
    if args.samples:
        study = replace(study, render=replace(study.render, samples=args.samples))

    told: dict[Kind, list[Job]] = defaultdict(list)
    for name in study.scenes:
        for job in jobs_of(study, load_scene(name)):
            told[kind_of(name, job.evaluate)].append(job)
    took: dict[Kind, list[JobTimings]] = defaultdict(list)
    for timings in read_timings(args.run / "costs"):
        took[kind_of(timings.scene, (one.task for one in timings.methods))].append(timings)

    heads = "".join(f"{head:>15s}" for head in ("frames", "render", "simulate", "score"))
    print(f"{'core seconds: told / measured':38s}jobs{heads}    ratio")
    every: list[tuple[float, ...]] = []
    for kind, jobs in told.items():
        told_frames = sum(estimate_job(job).frames for job in jobs)
        frames = told_frames, sum(one.rendered_frames for one in took[kind])
        pairs = list(zip(told_s(jobs), took_s(took[kind]), strict=True))
        every.append(tuple(x for pair in pairs for x in pair))
        ratio = sum(two for _, two in pairs) / sum(one for one, _ in pairs)
        columns = "".join(f"{a:7.0f} /{b:6.0f}" for a, b in (frames, *pairs))
        print(f"{kind[0]:12s} {kind[1]:26s} {len(jobs):3d}{columns}{ratio:9.2f}")
    sums = [sum(column) for column in zip(*every, strict=True)]
    ratio = sum(sums[1::2]) / sum(sums[::2])
    columns = "".join(f"{a:7.0f} /{b:6.0f}" for a, b in zip(sums[::2], sums[1::2], strict=True))
    print(f"{'all':42s}{'':15s}{columns}{ratio:9.2f}")

    print(f"\n{'CPU seconds of a method':58s}   answers  of one  at 1280 px")
    for (task, method), (count, shares, cpu_s) in methods_of(
        one for jobs in took.values() for one in jobs
    ).items():
        print(f"{task:15s} {method:42s} {count:9.0f} {cpu_s / count:7.3f} {cpu_s / shares:11.3f}")


if __name__ == "__main__":
    main()
