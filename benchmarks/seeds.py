"""Our networks on scenes, over several trainings: median scores, and claim 23.

    python benchmarks/seeds.py runs/twins_0 runs/twins_1 runs/twins_2

Each run is of `docs/studies/twins.toml` with the weights of one seed. An image has one score for
each seed, and intervals are over images.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tasks.row import Row, read_rows
from tasks.study.claims.judge import judge_all
from tasks.study.claims.training import TRAINING_CLAIMS
from tasks.study.results.words import cutoff_label


def rows_of(run: Path, seed: int) -> list[Row]:
    rows = read_rows(run / "rows.parquet")
    features = 1 + max(row.item for row in rows)
    return [replace(row, item=features * seed + row.item) for row in rows]


def table(rows: Sequence[Row], scene: str, speed: float) -> str:
    of_scene = [row for row in rows if (row.scene, row.speed) == (scene, speed)]
    widths = sorted({row.width for row in of_scene})
    lights = sorted({row.cutoff_hz for row in of_scene}, reverse=True)
    head = [f"{scene}, {speed:g}x", "light", *(f"{width} px" for width in widths)]
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for method in dict.fromkeys(row.method for row in of_scene):
        for light in lights:
            lit = [row for row in of_scene if (row.method, row.cutoff_hz) == (method, light)]
            cells = ([row.value for row in lit if row.width == width] for width in widths)
            scores = (f"{np.median(cell):.2f}" for cell in cells)
            lines.append(f"| {' | '.join((f'`{method}`', cutoff_label(light), *scores))} |")
    return "\n".join(lines)


def verdicts(rows: Sequence[Row]) -> str:
    found = judge_all(rows, {}, TRAINING_CLAIMS)
    return "\n".join(f"{one.title}: {one.status}: {one.ours}" for one in found)


def main(*runs: str) -> None:
    every: list[Row] = []
    for seed, run in enumerate(map(Path, runs)):
        rows = rows_of(run, seed)
        print(f"{run}: {verdicts(rows)}\n")
        every += rows
    print(f"all runs: {verdicts(every)}\n")
    for scene in dict.fromkeys(row.scene for row in every):
        for speed in sorted({row.speed for row in every if row.scene == scene}):
            print(table(every, scene, speed), "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
