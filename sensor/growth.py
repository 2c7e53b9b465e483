"""A bound on what a small file may become in memory."""

from __future__ import annotations

from sensor.errors import EventFormatError

_MAX_GROWTH = 500  # equal lamps in all pixels reach 200 with DSEC's compression
_FREE_BYTES = 1 << 28


def check_growth(declared_bytes: int, stored_bytes: int) -> None:
    """Refuse data that declares far more bytes than any compressed recording stores."""
    if declared_bytes > _FREE_BYTES + _MAX_GROWTH * stored_bytes:
        raise EventFormatError(
            f"the file declares {declared_bytes} bytes but stores {stored_bytes}, a factor of "
            f"more than {_MAX_GROWTH}; it is damaged"
        )
