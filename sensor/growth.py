"""A bound on what a small file may become in memory."""

from __future__ import annotations

from sensor.errors import EventFormatError

_MAX_GROWTH = 500  # equal lamps in all pixels reach 200 with DSEC's compression
_FREE_BYTES = 1 << 28


def check_growth(declared_bytes: int, stored_bytes: int) -> None:
    """Refuse data of far more bytes than are stored of it, as no recording can be compressed.

    Parameters
    ----------
    declared_bytes, stored_bytes
        Bytes in memory, and in the file.

    Raises
    ------
    EventFormatError
        There are more than 2^28 bytes, and more than 500 times as many as are stored.
    """
    if declared_bytes > _FREE_BYTES + _MAX_GROWTH * stored_bytes:
        raise EventFormatError(
            f"found {declared_bytes} bytes declared, but {stored_bytes} stored, expected at most "
            f"{_MAX_GROWTH} for each"
        )
