"""Commands that list: this machine, scenes, cameras, methods."""

from __future__ import annotations

from tasks.cli import terminal
from tasks.cli.table import Table


def doctor() -> int:
    """Show this machine: renderers that work, cores, versions, and places of code and cache.

    The exit code is 1 if no renderer works.
    """
    from tasks.cli.doctor import diagnose

    return diagnose(terminal.out)


def scenes() -> None:
    """List the packaged scenes."""
    from eres_render import list_scenes, load_scene

    table = Table("scene", "description", "camera speed", "length", "license", box=None)
    for name in list_scenes():
        scene = load_scene(name)
        table.add_row(
            name,
            scene.settings.title,
            f"{scene.trajectory().mean_speed_mps(scene.duration_s):.3g} m/s",
            f"{scene.duration_s:g} s",
            scene.settings.license,
        )
    terminal.out.print(table, crop=False)


def sensors() -> None:
    """List the event cameras of the paper's Table 1, for `eres simulate --sensor`."""
    from sensor.presets import SENSORS

    table = Table(
        "sensor", "supplier", "camera", "year", "pixels", "interface", "max Mev/s", box=None
    )
    for name, preset in SENSORS.items():
        rate = preset.max_bandwidth_mev_s
        table.add_row(
            name,
            preset.supplier,
            preset.camera,
            str(preset.year),
            f"{preset.model.width}x{preset.model.height}",
            preset.interface or "-",
            "-" if rate is None else f"{rate:g}",
        )
    terminal.out.print(table, crop=False)


def methods() -> None:
    """List the methods of each task."""
    from tasks.registry import TASKS

    table = Table("task", "method", "where", "note", box=None)
    for task, spec in TASKS.items():
        for name, where in spec.methods.items():
            note = "needs --weights" if name in spec.networks else ""
            table.add_row(task, name, where, "diagnostic" if name in spec.diagnostics else note)
    terminal.out.print(table, crop=False)
