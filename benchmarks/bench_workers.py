"""Measure how a study scales: the same small jobs on one and on two workers of one core each.

    python benchmarks/bench_workers.py

Both clusters run all the time and take turns. Every run has its own seed of the renderer, so it
renders its own frames. Each worker has one core and one Numba thread; Dr.Jit always has two. Wall
times on a busy machine say little. CPU times show the cost of distribution itself: those of the
workers per job, and those of client and scheduler, which are this process. "system" is how much of
them is system time.
"""

from __future__ import annotations

import argparse
import os
import pickle
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from distributed import LocalCluster
from process_times import Times, times_now

from eres_render import load_scene
from tasks.study.config import Study, preset
from tasks.study.run import run_study
from tasks.study.run.compute import compute_job
from tasks.study.run.jobs import QueuedJob, jobs_of


def study_of(seed: int, resolution: int, samples: int) -> Study:
    """Return a smaller preset quick."""
    quick = preset("quick")
    widths = tuple(w for w in quick.simulate.widths if w <= resolution)
    return replace(
        quick,
        render=replace(quick.render, resolution=resolution, samples=samples, seed=seed),
        simulate=replace(quick.simulate, widths=widths),
    )


def keep_to_cores(cluster: LocalCluster) -> None:
    """Pin each worker of a cluster to its own core."""
    cores = sorted(os.sched_getaffinity(0))
    for core, nanny in zip(cores, cluster.workers.values(), strict=False):
        for thread in Path(f"/proc/{nanny.pid}/task").iterdir():
            os.sched_setaffinity(int(thread.name), {core})


def times_of_workers(cluster: LocalCluster) -> Times:
    """Return the time, and the CPU time of all workers so far; they run, so no `getrusage`."""
    user, system = 0, 0
    for nanny in cluster.workers.values():
        stat = Path(f"/proc/{nanny.pid}/stat").read_text().rsplit(")", 1)[1].split()
        user, system = user + int(stat[11]), system + int(stat[12])
    hz = os.sysconf("SC_CLK_TCK")
    return Times(time.perf_counter(), user / hz, system / hz)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--resolution", type=int, default=346)
    parser.add_argument("--samples", type=int, default=8)
    parser.add_argument("--runs", type=int, default=3)
    args = parser.parse_args()
    os.environ["NUMBA_NUM_THREADS"] = "1"
    counts = (1, 2)
    with tempfile.TemporaryDirectory() as temporary:
        os.environ["ERES_CACHE"] = f"{temporary}/cache"
        clusters = [
            LocalCluster(
                n_workers=n, threads_per_worker=1, dashboard_address=":0", silence_logs="CRITICAL"
            )
            for n in counts
        ]
        for cluster in clusters:
            keep_to_cores(cluster)
        seeds = iter(range(1_000_000))

        def run(cluster: LocalCluster, samples: int) -> tuple[Times, Times]:
            """Return the times of the workers and of this process."""
            seed = next(seeds)
            workers, this = times_of_workers(cluster), times_now()
            study = study_of(seed, args.resolution, samples)
            run_study(study, Path(temporary) / str(seed), cluster.scheduler_address)
            return times_of_workers(cluster) - workers, times_now() - this

        for cluster in clusters:  # imports, compilation, the scene
            run(cluster, 4)
        found: dict[int, list[tuple[Times, Times]]] = {n: [] for n in counts}
        for _ in range(args.runs):
            for n, cluster in zip(counts, clusters, strict=True):
                found[n].append(run(cluster, args.samples))
        for cluster in clusters:
            cluster.close()

        first = min(this.wall_s for _, this in found[1])
        print(
            "workers  wall s (each run)             jobs/h  ratio   CPU s/job: workers  system"
            "  the rest  system"
        )
        for n, runs in found.items():
            wall = min(this.wall_s for _, this in runs)
            each = " ".join(f"{this.wall_s:7.1f}" for _, this in runs)
            worker, rest = (
                min(times, key=lambda one: one.cpu_s) for times in zip(*runs, strict=True)
            )
            print(
                f"{n:7d}  {each:28s} {3600 * args.samples / wall:8.0f}  {first / wall:5.2f}"
                f"  {worker.cpu_s / args.samples:19.2f}  {worker.system_s / args.samples:6.2f}"
                f"  {rest.cpu_s / args.samples:8.2f}  {rest.system_s / args.samples:6.2f}"
            )

        study = study_of(0, args.resolution, args.samples)
        job = jobs_of(study, load_scene("carpet"))[0]
        size = len(pickle.dumps(QueuedJob(job, job.key, True)))
        print(f"a job on its way to a worker: {size} bytes")
        for with_highlights in (False, True):
            queued = QueuedJob(job, job.key, with_highlights)
            computed = compute_job(queued, lambda *_: None)
            size = len(pickle.dumps(computed))
            kind = "with the report's files" if with_highlights else "rows and timings"
            print(f"a result of {len(computed.rows)} rows, {kind}: {size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
