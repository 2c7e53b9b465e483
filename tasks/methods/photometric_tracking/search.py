"""The search for the path of the least cost, from the coarsest reference view to the finest."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numba
import numpy as np
from scipy.spatial.transform import Rotation

from eres_render import Trajectory
from tasks.methods.photometric_tracking.accumulation import RobustSum, accumulate
from tasks.methods.photometric_tracking.reference_views import Level
from tasks.methods.photometric_tracking.residuals import Float64, Problem, join_events

_MAX_PASSES = 60  # on one level
_CONVERGED_PX = 0.02  # a step of less is the last, by the control poses' root mean square
_CONVERGED_NOISE = 0.1  # and one that gains less than so much of what noise does to the minimum


def search(
    problem: Problem, path: Trajectory, levels: Iterable[Level]
) -> tuple[Trajectory, RobustSum, int, bool]:
    """Go down from level to level.

    Parameters
    ----------
    problem
        The events.
    path
        Where to start.
    levels
        The reference view, the coarsest first.

    Returns
    -------
    The path, its sum on the last level, passes over the events on all, and whether the search on
    the last one converged.
    """
    passes, converged = 0, False
    state = RobustSum(math.nan, np.empty(0), np.empty((0, 0)), 0)
    for level in levels:
        on_level = join_events(problem, level.events)
        path, state, used, converged = _levenberg_marquardt(on_level, level, path)
        passes += used
    return path, state, passes, converged


def _levenberg_marquardt(
    problem: Problem, level: Level, path: Trajectory
) -> tuple[Trajectory, RobustSum, int, bool]:
    """Go down to a minimum: the path, its sum, passes over the events, whether it converged."""
    damping = 1e-3
    state = accumulate(problem, level, path)
    for passes in range(1, _MAX_PASSES):
        diagonal = np.diag(state.hessian)
        # A control pose that no event depends on stays where it is.
        floor = 1e-12 * diagonal.max()
        if not math.isfinite(state.cost) or floor == 0.0:
            return path, state, passes, False
        damped = state.hessian + np.diag(damping * diagonal + floor)
        step, solved = cholesky_solve(damped, -state.gradient)
        if not solved:
            damping = max(10.0 * damping, 1e-6)
            continue
        step = step.reshape(-1, 6)
        trial_path = moved(path, step)
        trial = accumulate(problem, level, trial_path)
        moved_px = level.intrinsics[0] * math.sqrt(
            np.mean(np.sum(step[:, :3] ** 2, axis=1)) / problem.distance_m**2
        )
        if trial.cost <= state.cost:
            # Noise lowers a sum of N squares at its minimum by its mean for each unknown.
            noise = len(state.gradient) * state.cost / problem.residuals
            small = state.cost - trial.cost < _CONVERGED_NOISE * noise
            path, state = trial_path, trial
            damping = max(0.2 * damping, 1e-9)
            if small or moved_px < _CONVERGED_PX:
                return path, state, passes + 1, True
        else:
            damping *= 8.0
            if moved_px < 1e-3 * _CONVERGED_PX:  # no step, however short, goes down
                return path, state, passes + 1, True
    return path, state, _MAX_PASSES, False


@numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def cholesky_solve(A, b):
    """Solve A x = b for a positive definite A; x, and whether A is that.

    LAPACK does it too, but splits large matrices, those of long paths, by its number of threads.

    Parameters
    ----------
    A
        (n, n), of which the upper half is read and overwritten by that of U, A = U^T U.
    b
        (n,), overwritten.
    """
    n = b.size
    for k in range(n):
        if not (A[k, k] > 0.0 and A[k, k] < np.inf):
            return b, False
        A[k, k:] /= math.sqrt(A[k, k])
        b[k] /= A[k, k]
        for i in range(k + 1, n):
            factor = A[k, i]
            b[i] -= factor * b[k]
            row, pivot = A[i, i:], A[k, i:]
            for j in range(n - i):
                row[j] -= factor * pivot[j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            b[i] -= A[i, j] * b[j]
        b[i] /= A[i, i]
    return b, True


def moved(path: Trajectory, step: Float64) -> Trajectory:
    """Move (M, 3) positions and turn (M, 3) rotations, on the left, of the control poses."""
    controls = path.controls.copy()
    controls[:, :3, 3] += step[:, :3]
    controls[:, :3, :3] = Rotation.from_rotvec(step[:, 3:]).as_matrix() @ controls[:, :3, :3]
    return Trajectory(path.knots_s, controls)
