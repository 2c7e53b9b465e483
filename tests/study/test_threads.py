"""A study's scores do not depend on the number of linear algebra threads."""

import json

import pytest

from another_process import run_python
from eres_render.cores import cores
from light_scenes import small_carpet_folder

# Reference views of more than 10,000 px and paths of more than 140 unknowns: above that
# OpenBLAS uses a second thread.
CODE = """
import json, sys
from dataclasses import asdict
from pathlib import Path
from tasks.study.config import Evaluate, Flow, Render, Simulate, Study, Tracking, Video
from tasks.study.run import run_study
study = Study(
    name="threads",
    scenes=(sys.argv[1],),
    render=Render(resolution=128, spp=1, max_displacement_px=1.0, samples=1),
    simulate=Simulate(widths=(128,), cutoffs_hz=(200.0,), speeds=(1.0,)),
    evaluate=Evaluate(
        flow=Flow(features=2),
        tracking=Tracking(
            methods=("photometric_tracking", "photometric_tracking_with_delay"),
            sigmas_mm=(20.0,),
            max_delay_us=35_000,
        ),
        video=Video(methods=("high_pass_filter",), duration_s=0.1, run_in_s=0.05),
    ),
)
print(json.dumps([asdict(row) for row in run_study(study, Path(sys.argv[2]))]))
"""


def rows_with(threads, scene_folder, folder):
    cache = str(folder / f"cache_{threads}")
    out = folder / f"run_{threads}"
    environment = {"OPENBLAS_NUM_THREADS": threads, "ERES_CACHE": cache}
    return json.loads(run_python(CODE, scene_folder, out, **environment).stdout)


@pytest.mark.slow
@pytest.mark.skipif(cores() < 2, reason="one core: linear algebra has one thread")
def test_rows_do_not_depend_on_the_threads_of_blas(tmp_path):
    """Promise: the same rows to the last bit, including frames, with one thread and with two.

    Dask gives its workers' linear algebra one thread; a local run has one for each core.
    """
    scene_folder = small_carpet_folder(tmp_path / "carpet")
    one = rows_with("1", scene_folder, tmp_path)
    assert {row["task"] for row in one} == {"reconstruction", "flow", "tracking", "video"}
    assert not any(row["failure"] for row in one if row["task"] == "tracking")
    assert rows_with("2", scene_folder, tmp_path) == one
