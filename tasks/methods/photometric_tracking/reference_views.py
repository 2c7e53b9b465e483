"""The reference view at several sizes, the coarsest first."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np

from tasks.methods.photometric_tracking.residuals import Float64, Intrinsics, intrinsics
from tasks.numerics.compiling import jit_contract

_COARSEST_PX = 16  # least side of the coarsest view


class Level(NamedTuple):
    """The reference view at one size."""

    image: Float64  # (h, w) log intensity
    intrinsics: Intrinsics  # in this view's pixels
    events: int  # number of consecutive events at a pixel that are joined into one


def pyramid(log_image: Float64, K: Float64, coarsest_px: float) -> Iterator[Level]:
    """Yield reference views, the coarsest first.

    Each view is the next finer one, blurred by a Gaussian of 1 px and halved by averaging areas.

    Parameters
    ----------
    log_image
        (h, w) float64, log intensity of the reference view.
    K
        (3, 3) camera matrix.
    coarsest_px
        Approximate blur of the coarsest view, in pixels of the reference view.

    Yields
    ------
    Views, the last of which is the reference view itself.
    """
    images: list[Float64] = [log_image]
    while 2 ** len(images) <= 2 * coarsest_px and min(images[-1].shape) >= 2 * _COARSEST_PX:
        blurred = cv2.GaussianBlur(images[-1], (0, 0), 1.0, borderType=cv2.BORDER_REFLECT)
        half = (round(blurred.shape[1] / 2), round(blurred.shape[0] / 2))
        images.append(np.asarray(cv2.resize(blurred, half, interpolation=cv2.INTER_AREA)))
    for level in reversed(range(len(images))):
        image = images[level]
        scale = np.array([image.shape[1] / log_image.shape[1], image.shape[0] / log_image.shape[0]])
        if level > 0:
            image = image * gain(log_image, image)
        yield Level(image, intrinsics(np.diag([*scale, 1.0]) @ K), 2**level)


def gain(log_image: Float64, coarse: Float64) -> float:
    """Return the factor on a blurred view that makes its gradient best predict the fine gradient.

    This is the regression of the fine gradient on the coarse one. The regression of the coarse
    gradient on the fine one is the share of contrast that the blur leaves. Reducing C to that share
    looks equivalent, but then the detail that the blur hides makes every path look too long, and
    the search ends millimeters away from the true path.

    Parameters
    ----------
    log_image
        (h, w) float64, the reference view.
    coarse
        A blurred view of any size.

    Returns
    -------
    The factor; 1 if the blurred view has no gradient.
    """
    size = (log_image.shape[1], log_image.shape[0])
    blurred = np.asarray(cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC))
    both, total = _gradient_products(blurred, log_image)
    return both / total if total > 0 else 1.0


@jit_contract
def _gradient_products(a, b):
    """Sum grad a . grad b and |grad a|^2 over two (h, w) images, with differences as gradients.

    The sums run row by row in a fixed order. BLAS adds in an order that depends on its threads, so
    that the same events would give another path on another machine.
    """
    height, width = a.shape
    both = total = 0.0
    for y in range(height):
        row_both = row_total = 0.0
        for x in range(width):
            if x + 1 < width:
                change = a[y, x + 1] - a[y, x]
                row_both += change * (b[y, x + 1] - b[y, x])
                row_total += change * change
            if y + 1 < height:
                change = a[y + 1, x] - a[y, x]
                row_both += change * (b[y + 1, x] - b[y, x])
                row_total += change * change
        both += row_both
        total += row_total
    return both, total
