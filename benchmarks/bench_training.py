"""Measure the CPU time of a training step in one thread: making its crops, and learning from them.

python benchmarks/bench_training.py [--steps 3] [--config small]
"""

from __future__ import annotations

import argparse
import resource
import time

import torch

from tasks.learned.cpu import has_bfloat16
from tasks.learned.training.flow import Flow
from tasks.learned.training.problem import Problem
from tasks.learned.training.reconstruction import Reconstruction
from tasks.learned.training.settings import FLOWS, RECONSTRUCTIONS


def measure(problem: Problem, steps: int) -> tuple[float, float]:
    """Return the mean CPU time of making a batch and of learning from it, in seconds."""
    optimizer = torch.optim.AdamW(problem.network.parameters())
    making_s, learning_s = [], []
    for step in range(steps + 1):  # the first one compiles
        started_s = time.process_time()
        batch = problem.batch(step)
        made_s = time.process_time()
        losses = problem.losses(batch)
        while True:
            with torch.autocast("cpu", torch.bfloat16, enabled=has_bfloat16()):
                loss = next(losses, None)
            if loss is None:
                break
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            optimizer.step()
        making_s.append(made_s - started_s)
        learning_s.append(time.process_time() - made_s)
    return sum(making_s[1:]) / steps, sum(learning_s[1:]) / steps


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=3)
    parser.add_argument("--config", default="small", choices=RECONSTRUCTIONS)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    for kind, known in ((Reconstruction, RECONSTRUCTIONS), (Flow, FLOWS)):
        settings = known[arguments.config]
        problem = kind(settings, "all", 0)
        problem.network.train()
        making_s, learning_s = measure(problem, arguments.steps)
        hours = settings.schedule.steps * (making_s + learning_s) / 3600
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
        weights = sum(one.numel() for one in problem.network.parameters())
        print(
            f"{kind.__name__.lower()}: crops {making_s:.2f} s, learning {learning_s:.2f} s, "
            f"{settings.schedule.steps} steps in {hours:.2f} core hours, {weights} weights, "
            f"peak of the process so far {peak:.2f} GB"
        )


if __name__ == "__main__":
    main()
