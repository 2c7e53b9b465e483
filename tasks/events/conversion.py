"""Convert files of events between formats."""

from __future__ import annotations

from pathlib import Path

from sensor.formats import find_format, read_header, read_triggers, write_events
from sensor.formats.registry import warn_of_loss
from tasks.errors import TaskError
from tasks.events.overwriting import check_new
from tasks.events.reading import AS_STORED, SHIFT_LIMIT_US, ReadOptions
from tasks.events.truth import COPIED, groups_to_copy


def convert(
    source: str | Path,
    out: str | Path,
    *,
    format: str | None = None,
    input_format: str | None = None,
    reading: ReadOptions = AS_STORED,
    shift_us: int = 0,
    from_start: bool = False,
    overwrite: bool = False,
) -> int:
    """Write a file's events in another format, with everything that the new format can hold.

    Ground truth is kept from DSEC to DSEC. A warning names what is lost.

    Parameters
    ----------
    source, out
        The files.
    format, input_format
        Formats of `out` and `source`; by default those of their extensions or headers.
    reading
        How to read `source`.
    shift_us
        Added to all times, microseconds: of events, triggers, ground truth, IMU, and the window in
        the origin.
    from_start
        Shift all times so that the first event is at 0.
    overwrite
        Whether to replace an existing file.

    Returns
    -------
    The number of events.

    Raises
    ------
    TaskError
        Both are the same file, `out` exists and may not be replaced, both kinds of shift are given,
        or the shift is too large.
    """
    source, out = Path(source), Path(out)
    if shift_us and from_start:
        raise TaskError("give --shift-us or --from-start, not both")
    if abs(shift_us) >= SHIFT_LIMIT_US:
        raise TaskError(f"--shift-us: found {shift_us}, expected between -2^62 and 2^62")
    header = read_header(source, format=input_format, topic=reading.topic)
    check_new(out, overwrite, source)
    to = find_format(out, format, new=True)
    parts = reading.parts(source, input_format)
    if from_start:
        shift_us = -next((int(part.t_us[0]) for part in parts if len(part)), 0)
        parts = reading.parts(source, input_format)
    both_dsec = to.name == find_format(source, input_format).name == "dsec"
    copied = [name for name in COPIED if both_dsec and name in header.others]
    origin = {**header.origin}
    for name in ("window_start_us", "window_end_us"):
        if isinstance(value := origin.get(name), int):
            origin[name] = value + shift_us
    count = write_events(
        out,
        (part.later(shift_us) for part in parts) if shift_us else parts,
        format=format,
        origin=origin,
        # A clock that starts at 0 has no start to shift.
        t_offset_us=0 if from_start or not header.t_offset_us else header.t_offset_us + shift_us,
        triggers=read_triggers(source, format=input_format).later(shift_us),
        add=groups_to_copy(source, copied, shift_us) if copied else None,
        overwrite=overwrite,
    )
    warn_of_loss(out, to, [name for name in header.others if name not in copied])
    return count
