"""Measure the CPU time of a training step in one thread: making its crops, and learning from them.

python benchmarks/bench_training.py [--steps 3] [--config small]
"""

from __future__ import annotations

import argparse
import resource

import numpy as np
import torch
from process_times import Times, times_now

from tasks.learned.training.flow import Flow
from tasks.learned.training.loop import Training
from tasks.learned.training.problem import Problem
from tasks.learned.training.reconstruction import Reconstruction
from tasks.learned.training.settings import FLOWS, RECONSTRUCTIONS


def measure(problem: Problem, steps: int) -> tuple[Times, Times]:
    """Return the mean times of making a batch and of learning from it."""
    training = Training(problem, "cpu")
    making, learning = [], []
    for training.step in range(steps + 1):  # the first one compiles
        start = times_now()
        batch = problem.batch(training.step)
        made = times_now()
        training.learn(batch)
        making.append(made - start)
        learning.append(times_now() - made)
    return Times(*np.mean(making[1:], axis=0)), Times(*np.mean(learning[1:], axis=0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=3)
    parser.add_argument("--config", default="small", choices=RECONSTRUCTIONS)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    for kind, known in ((Reconstruction, RECONSTRUCTIONS), (Flow, FLOWS)):
        settings = known[arguments.config]
        problem = kind(settings, "all", 0)
        making, learning = measure(problem, arguments.steps)
        hours = settings.schedule.steps * (making.cpu_s + learning.cpu_s) / 3600
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
        weights = sum(one.numel() for one in problem.network.parameters())
        print(
            f"{kind.__name__.lower()}: crops {making.cpu_s:.2f} s, {making.system_s:.2f} of them "
            f"system, learning {learning.cpu_s:.2f} s, {learning.system_s:.2f} of them system, "
            f"{settings.schedule.steps} steps in {hours:.2f} core hours, {weights} weights, "
            f"peak of the process so far {peak:.2f} GB"
        )


if __name__ == "__main__":
    main()
