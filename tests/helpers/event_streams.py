"""Event streams for the tests of the file formats."""

import numpy as np
from hypothesis import strategies as st

from sensor import Events, SensorModel

COLUMNS = ("t_us", "x", "y", "p")
SUFFIXES = {"dsec": ".h5", "evt3": ".raw", "evt2": ".raw", "npz": ".npz", "text": ".txt"}


def make_events(t_us, x, y, p, width=640, height=480, model=None):
    """Return events from columns that numpy can convert; p may be 0 or 1."""
    p = np.where(np.asarray(p) > 0, 1, -1).astype(np.int8)
    columns = np.asarray(t_us, np.int64), np.asarray(x, np.uint16), np.asarray(y, np.uint16), p
    return Events(*columns, width, height, model)


def random_events(count, width=640, height=480, start_us=0, mean_us=0.5, seed=0, model=None):
    """Return Poisson events over the sensor, sorted by (t, y, x)."""
    rng = np.random.default_rng(seed)
    t = start_us + np.cumsum(rng.poisson(mean_us, count))
    x, y = rng.integers(0, width, count), rng.integers(0, height, count)
    order = np.lexsort((x, y, t))
    return make_events(
        t[order], x[order], y[order], rng.integers(0, 2, count), width, height, model
    )


def bars(steps, width=640, height=8, gap_us=7):
    """Return whole rows that fire together, with holes: the case for EVT3's vectors."""
    rng = np.random.default_rng(0)
    fired = rng.random((steps, height, width)) < rng.random((steps, height, 1))
    step, y, x = np.nonzero(fired)
    return make_events(gap_us * step, x, y, (step + y) % 2, width, height)


def assert_same(a, b):
    assert (a.width, a.height) == (b.width, b.height)
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(a, column), getattr(b, column))


@st.composite
def streams(draw, max_start_us=1 << 30):
    """Draw a short stream: small and large steps in time, ties, neighbors in a row, any pixel."""
    width, height = draw(st.integers(1, 2048)), draw(st.integers(1, 2048))
    n = draw(st.integers(0, 40))
    rng = np.random.default_rng(draw(st.integers(0, 1 << 32)))
    steps = rng.integers(0, rng.choice([0, 70, 5000, 1 << 25], n), endpoint=True)
    x, y, p = rng.integers(0, [[width], [height], [2]], (3, n))
    x[rng.random(n) < 0.1], y[rng.random(n) < 0.1] = width - 1, height - 1
    if draw(st.booleans()):  # one row, one time, one polarity, left to right
        x, y, p = np.minimum(np.arange(n), width - 1), np.zeros(n), np.ones(n)
        steps *= 0
    t = draw(st.integers(0, max_start_us)) + np.cumsum(steps)
    model = draw(
        st.sampled_from(
            [
                None,
                SensorModel(width=width, height=height),
                SensorModel(width=width, height=height, cutoff_hz=50.0, dark_level=0.1 / 3),
            ]
        )
    )
    return make_events(t, x, y, p, width, height, model)
