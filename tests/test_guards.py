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
    assert {*keys} == {file.stem for file in (PAPER_RUN / "costs").glob("*.json")}
    assert digest("\n".join(keys).encode()) == stored["part_keys"]


def test_scenes_keep_their_digests(stored):
    """Promise: shipped lightmaps stay those of their scenes, cached frames those of their light."""
    assert scene_digests() == stored["scenes"]


def test_events_are_the_same_to_the_bit():
    """Promise: the events of five kinds of sensor on one moving texture.

    tests/study/test_numbers.py checks the scores of a small study in the same way.
    """
    assert event_digests() == stored_bits("events")


def report_of_the_paper(run: Path) -> dict[str, str]:
    """Return digests of the report and the table that are made from docs/results/paper."""
    shutil.copytree(PAPER_RUN, run, ignore=shutil.ignore_patterns("*.csv"))
    page_of(run)
    names = ("report.html", "tables.csv")
    return {name: digest(plain((run / name).read_text()).encode()) for name in names}


@pytest.mark.slow
def test_the_report_of_the_paper_run_is_the_same(stored, tmp_path):
    """Promise: report and tables made from docs/results/paper are those of the last time, except
    for white space, and the stored table is that one."""
    assert report_of_the_paper(tmp_path / "paper") == stored["report"]
    assert (
        digest(plain((PAPER_RUN / "tables.csv").read_text()).encode())
        == (stored["report"]["tables.csv"])
    )


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
            "report": report_of_the_paper(Path(folder) / "paper"),
            "machine": machine(),
        }
    GUARDS.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    if sys.argv[1:] != ["--rewrite"]:
        sys.exit(f"usage: {COMMAND}")
    rewrite()
