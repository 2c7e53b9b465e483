"""Nelder-Mead's search for the flow of the greatest contrast, in two unknowns.

The steps, their order and their arithmetic are those of SciPy's `minimize`, so that both end at the
same flow to the last bit. SciPy calls back for each value, which takes longer than the contrast of
a small patch, and keeps other threads of Python waiting; here one call is the whole search.
"""

from __future__ import annotations

import numpy as np

from tasks.methods.contrast_maximization.contrast import contrast_at
from tasks.numerics.compiling import jit

CONVERGED_PX = 2e-3  # a simplex of this size ends the search
MOST_IMAGES = 200  # so does this number of images


@jit
def sharpest_flow(patch, images, initial, size, reach):
    """Search for the flow of the greatest contrast near the initial one.

    Parameters
    ----------
    patch, images
        As in `contrast_at`.
    initial
        (2,) flow from which to start, px per window.
    size
        Side of the first simplex, px.
    reach
        Largest distance from the initial flow per component, px.

    Returns
    -------
    offset
        (2,) best flow, from the initial one.
    made
        Number of images of warped events.
    """
    simplex = np.array([[0.0, 0.0], [size, 0.0], [0.0, size]])
    losses = np.empty(3)
    for i in range(3):
        losses[i] = _loss(patch, images, initial, simplex[i], reach)
    made = 3
    _sort(simplex, losses)
    while made < MOST_IMAGES and np.abs(simplex[1:] - simplex[0]).max() > CONVERGED_PX:
        point = _across(simplex, 1.0)
        loss = _loss(patch, images, initial, point, reach)
        made += 1
        shrinks = False
        if not losses[0] <= loss < losses[1]:
            if made == MOST_IMAGES:
                break
            if loss < losses[0]:
                factor = 2.0  # go on in this direction
            elif loss < losses[2]:
                factor = 0.5
            else:
                factor = -0.5  # stay on this side
            other = _across(simplex, factor)
            other_loss = _loss(patch, images, initial, other, reach)
            made += 1
            if factor == 2.0:
                better = other_loss < loss
            else:
                better = other_loss <= loss if factor == 0.5 else other_loss < losses[2]
                shrinks = not better
            if better:
                point, loss = other, other_loss
        if not shrinks:
            simplex[2], losses[2] = point, loss
        else:
            for i in range(1, 3):
                if made == MOST_IMAGES:
                    break
                simplex[i] = simplex[0] + 0.5 * (simplex[i] - simplex[0])
                losses[i] = _loss(patch, images, initial, simplex[i], reach)
                made += 1
        _sort(simplex, losses)
    return simplex[0], made


@jit
def _loss(patch, images, initial, offset, reach):
    if max(abs(offset[0]), abs(offset[1])) > reach:
        return 0.0  # worse than any image, as squares are positive
    return -contrast_at(patch, images, initial[0] + offset[0], initial[1] + offset[1])


@jit
def _across(simplex, factor):
    """Return the middle of the two best points, moved away from the worst one.

    It moves by `factor` times the distance between the two; a negative factor moves it towards the
    worst point.
    """
    middle = (simplex[0] + simplex[1]) / 2.0
    return (1.0 + factor) * middle - factor * simplex[2]


@jit
def _sort(simplex, losses):
    """Sort the points by their losses, the lowest first."""
    for i in range(1, 3):
        for j in range(i, 0, -1):
            if losses[j] < losses[j - 1]:
                losses[j], losses[j - 1] = losses[j - 1], losses[j]
                for k in range(2):
                    simplex[j, k], simplex[j - 1, k] = simplex[j - 1, k], simplex[j, k]
