"""Numbers from a formula, the same on every machine: inputs and weights of stored fingerprints."""

import zlib

import numpy as np

from sensor import Events


def uniform(name, n):
    """Return n float64 in [0, 1): splitmix64 of the index and the CRC of the name."""
    i = np.arange(n, dtype=np.uint64)
    with np.errstate(over="ignore"):
        z = i + np.uint64(1) + (np.uint64(zlib.crc32(name.encode())) << np.uint64(32))
        z *= np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    return (z >> np.uint64(11)).astype(np.float64) * 2.0**-53


def hashed_events(name, n, width, height, duration_us):
    """Return (events, (n, 2) positions with fractions) over a window."""
    t_us = np.sort(np.floor(uniform(f"{name}.t", n) * duration_us).astype(np.int64))
    at = np.stack([uniform(f"{name}.x", n) * width, uniform(f"{name}.y", n) * height], axis=1)
    x, y = np.floor(at).astype(np.uint16).T.copy()
    p = np.where(uniform(f"{name}.p", n) < 0.5, -1, 1).astype(np.int8)
    return Events(t_us, x, y, p, width, height), at


def signed(name, n):
    """Return n float64 in [-1, 1)."""
    return 2.0 * uniform(name, n) - 1.0


def voxels(name, shape, keep=0.4):
    """Return a sparse float64 grid: a fraction `keep` has 5 * signed values, the rest is 0."""
    n = int(np.prod(shape))
    values = 5.0 * signed(name, n)
    values[uniform(f"{name}.mask", n) >= keep] = 0.0
    return values.reshape(shape)


def weight(key, shape, gain):
    """Return the value of an entry of a state dict: computed in float64, rounded to float32."""
    n = int(np.prod(shape, dtype=np.int64))
    if key.endswith("num_batches_tracked"):
        return np.array(7, np.int64)
    values = signed(key, n)
    if key.endswith("running_mean"):
        values = 0.1 * values
    elif key.endswith("running_var"):
        values = 1.0 + 0.5 * values
    elif len(shape) >= 2:  # of a convolution: uniform with variance gain^2 / fan
        values = gain * np.sqrt(3.0 / (n // shape[0])) * values
    elif key.endswith("weight"):  # of a normalization
        values = 1.0 + 0.25 * values
    else:  # a bias
        values = 0.1 * values
    return values.astype(np.float32).reshape(shape)


def assert_described(found, described, atol, rtol=0.0):
    """Check shape, mean, deviation, range and some values of an array against stored ones."""
    found = np.asarray(found, np.float64)
    assert list(found.shape) == described["shape"]
    summary = {"mean": found.mean(), "std": found.std(), "min": found.min(), "max": found.max()}
    for name, value in summary.items():
        np.testing.assert_allclose(value, described[name], atol=atol, rtol=rtol, err_msg=name)
    values = found.ravel()[described["flat_index"]]
    np.testing.assert_allclose(values, described["values"], atol=atol, rtol=rtol)
