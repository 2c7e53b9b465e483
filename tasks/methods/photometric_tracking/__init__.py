"""Event-based Photometric Pose Tracker (EPPT), Eqs. (13) to (15), with C known.

Log intensity changed by p C between two events at a pixel. The reference view gives the value that
the pixel saw: its ray meets the plane, and that point is projected into the reference view, Eq.
(13). So each event with an earlier one at its pixel gives one residual, Eq. (14),

    r_k = p_k (L_l(x'_1) - L_l(x'_0)) - C ,

in the control poses of the path. Levenberg-Marquardt minimizes their robust sum of squares, Eq.
(15), in all six degrees of freedom of every control pose. The paper perturbs only the positions but
estimates the poses: within 14 ms, a rotation by less than a pixel looks like a translation.
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
