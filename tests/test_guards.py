"""What refactoring must not change: names of results, and results to the last bit.

`tests/data/guards.json` holds them. An intended change comes with a raised stage version and an
entry under "Numbers change" in CHANGELOG.md, and is stored by

    PYTHONPATH=tests/helpers python tests/test_guards.py --rewrite

Bits depend on the processor and the versions of libraries: elsewhere those tests are skipped.
`tests/study/test_numbers.py` holds the same scores within tolerances on any machine.
"""

import json
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path

import pytest

from eres_render import list_scenes, load_scene
from finished_runs import page_of
from moving_texture import texture_in_motion
from sensor import SensorModel, simulate
from small_study import GUARDS, STUDY, digest, machine, score_digest, stored_bits
from stored_studies import paper_study
from tasks.study.run import run_study
from tasks.study.run.jobs import jobs_of

COMMAND = "PYTHONPATH=tests/helpers python tests/test_guards.py --rewrite"
PAPER_RUN = Path(__file__).parent.parent / "docs" / "results" / "paper"

SIZE = {"width": 60, "height": 48, "dark_level": 0.01}
MODELS = {
    "ideal": SensorModel(**SIZE),
    "200 Hz": SensorModel(**SIZE, cutoff_hz=200.0),
    "one pole": SensorModel(**SIZE, cutoff_hz=200.0, photoreceptor="one_pole"),
    "own light, all noise": SensorModel(
        **SIZE,
        cutoff_hz=300.0,
        cutoff_reference=1.0,
        random_start=True,
        threshold_mismatch=0.03,
        leak_hz=5.0,
        shot_noise_hz=20.0,
        hot_pixel_fraction=0.01,
        refractory_s=1e-3,
        fill_factor=0.5,
    ),
    "leaky": SensorModel(**SIZE, leak_hz=40.0),
}


def part_keys() -> list[str]:
    study = paper_study()
    return sorted(job.key for name in study.scenes for job in jobs_of(study, load_scene(name)))


def scene_digests() -> dict[str, list[str]]:
    scenes = map(load_scene, list_scenes())
    return {scene.name: [scene.digest, scene.light_digest] for scene in scenes}


def event_digests() -> dict[str, str]:
    frames, t_s = texture_in_motion(3, 14, (96, 120), 2e-3, travel_px=14.0)
    found = {}
    for name, model in MODELS.items():
        events = simulate(frames, t_s, model, seed=7)
        columns = (events.t_us, events.x, events.y, events.p)
        found[name] = f"{len(events)} {digest(*(column.tobytes() for column in columns))}"
    return found


@pytest.fixture(scope="module")
def stored() -> dict:
    return json.loads(GUARDS.read_text())


def test_jobs_of_the_paper_run_keep_their_names(stored):
    """Promise: existing results remain the results of the same study."""
    keys = part_keys()
    assert {*keys} == {file.stem for file in (PAPER_RUN / "parts").glob("*.parquet")}
    assert digest("\n".join(keys).encode()) == stored["part_keys"]


def test_scenes_keep_their_digests(stored):
    """Promise: shipped lightmaps stay those of their scenes, cached frames those of their light."""
    assert scene_digests() == stored["scenes"]


def test_events_are_the_same_to_the_bit():
    """Promise: the events of five kinds of sensor on one moving texture.

    tests/study/test_numbers.py checks the scores of a small study in the same way.
    """
    assert event_digests() == stored_bits("events")


@pytest.mark.slow
def test_the_report_of_the_paper_run_is_the_same(tmp_path):
    """Promise: report and tables made from docs/results/paper equal the stored ones, except for
    white space."""
    run = tmp_path / "paper"
    shutil.copytree(PAPER_RUN, run, ignore=shutil.ignore_patterns("parts", "*.html", "*.csv"))
    page_of(run)
    for name in ("report.html", "tables.csv"):
        made, there = ((folder / name).read_text() for folder in (run, PAPER_RUN))
        assert plain(made) == plain(there), name


def plain(text: str) -> str:
    """Return the text without the white space between tags and at the ends of lines."""
    return re.sub(r"\s+", " ", re.sub(r">\s+", ">", re.sub(r"\s+<", "<", text))).strip()


def rewrite() -> None:
    """Store the current state."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["ERES_CACHE"] = f"{folder}/cache"
        found = {
            "part_keys": digest("\n".join(part_keys()).encode()),
            "scenes": scene_digests(),
            "events": event_digests(),
            "scores": score_digest(run_study(STUDY, Path(folder) / "run")),
            "machine": machine(),
        }
    GUARDS.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    if sys.argv[1:] != ["--rewrite"]:
        sys.exit(f"usage: {COMMAND}")
    rewrite()
