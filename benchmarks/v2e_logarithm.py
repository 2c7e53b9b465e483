"""Measure what the linear part of v2e's logarithm does to the margin of the finest sensor.

    python benchmarks/v2e_logarithm.py --samples 4

prints by how much event integration is better at 1280 than at 640 px on rocks and room, in dB: with
exact pixels, and with v2e whose logarithm is linear below a gray value of 20, as in its program, or
of 1. Medians of the samples' differences, at a frame step of 0.5 px.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import sensor.emulators.v2e_steps as program
from eres_render.progress import silent
from tasks.evaluation.settings import Evaluate, Flow, Reconstruction, Tracking, Video
from tasks.study.config import Render, Simulate, Study
from tasks.study.run import run_study

FINE, COARSE = 1280, 640


def margins(samples: int) -> dict[tuple[str, str, float], float]:
    """Return the median margin by scene, simulator and cutoff in Hz, dB."""
    study = Study(
        name="logarithm",
        scenes=("rocks", "room"),
        render=Render(samples=samples),
        simulate=Simulate(
            widths=(COARSE, FINE),
            cutoffs_hz=(math.inf, 200.0),
            speeds=(1.0,),
            simulators=("exact", "v2e", "v2e-A"),
        ),
        evaluate=Evaluate(
            reconstruction=Reconstruction(methods=("event_integration",)),
            flow=Flow(methods=()),
            tracking=Tracking(methods=()),
            video=Video(methods=()),
        ),
    )
    with TemporaryDirectory() as folder:
        rows = run_study(study, Path(folder) / "run", None, silent)
    found = {
        (row.scene, row.simulator, row.cutoff_hz, row.sample, row.width): row.value for row in rows
    }
    places = {place[:3] for place in found}
    return {
        at: median(
            found[*at, k, FINE] - found[*at, k, COARSE]
            for *there, k, w in found
            if (*there,) == at
            if w == FINE
        )
        for at in sorted(places)
    }


def main() -> None:
    """Print the margins."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--samples", type=int, default=4)
    samples = parser.parse_args().samples
    for joint in (program._JOINT, 1.0):
        program._JOINT = joint
        for (scene, simulator, cutoff_hz), db in margins(samples).items():
            print(f"linear below {joint:g}: {scene}, {simulator}, {cutoff_hz:g} Hz: {db:+.2f} dB")


if __name__ == "__main__":
    main()
