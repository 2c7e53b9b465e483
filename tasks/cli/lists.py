"""Commands that list: this machine, scenes, cameras, methods."""

from __future__ import annotations

from typing import Annotated

from rich.table import Column
from tyro.conf import Positional, arg

from tasks.cli import terminal
from tasks.cli.table import Table


def doctor() -> int:
    """Show which renderers work, cores, versions and folders.

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


def sensors(
    profile: Annotated[
        Positional[str | None], arg(metavar="[PROFILE]", help="show all of one profile")
    ] = None,
) -> None:
    """List event cameras, and profiles of their electronics.

    Cameras are for `eres simulate --sensor`, profiles for `--profile`.

    The cameras are those of the paper's Table 1. With the name or file of a profile, list its known
    values with units, 95 % intervals and sources, the bounds of others, and the unknown ones.
    """
    if profile is not None:
        _show(profile)
        return
    from sensor.presets import SENSORS

    table = Table(
        *("sensor", "supplier", "camera", "year", "pixels", "pitch", "fill", "interface"),
        "max Mev/s",
        box=None,
    )
    for name, preset in SENSORS.items():
        rate, pitch, fill = preset.max_bandwidth_mev_s, preset.pixel_pitch_um, preset.fill_factor
        table.add_row(
            name,
            preset.supplier,
            preset.camera,
            str(preset.year),
            f"{preset.model.width}x{preset.model.height}",
            "-" if pitch is None else f"{pitch:g} um",
            "-" if fill is None else f"{100 * fill:g} %",
            preset.interface or "-",
            "-" if rate is None else f"{rate:g}",
        )
    terminal.out.print(table, crop=False)
    _list_profiles()


def _list_profiles() -> None:
    from sensor.profiles import find_profile, profile_names

    table = Table("profile", "electronics of", "known", "unknown", box=None)
    for name in profile_names():
        found = find_profile(name)
        table.add_row(name, found.title, ", ".join(found.known), ", ".join(found.unknown))
    terminal.out.print()
    terminal.out.print(table, crop=False)


def _show(name: str) -> None:
    """List the known and unknown values of a profile."""
    from sensor.profiles import Sourced, find_profile
    from sensor.profiles.quantities import FIELDS, QUANTITIES

    profile = find_profile(name)
    terminal.out.print(profile.title)
    table = Table("field", "value", "unit", "95 % interval", "source", box=None)
    for field in FIELDS:
        found = profile.known.get(field) or profile.bounds.get(field)
        if found is None:
            table.add_row(field, "unknown", "", "", "")
            continue
        value = found.value if isinstance(found, Sourced) else "bound"
        low_high = "" if found.interval is None else "{:.4g} to {:.4g}".format(*found.interval)
        table.add_row(
            field,
            value if isinstance(value, str) else f"{value:.4g}",
            "" if field not in QUANTITIES else next(iter(QUANTITIES[field].units)),
            low_high,
            found.source,
        )
    terminal.out.print(table, crop=False)


def methods() -> None:
    """List the methods of each task."""
    from tasks.methods.networks import weights_of
    from tasks.registry import TASKS

    table = Table("task", "method", "where", Column("note", no_wrap=True), box=None)
    for task, spec in TASKS.items():
        for name, where in spec.methods.items():
            note = "diagnostic" if name in spec.diagnostics else ""
            if name in spec.networks:
                note = "needs PyTorch" if weights_of(name) else "needs PyTorch, --weights"
            table.add_row(task, name, where, note)
    terminal.out.print(table, crop=False)
