"""A small study with every task, and the comparison of its scores to the bit."""

import hashlib
import json
import math
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import llvmlite.binding
import pytest

from tasks.row import Row
from tasks.study.config import Evaluate, Flow, Render, Simulate, Study, Tracking, Video

GUARDS = Path(__file__).parents[1] / "data" / "guards.json"
LIBRARIES = ("numpy", "numba", "scipy", "mitsuba", "opencv-python-headless", "OpenEXR")


STUDY = Study(
    name="numbers",
    scenes=("carpet",),
    render=Render(resolution=320, spp=4, max_displacement_px=1.0, samples=1),
    simulate=Simulate(widths=(64, 160, 320), cutoffs_hz=(math.inf, 50.0), speeds=(1.0, 2.0)),
    evaluate=Evaluate(
        flow=Flow(features=5),
        tracking=Tracking(sigmas_mm=(10.0,), max_events=5000),
        video=Video(
            methods=("high_pass_filter", "blank"), duration_s=0.3, run_in_s=0.1, every_s=0.1
        ),
    ),
)


def only(**tasks):
    """Return the settings of these tasks; the others have no methods."""
    none = {task: replace(settings, methods=()) for task, settings in Evaluate().items()}
    return Evaluate(**none | tasks)


def digest(*chunks: bytes) -> str:
    whole = hashlib.sha256()
    for chunk in chunks:
        whole.update(chunk)
    return whole.hexdigest()


def score_digest(rows: list[Row]) -> str:
    lines = sorted(
        f"{r.task} {r.method} {r.variant} {r.width} {r.cutoff_hz} {r.speed} {r.sample} {r.item} "
        f"{r.metric} {r.value.hex()} {r.event_rate_hz.hex()} {r.failure}"
        for r in rows
    )
    return f"{len(lines)} {digest(chr(10).join(lines).encode())}"


def machine() -> dict[str, str]:
    """Return all versions that bits depend on: processor, Python and libraries."""
    found = {"processor": llvmlite.binding.get_host_cpu_name(), "python": sys.version.split()[0]}
    return found | {name: version(name) for name in LIBRARIES}


def stored_bits(kind: str) -> dict[str, str] | str:
    """Return the stored scores that this machine must reproduce to the bit; skip the test
    elsewhere."""
    found, here = json.loads(GUARDS.read_text()), machine()
    if different := [name for name in here if here[name] != found["machine"].get(name)]:
        pytest.skip(f"bits were stored on a machine with another {', '.join(different)}")
    return found[kind]


def tiny_study(folder, seed=0, samples=3):
    """Return a study of reconstruction on a few samples; another seed is another study."""
    return Study(
        name="tiny",
        scenes=(str(folder),),
        render=Render(resolution=64, spp=4, max_displacement_px=0.1, samples=samples, seed=seed),
        simulate=Simulate(widths=(32, 64), cutoffs_hz=(math.inf, 50.0), speeds=(1.0,)),
        evaluate=Evaluate(flow=Flow(methods=()), tracking=Tracking(methods=())),
    )
