"""Units of time in the files of other programs."""

TIME_UNITS = {"s": 6, "ms": 3, "us": 0, "ns": -3}
"""Powers of ten from each unit to microseconds."""
