"""A training's learning curve, as a table and as a picture."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from eres_render.storage.atomic import write_bytes, write_text
from tasks.learned.training.problem import LIGHTS, Problem

Row = dict[str, float]


def write_curve(folder: Path, curve: Sequence[Row], problem: Problem) -> None:
    """Write the scores of the network and of the baselines over steps, a panel for each light."""
    text = io.StringIO(newline="")
    table = csv.DictWriter(text, list(curve[0]), lineterminator="\n")
    table.writeheader()
    table.writerows({name: f"{value:.6g}" for name, value in row.items()} for row in curve)
    write_text(folder / "curve.csv", text.getvalue())
    steps = [row["step"] for row in curve]
    figure = Figure(figsize=(3.2 * len(LIGHTS), 2.8), layout="constrained")
    panels = figure.subplots(1, len(LIGHTS), sharey=True)
    for panel, light in zip(panels, LIGHTS, strict=True):
        panel.set_title(light)
        panel.set_xlabel("step")
        panel.plot(steps, [row[f"{light}, network"] for row in curve], color="C0", label="network")
        for name, style in zip(problem.baselines, ("--", ":"), strict=False):
            panel.axhline(curve[-1][f"{light}, {name}"], color="0.4", linestyle=style, label=name)
    panels[0].set_ylabel(problem.score)
    panels[-1].legend(fontsize="small")
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=120)
    write_bytes(folder / "curve.png", picture.getvalue())
