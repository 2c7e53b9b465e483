"""Convert files of events between formats."""

from __future__ import annotations

from pathlib import Path

from sensor.formats import find_format, read_events, read_header, write_events
from sensor.formats.registry import warn_of_loss
from tasks.errors import TaskError
from tasks.events.overwriting import check_new
from tasks.events.truth import truth_to_copy


def convert(
    source: Path,
    out: Path,
    *,
    format: str | None = None,
    input_format: str | None = None,
    size: tuple[int, int] | None = None,
    overwrite: bool = False,
) -> int:
    """Write a file's events in another format, with everything that the new format can hold.

    Ground truth is kept from DSEC to DSEC. A warning names what is lost.

    Parameters
    ----------
    source, out
        The files.
    format, input_format
        Formats of `out` and `source`; by default their extensions or headers tell.
    size
        Width and height of the sensor, for a source that does not store them.
    overwrite
        Whether to replace an existing file.

    Returns
    -------
    The number of events.

    Raises
    ------
    TaskError
        Both are the same file, or `out` exists and may not be replaced.
    """
    header = read_header(source, format=input_format)
    if out.exists() and out.samefile(source):
        raise TaskError(f"{out}: is the input {source}, which cannot be replaced while it is read")
    check_new(out, overwrite)
    to = find_format(out, format, new=True)
    left_out, add = list(header.others), None
    if "truth" in left_out and to.name == find_format(source, input_format).name == "dsec":
        left_out.remove("truth")
        add = truth_to_copy(source)
    parts = read_events(source, format=input_format, size=size)
    count = write_events(
        out,
        parts,
        format=format,
        origin=header.origin,
        t_offset_us=header.t_offset_us,
        add=add,
    )
    warn_of_loss(out, to, left_out)
    return count
