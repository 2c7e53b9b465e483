"""Search for the path of least cost, from the coarsest reference view to the finest."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from scipy.spatial.transform import Rotation

from eres_render import Trajectory
from tasks.methods.photometric_tracking.accumulation import RobustSum, accumulate
from tasks.methods.photometric_tracking.reference_views import Level
from tasks.methods.photometric_tracking.residuals import Float64, Problem, join_events
from tasks.numerics.compiling import jit_contract

_MAX_PASSES = 60  # per level
_CONVERGED_PX = 0.02  # a shorter step is the last; root mean square over the control poses
_CONVERGED_NOISE = 0.1  # a step that gains less than this share of the minimum's noise is the last

Result = tuple[Trajectory, RobustSum, int, bool]


def search(problem: Problem, path: Trajectory, levels: Iterable[Level], passes: int = 0) -> Result:
    """Search on one reference view after another, after some passes over the events."""
    converged = False
    state = RobustSum(math.nan, np.empty(0), np.empty((0, 0)), 0)
    for level in levels:
        on_level = join_events(problem, level.events)
        path, state, used, converged = _levenberg_marquardt(on_level, level, path)
        passes += used
    return path, state, passes, converged


def _levenberg_marquardt(problem: Problem, level: Level, path: Trajectory) -> Result:
    """Return path, sum, number of passes over the events, and whether the search converged."""
    damping = 1e-3
    state = accumulate(problem, level, path)
    for passes in range(1, _MAX_PASSES):
        diagonal = np.diag(state.hessian)
        # A control pose on which no event depends stays where it is.
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
            # Noise lowers the minimum of a sum of squares by their mean for each unknown.
            noise = len(state.gradient) * state.cost / problem.residuals
            small = state.cost - trial.cost < _CONVERGED_NOISE * noise
            path, state = trial_path, trial
            damping = max(0.2 * damping, 1e-9)
            if small or moved_px < _CONVERGED_PX:
                return path, state, passes + 1, True
        else:
            damping *= 8.0
            if moved_px < 1e-3 * _CONVERGED_PX:  # no step, however short, lowers the cost
                return path, state, passes + 1, True
    return path, state, _MAX_PASSES, False


@jit_contract
def cholesky_solve(A, b):
    """Solve A x = b for a positive definite A.

    LAPACK splits large matrices, those of long paths, by its number of threads, which changes the
    rounding.

    Parameters
    ----------
    A
        (n, n); the upper half is read, and overwritten by U with A = U^T U.
    b
        (n,), overwritten.

    Returns
    -------
    x, and whether A is positive definite.
    """
    n = b.size
    for k in range(n):
        if not (A[k, k] > 0.0 and A[k, k] < np.inf):
            return b, False
        root = math.sqrt(A[k, k])
        for j in range(k, n):  # an assignment of the row compiles slowly
            A[k, j] /= root
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
    """Move control poses by (M, 6): translations, then rotation vectors applied on the left."""
    controls = path.controls.copy()
    controls[:, :3, 3] += step[:, :3]
    controls[:, :3, :3] = Rotation.from_rotvec(step[:, 3:]).as_matrix() @ controls[:, :3, :3]
    return Trajectory(path.knots_s, controls)
