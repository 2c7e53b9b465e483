"""Mistakes in your own methods: named on the first sample, or counted as failures."""

import math
import traceback
from dataclasses import dataclass, fields, replace
from types import SimpleNamespace

import numpy as np
import pytest

from eres_render import Trajectory, load_scene, path_through
from finished_runs import page_of
from sensor import Events
from small_study import only
from tasks.errors import MethodError, TaskError
from tasks.evaluation.answers import ask, path_answer
from tasks.flow import FlowEstimate, FlowSample
from tasks.methods import task_of
from tasks.reconstruction import ReconstructionSample
from tasks.study.config import (
    DenseFlow,
    Evaluate,
    Flow,
    Reconstruction,
    Render,
    Simulate,
    Study,
    Tracking,
    Video,
    preset,
    with_method,
)
from tasks.study.run import run_study, scheduler
from tasks.study.run.jobs import jobs_of, trials
from tasks.tracking import TrackingEstimate, TrackingSample, failure_of

HERE = __name__


def image_of(value):
    def reconstruct(sample: ReconstructionSample):
        return value(sample) if callable(value) else value

    return reconstruct


def flow_of(value):
    def estimate(sample: FlowSample):
        return value(sample) if callable(value) else value

    return estimate


def path_of(value):
    def estimate(sample: TrackingSample):
        return value(sample) if callable(value) else value

    return estimate


class Blank:
    """A correct method; each of those below has one mistake."""

    def __init__(self, width, height, contrast_threshold):
        self.shape = height, width

    def push(self, events: Events):
        pass

    def image(self, t_us):
        return np.zeros(self.shape)


class Unmade(Blank):
    def __init__(self):
        pass


class Deaf(Blank):
    push = None


class Wide(Blank):
    def image(self, t_us):
        return np.zeros((self.shape[0], 2 * self.shape[1]))


class NotFiniteVideo(Blank):
    def image(self, t_us):
        return np.full(self.shape, -np.inf)


def raises(sample):
    return {}["no such key"]


def raises_elsewhere(sample):
    return np.linalg.inv(np.zeros((2, 2)))


def lines(sample):
    raise RuntimeError("two\nlines")


def one_pixel_is_nan(sample):
    image = sample.log_keyframe.copy()
    image[3, 4] = np.nan
    return image


def short_path(sample):
    controls = sample.initial.controls
    return TrackingEstimate(path_through([0.0, 1e-3], controls[:2]))


def not_finite_path(sample):
    controls = sample.initial.controls.copy()
    controls[:, 0, 3] = np.nan
    return TrackingEstimate(replace(sample.initial, controls=controls))


RAISED = rf"{HERE}:method': raised KeyError at {__file__}:\d+: 'no such key'$"
WRONG = {
    "image raises": (image_of(raises), f"reconstruction, method '{RAISED}"),
    "no image": (image_of(None), r"None, expected an array of numbers of shape \(64, 64\)$"),
    "small image": (image_of(np.zeros((3, 4))), r"array of shape \(3, 4\) and type float64, exp"),
    "ragged image": (image_of([[1.0], [1.0, 2.0]]), "returned a list, expected an array"),
    "complex image": (
        image_of(lambda s: s.log_keyframe * 1j),
        r"shape \(64, 64\) and type complex128,",
    ),
    "flow raises": (flow_of(raises), f"flow, method '{RAISED}"),
    "a library raises": (flow_of(raises_elsewhere), rf"raised LinAlgError at {__file__}:\d+: Sing"),
    "two lines": (flow_of(lines), "raised RuntimeError at .*: two lines$"),
    "bare flow": (flow_of((1.0, 2.0)), "returned a tuple, expected a tasks.flow.FlowEstimate$"),
    "flow in 3d": (flow_of(FlowEstimate(np.zeros(3))), r"flow is an array of shape \(3,\) and"),
    "worded flow": (flow_of(FlowEstimate("up")), "flow is a str, expected two numbers$"),
    "no reason": (flow_of(FlowEstimate(np.zeros(2), None)), "returned None as failure, expected"),
    "path raises": (path_of(raises), f"tracking, method '{RAISED}"),
    "bare path": (path_of(lambda s: s.initial), "returned a Trajectory, expected a tasks.tracking"),
    "path of poses": (path_of(TrackingEstimate(np.eye(4))), r"path is an array of shape \(4, 4\)"),
    "short path": (path_of(short_path), "a path of 0.001 s, expected a path of at least 0.014 s$"),
    "video takes nothing": (Unmade, "video, method .* raised TypeError .*positional argument"),
    "video is not pushed": (Deaf, "video, method .* raised TypeError .*not callable"),
    "wide video": (Wide, r"array of shape \(32, 64\) and type float64, expected an array of"),
}


def tiny_study(scene_folder):
    return Study(
        name="tiny",
        scenes=(str(scene_folder),),
        render=Render(resolution=64, spp=1, max_displacement_px=2.0, samples=2),
        simulate=Simulate(widths=(64, 32), cutoffs_hz=(math.inf, 50.0), speeds=(1.0,)),
        evaluate=only(),
    )


@pytest.mark.parametrize(("method", "said"), WRONG.values(), ids=WRONG)
def test_a_wrong_method_ends_the_study_on_its_first_sample(
    scene_folder, tmp_path, monkeypatch, method, said
):
    """Promise: one line with the method's name and the finding, after one sensor and one clip."""
    monkeypatch.setitem(globals(), "method", method)
    study = with_method(tiny_study(scene_folder), f"{HERE}:method")
    computed = []

    def compute(queued, on_progress):
        computed.append(queued.job)
        return real(queued, on_progress)

    real = scheduler.compute_job
    monkeypatch.setattr(scheduler, "compute_job", compute)
    with pytest.raises(MethodError, match=said) as refused:
        run_study(study, tmp_path / "run")
    assert "\n" not in str(refused.value)
    assert f"method '{HERE}:method': " in str(refused.value)
    (job,) = computed
    assert (job.simulate.widths, job.simulate.cutoffs_hz) == ((32,), (math.inf,))
    assert not (tmp_path / "run").exists()


def test_the_traceback_of_what_a_method_raised_is_kept(scene_folder, tmp_path, monkeypatch):
    """Promise: in Python the method's own error is the cause, with its full traceback."""
    monkeypatch.setitem(globals(), "method", flow_of(raises))
    study = with_method(tiny_study(scene_folder), f"{HERE}:method")
    with pytest.raises(MethodError) as refused:
        run_study(study, tmp_path / "run")
    cause = refused.value.__cause__
    assert isinstance(cause, KeyError)
    assert [frame.name for frame in traceback.extract_tb(cause.__traceback__)][-1] == "raises"


NOT_FINITE = {
    "reconstruction": (image_of(one_pixel_is_nan),),
    "flow": (
        flow_of(FlowEstimate(np.array([1.0, np.nan]))),
        flow_of(FlowEstimate(np.array([1.0, np.inf]))),
        flow_of(FlowEstimate(np.array([1.0, 1e300]))),
    ),
    "tracking": (path_of(not_finite_path),),
    "video": (NotFiniteVideo,),
}


def test_what_is_not_finite_is_a_failure(scene_folder, tmp_path, monkeypatch):
    """Promise: a failed method scores like doing nothing; the report counts it with its reason."""
    own = {}
    for task, methods in NOT_FINITE.items():
        for i, method in enumerate(methods):
            monkeypatch.setitem(globals(), f"{task}_{i}", method)
        own[task] = tuple(f"{HERE}:{task}_{i}" for i in range(len(methods)))
    study = replace(
        tiny_study(scene_folder),
        evaluate=Evaluate(
            reconstruction=Reconstruction(methods=("no_events", *own["reconstruction"])),
            flow=Flow(methods=("initial_flow", *own["flow"]), features=2),
            tracking=Tracking(methods=("initial_path", *own["tracking"])),
            video=Video(methods=("blank", *own["video"]), duration_s=0.1, run_in_s=0.05),
        ),
    )
    rows = run_study(study, tmp_path / "run")
    reasons = {"flow": "the flow", "tracking": "the path"}
    for task, names in own.items():
        mine = [row for row in rows if row.method in names]
        nothing = [row for row in rows if row.task == task and ":" not in row.method]
        assert len(mine) == len(names) * len(nothing) > 0
        assert {row.failure for row in mine} == {f"{reasons.get(task, 'the image')} is not finite"}
        for name in names:
            assert [row.value for row in mine if row.method == name] == [r.value for r in nothing]
    assert f"{HERE}:flow_0" in page_of(tmp_path / "run")


def overwritten(sample):
    for one in fields(sample):
        if isinstance(array := getattr(sample, one.name), np.ndarray):
            array[...] = 1
    return sample


def test_a_sample_in_a_sample_is_copied_too():
    """Promise: events of two windows and paths, with arrays of their own, stay as they are."""
    x = np.array([0, 1], np.uint16)
    events = Events(np.array([10, 20]), x, x, np.array([1, -1], np.int8), width=64, height=64)
    path = path_through([0.0, 1.0], np.tile(np.eye(4), (2, 1, 1)))
    controls = path.controls.copy()

    @dataclass(frozen=True)
    class Sample:
        before: Events
        initial: Trajectory

    def changes(sample):
        sample.before.t_us[:] = 0
        sample.initial.controls[:, 0, 3] += 1.0
        return sample

    changed, _ = ask("tracking", f"{HERE}:changes", changes, Sample(events, path))
    assert changed.before.t_us.tolist() == [0, 0]
    assert events.t_us.tolist() == [10, 20]
    np.testing.assert_array_equal(path.controls, controls)
    moved, still = (TrackingEstimate(one) for one in (changed.initial, replace(path)))
    assert failure_of(moved, path, 1000.0, 10.0) == "ended far off"
    assert failure_of(still, path, 10.0, 10.0) == ""


@pytest.mark.parametrize("used_by", ["the scorer", "the method"])
def test_a_path_changed_in_place_is_scored_as_it_then_is(used_by):
    """Promise: control poses that a method changes in place are those of the scored path, also if
    poses of the path were computed before."""
    controls = np.tile(np.eye(4), (10, 1, 1))
    controls[:, 0, 3] = 0.002 * np.arange(-1.0, 9.0)
    initial = Trajectory(0.002 * np.arange(-1.0, 9.0), controls)

    def changes(path):
        if used_by == "the method":
            path.pose(0.005)
        path.controls[5, 0, 3] += 1.0
        return TrackingEstimate(path)

    if used_by == "the scorer":
        initial.pose(0.005)
    answer, _ = ask("tracking", f"{HERE}:changes", changes, initial)
    found = path_answer("changes", SimpleNamespace(initial=initial), answer).path
    controls[5, 0, 3] += 1.0
    t_s = np.linspace(0.0, 0.014, 50)
    np.testing.assert_array_equal(found.pose(t_s), Trajectory(initial.knots_s, controls).pose(t_s))


class LatePath(Trajectory):
    """A path with an attribute that is no field."""


def test_an_own_path_keeps_what_it_has():
    """Promise: attributes of a method's own class of paths are those of the scored path."""
    path = LatePath(0.002 * np.arange(-1.0, 9.0), np.tile(np.eye(4), (10, 1, 1)))
    object.__setattr__(path, "late_s", 0.003)
    found = path_answer("own", SimpleNamespace(initial=path), TrackingEstimate(path)).path
    assert (type(found), found.late_s) == (LatePath, 0.003)


class Overwriting(Blank):
    def push(self, events: Events):
        for column in events.columns:
            column[...] = 1


@pytest.mark.slow
def test_a_method_may_change_what_it_gets(scene_folder, tmp_path, monkeypatch):
    """Promise: a method that changes its sample in place changes no score of another method, of the
    baseline or of another sensor."""
    own = {
        "reconstruction": image_of(lambda sample: overwritten(sample).log_keyframe),
        "flow": flow_of(lambda sample: FlowEstimate(overwritten(sample).initial)),
        "tracking": path_of(lambda sample: TrackingEstimate(overwritten(sample).initial)),
        "video": Overwriting,
    }
    for task, method in own.items():
        monkeypatch.setitem(globals(), f"overwriting_{task}", method)
    video = {"duration_s": 0.1, "run_in_s": 0.05}

    def rows_with(out, named):
        evaluate = Evaluate(
            reconstruction=Reconstruction(methods=(*named("reconstruction"), "event_integration")),
            flow=Flow(methods=(*named("flow"), "contrast_maximization"), features=2),
            tracking=Tracking(methods=(*named("tracking"), "photometric_tracking")),
            video=Video(methods=(*named("video"), "high_pass_filter"), **video),
        )
        study = replace(tiny_study(scene_folder), evaluate=evaluate)
        return [row for row in run_study(study, tmp_path / out) if ":" not in row.method]

    found = rows_with("with", lambda task: [f"{HERE}:overwriting_{task}"])
    assert found == rows_with("without", lambda task: [])


def test_a_method_of_another_task_is_refused_before_anything_is_rendered(
    eres, scene_folder, tmp_path, monkeypatch
):
    """Promise: the annotation tells the task; one line names both tasks, and no files remain."""
    monkeypatch.setattr(scheduler, "compute_job", None)
    monkeypatch.setitem(globals(), "function", image_of(None))
    for task, name, found in (
        ("flow", "function", "found a function of a ReconstructionSample, which is for reconstruc"),
        ("tracking", "Blank", "found a class, which is for video, expected a function of a Track"),
        ("video", "function", "which is for reconstruction, expected a class"),
    ):
        toml = tmp_path / "my.toml"
        toml.write_text(
            f'scenes = ["{scene_folder}"]\n[evaluate.{task}]\nmethods = ["{HERE}:{name}"]\n'
        )
        code, _, err = eres("study", toml, "--out", tmp_path / "run")
        assert (code, len(err.splitlines())) == (1, 1)
        assert err.startswith(f"error: {task}, method '{HERE}:{name}': found ")
        assert found in err
    assert [file.name for file in tmp_path.iterdir()] == ["my.toml"]


def test_evaluate_says_whose_mistake_it_is(eres, scene_folder, tmp_path, monkeypatch):
    """Promise: one line with the place in the method's file, and exit code 1, here too."""
    (tmp_path / "hasty.py").write_text(
        "from tasks.flow import FlowSample\n\ndef estimate(sample: FlowSample):\n    return 1 / 0\n"
    )
    monkeypatch.chdir(tmp_path)
    args = ("--resolution", 64, "--spp", 1, "--samples", 1)
    assert eres("render", scene_folder, "--out", tmp_path / "clips", *args)[0] == 0
    args = ("--task", "flow", "--method", "hasty:estimate", "initial_flow", "--resolution", 32)
    code, out, err = eres("evaluate", tmp_path / "clips" / "clip_000", *args)
    assert (code, len(out.splitlines()), len(err.splitlines())) == (1, 1, 1)
    where = tmp_path / "hasty.py"
    assert f"method 'hasty:estimate': raised ZeroDivisionError at {where}:4: division" in err


def test_every_new_method_is_tried_once_where_it_can_work(scene_folder):
    """Promise: trials use tracking on the first planar scene, video without its stretch, and no
    method that a job has tried."""
    study = replace(
        preset("quick"),
        scenes=("room", "carpet"),
        evaluate=Evaluate(
            reconstruction=Reconstruction(methods=("event_integration", "mine:recon")),
            flow=Flow(methods=(), fast_methods=("mine:flow",)),
            tracking=Tracking(methods=("mine:track", "initial_path")),
            video=Video(methods=("mine:video",)),
        ),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tasks.study.run.jobs.code_of", lambda names: {})
        work = [job for name in study.scenes for job in jobs_of(study, load_scene(name))]
        room, carpet = trials(study, work, [])
        assert (room.scene.name, room.clip) == ("room", work[0].clip)
        tried = {task: settings.methods for task, settings in room.evaluate.items()}
        assert tried == {
            "reconstruction": ("mine:recon",),
            "flow": ("mine:flow",),
            "video": ("mine:video",),
        }
        assert (carpet.scene.name, *carpet.evaluate) == ("carpet", "tracking")
        assert carpet.evaluate["tracking"].methods == ("mine:track",)
        assert trials(study, work, work) == []
        films = [job for job in work if "video" in job.evaluate]
        (film,) = trials(study, films, [job for job in work if job not in films])
        assert film.clip.t_window_end_s == pytest.approx(study.render.window_s)
        assert film.frames_decided_by != films[0].frames_decided_by


def test_own_methods_are_tried_on_clips_like_theirs(scene_folder):
    """Promise: a dense-flow method's trial has the earlier window, and a tracking method's the
    longer one, as their jobs have them."""
    quick = preset("quick")
    study = replace(
        quick,
        evaluate=Evaluate(
            flow=quick.evaluate["flow"],
            tracking=Tracking(methods=("mine:track",), tracking_window_s=0.072),
            dense_flow=DenseFlow(methods=("mine:dense", "zero_flow")),
        ),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tasks.study.run.jobs.code_of", lambda names: {})
        work = jobs_of(study, load_scene("carpet"))
        tried = {task: one.clip for one in trials(study, work, []) for task in one.evaluate}
        scored = {task: job.clip for job in reversed(work) for task in job.evaluate}
    assert tried == {task: scored[task] for task in ("tracking", "dense_flow")}
    dense = tried["dense_flow"]
    assert dense.t_window_start_s - dense.t_start_s > study.render.window_s


class _Untyped:
    def __call__(self, sample):
        return sample


untyped = _Untyped()


def of_unknown(sample: "NoSuchSample"):  # noqa: F821
    return sample


@pytest.mark.parametrize("name", ["untyped", "of_unknown"])
def test_a_method_whose_task_cannot_be_told_is_refused(name):
    """Promise: also if its annotations are missing or cannot be resolved."""
    with pytest.raises(TaskError, match="as the type of its first parameter, expected one of Rec"):
        task_of(f"{HERE}:{name}")


def test_a_module_that_raises_when_imported_is_named(tmp_path, monkeypatch):
    """Promise: any exception, also a syntax error, causes one line with the method's name."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "unfinished.py").write_text("def estimate(sample:\n")
    (tmp_path / "unlucky.py").write_text("1 / 0\n")
    for module, said in (("unfinished", "SyntaxError: "), ("unlucky", "ZeroDivisionError: div")):
        with pytest.raises(TaskError, match=f"'{module}:estimate': cannot be imported: {said}"):
            task_of(f"{module}:estimate")
