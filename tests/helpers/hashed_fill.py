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
