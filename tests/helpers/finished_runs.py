"""Folders of finished runs, for the report to read."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tasks.evaluation.timings import JobTimings, MethodTimings
from tasks.row import Row, write_rows
from tasks.study.report import write_report
from tasks.study.results.paper import WIDTHS
from tasks.study.results.previews import FILM_PICTURES
from tasks.study.run.highlights import film_strip


def make_run(folder: Path, rows: list[Row]) -> Path:
    write_rows(folder / "rows.parquet", rows)
    environment = {"command": "eres study --preset quick", "Mitsuba variant": "llvm <mono>"}
    (folder / "environment.json").write_text(json.dumps(environment))
    (folder / "study.json").write_text(json.dumps({"render": {"spp": 16}}))
    return folder


def page_of(folder: Path, **options) -> str:
    """Write the report of a run without static figures, which take longest; return its page."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tasks.study.report.page.figure_files", lambda plots: {})
        return write_report(folder, **options).read_text()


def add_previews(folder: Path, *, films: bool = False) -> None:
    (folder / "previews").mkdir()
    index = []
    for width in WIDTHS:
        file = f"{width}.png"
        cv2.imwrite(str(folder / "previews" / file), np.full((8, 8, 3), 200, np.uint8))
        entry = {"file": file, "scene": "carpet", "width": width, "cutoff_hz": "inf", "speed": 1.0}
        index.append({**entry, "kind": "events", "caption": f"{width} px of events"})
    index.append({**index[0], "kind": "frame", "caption": "the radiance"})
    if films:
        nothing = np.zeros((FILM_PICTURES, 8, 8))
        drawn = film_strip(nothing.astype(np.float32), nothing.astype(np.int16))
        (folder / "previews" / "film.webp").write_bytes(drawn)
        index.append({**index[0], "file": "film.webp", "cutoff_hz": "50"})
    (folder / "previews" / "index.json").write_text(json.dumps(index))


FLOW = MethodTimings("flow", "photometric_flow", "", 640, 20, 400_000, cpu_s=2.0, median_cpu_s=0.05)


NOTHING = MethodTimings("flow", "initial_flow", "", 640, 20, 400_000, cpu_s=0.1, median_cpu_s=0.0)


JOB = JobTimings(
    scene="carpet",
    sample=0,
    cores=2,
    frames=100,
    resolution=1280,
    spp=4,
    reading_s=2.0,
    sensors=1,
    pixel_frames=300_000_000,
    events=60_000_000,
    simulating_s=3.0,
    collecting_s=0.5,
    scoring_s=2.5,
    methods=(FLOW, NOTHING),
    rendered_frames=50,
    rendering_s=12.0,
)
