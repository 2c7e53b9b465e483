"""A bound on what a small file may become in memory."""

from __future__ import annotations

from sensor.errors import EventFormatError

_MAX_GROWTH = 500  # equal lamps in all pixels reach 200 with DSEC's compression
_FREE_BYTES = 1 << 28


def check_growth(declared_bytes: int, stored_bytes: int) -> None:
    """Refuse data of far more bytes than are stored of it, as no recording can be compressed."""
    if declared_bytes > _FREE_BYTES + _MAX_GROWTH * stored_bytes:
        raise EventFormatError(
            f"found {declared_bytes} bytes declared, but {stored_bytes} stored, expected at most "
            f"{_MAX_GROWTH} for each"
        )
