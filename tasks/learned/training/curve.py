"""A training's learning curve, as a picture."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from eres_render.storage.atomic import write_bytes

_NETWORK = ", network"
_STYLES = ("--", ":", "-.")


def draw_curve(file: Path, curve: Sequence[Mapping[str, float]], score: str) -> None:
    """Draw the scores of the network and of the baselines over steps, a panel for each light."""
    lights = [name.removesuffix(_NETWORK) for name in curve[0] if name.endswith(_NETWORK)]
    steps = [row["step"] for row in curve]
    figure = Figure(figsize=(3.2 * len(lights), 2.8), layout="constrained")
    panels = figure.subplots(1, len(lights), sharey=True, squeeze=False)[0]
    for panel, light in zip(panels, lights, strict=True):
        panel.set_title(light)
        panel.set_xlabel("step")
        panel.plot(steps, [row[light + _NETWORK] for row in curve], color="C0", label="network")
        others = [name for name in curve[0] if name.startswith(f"{light}, ")]
        for name, style in zip(others[1:], _STYLES, strict=False):
            panel.axhline(
                curve[-1][name], color="0.4", linestyle=style, label=name.removeprefix(f"{light}, ")
            )
    panels[0].set_ylabel(score)
    panels[-1].legend(fontsize="small")
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=120)
    write_bytes(file, picture.getvalue())
