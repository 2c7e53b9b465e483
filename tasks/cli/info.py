"""The command that describes a sequence or a file of events."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional, arg

from tasks.cli import terminal
from tasks.cli.table import Table
from tasks.events.reading import AS_STORED, ReadOptions


def info(
    path: Annotated[
        Positional[Path], arg(metavar="PATH", help="folder of a sequence, or file of events")
    ],
    format: str | None = None,
    reading: OmitArgPrefixes[ReadOptions] = AS_STORED,
) -> None:
    """Describe a radiance sequence or a file of events.

    Parameters
    ----------
    format
        dsec, evt3, evt2, npz, text, csv, aedat3, aedat4, dat, es, bag or package.module:Format,
        instead of what the extension says.
    """
    if path.is_file():
        from tasks.events.description import describe

        _print_pairs(describe(path, format=format, reading=reading))
        return
    from eres_render import SequenceError, open_sequence
    from tasks.events.description import seconds

    if not path.exists():
        raise SequenceError(f"{path}: no such file or folder")
    if (format, reading) != (None, AS_STORED):
        raise SequenceError(f"{path}: is a folder; the given options are for files of events")
    sequence = open_sequence(path)
    manifest, camera = sequence.manifest, sequence.camera
    start_s, end_s = sequence.window_s
    length_m = float(np.diff(sequence.trajectory.length_m(sequence.t_s[[0, -1]]))[0])
    part = "continuous" if sequence.is_continuous else f"clip {manifest.clip}"
    clock = f"time 0 is {seconds(sequence.t_offset_us)} s on the clock of the given poses"
    pinhole = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy")}
    terms = {} if camera.distortion is None else dataclasses.asdict(camera.distortion)
    pairs = {
        "scene": f"{manifest.scene}, {part}",
        "found at": sequence.scene_source,
        "frames": f"{len(sequence)} of {manifest.width}x{manifest.height} px, half-float OpenEXR",
        "camera": f"{_terms(pinhole)} px" if terms else "",
        "lens": _terms(terms),
        "time": f"{sequence.t_s[0]:.4f} to {sequence.t_s[-1]:.4f} s",
        "clock": clock if sequence.t_offset_us else "",
        "window": f"{start_s:.4f} to {end_s:.4f} s",
        "camera speed": f"{length_m / (sequence.t_s[-1] - sequence.t_s[0]):.3g} m/s on average",
        "moving objects": ", ".join(manifest.objects),
        "white": f"{sequence.white_level:.4g} W m^-2 sr^-1",
        "samples per pixel": str(manifest.spp),
        "motion per frame": f"at most {manifest.max_displacement_px:g} px",
        "rendered by": f"Mitsuba {manifest.mitsuba}, {manifest.variant}, {manifest.integrator}",
    }
    _print_pairs(pairs)


def _terms(values: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.6g}" for name, value in values.items())


def _print_pairs(pairs: dict[str, str]) -> None:
    """Print the pairs that have a value."""
    table = Table(box=None, show_header=False)
    for name, value in pairs.items():
        if value:
            table.add_row(name, value)
    terminal.show(table)
