"""A study on many machines gives the same rows for any workers, even if some of them die."""

import itertools
import logging
import os
import pickle
import random
import re
import signal
import statistics
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from distributed import LocalCluster
from hypothesis import given
from hypothesis import strategies as st

from another_process import environment
from benchmark_files import benchmark
from eres_render import load_scene
from eres_render.errors import RenderError
from eres_render.progress import silent
from eres_render.storage.cache import cache_dir
from light_scenes import small_carpet_folder, write_poses
from small_study import only, tiny_study
from tasks import cluster as connection_module
from tasks.errors import StudyError, TaskError
from tasks.row import read_rows
from tasks.study.config import (
    Evaluate,
    Flow,
    Reconstruction,
    Render,
    Simulate,
    Tracking,
    Video,
    with_method,
)
from tasks.study.run import run_study, scheduler
from tasks.study.run.compute import ComputedJob
from tasks.study.run.estimate import JobEstimate, estimate_job
from tasks.study.run.jobs import QueuedJob, jobs_of

# Dask warns of a disk that takes a second to make a folder.
pytestmark = pytest.mark.filterwarnings("default:Creating scratch directories")


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """Allow a scheduler on a busy machine more time to answer."""
    monkeypatch.setattr(connection_module, "_CONNECT_S", 60.0)


@contextmanager
def local_cluster(**options):
    here = {"host": "127.0.0.1", "protocol": "tcp://", "dashboard_address": ":0", "memory_limit": 0}
    options = here | options
    with LocalCluster(silence_logs=logging.CRITICAL, **options) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def cluster():
    """Start two workers, each a process of one thread that restarts after its death."""
    with local_cluster(n_workers=2, threads_per_worker=1, processes=True) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def one_worker():
    """Start a worker in this process, so that tests can change its behavior."""
    with local_cluster(n_workers=1, threads_per_worker=1, processes=False) as cluster:
        yield cluster


@pytest.mark.slow
def test_workers_make_the_same_run(cluster, scene_folder, tmp_path):
    """Promise: rows and pictures equal those of a local run, byte by byte, in every task.

    Workers' linear algebra has one thread. In a local run it has one for each core, which it uses
    if a view has more than 10,000 px.
    """
    study = replace(
        tiny_study(scene_folder),
        render=Render(resolution=128, spp=1, max_displacement_px=0.5, samples=2),
        simulate=Simulate(widths=(32, 128), cutoffs_hz=(50.0,), speeds=(1.0,)),
        evaluate=Evaluate(
            flow=Flow(features=2),
            tracking=Tracking(methods=("photometric_tracking",), sigmas_mm=(20.0,)),
            video=Video(methods=("high_pass_filter",), duration_s=0.1, run_in_s=0.05),
        ),
    )
    rows = run_study(study, tmp_path / "here")
    assert {row.task for row in rows} == {"reconstruction", "flow", "tracking", "video"}
    there = tmp_path / "there"
    assert run_study(study, there, cluster.scheduler_address) == rows
    for file in (tmp_path / "here").rglob("*.*"):
        if file.suffix in (".parquet", ".png") or file.parent.name == "scaling":
            assert (there / file.relative_to(tmp_path / "here")).read_bytes() == file.read_bytes()


@pytest.mark.slow
def test_a_killed_worker_costs_its_job_only(cluster, scene_folder, tmp_path):
    """Promise: after SIGKILL in the middle of a job, others continue, and the rows are the same."""
    study = tiny_study(scene_folder, seed=1, samples=3)
    before, killed, over = frames_begun(cache_dir()), [], threading.Event()

    def kill():
        while not killed and not over.wait(0.01):
            if frames_begun(cache_dir()) <= before:
                continue
            for nanny in list(cluster.workers.values()):
                state = cluster.scheduler.workers.get(nanny.worker_address)
                if state is not None and (working_on := list(state.processing)):
                    killed.extend(task.key for task in working_on)
                    os.kill(nanny.pid, signal.SIGKILL)
                    return

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        rows = run_study(study, tmp_path / "there", cluster.scheduler_address)
    finally:
        over.set()
        killer.join()
    assert any(job.key in killed[0] for job in jobs_of(study, load_scene(scene_folder)))
    assert rows == run_study(study, tmp_path / "here")


def frames_begun(cache):
    """Return the clips in a cache with at least one frame."""
    return {file for file in cache.glob("frames/*/SHA256SUMS") if file.stat().st_size}


def kill_and_resume(study, folder, moments, *options):
    """Start the study in processes, kill each at its moment, and return the study's final rows."""
    code = (
        "from pathlib import Path; from small_study import tiny_study; from tasks.study.run import "
        f"run_study; run_study(tiny_study({study.scenes[0]!r}, {study.render.seed}, "
        f"{study.render.samples}), Path({str(folder)!r}), *{options!r})"
    )
    for moment in moments:
        for name in ("study.json", "rows.parquet"):  # of a run that ended within a moment
            (folder / name).unlink(missing_ok=True)
        process = subprocess.Popen([sys.executable, "-c", code], env=environment())
        while not moment():
            assert process.poll() is None or moment(), "the run ended before it could be killed"
            time.sleep(0.01)
        process.kill()
        process.wait()
    return run_study(study, folder, *options)


def random_moments(folder, count):
    """Draw moments to kill at, up to 1.5 s after study.json is written, before the first job."""

    def moment(delay_s):
        if not (folder / "study.json").exists():
            return False
        time.sleep(delay_s)
        return True

    rng = random.Random(count)
    return [partial(moment, rng.uniform(0, 1.5)) for _ in range(count)]


@pytest.mark.slow
def test_a_run_that_is_killed_resumes_to_the_same_rows(scene_folder, tmp_path, monkeypatch):
    """Promise: a run killed in mid-render and between two jobs ends with the same rows."""
    study = tiny_study(scene_folder, seed=2)
    rows = run_study(study, tmp_path / "unbroken")
    cache, broken = tmp_path / "cache", tmp_path / "broken"
    monkeypatch.setenv("ERES_CACHE", str(cache))
    moments = (lambda: frames_begun(cache)), (lambda: list(broken.glob("jobs/*.parquet")))
    assert kill_and_resume(study, broken, moments) == rows
    assert read_rows(broken / "rows.parquet") == rows


@pytest.mark.slow
def test_a_run_that_is_killed_often(scene_folder, tmp_path, monkeypatch):
    """Promise: after kill -9 at any moment and a new start, the rows are the same."""
    study = tiny_study(scene_folder, seed=3, samples=15)
    rows = run_study(study, tmp_path / "unbroken")
    monkeypatch.setenv("ERES_CACHE", str(tmp_path / "cache"))
    broken = tmp_path / "broken"
    assert kill_and_resume(study, broken, random_moments(broken, 12)) == rows


@pytest.mark.slow
def test_a_client_that_is_killed_resumes_with_what_workers_had_done(
    cluster, scene_folder, tmp_path
):
    """Promise: jobs are written as they arrive, so a killed client loses only the others."""
    study = tiny_study(scene_folder, seed=4, samples=15)
    options = (cluster.scheduler_address,)
    broken = tmp_path / "broken"
    rows = kill_and_resume(study, broken, random_moments(broken, 4), *options)
    assert rows == run_study(study, tmp_path / "unbroken")


@pytest.mark.slow
def test_a_job_that_kills_its_workers_ends_the_run(scene_folder, tmp_path, monkeypatch):
    """Promise: after some workers the error names the job, and the results of others remain."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "deadly.py").write_text(
        "import os\nfrom tasks.reconstruction import ReconstructionSample\n"
        "def reconstruct(sample: ReconstructionSample):\n    os._exit(1)\n"
    )
    study = with_method(tiny_study(scene_folder, samples=1), "deadly:reconstruct")
    with local_cluster(n_workers=1, threads_per_worker=1, processes=True) as cluster:
        cluster.scheduler.allowed_failures = 1
        with pytest.raises(TaskError, match=r"^carpet, clip 0: one worker after another died"):
            run_study(study, tmp_path / "run", cluster.scheduler_address)


def queued_jobs(scene_folder):
    work = jobs_of(tiny_study(scene_folder), load_scene(scene_folder))
    return [QueuedJob(job, job.key, False) for job in work]


@given(
    st.lists(st.tuples(st.floats(1e-3, 1e3), st.floats(1e-3, 1e3)), min_size=2, max_size=6),
)
def test_progress_never_goes_back(stages_s) -> None:
    """Promise: not by a rounding either, as the elapsed time would start again at 0."""
    jobs = [JobEstimate(1, 1.0, *lengths_s, 0.0) for lengths_s in stages_s]
    before_s, total_s, seen = 0.0, sum(one.core_s for one in jobs), []

    def seen_at(stage, done, of, /):
        seen.append(done)

    for one in jobs:
        seen.append(before_s)
        on_job = scheduler._within(seen_at, one, before_s, total_s)
        for stage in ("simulating", "scoring", "scoring"):
            on_job(stage, 75, 75)
        before_s += one.core_s
    assert seen == sorted(seen)


def nothing_computed(queued, on_progress):
    on_progress("simulating", 1, 2)
    return ComputedJob([], None, {}, {})


def test_progress_is_of_all_jobs(one_worker, scene_folder, monkeypatch):
    """Promise: progress counts each job with its estimated time, so that the time left follows the
    machine, and of a job that has begun its parts, or half of it on workers once a job is done; it
    is complete at the end."""
    monkeypatch.setattr(scheduler, "compute_job", nothing_computed)
    jobs = queued_jobs(scene_folder)
    estimates = [estimate_job(queued.job) for queued in jobs]
    ends = list(itertools.accumulate((one.core_s for one in estimates), initial=0.0))
    halves = [start + one.frames_s / 2 for start, one in zip(ends, estimates, strict=False)]
    order = sorted(range(len(jobs)), key=lambda k: estimates[k].core_s, reverse=True)
    sums = list(itertools.accumulate((estimates[k].core_s for k in order), initial=0.0))
    on_worker = [0.0, *map(statistics.mean, itertools.pairwise(sums[1:])), sums[-1]]
    for address, expected in (
        (None, [*itertools.chain.from_iterable(zip(ends, halves, strict=False)), ends[-1]]),
        (one_worker.scheduler_address, on_worker),
    ):
        said = []
        with scheduler.open_scheduler(address) as computing:
            computed = list(computing.compute(jobs, lambda _, done, of, to=said: to.append(done)))
        assert said == pytest.approx(expected)
        assert {job.key for job, _ in computed} == {job.key for job in jobs}


def test_workers_take_the_longest_job_first(one_worker, scene_folder, monkeypatch):
    """Promise: idle workers begin with it too, so that no worker is left with it at the end."""
    jobs, begun = queued_jobs(scene_folder), []
    lengths_s = {queued.job.key: 1.0 + 0.1 * place for place, queued in enumerate(jobs)}

    def computed(queued, on_progress):
        begun.append(queued.key)
        return ComputedJob([], None, {}, {})

    monkeypatch.setattr(scheduler, "compute_job", computed)
    monkeypatch.setattr(
        scheduler,
        "estimate_job",
        lambda job: JobEstimate(1, 1.0, lengths_s[job.key], samples_s=0.0, render_s=0.0),
    )
    with scheduler.open_scheduler(one_worker.scheduler_address) as computing:
        assert len(list(computing.compute(jobs, silent))) == len(jobs)
    assert begun == [queued.key for queued in reversed(jobs)]


@pytest.mark.parametrize("on_cluster", [False, True])
def test_weights_that_change_meanwhile_end_the_study(
    one_worker, scene_folder, tmp_path, monkeypatch, on_cluster
):
    """Promise: scores of other weights never get the name of those that the study began with."""
    file = tmp_path / "weights.pt"
    file.write_bytes(b"of one training")
    name = "our_reconstruction_all_light"
    video = Video(methods=(name, "blank"), weights={name: str(file)}, duration_s=0.1, run_in_s=0.05)
    study = replace(tiny_study(scene_folder, samples=1), evaluate=only(video=video))

    def computed(queued, on_progress):
        file.write_bytes(b"of another training")
        return ComputedJob([], None, {}, {})

    monkeypatch.setattr(scheduler, "compute_job", computed)
    run_module = sys.modules["tasks.study.run.run_study"]
    for module in (scheduler, run_module):  # the weights are not those of a network
        monkeypatch.setattr(module, "check_methods", lambda *_: None)
    address = one_worker.scheduler_address if on_cluster else None
    with pytest.raises(StudyError, match=r"weights.pt: changed while the study ran"):
        run_study(study, tmp_path / "run", address)
    assert [one.name for one in (tmp_path / "run").iterdir()] == ["study.json"]


@pytest.mark.parametrize("wrapped", [False, True])
def test_what_may_pass_is_tried_again(one_worker, scene_folder, tmp_path, monkeypatch, wrapped):
    """Promise: an error of the system costs a job two retries, then the run ends and names the
    job; so does the error of a file that cannot be written."""
    tries = []

    def failing(queued, on_progress):
        tries.append(queued)
        full = OSError(28, "No space left on device", "/cache/frames")
        if wrapped:
            raise RenderError("/cache/frames: cannot be written: No space left on device") from full
        raise full

    monkeypatch.setattr(scheduler, "compute_job", failing)
    study = tiny_study(scene_folder, samples=1)
    with pytest.raises(StudyError, match=r"carpet, clip 0: failed 3 times .*/cache/frames"):
        run_study(study, tmp_path / "run", one_worker.scheduler_address)
    assert len(tries) == 3
    assert [file.name for file in (tmp_path / "run").iterdir()] == ["study.json"]


def test_a_mistake_in_your_own_method_ends_the_run_at_once(
    one_worker, scene_folder, tmp_path, monkeypatch
):
    """Promise: the error on a worker has the name too, after one small job; no other begins."""
    (tmp_path / "rash.py").write_text(
        "from tasks.flow import FlowSample\n\ndef estimate(sample: FlowSample):\n    return 1 / 0\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    computed = []

    def compute(queued, on_progress):
        computed.append(queued.job)
        return real(queued, on_progress)

    real = scheduler.compute_job
    monkeypatch.setattr(scheduler, "compute_job", compute)
    study = with_method(tiny_study(scene_folder), "rash:estimate")
    said = r"^worker tcp://\S+ on \S+: flow, method 'rash:estimate': raised ZeroDivisionError at "
    with pytest.raises(StudyError, match=said + r"\S+rash.py:4: division by zero$"):
        run_study(study, tmp_path / "run", one_worker.scheduler_address)
    (job,) = computed
    assert job.simulate.widths == (32,)
    assert not (tmp_path / "run").exists()


def test_a_worker_of_other_code_or_scenes_is_refused(
    one_worker, scene_folder, tmp_path, monkeypatch
):
    """Promise: a worker refuses a job that its own files would change; the error says so."""

    def refusal(study):
        with pytest.raises(StudyError, match=r"^worker tcp://\S+ on \S+: ") as refused:
            run_study(study, tmp_path / "run", one_worker.scheduler_address)
        return str(refused.value).split(": ", 1)[1]

    study = tiny_study(scene_folder, samples=1)
    here = scheduler._versions()
    assert {"eres", "render", "simulate", "evaluate"} <= {*here}
    for other in ({**here, "eres": "9.9"}, {**here, "render": 0}):
        with monkeypatch.context() as patch:
            asked_then_found = iter([other, here, here])
            patch.setattr(scheduler, "_versions", asked_then_found.__next__)
            assert refusal(study) == f"has versions {here}, expected {other}"
    with monkeypatch.context() as patch:
        other = SimpleNamespace(
            dumps=lambda one: pickle.dumps(replace(one, key="other")), loads=pickle.loads
        )
        patch.setattr(scheduler, "pickle", other)
        assert refusal(study).startswith("your own method or weights are not")
    with monkeypatch.context() as patch:
        edited = small_carpet_folder(tmp_path / "edited")
        toml = edited / "scene.toml"
        toml.write_text(toml.read_text().replace("seed = ", "seed = 1"))
        patch.setattr(
            *(scheduler, "load_scene"),
            lambda source, path: replace(load_scene(edited, path), source=source),
        )
        assert refusal(study).startswith(f"scene {scene_folder}: its files differ")
    assert not list((tmp_path / "run").rglob("*.parquet"))


def test_a_worker_reads_the_path_that_the_study_gives(
    one_worker, scene_folder, tmp_path, monkeypatch
):
    """Promise: the path of a study, or of a scene, comes from its file, which must be the same."""
    monkeypatch.setattr(scheduler, "compute_job", nothing_computed)
    positions_m = [(0.05 * k, -0.4, 1.0) for k in range(6)]
    poses = write_poses(tmp_path, positions_m, [0.2 * k for k in range(6)])
    own = small_carpet_folder(tmp_path / "own")
    toml = own / "scene.toml"
    before, after = toml.read_text().split("[path]")
    path = '[path]\nkind = "tum"\nfile = "../poses.txt"\nmin_clearance_m = 0.2\n\n['
    toml.write_text(before + path + after.split("\n[", 1)[1])
    for scene in (load_scene(scene_folder, poses), load_scene(own)):
        study = replace(
            tiny_study(scene.source, samples=1), evaluate=only(reconstruction=Reconstruction())
        )
        jobs = [QueuedJob(job, job.key, False) for job in jobs_of(study, scene)]
        with scheduler.open_scheduler(one_worker.scheduler_address) as computing:
            assert len(list(computing.compute(jobs, lambda *_: None))) == len(jobs) == 1
    write_poses(tmp_path, positions_m[::-1], [0.2 * k for k in range(6)])
    with (
        scheduler.open_scheduler(one_worker.scheduler_address) as computing,
        pytest.raises(StudyError, match="its files differ"),
    ):
        list(computing.compute(jobs, lambda *_: None))


def test_a_worker_of_several_threads_is_refused(scene_folder, tmp_path):
    """Promise: the run refuses workers that share a process, as two jobs would share a renderer."""
    study, said = tiny_study(scene_folder), r"2 threads; start it with --nthreads 1"
    with (
        local_cluster(n_workers=1, threads_per_worker=2, processes=False) as cluster,
        pytest.raises(StudyError, match=said),
    ):
        run_study(study, tmp_path / "run", cluster.scheduler_address)


@pytest.mark.parametrize(
    ("address", "text"),
    [
        ("tcp://127.0.0.1:9", "no Dask scheduler at tcp://127.0.0.1:9: Timed out"),
        ("localhost", "found 'localhost', expected tcp://HOST:PORT"),
    ],
)
def test_no_scheduler_is_said_before_anything_else(eres, tmp_path, monkeypatch, address, text):
    """Promise: one line, exit code 1, no folder, and no access to scenes, which may not exist."""
    monkeypatch.setattr(connection_module, "_CONNECT_S", 0.5)
    args = ("--scenes", "nowhere", "--out", tmp_path / "run", "--scheduler", address)
    code, _, err = eres("study", *args)
    assert code == 1
    assert err.startswith(f"error: --scheduler: {text}")
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "run").exists()


def test_without_dask_the_error_says_how_to_get_it(eres, tmp_path, monkeypatch):
    """Promise: the error names the extra."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    code, _, err = eres("study", "--out", tmp_path / "run", "--scheduler", "tcp://127.0.0.1:9")
    assert (code, len(err.splitlines())) == (1, 1)
    assert "pip install 'eres-events[distributed]'" in err


@pytest.mark.slow
def test_the_page_on_clusters_has_the_numbers_of_the_model(capsys):
    """Promise: docs/many_machines.md says what `python benchmarks/cluster_model.py` prints."""

    def numbers(lines):
        return [tuple(re.findall(r"\d+(?:\.\d+)?", line)) for line in lines]

    benchmark("cluster_model").main()
    printed = capsys.readouterr().out.splitlines()
    page = (Path(__file__).parents[2] / "docs" / "many_machines.md").read_text()
    tables = numbers(line for line in page.splitlines() if line.startswith("|"))
    rows = [row for row in numbers(printed) if len(row) in (5, 7)]
    assert len(rows) == 11
    assert [row for row in rows if row not in tables] == []
    (split,) = (line for line in printed if line.startswith("split:"))
    renders, simulates, minutes, gigabytes = numbers([split])[0]
    text = " ".join(page.split())
    for words in (
        f"give {renders} tasks",
        f"{simulates} tasks of up to {minutes} minutes",
        f"{gigabytes} GB",
    ):
        assert words in text
