"""Show our networks next to the paper's networks on its carpet, as a Markdown table.

    python benchmarks/beside_paper.py docs/results/twins_2
    python benchmarks/beside_paper.py docs/results/flow_twins_2

The paper's networks are E2VID and E-RAFT; scores are medians at base speed. The scene, the images
and the places are ours, so levels differ, and the course over the widths is what compares.
"""

from __future__ import annotations

import sys
from pathlib import Path

from tasks.registry import TASKS
from tasks.study.results.asked import Condition, Series
from tasks.study.results.paper import CUTOFFS_HZ, WIDTHS, published
from tasks.study.results.run_files import scores_of_run
from tasks.study.results.scores import Scores

SCENE = "carpet"
LIGHTS = dict(zip(CUTOFFS_HZ, ("ideal", "day", "night"), strict=True))
OURS = {
    "e2vid": ("our_reconstruction_ideal_light", "our_reconstruction_all_light"),
    "eraft": ("our_flow_ideal_light", "our_flow_all_light"),
}


def lines(scores: Scores, task: str, network: str) -> list[str]:
    """Return the lines of a table: each light with the paper's network and with ours."""
    metric, found = TASKS[task].metric, []
    for cutoff_hz, light in LIGHTS.items():
        paper = [published(SCENE, task, network, w, cutoff_hz, 1.0) for w in WIDTHS]
        rows = {f"{TASKS[task].label(network)}, the paper": paper}
        for method in OURS[network]:
            series = Series(task, method, metric.name)
            where = [Condition(SCENE, width, cutoff_hz, 1.0) for width in WIDTHS]
            rows[TASKS[task].label(method)] = [scores.cell(series, one).median for one in where]
        for name, values in rows.items():
            known = [value for value in values if value is not None]
            best = (max if metric.higher_is_better else min)(known, default=None)
            shown = [
                "–" if v is None else f"**{v:.2f}**" if v == best else f"{v:.2f}" for v in values
            ]
            found.append(f"| {light} | {name} | {' | '.join(shown)} |")
    return found


def main() -> None:
    scores = scores_of_run(Path(sys.argv[1]))["two_pole"][0]
    heads = ["light", "network", *(f"{width} px" for width in WIDTHS)]
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for task, network in (("video", "e2vid"), ("dense_flow", "eraft")):
        if any(series.method in OURS[network] for series in scores.series()):
            print("\n".join(lines(scores, task, network)))


if __name__ == "__main__":
    main()
