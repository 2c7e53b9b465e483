"""Checks of this machine, for `eres doctor`."""

from __future__ import annotations

import importlib.util
import platform
import shutil
import sys

import numpy as np
from rich.console import Console
from rich.text import Text

from eres_render.cores import cores
from eres_render.rendering.backend import probe_variants
from eres_render.scene.load import scene_root
from eres_render.storage.cache import cache_dir
from sensor import SensorError, SensorModel, simulate
from tasks.cli.table import Table
from tasks.provenance import versions

_GB = 1e9


def diagnose(console: Console) -> int:
    """Print what works on this machine; return the exit code, 1 if no renderer works."""
    verdicts = probe_variants()
    table = Table("Mitsuba variant", "works", "remark", box=None)
    for verdict in verdicts:
        mark = Text("yes", "green") if verdict.works else Text("no", "red")
        remark = f"first render in {verdict.seconds:.1f} s" if verdict.works else verdict.reason
        table.add_row(verdict.name, mark, remark)
    console.print(table, crop=False)
    best = next((v.name for v in verdicts if v.works), None)
    console.print(f"renders use: {best or 'nothing works'}\n")

    facts = Table(box=None, show_header=False)
    facts.add_row("cores", str(cores()))
    facts.add_row('sensor, device="cuda"', _sensor_on_a_gpu())
    facts.add_row("python", f"{platform.python_version()} at {sys.executable}")
    for name, number in versions().items():
        facts.add_row(name, number)
    for name in ("eres_render", "sensor", "tasks"):
        spec = importlib.util.find_spec(name)
        facts.add_row(f"import {name}", str(spec.origin if spec else "missing"))
    facts.add_row("scenes", str(scene_root()))
    cache = cache_dir()
    free = shutil.disk_usage(next(p for p in (cache, *cache.parents) if p.exists())).free
    used = sum(f.stat().st_size for f in cache.rglob("*") if f.is_file())
    facts.add_row("cache", f"{cache}: {used / _GB:.1f} GB used, {free / _GB:.0f} GB free")
    console.print(facts, crop=False)
    return 0 if best else 1


def _sensor_on_a_gpu() -> str:
    try:
        simulate(np.ones((1, 1, 1)), [0.0], SensorModel(width=1, height=1), device="cuda")
    except SensorError as error:
        return f"no: {str(error).partition('here: ')[2]}"
    return "works"
