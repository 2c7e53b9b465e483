"""Nelder-Mead's search for the flow of the greatest contrast, in two unknowns.

The steps, their order and their arithmetic are those of SciPy's `minimize`, so that both end at the
same flow to the last bit. SciPy calls back for each value, which takes longer than the contrast of
a small patch, and holds the GIL; here the whole search is one compiled call.
"""

from __future__ import annotations

from tasks.methods.contrast_maximization.contrast import contrast_at
from tasks.numerics.compiling import inlined, jit_in_place

CONVERGED_PX = 2e-3  # a simplex of this size ends the search
MAX_IMAGES = 200  # so does this number of images


@jit_in_place
def find_sharpest(patch, work, initial, reach, simplex):
    """Search for the flow of the greatest contrast near the initial flow, (2,) px per window.

    `reach` is the largest distance from the initial flow per component, px. `simplex` is (3, 3):
    each row has x and y of a point from the initial flow, and room for the loss. The last three
    points overwrite the first three, the best point first.
    """
    for i in range(3):
        simplex[i, 2] = _loss(patch, work, initial, reach, simplex[i, 0], simplex[i, 1])
    images = 3
    _sort(simplex)
    while images < MAX_IMAGES and _extent(simplex) > CONVERGED_PX:
        best, second, worst = simplex[0, 2], simplex[1, 2], simplex[2, 2]
        x, y = _across(simplex, 1.0)
        loss = _loss(patch, work, initial, reach, x, y)
        images += 1
        shrinks = False
        if not best <= loss < second:
            if images == MAX_IMAGES:
                break
            if loss < best:
                factor = 2.0  # go on in this direction
            elif loss < worst:
                factor = 0.5
            else:
                factor = -0.5  # stay on this side
            other_x, other_y = _across(simplex, factor)
            other = _loss(patch, work, initial, reach, other_x, other_y)
            images += 1
            better = other <= loss if factor == 0.5 else other < min(loss, worst)
            shrinks = not better and factor != 2.0
            if better:
                x, y, loss = other_x, other_y, other
        if not shrinks:
            simplex[2, 0], simplex[2, 1], simplex[2, 2] = x, y, loss
        else:
            for i in range(1, 3):
                if images == MAX_IMAGES:
                    break
                for k in range(2):
                    simplex[i, k] = simplex[0, k] + 0.5 * (simplex[i, k] - simplex[0, k])
                simplex[i, 2] = _loss(patch, work, initial, reach, simplex[i, 0], simplex[i, 1])
                images += 1
        _sort(simplex)
    return images


@inlined
def _loss(patch, work, initial, reach, x, y):
    """Return the negative contrast at an offset from the initial flow."""
    if max(abs(x), abs(y)) > reach:
        return 0.0  # worse than any image, whose squares are positive
    return -contrast_at(patch, work, initial[0] + x, initial[1] + y)


@jit_in_place
def _extent(simplex):
    """Return the largest distance of any point from the best one, per component."""
    extent = 0.0
    for i in range(1, 3):
        for k in range(2):
            extent = max(extent, abs(simplex[i, k] - simplex[0, k]))
    return extent


@jit_in_place
def _across(simplex, factor):
    """Return the middle of the two best points, moved away from the worst point.

    It moves by `factor` times its distance from the worst point; a negative factor moves it closer.
    """
    x = (1.0 + factor) * ((simplex[0, 0] + simplex[1, 0]) / 2.0) - factor * simplex[2, 0]
    y = (1.0 + factor) * ((simplex[0, 1] + simplex[1, 1]) / 2.0) - factor * simplex[2, 1]
    return x, y


@jit_in_place
def _sort(simplex):
    """Sort the points by their losses, the lowest first."""
    for i in range(1, 3):
        for j in range(i, 0, -1):
            if simplex[j, 2] < simplex[j - 1, 2]:
                for k in range(3):
                    simplex[j, k], simplex[j - 1, k] = simplex[j - 1, k], simplex[j, k]
