"""Commands that list: this machine, scenes, cameras, methods."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any

from rich.table import Column
from rich.text import Text
from tyro.conf import Positional, arg

import eres_render
from sensor import EventCamera, camera_names, find_camera
from sensor.cameras.camera import KEYS
from sensor.cameras.files import facts_of
from tasks.cli import terminal
from tasks.cli.app import AsJson

_LEGEND = """
min: the smallest contrast seen, not the nominal threshold.
lent: no cutoff is known; a DVS128's, times the photodiode's area to the power
of 1 and of 0. Those with pixels are for --sensor, all are for --electronics.
eres sensors NAME has the values of one, with their sources."""


def doctor(*, as_json: AsJson = False) -> int:
    """Show which renderers and extras work, cores, versions and folders.

    The exit code is 1 if Mitsuba is installed but no renderer works.
    """
    import os
    import platform
    import shutil
    import sys

    import eres_events
    from eres_render.cores import cores
    from eres_render.rendering.backend import probe_variants
    from eres_render.scene.load import scene_root
    from eres_render.storage.cache import cache_dir
    from tasks.extras import EXTRAS, install, is_installed
    from tasks.provenance import versions

    verdicts = probe_variants() if is_installed("mitsuba") else []
    table = terminal.Table("Mitsuba variant", "works", "remark")
    for verdict in verdicts:
        mark = Text("yes", "green") if verdict.works else Text("no", "red")
        remark = f"first render in {verdict.seconds:.1f} s" if verdict.works else verdict.reason
        table.add_row(verdict.name, mark, remark)
    best = next((verdict.name for verdict in verdicts if verdict.works), None)
    without = "no variant, as none works" if verdicts else "nothing, as Mitsuba is not installed"

    cache = cache_dir()
    free = shutil.disk_usage(next(p for p in (cache, *cache.parents) if p.exists())).free
    used = sum(f.stat().st_size for f in cache.rglob("*") if f.is_file())
    hiding = eres_events.shadows([os.getcwd()])
    facts = {
        **{
            f"extra {extra}": "installed" if all(map(is_installed, modules)) else install(extra)
            for extra, modules in EXTRAS.items()
        },
        "cores": str(cores()),
        'sensor, device="cuda"': _sensor_on_a_gpu(),
        "python": f"{platform.python_version()} at {sys.executable}",
        **versions(),
        **{f"import {n}": str(sys.modules[n].__file__) for n in ("eres_render", "sensor", "tasks")},
        **{f"{n} in scripts here": f"{file}, but for eres_events" for n, file in hiding.items()},
        "scenes": str(scene_root()),
        "cache": f"{cache}: {used / 1e9:.1f} GB used, {free / 1e9:.0f} GB free",
    }
    if as_json:
        works = {verdict.name: verdict.works for verdict in verdicts}
        terminal.show_json({"renders use": best, "works": works, **facts})
    else:
        if verdicts:
            terminal.show(table)
        terminal.say(f"renders use: {best or without}\n")
        terminal.show_pairs(facts)
    return 1 if verdicts and not best else 0


def _sensor_on_a_gpu() -> str:
    import numpy as np

    from sensor import SensorError, SensorModel, simulate

    try:
        simulate(np.ones((1, 1, 1)), [0.0], SensorModel(width=1, height=1), device="cuda")
    except SensorError as error:
        return f"no: {str(error).partition('here: ')[2]}"
    return "works"


def scenes() -> None:
    """List the packaged scenes."""
    table = terminal.Table("scene", "description", "camera speed", "length", "license")
    for name in eres_render.list_scenes():
        scene = eres_render.load_scene(name)
        speed = f"{scene.trajectory().mean_speed_mps(scene.duration_s):.3g} m/s"
        settings, length = scene.settings, f"{scene.duration_s:g} s"
        table.add_row(name, settings.title, speed, length, settings.license)
    terminal.show(table)


def sensors(
    camera: Annotated[
        Positional[str | None], arg(metavar="[CAMERA]", help="show all of one camera")
    ] = None,
    *,
    schema: bool = False,
    as_json: AsJson = False,
) -> None:
    """List event cameras.

    With the name or the file of a camera, list its values with units, 95 % intervals and sources.
    Unknown values show their defaults.

    Columns: pixels; their pitch; the light-sensitive share of their area; contrast thresholds of ON
    and OFF events; cutoff of the photoreceptor per lux, lent by another camera if unknown; kinds of
    noise; capacity of the bus in million events per second.

    Parameters
    ----------
    schema
        Print the JSON schema of a camera's file, for editors of TOML.
    """
    if schema:
        import json

        from sensor.cameras.schema import camera_schema

        print(json.dumps(camera_schema(), indent=2))
        return
    if as_json:
        names = camera_names() if camera is None else [camera]
        terminal.show_json({name: dict(_facts(find_camera(name))) for name in names})
    elif camera is not None:
        _show(find_camera(camera))
    else:
        table = terminal.Table("sensor", "pixels", "um", "fill", "C, %", "Hz/lux", "noise", "Mev/s")
        for each in map(find_camera, camera_names()):
            table.add_row(*_cells(each))
        terminal.show(table)
        terminal.say(_LEGEND)


def _facts(camera: EventCamera, known: bool = True) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the keys of a camera's file with their facts; with `known`, those that it states."""
    for name, facts in facts_of(camera):
        if KEYS[name].part != "name" and (not known or facts["kind"] or camera.states(name)):
            yield name, facts


def _cells(camera: EventCamera) -> Iterator[str]:
    """Yield the cells of a camera in the list."""
    yield camera.name
    yield "-" if camera.width is None else f"{camera.width}x{camera.height}"
    yield "-" if camera.pitch_um is None else f"{camera.pitch_um:g}"
    yield "-" if camera.fill_factor is None else f"{100 * camera.fill_factor:g} %"
    threshold = "-"
    if camera.states("threshold"):
        on, off = camera.contrast_threshold, camera.contrast_threshold_off
        off = on if off is None else off
        rise, fall = (f"{100 * abs(math.expm1(c)):.3g}" for c in (on, -off))
        smallest = camera.sources["threshold"].kind == "smallest"
        threshold = (rise if rise == fall else f"{rise}/{fall}") + (" min" if smallest else "")
    yield threshold
    ends = {f"{replace(camera, area_exponent=g).cutoff_at(1.0):.2g}" for g in (0.0, 1.0)}
    yield "-".join(sorted(ends, key=float)) + (" lent" if camera.borrows_cutoff else "")
    noise = {"leak": camera.leak_hz, "shot": camera.shot_noise_hz, "hot": camera.hot_pixel_fraction}
    yield ", ".join(kind for kind, amount in noise.items() if amount) or "-"
    yield "-" if camera.bus is None else f"{camera.bus_hz / 1e6:g}"


def _show(camera: EventCamera) -> None:
    """List all values of a camera."""
    about = camera.title or camera.name, str(camera.year or ""), camera.interface
    terminal.say(", ".join(filter(None, about)))
    table = terminal.Table("field", "value", "unit", "95 % interval", "kind", "source")
    for name, facts in _facts(camera, known=False):
        value, ends = facts["value"], facts["interval"]
        text = f"{value:.4g}" if isinstance(value, float) else str(value)
        table.add_row(
            name,
            "-" if value is None else text.lower() if isinstance(value, bool) else text,
            facts["unit"].removesuffix("1"),
            " to ".join(f"{end:.4g}" for end in ends),
            facts["kind"] or ("" if value is None else "default"),
            facts["source"],
        )
    terminal.show(table)


def methods(*, as_json: AsJson = False) -> None:
    """List the methods of each task.

    Where the function of a method is, --json tells.
    """
    from tasks.methods.networks import weights_of
    from tasks.registry import TASKS

    listed = []
    table = terminal.Table("task", "method", Column("note", no_wrap=True))
    for task, spec in TASKS.items():
        for name in spec.methods:
            method = spec.method(name)
            note = "diagnostic" if method.role == "diagnostic" else ""
            if method.network:
                note = "PyTorch" if weights_of(name) else "PyTorch, --weights"
            listed.append({"task": task, "method": name, "where": method.place, "note": note})
            table.add_row(task, name, note)
    if as_json:
        terminal.show_json(listed)
        return
    terminal.show(table)
    terminal.say("PyTorch: needs the extra `learned`; --weights: and a file that you bring.")
