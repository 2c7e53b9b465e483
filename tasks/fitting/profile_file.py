"""Write the profile of a sensor, for `eres simulate --profile`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from eres_render.storage.atomic import write_text
from tasks.numerics.estimate import Estimate


class Measured(NamedTuple):
    """A field of a profile, as measured.

    Parameters
    ----------
    value
        An estimate in the given unit, a number that was not estimated, or the name of a
        photoreceptor. An estimate that is only a bound is written without its value.
    unit
        Its unit, one of `sensor.profiles.quantities`; empty for a name.
    source
        Where the value comes from, and how it was measured.
    """

    value: Estimate | float | str
    unit: str
    source: str


def write_profile(
    file: Path, title: str, fields: Mapping[str, Measured], *, overwrite: bool = True
) -> None:
    """Write a profile.

    Parameters
    ----------
    file
        The TOML file.
    title
        Name of the sensor.
    fields
        Measured values by the name of the field.
    overwrite
        Whether to replace a file.
    """
    parts = [f"title = {_text(title)}\n"]
    for name, (value, unit, source) in fields.items():
        parts.append(f"[{name}]")
        if isinstance(value, str):
            parts.append(f"value = {_text(value)}")
        elif isinstance(value, Estimate):
            if not value.is_bound:
                parts.append(f"value = {value.value:.6g}")
            parts.append(f"interval = [{value.low:.6g}, {value.high:.6g}]")
        else:
            parts.append(f"value = {value:.6g}")
        if unit:
            parts.append(f"unit = {_text(unit)}")
        parts.append(f"source = {_text(source)}\n")
    write_text(file, "\n".join(parts), overwrite=overwrite)


def _text(value: str) -> str:
    """Return a TOML string; JSON's escapes are among those of TOML, which has one more."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
