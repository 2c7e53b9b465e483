"""Compare the preset "chip" with what was predicted, and draw it.

    eres study --preset chip --out runs/chip
    python benchmarks/chip.py docs/results/chip
    python benchmarks/chip.py docs/results/chip --write

prints how often the width that docs/predictions/chip.toml names is as good as the best, and what
following it costs, as Markdown tables; next to it what a random texture says, as `eres advise` asks
it for unequal cutoffs. That was tried after the run. `--write` draws docs/figures/chip.png.
"""

from __future__ import annotations

import argparse
import io
import math
import tomllib
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from statistics import mean, median
from typing import Any, NamedTuple

from lag_law import table
from matplotlib.figure import Figure
from PIL import Image

from sensor.model import cutoff_in_light
from tasks.advice.advise import WINDOW_S
from tasks.advice.spectrum import MovingImage, texture
from tasks.row import read_rows
from tasks.study.settings import AREA

ROOT = Path(__file__).parents[1]
WIDTHS = (128, 240, 346, 640, 1280)
LIGHTS = {"day": 200.0, "night": 50.0}
"""Cutoff of a pixel of 640 px, Hz."""
EXPONENTS = {"0": "0", "0.5": "0_5", "1": "1"}
BUS = ", 165 Mev/s"
NEAR_DB = 0.1
LAGS_PX = {"carpet": 0.90, "rocks": 0.74, "room": 0.84}
"""Of 1280 px at 200 Hz and speed 1, docs/what_decides.md."""
COLORS = {"0": "#7a7a7a", "0.5": "#3b7dbd", "1": "#b3472e"}


class Cell(NamedTuple):
    """A sensor on a scene in a light at a speed."""

    scene: str
    light: str
    speed: float
    sensor: str


def medians(folder: Path, method: str = "event_integration") -> dict[Cell, float]:
    """Return the median score of a method in each cell."""
    name = {round(hz): light for light, hz in LIGHTS.items()}
    values: defaultdict[Cell, list[float]] = defaultdict(list)
    for row in read_rows(folder / "rows.parquet"):
        if row.method == method and row.illuminance_lux:
            light = name[round(cutoff_in_light(row.illuminance_lux))]
            values[Cell(row.scene, light, row.speed, row.sensor)].append(row.value)
    return {cell: median(each) for cell, each in values.items()}


def ladders(found: Mapping[Cell, float]) -> Iterator[tuple[str, Cell, dict[int, float]]]:
    """Yield exponent, condition and the scores by width, without a bus."""
    for exponent in EXPONENTS:
        for at in sorted({cell._replace(sensor="") for cell in found}):
            names = {width: f"{width} px {AREA}{exponent}" for width in WIDTHS}
            yield exponent, at, {w: found[at._replace(sensor=n)] for w, n in names.items()}


def predicted(exponent: str, at: Cell) -> int:
    """Return the width that was predicted."""
    text = (ROOT / "docs/predictions/chip.toml").read_text(encoding="utf-8")
    ours = tomllib.loads(text)["reconstruction"][at.scene][EXPONENTS[exponent]]
    return int(ours[2 * [*LIGHTS].index(at.light) + round(at.speed) - 1])


@cache
def by_texture(exponent: str, at: Cell) -> int:
    """Return the width that the spectrum of a random texture chooses."""
    px_s = LAGS_PX[at.scene] * math.pi * LIGHTS["day"] * at.speed
    moving = MovingImage(stand_in(), px_s * WINDOW_S / at.speed)
    cutoffs = {w: LIGHTS[at.light] * (640 / w) ** (2 * float(exponent)) for w in WIDTHS}
    lags_px = {width: px_s / (math.pi * hz) for width, hz in cutoffs.items()}
    return max(WIDTHS, key=lambda width: moving.psnr_db(width, [lags_px[width]])[0])


@cache
def stand_in() -> Any:
    """Return the texture."""
    return texture(WIDTHS[-1], WIDTHS[-1])


RULES: dict[str, Callable[[str, Cell], int]] = {"the law": predicted, "a texture": by_texture}


def draw(found: Mapping[Cell, float]) -> Figure:
    """Draw the PSNR at base speed against the width."""
    scenes = sorted({cell.scene for cell in found})
    figure = Figure(figsize=(9, 5.2), layout="constrained")
    grid = figure.subplots(len(LIGHTS), len(scenes), sharex=True, sharey="col", squeeze=False)
    for row, light in zip(grid, LIGHTS, strict=True):
        for axes, scene in zip(row, scenes, strict=True):
            for exponent, color in COLORS.items():
                names = [f"{width} px {AREA}{exponent}" for width in WIDTHS]
                at = [Cell(scene, light, 1.0, name) for name in names]
                label = "one cutoff for all" if exponent == "0" else f"cutoff by area^{exponent}"
                axes.plot(WIDTHS, [found[c] for c in at], "o-", color=color, ms=4, label=label)
                fine = [cell._replace(sensor=cell.sensor + BUS) for cell in at]
                dashed = "on a bus of 165 Mev/s" if exponent == "0" else None
                values = [found[c] for c in fine]
                axes.plot(WIDTHS, values, "--", color=color, lw=1, label=dashed)
            axes.set(xscale="log", title=f"{scene}, {light}")
            axes.set_xticks(WIDTHS, map(str, WIDTHS), minor=False)
            axes.minorticks_off()
            axes.grid(alpha=0.3)
        row[0].set_ylabel("PSNR, dB")
    for axes in grid[-1]:
        axes.set_xlabel("pixels in a row of the chip")
    figure.legend(*grid[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def main() -> None:
    """Print the tables, and draw the figure if asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    found = medians(arguments.folder)
    lines, rules = [], defaultdict[str, list[float]](list)
    for rule, choice in RULES.items():
        for exponent in EXPONENTS:
            regrets = []
            for power, at, scores in ladders(found):
                if power == exponent:
                    regrets.append(max(scores.values()) - scores[choice(power, at)])
            right = sum(one <= NEAR_DB for one in regrets)
            costs = f"{mean(regrets):.2f}", f"{max(regrets):.2f}"
            lines.append((rule, f"area^{exponent}", f"{right} of {len(regrets)}", *costs))
            rules[rule] += regrets
    for _, _, scores in ladders(found):
        for width in WIDTHS:
            rules[f"always {width} px"].append(max(scores.values()) - scores[width])
    table(("rule", "cutoff by", "right", "mean regret, dB", "worst"), lines)
    table(
        ("rule", "cells", "mean regret, dB", "worst"),
        ((rule, len(r), f"{mean(r):.2f}", f"{max(r):.2f}") for rule, r in rules.items()),
    )
    if arguments.write:
        pixels = io.BytesIO()
        draw(found).savefig(pixels, dpi=110, metadata={"Software": None})
        small = Image.open(pixels).convert("RGB").quantize(64, dither=Image.Dither.NONE)
        small.save(ROOT / "docs/figures/chip.png", optimize=True)


if __name__ == "__main__":
    main()
