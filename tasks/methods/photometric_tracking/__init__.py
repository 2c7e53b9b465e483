"""Event-based Photometric Pose Tracker (EPPT), Eqs. (13) to (15), with C known.

Between two events at a pixel the light there changed by C. What the pixel saw is found in the
reference view: its ray meets the plane, and the point is projected into the reference view, Eq.
(13). So each event with one before it at its pixel gives one residual, Eq. (14),

    r_k = p_k (L_l(x'_1) - L_l(x'_0)) - C ,

in the control poses of the path. Their robust sum of squares, Eq. (15), is minimised with
Levenberg-Marquardt in all six degrees of freedom of every control pose. The paper perturbs only the
positions, but looks for the poses; a camera that turns less than a pixel in 14 ms cannot be told
beforehand from one that moves.
"""

from tasks.methods.photometric_tracking.accumulation import normal_equations
from tasks.methods.photometric_tracking.reference_views import gain, pyramid
from tasks.methods.photometric_tracking.search import cholesky_solve
from tasks.methods.photometric_tracking.tracker import estimate, estimate_with_delay

__all__ = [
    "cholesky_solve",
    "estimate",
    "estimate_with_delay",
    "gain",
    "normal_equations",
    "pyramid",
]
