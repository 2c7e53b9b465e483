"""Lens distortion as in OpenCV: three radial and two tangential terms (Brown 1966).

Points are directions (x, y, 1) in the camera's axes. On the image plane at distance 1, a pinhole
shows them at (x, y), and a lens at

    x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y,    r^2 = x^2 + y^2.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eres_render.errors import RenderError

Float64 = NDArray[np.float64]

_CLOSE = 1e-13  # error on the image plane at distance 1 at which the search ends
_CLOSE_ENOUGH = 1e-12
_MIN_COEFFICIENT = 1e-60  # smaller ones bend nothing, and overflow in the search for roots
_MAX_STEPS = 200  # needed far out, where r^7 dominates; pixels of an image take about 5


@dataclass(frozen=True, slots=True)
class Distortion:
    """The distortion of a lens, by OpenCV's coefficients.

    Near the axis the map from directions to the image is one to one. Far from the axis the
    polynomials turn back, and would put far points inside the image, which no lens does. Beyond
    `reach`, a point therefore has the offset at `reach` in its direction from the axis.

    Parameters
    ----------
    k1, k2, k3
        Radial terms: of r^2, r^4 and r^6.
    p1, p2
        Tangential terms.

    Raises
    ------
    RenderError
        If a coefficient is not finite.

    Examples
    --------
    A lens with barrel distortion moves points toward the axis:

    >>> import numpy as np
    >>> from eres_render import Distortion
    >>> lens = Distortion(k1=-0.2)
    >>> lens.distort(np.array([0.5, 0.0]))
    array([0.475, 0.   ])
    >>> lens.undistort(np.array([0.475, 0.0])).round(12)
    array([0.5, 0. ])
    """

    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = float(getattr(self, field.name))  # OpenCV returns NumPy numbers
            if not math.isfinite(value):
                raise RenderError(f"Distortion.{field.name}: found {value}, expected a number")
            object.__setattr__(self, field.name, value)

    @property
    def reach(self) -> float:
        """Radius on the image plane at distance 1 within which the map is certainly one to one.

        The Jacobian of the map is symmetric. Its eigenvalues are those of the radial terms, plus at
        least `-6 |(p1, p2)| r`; as long as both are positive, the map is the gradient of a convex
        function. Inf if they always are.
        """
        return _reach(self)

    def distort(self, xy: ArrayLike) -> Float64:
        """Return where a lens shows directions.

        Parameters
        ----------
        xy
            (..., 2) directions (x, y, 1).

        Returns
        -------
        distorted
            (..., 2) places on the image plane at distance 1.
        """
        x, y = np.moveaxis(np.asarray(xy, np.float64), -1, 0)
        return np.stack(_bent(x, y, self)[:2], axis=-1)

    def undistort(self, distorted: ArrayLike) -> Float64:
        """Return the directions that a lens shows at given places, to 1e-12, by Newton's method.

        Parameters
        ----------
        distorted
            (..., 2) places on the image plane at distance 1.

        Returns
        -------
        xy
            (..., 2) directions (x, y, 1).

        Raises
        ------
        RenderError
            If the search fails, as it may at `reach`.
        """
        wanted_x, wanted_y = np.moveaxis(np.asarray(distorted, np.float64), -1, 0)
        x, y = wanted_x, wanted_y
        try_x, try_y = x, y
        step_x = step_y = np.zeros(x.shape)
        left = np.full(x.shape, np.inf)
        close = 1 + np.hypot(x, y)
        for _ in range(_MAX_STEPS):
            image_x, image_y, xx, xy, yx, yy = _bent(try_x, try_y, self)
            off_x, off_y = wanted_x - image_x, wanted_y - image_y
            off = np.hypot(off_x, off_y)
            nearer = off < left
            x, y, left = (np.where(nearer, *pair) for pair in ((try_x, x), (try_y, y), (off, left)))
            if np.all(left <= _CLOSE * close):
                break
            # Newton's step, or half of the last one if that led away.
            with np.errstate(divide="ignore", invalid="ignore"):
                determinant = xx * yy - xy * yx
                newton_x = (off_x * yy - off_y * xy) / determinant
                newton_y = (off_y * xx - off_x * yx) / determinant
            step_x = np.where(nearer, newton_x, 0.5 * step_x)
            step_y = np.where(nearer, newton_y, 0.5 * step_y)
            try_x, try_y = x + step_x, y + step_y
        if not np.all(left <= _CLOSE_ENOUGH * close):
            raise RenderError(
                f"{self}: cannot be inverted at a point; the search for its direction ended "
                f"{np.max(left):.2g} away (limit {_CLOSE_ENOUGH:g})"
            )
        return np.stack([x, y], axis=-1)


def polynomials(x: Any, y: Any, lens: Distortion) -> tuple[Any, Any, Any, Any, Any]:
    """Return x and y through a lens's polynomials, and their symmetric Jacobian as xx, xy, yy."""
    k1, k2, p1, p2, k3 = lens.k1, lens.k2, lens.p1, lens.p2, lens.k3
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    by_r2 = k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3))
    return (
        x * radial + 2.0 * p1 * (x * y) + p2 * (r2 + 2.0 * (x * x)),
        y * radial + p1 * (r2 + 2.0 * (y * y)) + 2.0 * p2 * (x * y),
        radial + 2.0 * by_r2 * (x * x) + 2.0 * p1 * y + 6.0 * p2 * x,
        2.0 * by_r2 * (x * y) + 2.0 * p1 * x + 2.0 * p2 * y,
        radial + 2.0 * by_r2 * (y * y) + 6.0 * p1 * y + 2.0 * p2 * x,
    )


@functools.lru_cache(maxsize=64)
def _reach(lens: Distortion) -> float:
    tangential = -6 * math.hypot(lens.p1, lens.p2)
    # The eigenvalues of the radial terms: d(r f)/dr along the radius and f across it.
    along = [7 * lens.k3, 0, 5 * lens.k2, 0, 3 * lens.k1, tangential, 1]
    across = [lens.k3, 0, lens.k2, 0, lens.k1, tangential, 1]
    clean = [np.where(np.abs(terms) > _MIN_COEFFICIENT, terms, 0.0) for terms in (along, across)]
    roots = np.concatenate([np.roots(terms) for terms in clean])
    real = roots.real[(abs(roots.imag) <= 1e-9 * abs(roots)) & (roots.real > 0)]
    return float(real.min(initial=math.inf))


def _bent(x: Float64, y: Float64, lens: Distortion) -> tuple[Float64, ...]:
    """Return where a lens shows directions, and the derivatives by x and y: xx, xy, yx, yy."""
    reach = lens.reach
    if math.isinf(reach):
        image_x, image_y, xx, xy, yy = polynomials(x, y, lens)
        return image_x, image_y, xx, xy, xy, yy
    r = np.hypot(x, y)
    beyond = r > reach
    share = np.where(beyond, reach / np.where(beyond, r, 1.0), 1.0)
    edge_x, edge_y = share * x, share * y
    at_x, at_y, xx, xy, yy = polynomials(edge_x, edge_y, lens)
    # Beyond, the offset depends on the direction from the axis only: its derivative is that at the
    # edge, times `share`, across the radius.
    nx, ny = edge_x / reach, edge_y / reach
    by_x, by_y = (xx - 1) * ny - xy * nx, xy * ny - (yy - 1) * nx  # of the offset, along (ny, -nx)
    return (
        at_x + (x - edge_x),
        at_y + (y - edge_y),
        np.where(beyond, 1 + share * by_x * ny, xx),
        np.where(beyond, -share * by_x * nx, xy),
        np.where(beyond, share * by_y * ny, xy),
        np.where(beyond, 1 - share * by_y * nx, yy),
    )
