"""Compare photometric flow's scores with how evenly the flow is over the patches.

    python benchmarks/patch_flow.py RUN SCENE

Photometric flow assumes the same flow everywhere in a patch. In a scene with depth this is wrong.
This script finds the features of a finished study's samples again, computes the true flow all over
each patch of 61 px (at 1280 px), and splits the run's scores at base speed in ideal light by the
departure of the patch's flow from that of its center, in px of a 1280 px image (root mean square).
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

import numpy as np

from eres_render import GroundTruth, Renderer, clips, load_scene
from eres_render.sequence.ground_truth import surfaces
from tasks.flow import PATCH_PX, find_features
from tasks.row import read_rows

METHOD = "photometric_flow"
EVEN_PX = 0.5


def departures_px(run: Path, scene_name: str) -> dict[tuple[int, int], float]:
    """Return the departure of each patch from uniform flow, px, by sample and item."""
    study = json.loads((run / "study.json").read_text())
    render, flow = study["render"], study["evaluate"]["flow"]
    scene = load_scene(scene_name)
    renderer = Renderer(scene, render["resolution"], render["spp"], render["seed"])
    truth = GroundTruth(renderer.trajectory, renderer.camera, surfaces(scene)[0], scene.plane)
    rows = [row for row in read_rows(run / "rows.parquet") if row.scene == scene_name]
    samples = {row.sample for row in rows if row.task == "flow"}
    width = renderer.camera.width
    offset = np.linspace(-0.5, 0.5, 13) * PATCH_PX * width / 1280
    offsets = np.stack(np.meshgrid(offset, offset), axis=-1).reshape(-1, 2)
    found = {}
    for clip in clips(scene, every_s=render["every_s"], window_s=render["window_s"]):
        if clip.index not in samples:
            continue
        window_s = clip.t_window_start_s, clip.t_window_end_s
        image = renderer.frame(renderer.trajectory.pose(window_s[0]))
        features = find_features(
            image,
            truth,
            window_s,
            (scene_name, clip.index),
            count=flow["features"],
            seed=flow["seed"],
        )
        pairs = zip(features.centers_px, features.flow_px, strict=True)
        for item, (center_px, flow_px) in enumerate(pairs):
            points = center_px + offsets
            points = points[((points > 0) & (points < width)).all(axis=1)]
            there, _ = truth.point_flow(points, *window_s, width)
            square = np.sum((there - flow_px) ** 2, axis=1).mean()
            found[clip.index, item] = math.sqrt(square) * 1280 / width
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path, help="folder of a finished study")
    parser.add_argument("scene", help="one of its scenes")
    args = parser.parse_args()
    departure = departures_px(args.run, args.scene)
    rows = [
        row
        for row in read_rows(args.run / "rows.parquet")
        if (row.scene, row.method, row.variant) == (args.scene, METHOD, "")
        and (row.cutoff_hz, row.speed) == (math.inf, 1.0)
    ]
    median = np.median(list(departure.values()))
    print(f"{args.scene}: {len(departure)} patches, median departure {median:.2f} px")
    print(
        f"{'sensor':>8s} {'all':>8s} {f'under {EVEN_PX} px':>14s} {'the rest':>10s}   median RNEPE"
    )
    for width in sorted({row.width for row in rows}):
        value = {(row.sample, row.item): row.value for row in rows if row.width == width}
        even = [v for key, v in value.items() if departure[key] < EVEN_PX]
        rest = [v for key, v in value.items() if departure[key] >= EVEN_PX]
        parts = [f"{np.median(v):.2f} ({len(v)})" if v else "-" for v in (even, rest)]
        everything = np.median(list(value.values()))
        print(f"{width:5d} px {everything:8.2f} {parts[0]:>14s} {parts[1]:>10s}")


if __name__ == "__main__":
    main()
