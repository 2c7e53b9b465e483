"""Pose tracking: the spline and its derivatives, the metric, and a synthetic case with known
path."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import Rotation

from eres_render import Camera, Distortion, Plane, Trajectory, path_through
from sensor import Events, SensorModel, simulate
from tasks.errors import MethodError, TaskError
from tasks.evaluation.rendered_clip import RenderedClip
from tasks.evaluation.scorers.tracking import TrackingScorer
from tasks.evaluation.sensor_setting import Setting
from tasks.evaluation.settings import Tracking
from tasks.methods import load_method
from tasks.methods import photometric_tracking as eppt
from tasks.methods.baselines import initial_path
from tasks.methods.photometric_tracking import accumulation, search, tracker
from tasks.methods.photometric_tracking.residuals import join_events, problem_of
from tasks.numerics import bicubic, cumulative_spline
from tasks.tracking import (
    TrackingEstimate,
    TrackingSample,
    failure_of,
    path_at,
    perturbed,
    position_error_mm,
    succeeded,
    tracking_sample,
)

WIDTH = 480
C = 0.2
SPEED_MPS = 0.9
DURATION_S = 0.014
START_US = 2000  # of the path; there are events before it, and after its end
FLOOR = Plane((0.0, 0.0, 1.0), 0.0)
CAMERA = Camera(WIDTH, WIDTH, math.radians(60))


def band_limited(seed, size):
    """Return a periodic texture with no detail below 4 of its texels."""
    rng = np.random.default_rng(seed)
    fy, fx = np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size), indexing="ij")
    radius = np.hypot(fx, fy)
    keep = np.where((radius > 0) & (radius < 0.25), 1 / np.maximum(radius, 1 / size), 0)
    image = np.fft.ifft2(np.fft.fft2(rng.standard_normal((size, size))) * keep).real
    return 0.7 * image / image.std()


def moving_camera(seed):
    """Return the pose over time: 1 m above the floor, at 0.9 m/s, accelerating and turning."""
    rng = np.random.default_rng(seed)
    t = np.linspace(-0.01, 0.04, 6)
    way = rng.normal(size=3) * [1.0, 1.0, 0.3]
    T = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (len(t), 1, 1))
    turn = rng.normal(0.0, 0.05, 3) + np.outer(t, [0.3, -0.2, 0.4])
    T[:, :3, :3] = Rotation.from_euler("xyz", turn).as_matrix() @ T[:, :3, :3]
    T[:, :3, 3] = 0.02, -0.03, 1.0
    T[:, :3, 3] += np.outer(t, SPEED_MPS * way / np.linalg.norm(way))
    T[:, :3, 3] += 0.5 * np.outer(t**2, rng.normal(0.0, 5.0, 3))
    path = path_through(t, T)
    return lambda t_s: path.pose(np.asarray(t_s) - t[0])


def made_up(seed):
    """Simulate an exact sensor above a known texture: (events, log image at 0, pose over time)."""
    pose = moving_camera(seed)
    texel_m = 1.0 / CAMERA.focal_px
    texture = ndimage.spline_filter(band_limited(seed, 1024), mode="grid-wrap")
    rays = CAMERA.rays(CAMERA.centers())
    t_s = np.arange(-2, 17) * 1e-3
    log_frames = np.empty((len(t_s), WIDTH, WIDTH))
    for image, T in zip(log_frames, pose(t_s), strict=True):
        points = FLOOR.intersect(T[:3, 3], rays @ T[:3, :3].T)
        at = points[:, 1::-1].T / texel_m
        image.ravel()[:] = ndimage.map_coordinates(texture, at, prefilter=False, mode="grid-wrap")
    model = SensorModel(width=WIDTH, height=WIDTH, contrast_threshold=C, dark_level=0.0)
    events = simulate(np.exp(log_frames), t_s - t_s[0], model)
    return events, log_frames[2], pose


@pytest.fixture(scope="module")
def scene():
    return made_up(3)


def sample_of(scene, sigma_m, trial, **options):
    events, log_image, pose = scene
    truth = path_at(pose, 0.0)
    initial = perturbed(truth, sigma_m, trial)
    options = {"max_events": 60_000} | options
    seen = {"log_image": log_image, "contrast_threshold": C, "camera": CAMERA, "plane": FLOOR}
    path = {"T_0": pose(0.0), "initial": initial, "initial_sigma_m": sigma_m}
    return tracking_sample(events, START_US, **seen, **path, **options)


def error_mm(path, scene):
    return position_error_mm(path, scene[2], 0.0, DURATION_S)


def winding_path():
    """Return ten control poses that turn too far for any small-angle approximation."""
    rng = np.random.default_rng(0)
    controls = np.tile(np.eye(4), (10, 1, 1))
    controls[:, :3, :3] = Rotation.from_rotvec(rng.normal(0.0, 0.8, (10, 3))).as_matrix()
    controls[:, :3, 3] = rng.normal(size=(10, 3))
    return Trajectory(0.002 * np.arange(-1, 9), controls)


def spline_at(path, t_us, q=(), w=()):
    """Return a path's R(t) and p(t), and the derivatives of q . p(t) + w . turn, (N, 10, 6)."""
    R, p = (np.ascontiguousarray(path.controls[:, :3, k]) for k in (slice(3), 3))
    turns = Rotation.from_matrix(R)
    omega = (turns[:-1].inv() * turns[1:]).as_rotvec()
    T, J = np.empty((len(t_us), 3, 4)), np.zeros((len(t_us), 10, 6))
    for s in range(7):
        segment = cumulative_spline.segment_after(R, p, omega, s)
        these = np.flatnonzero(t_us // 2000 == s)
        n = len(these)
        weights, out = np.empty((12, n)), np.empty((24, n))
        cumulative_spline.weigh(n, t_us[these] / 2000 - s, segment, weights)
        for axis in range(3):
            v = np.tile(np.eye(3)[axis][:, None], n)
            cumulative_spline.turn(n, weights, segment, v)
            T[these, :, axis] = v.T
        for k, row in enumerate(these):
            T[row, :, 3] = cumulative_spline.position(weights, k, segment)
        if len(q):
            in_lanes = (np.tile(np.array(v)[:, None], n) for v in (q, w))
            cumulative_spline.pull_back(n, weights, segment, *in_lanes, out)
            J[these, s : s + 4] = out.T.reshape(n, 4, 6)
    return T, J


@pytest.mark.parametrize("seed", range(3))
def test_recovers_a_known_path(scene, seed):
    """Physics: exact events of a band-limited plane at 1 m give the path to 0.5 mm."""
    sample = sample_of(scene, 0.002, seed)
    answer = eppt.estimate(sample)
    start, end = error_mm(sample.initial, scene), error_mm(answer.path, scene)
    assert not answer.failure
    assert start > 1.0
    assert end < 0.5
    assert succeeded(answer, end, start)
    assert 0 < answer.diagnostics.outside < 0.05 * answer.diagnostics.residuals


def test_coarse_to_fine_reaches_ten_pixels(scene):
    """Promise: blurring finds the path from 20 mm off, 11 px, where the sharp view alone fails."""
    sample = sample_of(scene, 0.02, 0, max_events=20_000)
    assert error_mm(eppt.estimate(sample).path, scene) < 0.5
    sharp = eppt.estimate(replace(sample, initial_sigma_m=0.0))
    assert error_mm(sharp.path, scene) > 5.0


@pytest.mark.slow
def test_recovers_a_known_path_in_every_trial():
    """Physics: the same for 20 trials on each of two textures and motions."""
    for scene_seed in (4, 5):
        scene = made_up(scene_seed)
        for seed in range(20):
            answer = eppt.estimate(sample_of(scene, 0.002, seed))
            assert not answer.failure
            assert error_mm(answer.path, scene) < 0.5


def test_spline_is_that_of_the_trajectories():
    """Promise: the spline agrees with `eres_render.Trajectory` at every microsecond."""
    path, t_us = winding_path(), np.arange(14_000)
    T, _ = spline_at(path, t_us)
    np.testing.assert_allclose(T, path.pose(1e-6 * t_us)[:, :3], atol=1e-12)


def test_spline_derivatives_are_those_of_its_values():
    """Promise: the pose's derivatives by each control pose agree with differences."""
    path, h = winding_path(), 1e-6
    t_us = np.array([0, 700, 3999, 4000, 9123, 13_999])
    q, w = np.random.default_rng(1).normal(size=(2, 3))
    _, J = spline_at(path, t_us, q, w)
    numeric = np.empty((len(t_us), 60))
    for i in range(60):
        step = np.zeros(60)
        step[i] = h
        there, back = (
            search.moved(path, s.reshape(10, 6)).pose(1e-6 * t_us) for s in (step, -step)
        )
        turn = Rotation.from_matrix(there[:, :3, :3] @ back[:, :3, :3].transpose(0, 2, 1))
        moved = (there - back)[:, :3, 3]
        numeric[:, i] = (moved @ q + turn.as_rotvec() @ w) / (2 * h)
    np.testing.assert_allclose(J.reshape(-1, 60), numeric, atol=1e-8)


def sum_at(sample, path, huber_in_c, joined=1):
    """Return cost, gradient, Hessian and the number of events outside, for a path."""
    problem = join_events(problem_of(sample, 14_000)[0], joined)
    (level,) = eppt.pyramid(sample.log_image, sample.camera.K, 0.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(accumulation, "HUBER_IN_C", huber_in_c)
        return accumulation.accumulate(problem, level, path)


@pytest.mark.parametrize("huber_in_c", [0.5, 1e6])
def test_gradient_is_that_of_the_cost(scene, huber_in_c):
    """Promise: the gradient in all 60 unknowns agrees with differences of the cost."""
    sample, h = sample_of(scene, 0.002, 0, max_events=300), 1e-7
    path = sample.initial
    gradient = sum_at(sample, path, huber_in_c).gradient
    numeric = np.empty(60)
    for i in range(60):
        step = np.zeros(60)
        step[i] = h
        there, back = (
            sum_at(sample, search.moved(path, s.reshape(10, 6)), huber_in_c).cost
            for s in (step, -step)
        )
        numeric[i] = (there - back) / (2 * h)
    scale = np.abs(gradient).max()
    assert scale > 0
    np.testing.assert_allclose(gradient, numeric, atol=1e-5 * scale)


def pair_of(sample, k):
    """Return a sample of one event and the one before it at its pixel."""
    names = ("x", "y", "t_us", "t_before_us", "p")
    pair = replace(sample, **{name: getattr(sample, name)[k - 1 : k + 1].copy() for name in names})
    pair.t_before_us[0] = -1
    return pair


@pytest.mark.parametrize(("segments_apart", "unknowns"), [(0, 24), (2, 36), (5, 48)])
def test_hessian_of_one_residual_is_the_square_of_its_jacobian(scene, segments_apart, unknowns):
    """Promise: for one residual, J^T J is g g^T / r^2, since g = J r and the cost is r^2 / 2."""
    sample = sample_of(scene, 0.002, 0)
    apart = sample.t_us // 2000 - sample.t_before_us // 2000
    in_view = np.abs(sample.y - 0.5 * WIDTH) < 0.4 * WIDTH
    alike = (sample.t_before_us >= 0) & (apart == segments_apart) & in_view
    pair = pair_of(sample, int(np.flatnonzero(alike)[0]))
    total = sum_at(pair, pair.initial, 1e6)
    expected = np.outer(total.gradient, total.gradient) / (2 * total.cost)
    assert np.count_nonzero(total.gradient) == unknowns
    np.testing.assert_allclose(total.hessian, expected, atol=1e-9 * np.abs(expected).max())


def test_sums_are_those_of_each_residual_alone(scene):
    """Promise: how residuals are grouped, by segments and by 64 and 4, changes no sum."""
    sample = sample_of(scene, 0.002, 0, max_events=1500)
    later = np.flatnonzero(sample.t_before_us >= 0)
    alone = [sum_at(pair_of(sample, k), sample.initial, 0.5) for k in later]
    together = sum_at(sample, sample.initial, 0.5)
    groups = np.unique([sample.t_us[later] // 2000, sample.t_before_us[later] // 2000], axis=1)
    assert groups.shape[1] > 20
    assert len(later) > 64 * groups.shape[1] / 4
    assert together.outside > 0
    for field, value in together._asdict().items():
        expected = sum(getattr(one, field) for one in alone)
        np.testing.assert_allclose(value, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_all_directions_are_seen(scene):
    """Physics: relative to the reference view of a texture every pose is determined, so none is
    fixed."""
    sample = sample_of(scene, 0.0, 0)
    hessian = sum_at(sample, sample.initial, 0.5).hessian
    scale = 1 / np.sqrt(np.diag(hessian))
    eigenvalues = np.linalg.eigvalsh(scale[:, None] * hessian * scale)
    assert eigenvalues[0] > 1e-6 * eigenvalues[-1]


def test_normal_equations_are_solved_as_lapack_does():
    """Oracle: LAPACK, within the condition number; the solver reports a matrix that is not positive
    definite."""
    rng = np.random.default_rng(0)
    for n in (1, 6, 60, 150):
        J = rng.standard_normal((3 * n, n))
        A, b = J.T @ J, rng.standard_normal(n)
        x, solved = eppt.cholesky_solve(A.copy(), b.copy())
        assert solved
        np.testing.assert_allclose(x, np.linalg.solve(A, b), rtol=1e-9, atol=1e-12)
    for diagonal in ([1.0, -1.0], [1.0, 0.0], [np.nan, 1.0], [1.0, np.inf]):
        assert not eppt.cholesky_solve(np.diag(diagonal), np.ones(2))[1]
    assert not eppt.cholesky_solve(np.array([[1.0, 2.0], [2.0, 1.0]]), np.ones(2))[1]


def test_the_gain_of_a_blurred_view_is_that_of_a_regression():
    """Oracle: the fine on the coarse gradient, by NumPy's differences."""
    fine = np.ascontiguousarray(band_limited(3, 96)[:, :80])
    coarse = 0.5 * ndimage.gaussian_filter(fine, 1.5)
    slopes = [
        np.concatenate([d.ravel() for d in (np.diff(i, axis=0), np.diff(i, axis=1).T)])
        for i in (coarse, fine)
    ]
    expected = np.sum(slopes[0] * slopes[1]) / np.sum(slopes[0] ** 2)
    assert expected > 1.5
    assert eppt.gain(fine, coarse) == pytest.approx(expected, rel=1e-12)
    assert eppt.gain(fine, np.zeros((48, 40))) == 1.0


def test_looking_away_is_counted_and_does_not_pay(scene):
    """Promise: events outside the reference view have no gradient, and cost rho(p C), as in
    a flat view, also where p is a sum of several polarities."""
    sample = sample_of(scene, 0.0, 0, max_events=2000)
    away = np.zeros((10, 6))
    away[:, 0] = 5.0
    total = sum_at(sample, search.moved(sample.initial, away), 0.5)
    residuals = np.count_nonzero(sample.t_before_us >= 0)
    assert total.outside == residuals
    assert total.cost == pytest.approx(residuals * 0.5 * C * (C - 0.25 * C))
    assert not total.gradient.any()
    flat = replace(sample, log_image=np.zeros_like(sample.log_image))
    for joined in (1, 2, 5):
        outside = sum_at(sample, search.moved(sample.initial, away), 0.5, joined)
        inside = sum_at(flat, sample.initial, 0.5, joined)
        assert inside.outside < 0.05 * outside.outside
        assert outside.cost == pytest.approx(inside.cost, rel=1e-12)
    below = np.zeros((10, 6))
    below[:, 2] = -2.0  # beyond the plane
    assert sum_at(sample, search.moved(sample.initial, below), 0.5).outside == residuals


def test_a_delay_is_told_apart_by_the_reference_view(scene):
    """Physics: events late by d fit the path moved by d; its passage through T_0 determines d."""
    events, log_image, pose = scene
    late_us = 1000
    late = Events(events.t_us + late_us, events.x, events.y, events.p, WIDTH, WIDTH, events.model)
    sample = sample_of((late, log_image, pose), 0.002, 0, max_delay_us=2000)
    plain, compensated = eppt.estimate(sample), eppt.estimate_with_delay(sample)
    assert error_mm(plain.path, scene) == pytest.approx(1e-3 * late_us * SPEED_MPS, rel=0.2)
    assert not compensated.failure
    assert compensated.diagnostics.delay_us == pytest.approx(late_us, abs=150)
    assert error_mm(compensated.path, scene) < 0.2
    with pytest.raises(TaskError, match="max_delay_us"):
        eppt.estimate_with_delay(sample_of(scene, 0.002, 0))
    for most_us in (500, 30, 505):  # 1e6 times the seconds of the second is below it
        bounded = eppt.estimate_with_delay(replace(sample, max_delay_us=most_us))
        assert "bound" in bounded.failure
        assert bounded.path is sample.initial
        assert bounded.diagnostics.delay_us == most_us


def test_a_sample_that_changed_in_place_is_searched_again(scene):
    """Promise: an answer is that of the sample's arrays as they are, whatever was asked before."""
    sample = sample_of(scene, 0.002, 0, max_events=2000)
    eppt.estimate(sample)
    sample.p[:] *= -1
    again, fresh = eppt.estimate(sample), eppt.estimate(replace(sample))
    assert again.diagnostics == fresh.diagnostics
    np.testing.assert_array_equal(again.path.controls, fresh.path.controls)


def test_both_methods_share_one_coarse_search(scene, monkeypatch):
    """Promise: the second method on a sample does not repeat the search of the coarse levels."""
    starts = []
    counted = tracker.problem_of
    monkeypatch.setattr(
        tracker, "problem_of", lambda sample, us: starts.append(us) or counted(sample, us)
    )
    sample = sample_of(scene, 0.002, 0, max_events=2000, max_delay_us=2000)
    eppt.estimate(sample)
    eppt.estimate_with_delay(sample)
    assert len(starts) == 2  # the search of all of the late path is the second's own


def test_a_random_part_keeps_pixels_whole(scene):
    """Promise: a kept pixel has all its events, so each event has its true predecessor."""
    whole = sample_of(scene, 0.002, 0, max_events=None)
    part = sample_of(scene, 0.002, 0, max_events=50_000)
    again = sample_of(scene, 0.002, 0, max_events=50_000)
    other = sample_of(scene, 0.002, 0, max_events=50_000, seed=1)
    assert 49_000 < len(part.t_us) <= 50_000
    np.testing.assert_array_equal(part.x, again.x)
    assert not np.array_equal(part.x[:100], other.x[:100])
    events = scene[0].between(START_US, START_US + 14_000)
    assert len(whole.t_us) == len(events)
    for sample in (whole, part):
        pixel = sample.y.astype(int) * WIDTH + sample.x
        assert np.all(np.diff(pixel) >= 0)
        same = np.diff(pixel, prepend=-1) == 0
        np.testing.assert_array_equal(sample.t_before_us >= 0, same)
        np.testing.assert_array_equal(sample.t_before_us[same], sample.t_us[:-1][same[1:]])
    everywhere = np.bincount(events.y.astype(int) * WIDTH + events.x, minlength=WIDTH**2)
    kept = np.bincount(part.y.astype(int) * WIDTH + part.x, minlength=WIDTH**2)
    np.testing.assert_array_equal(kept[kept > 0], everywhere[kept > 0])


_SEEN: list[TrackingSample] = []


def seen(sample: TrackingSample) -> TrackingEstimate:
    """Keep the sample, and fail."""
    _SEEN.append(sample)
    raise LookupError


def kept(sample: TrackingSample) -> TrackingEstimate:
    """Keep the sample, and its initial path."""
    _SEEN.append(sample)
    return TrackingEstimate(sample.initial)


def scorer_of(task, scene, name="carpet"):
    """Return the scorer of a task on a made-up clip, which lasts 28 ms."""
    _, log_image, pose = scene
    sequence = SimpleNamespace(
        window_s=(0.002, 0.03),
        t_s=np.array([0.0, 0.04]),
        manifest=SimpleNamespace(clip=0, scene=name),
    )
    path = SimpleNamespace(pose=pose, duration_s=0.04)
    truth = SimpleNamespace(trajectory=path, plane=FLOOR)
    reference = SimpleNamespace(
        sequence=sequence, truth=truth, camera=lambda *_: CAMERA, log_image=lambda _: log_image
    )
    model = SensorModel(width=WIDTH, height=WIDTH, contrast_threshold=C)
    setting = Setting(model, 1.0, START_US, START_US + 28_000)
    return TrackingScorer(RenderedClip(reference, setting), task)


@pytest.mark.parametrize("count", [1000, 150_000, 2_000_000])
def test_a_scored_sample_is_that_of_all_events(scene, count):
    """Promise: the scorer forgets no event that the sample has: it has as many as it may, be there
    one event at hundreds of pixels or many at each, and they are those of a choice among all."""
    _, log_image, _ = scene
    task = Tracking(methods=(f"{__name__}:seen",), max_events=1000, max_delay_us=10_000)
    rng = np.random.default_rng(0)
    t_us = np.sort(rng.integers(START_US, START_US + 24_000, count))
    model = SensorModel(width=WIDTH, height=WIDTH, contrast_threshold=C)
    x, y = rng.integers(0, WIDTH, (2, count), np.uint16)
    events = Events(t_us, x, y, np.ones(count, np.int8), WIDTH, WIDTH, model)
    scorer = scorer_of(task, scene)
    for start_us in range(0, START_US + 30_000, 3000):
        scorer.push(events.between(start_us, start_us + 3000))
    with pytest.raises(MethodError, match="raised LookupError"):
        list(scorer.scores())
    found = _SEEN.pop()
    most = round(1000 * 24 / 14)
    among_all = tracking_sample(
        *(events, START_US, log_image, C, CAMERA, FLOOR, found.T_0, found.initial, 0.02),
        max_events=most,
        max_delay_us=10_000,
        seed=int(np.random.SeedSequence([task.seed, 0]).generate_state(1)[0]),
    )
    assert min(count, most) - count / WIDTH**2 - 10 < len(found.t_us) <= most
    for name in ("x", "y", "t_us", "t_before_us", "p"):
        np.testing.assert_array_equal(getattr(found, name), getattr(among_all, name))


def test_each_start_and_each_seed_of_a_scene_has_its_own_path(scene):
    """Promise: the starts of a sample are its items, the first one the same for any number; those
    of a scene with another seed differ from it, as those of "carpet" must not."""

    def starts(name, count):
        task = Tracking(methods=(f"{__name__}:kept",), starts=count)
        scorer = scorer_of(task, scene, name)
        scorer.push(scene[0])
        items = [score.item for score in scorer.scores()]
        assert items == list(range(count or 1))
        return [_SEEN.pop(0).initial.controls.tobytes() for _ in items]

    (first,) = starts("carpet", None)
    assert first == starts("carpet", 3)[0]
    every = [*starts("carpet", 3), *starts("carpet@1", 3), *starts("carpet@2", 3)]
    assert len(set(every)) == 9


def test_joined_events_add_up(scene):
    """Promise: joining keeps each pixel's sum of polarities, its first event and its last."""
    sample = sample_of(scene, 0.002, 0, max_events=20_000)
    problem, _ = problem_of(sample, 14_000)
    joined = join_events(problem, 4)
    assert joined.residuals < 0.6 * problem.residuals
    for p in (problem, joined):
        assert p.residuals == np.count_nonzero(p.events.t_before_us >= 0)

    def by_pixel(events, values):
        later = events.t_before_us >= 0
        pixel = events.y.astype(int) * WIDTH + events.x
        return np.bincount(pixel, np.where(later, values, 0), WIDTH**2)

    apart, together = problem.events, joined.events
    np.testing.assert_array_equal(by_pixel(apart, apart.p), by_pixel(together, together.p))
    np.testing.assert_array_equal(
        by_pixel(apart, apart.t_us - apart.t_before_us),
        by_pixel(together, together.t_us - together.t_before_us),
    )


def test_what_fails_keeps_the_initial_path_and_says_why(scene):
    """Promise: too few events or a search that diverges is a counted failure."""
    starved = sample_of(scene, 0.002, 0, max_events=200)
    answer = eppt.estimate(starved)
    assert "events" in answer.failure
    assert answer.path is starved.initial
    assert answer.diagnostics is None
    astray = sample_of(scene, 0.002, 0)
    away = np.zeros((10, 6))
    away[:, 0] = 5.0
    astray = replace(astray, initial=search.moved(astray.initial, away))
    answer = eppt.estimate(astray)
    assert "left the reference view" in answer.failure
    assert answer.path is astray.initial
    assert not succeeded(answer, 1.0, 5.0)


def test_bad_input_is_refused(scene):
    """Promise: the error names samples that cannot be tracked."""
    events, log_image, pose = scene
    initial = path_at(pose, 0.0)
    good = {
        "log_image": log_image,
        "contrast_threshold": C,
        "camera": CAMERA,
        "plane": FLOOR,
        "T_0": pose(0.0),
        "initial": initial,
        "initial_sigma_m": 0.002,
    }
    for name, bad, message in (
        ("plane", None, "depth"),
        ("log_image", log_image[:-1], "log_image"),
        ("camera", Camera(320, 320, 1.0), "camera"),
        ("camera", Camera(8, 8, 1.0, distortion=Distortion(k1=-0.1)), "lens: found Distortion"),
        ("T_0", np.eye(3), "T_0"),
    ):
        with pytest.raises(TaskError, match=message):
            tracking_sample(events, START_US, **(good | {name: bad}))
    sample = tracking_sample(events, START_US, *good.values(), max_events=20_000)
    uneven = Trajectory(np.array([-0.001, 0.0, 0.002, 0.004, 0.006]), initial.controls[:5])
    with pytest.raises(TaskError, match="even intervals"):
        eppt.estimate(replace(sample, initial=uneven))


def test_the_error_is_the_mean_distance_and_the_baseline_keeps_it(scene):
    """Promise: a path moved by 3 mm is 3 mm off; doing nothing returns the initial path."""
    pose = scene[2]
    truth = path_at(pose, 0.0)
    controls = truth.controls.copy()
    controls[:, :3, 3] += [0.001, 0.002, 0.002]
    moved = Trajectory(truth.knots_s, controls)
    assert error_mm(moved, scene) == pytest.approx(3.0, abs=0.02)
    assert error_mm(truth, scene) < 0.02
    sample = sample_of(scene, 0.002, 0, max_events=2000)
    assert initial_path(sample).path is sample.initial
    assert load_method("tracking", "photometric_tracking") is eppt.estimate
    assert succeeded(TrackingEstimate(moved), 0.9, 2.0)
    assert not succeeded(TrackingEstimate(moved), 1.1, 2.0)


def test_a_path_that_stays_fails_only_if_the_method_says_so():
    """Promise: doing nothing is no failure; a path that moved and is not twice as good is one."""
    initial, moved = (perturbed(path_at(moving_camera(0), 0.0), 1e-3, k) for k in (0, 1))
    cases = (initial, "", 2.0), (initial, "no events", 2.0), (moved, "", 2.0), (moved, "", 0.9)
    found = [failure_of(TrackingEstimate(p, why), initial, mm, 2.0) for p, why, mm in cases]
    assert found == ["", "no events", "ended far off", ""]


@pytest.mark.slow
def test_the_optimum_is_that_of_ceres(scene):
    """Promise: Ceres, with independently written residuals, ends at the same path."""
    pyceres = pytest.importorskip("pyceres")
    sample = sample_of(scene, 0.0005, 0, max_events=6000)
    sample = replace(sample, initial_sigma_m=0.0)  # one level
    huber = 0.5 * C
    later = np.flatnonzero(sample.t_before_us >= 0)
    pixels = np.stack([sample.x, sample.y], axis=1)[later] + 0.5
    rays = CAMERA.rays(pixels)
    to_reference = np.linalg.inv(sample.T_0)
    inner = np.all((pixels > 20) & (pixels < WIDTH - 20), axis=1)

    def seen(path, t_us):
        T = path.pose(1e-6 * t_us)
        points = FLOOR.intersect(T[:, :3, 3], np.einsum("nij,nj->ni", T[:, :3, :3], rays))
        at = CAMERA.project(points @ to_reference[:3, :3].T + to_reference[:3, 3])
        out = np.empty((3, len(at)))
        bicubic.sample_all(sample.log_image, *at.T.copy(), out)
        return out[0]

    def residuals(step):
        """Residuals with squares that sum to twice the robust cost."""
        path = search.moved(sample.initial, step.reshape(10, 6))
        change = seen(path, sample.t_us[later]) - seen(path, sample.t_before_us[later])
        r = sample.p[later] * change - C
        size = np.abs(r)
        robust = np.where(size > huber, np.sqrt(np.maximum(huber * (2 * size - huber), 0)), size)
        return (np.sign(r) * robust)[inner]

    class Events60(pyceres.CostFunction):
        def __init__(self):
            super().__init__()
            self.set_num_residuals(int(inner.sum()))
            self.set_parameter_block_sizes([60])

        def Evaluate(self, parameters, out, jacobians):
            step = np.array(parameters[0])
            out[:] = residuals(step)
            if jacobians is not None:
                h = 1e-6
                J = np.empty((len(out), 60))
                for i in range(60):
                    e = np.zeros(60)
                    e[i] = h
                    J[:, i] = (residuals(step + e) - residuals(step - e)) / (2 * h)
                jacobians[0][:] = J.ravel()
            return True

    step = np.zeros(60)
    problem = pyceres.Problem()
    problem.add_residual_block(Events60(), None, [step])
    options = pyceres.SolverOptions()
    options.max_num_iterations = 60
    options.minimizer_progress_to_stdout = False
    options.function_tolerance = 1e-12
    summary = pyceres.SolverSummary()
    pyceres.solve(options, problem, summary)
    ceres = search.moved(sample.initial, step.reshape(10, 6))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "_CONVERGED_PX", 1e-6)
        patch.setattr(search, "_CONVERGED_NOISE", 0.0)
        names = ("x", "y", "t_us", "t_before_us", "p")
        kept = np.zeros(len(sample.t_us), bool)
        kept[later[inner]] = True
        kept[later[inner] - 1] = True
        ours = eppt.estimate(
            replace(sample, **{name: getattr(sample, name)[kept] for name in names})
        )
    assert not ours.failure
    assert error_mm(sample.initial, scene) > 0.3
    apart = np.linalg.norm(ours.path.controls[:, :3, 3] - ceres.controls[:, :3, 3], axis=1)
    assert 1e3 * apart.max() < 0.01
