"""The bundle adjustment finds the rig from corners, and says when it cannot."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eres_render import Camera, Distortion
from rig_corners import PAGE, Rig, davis346, gen4
from tasks.errors import RigError
from tasks.rig.bundle import CORNER_BIAS, LATENCY, SCALE, Corners, RigPose, solve
from tasks.rig.calibration import compare
from tasks.rig.slider import Slider

STROKE = 0.0, 0.2
ALL = LATENCY, SCALE, CORNER_BIAS


def sigma_ms(solution):
    """Return the standard deviation of the latency."""
    k = solution.names.index(LATENCY)
    return np.sqrt(solution.covariance[k, k])


def errors(rig, solution):
    return compare(solution.pose, rig.pose, STROKE)


def test_perfect_corners_give_the_truth():
    """Promise: without noise every unknown is found exactly, all eleven at once."""
    rig = Rig(0.436)
    corners = rig.corners(0.0, latency_ms=3.0, bias_px=-0.4, scale=1.002)
    solution = solve(corners, rig.slider, rig.camera, ALL)
    assert solution.latency_ms == pytest.approx(3.0, abs=1e-4)
    assert solution.corner_bias_px == pytest.approx(-0.4, abs=1e-4)
    assert solution.pose.scale == pytest.approx(1.002, abs=1e-6)
    found = errors(rig, replace(solution, pose=replace(solution.pose, scale=1.0)))
    assert found.image_px < 1e-3
    assert found.position_mm < 1e-3


def test_the_clock_may_count_from_1970():
    """Promise: latency is found on any clock; steps of the search are nanoseconds."""
    rig = Rig(0.436)
    corners = rig.corners(0.1, latency_ms=3.0)
    early = solve(corners, rig.slider, rig.camera, (LATENCY,))
    late_us = 1.6e15
    late = solve(
        replace(corners, t_us=corners.t_us + late_us),
        replace(rig.slider, t_us=rig.slider.t_us + late_us),
        rig.camera,
        (LATENCY,),
    )
    assert late.latency_ms == pytest.approx(early.latency_ms, abs=1e-3)
    assert sigma_ms(late) == pytest.approx(sigma_ms(early), rel=1e-3)


@pytest.mark.parametrize("turned_rad", [0.0, 1e-9, 1e-7, 0.3])
def test_small_turns_are_measured(turned_rad):
    """Physics: the angle between two rotations, also where its cosine is 1 but for rounding."""
    rig = Rig(0.436)
    turn = Rotation.from_rotvec([0.0, turned_rad, 0.0]).as_matrix()
    other = replace(rig.pose, R_world_cam=rig.pose.R_world_cam @ turn)
    found_rad = np.deg2rad(compare(other, rig.pose, STROKE).turn_deg)
    assert found_rad == pytest.approx(turned_rad, abs=1e-12)


@pytest.mark.parametrize(
    ("depth_m", "sigma_px", "position_mm", "image_px", "flow_px"),
    [
        (0.24, 0.3, 0.19, 0.12, 0.016),
        (0.44, 0.3, 0.10, 0.035, 0.002),
        (0.64, 0.3, 0.19, 0.018, 0.002),
    ],
)
def test_accuracy_with_noise(depth_m, sigma_px, position_mm, image_px, flow_px):
    """Promise: with 20 views, errors are at most sqrt(3) times those of 60 views in the first study
    of the rig."""
    rig = Rig(depth_m)
    found = [
        errors(rig, solve(rig.corners(sigma_px, seed=seed), rig.slider, rig.camera))
        for seed in range(2)
    ]
    assert np.median([one.position_mm for one in found]) < position_mm
    assert np.median([one.image_px for one in found]) < image_px
    assert np.median([one.flow_px for one in found]) < flow_px


def test_covariance_is_that_of_the_errors():
    """Promise: errors are as large as the covariance says (the whitened errors of all eleven
    parameters together have a mean square of 1)."""
    rig = Rig(0.436, davis346())
    exact = solve(rig.corners(0.0, 8), rig.slider, rig.camera, ALL)
    squares = []
    for seed in range(4):
        solution = solve(rig.corners(0.3, 8, seed), rig.slider, rig.camera, ALL)
        off = np.concatenate(
            [
                (
                    Rotation.from_matrix(exact.pose.R_world_cam.T @ solution.pose.R_world_cam)
                ).as_rotvec(),
                solution.pose.origin_m - exact.pose.origin_m,
            ]
        )
        squares.append(off @ np.linalg.solve(solution.covariance[:6, :6], off) / 6)
        assert solution.rms_px == pytest.approx(0.3 * np.sqrt(2), rel=0.1)
    assert 0.4 < np.mean(squares) < 2.0


def test_nine_parameters_have_a_null_direction_and_eight_have_none():
    """Promise: the paper's nine unknowns (pose of the slider's base, rotation of the camera on it)
    have rank 8: turning the base about the slider's axis and the camera back changes nothing."""
    rig = Rig(0.44)
    corners = rig.corners(0.0, 8)
    x_m = rig.slider.position_m(corners.t_us)
    base = Rotation.align_vectors([rig.pose.direction], [[1, 0, 0]])[0]
    on_base = base.inv() * Rotation.from_matrix(rig.pose.R_world_cam)

    def predicted(nine):
        turned = Rotation.from_rotvec(nine[:3]) * base
        R = (turned * on_base * Rotation.from_rotvec(nine[6:])).as_matrix()
        direction = turned.as_matrix()[:, 0]
        pose = RigPose(rig.camera, R, rig.pose.origin_m + nine[3:6], direction)
        return pose.project(corners.page_m, x_m).ravel()

    step = 1e-5
    jacobian = np.stack(
        [(predicted(step * e) - predicted(-step * e)) / (2 * step) for e in np.eye(9)], axis=1
    )
    scaled = jacobian / np.linalg.norm(jacobian, axis=0)
    singular = np.linalg.svd(scaled, compute_uv=False)
    assert singular[-1] < 1e-7 * singular[0]
    assert singular[-2] > 1e-5 * singular[0]
    # and the null direction is that turn
    axis = rig.pose.direction
    turn = np.concatenate([axis, np.zeros(3), -(on_base.inv().apply([1.0, 0.0, 0.0]))])
    assert np.abs(jacobian @ turn).max() < 1e-6 * np.abs(jacobian).max()
    assert len(solve(corners, rig.slider, rig.camera).names) == 8


def test_latency_bends_the_poses_only_in_one_direction():
    """Promise: an unknown latency shifts the image truth by speed times latency, unnoticed, if the
    slider goes one way, and cancels if it also goes back; if estimated, it is found."""
    rig = Rig(0.44)
    shift_px = 0.005 * 0.2 * rig.camera.fx / 0.44
    one_way = solve(rig.corners(0.3, 12, latency_ms=5.0, one_way=True), rig.slider, rig.camera)
    assert errors(rig, one_way).image_px == pytest.approx(shift_px, rel=0.1)
    assert one_way.rms_px < 0.5
    both_corners = rig.corners(0.3, 12, latency_ms=5.0)
    both = solve(both_corners, rig.slider, rig.camera)
    assert errors(rig, both).image_px < 0.1 * shift_px
    assert both.rms_px > 2.0
    fitted = solve(both_corners, rig.slider, rig.camera, (LATENCY,))
    assert fitted.latency_ms == pytest.approx(5.0, abs=0.05)
    assert abs(fitted.latency_ms - 5.0) < 4 * sigma_ms(fitted)
    assert errors(rig, fitted).image_px < 0.04


def test_latency_is_refused_in_one_direction():
    rig = Rig(0.44)
    corners = rig.corners(0.1, 8, one_way=True)
    with pytest.raises(RigError, match="8 on the way there and 0 on the way back"):
        solve(corners, rig.slider, rig.camera, (LATENCY,))


def test_a_wrong_focal_length_is_invisible():
    """Promise (the docs' warning): half a percent of the focal length moves the camera by two
    millimeters, at the same residuals, and does not change the flow."""
    rig = Rig(0.44, turn_deg=(0.0, 0.0, 0.0), direction=(1.0, 0.0, 0.0))
    corners = rig.corners(0.3, 8)
    wrong = Camera(1280, 720, fx=1.005 * rig.camera.fx)
    right = solve(corners, rig.slider, rig.camera)
    solution = solve(corners, rig.slider, wrong)
    off_mm = 1e3 * abs(solution.pose.origin_m[2] - rig.pose.origin_m[2])
    assert off_mm == pytest.approx(2.2, rel=0.1)
    assert solution.rms_px == pytest.approx(right.rms_px, rel=0.02)


def test_wrong_markers_are_left_out():
    """Promise: markers that are misread or misplaced do not move the solution."""
    rig = Rig(0.44)
    corners = rig.corners(0.2, 10)
    image_px = corners.image_px.copy()
    image_px[::10] += 7.0
    solution = solve(replace_px(corners, image_px), rig.slider, rig.camera)
    assert not solution.inliers[::10].any()
    assert solution.inliers.mean() > 0.85
    assert errors(rig, solution).image_px < 0.03


def replace_px(corners, image_px):
    return Corners(corners.t_us, corners.page_m, image_px)


def test_a_lens_is_part_of_the_camera():
    """Promise: distortion in the camera is used; ignored, it leaves residuals over a pixel."""
    pinhole = gen4()
    lens = Camera(1280, 720, fx=pinhole.fx, distortion=Distortion(k1=-0.1))
    rig = Rig(0.44, lens)
    corners = rig.corners(0.1, 8)
    assert errors(rig, solve(corners, rig.slider, lens)).image_px < 0.02
    assert solve(corners, rig.slider, pinhole).rms_px > 0.3


def test_contradictions_and_too_few_are_refused():
    """Promise: solve raises an error."""
    rig = Rig(0.44)
    corners = rig.corners(0.1, 5)
    with pytest.raises(RigError, match=r"solve: .* at 2 positions"):
        solve(corners.of(corners.t_us < np.unique(corners.t_us)[2]), rig.slider, rig.camera)
    shuffled = np.random.default_rng(0).permutation(corners.image_px)
    with pytest.raises(RigError):
        solve(replace_px(corners, shuffled), rig.slider, rig.camera)
    still = Slider(rig.slider.t_us, np.zeros_like(rig.slider.x_m))
    with pytest.raises(RigError, match=r"solve: .* at 1 positions"):
        solve(corners, still, rig.camera)
    late = Slider(rig.slider.t_us + 1e7, rig.slider.x_m)
    with pytest.raises(RigError, match="both clocks agree"):
        solve(corners, late, rig.camera)


def test_the_page_has_markers_wherever_the_camera_looks():
    """Promise: in every view of all three depths of the paper there are markers to see."""
    assert PAGE.marker_m == pytest.approx(0.014, rel=0.01)
    for depth_m in (0.236, 0.436, 0.636):
        for camera in (gen4(), davis346()):
            corners = Rig(depth_m, camera).corners(0.0)
            counts = np.unique(corners.t_us, return_counts=True)[1]
            assert len(counts) == 20
            assert counts.min() >= 4, (depth_m, camera.width, counts)
