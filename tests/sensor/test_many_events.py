"""More events than 32 bits can count."""

import itertools

import numpy as np
import pytest

from sensor import SensorModel, stream


@pytest.mark.slow
def test_more_than_two_to_the_31_events():
    """Promise: no counter, index or time wraps: light that swings by 5000.5 thresholds fires 5000
    events per pixel and swing, for any total."""
    side, swings, C = 16, 1700, 1e-4
    high, low = (np.full((side, side), np.exp(u)) for u in (0.50005, -0.00005))
    frames = itertools.chain([np.ones((side, side))], itertools.cycle([high, low]))
    t_s = np.arange(swings + 1) * 1e-3
    model = SensorModel(width=side, height=side, contrast_threshold=C, dark_level=0.0)
    count, brighter, last_us = 0, 0, 0
    for part in stream(itertools.islice(frames, swings + 1), t_s, model):
        if len(part):
            assert part.t_us[0] >= last_us
            last_us = int(part.t_us[-1])
        count += len(part)
        brighter += int(np.count_nonzero(part.p > 0))
    assert count == side * side * 5000 * swings > 1 << 31
    assert brighter == count // 2
    assert last_us <= 1e6 * t_s[-1]
