"""The rules of a study: what contradicts itself, or what no scene, sensor or method can give.

`check` needs the study alone, and `Study` calls it. The others need its scenes, which a run checks
before it renders the first frame. A rule raises `StudyError` with field, value and limit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eres_render import list_scenes
from eres_render.errors import check_spp, suggestion
from sensor.cameras.camera import BUS_KEYS
from sensor.errors import SensorError
from sensor.model import cutoff_in_light
from tasks.errors import StudyError
from tasks.evaluation.settings import MAY_BE_ZERO, Flow, Tracking, unlike_two_poles
from tasks.registry import TASKS
from tasks.study.results.previews import INDEX_NAME
from tasks.tracking import KNOT_INTERVAL_S, PATH_S

if TYPE_CHECKING:
    from eres_render import Scene, Trajectory
    from sensor import EventCamera
    from tasks.evaluation.settings import Stretches, TaskSettings
    from tasks.study.settings import Render, Simulate, Study

MIN_RESOLUTION = 62
"""Least side of a frame, px: `sensor.statistics.slopes_by_pixel_size` needs it for its blocks."""

# Least and largest number of a field, where it is not just positive.
_RANGES: dict[str, tuple[float, float]] = {
    "render.resolution": (MIN_RESOLUTION, math.inf),
    "render.height": (MIN_RESOLUTION, math.inf),
    "render.max_displacement_px": (0.001, math.inf),
    "render.seed": (0, (1 << 32) - 1),
    "simulate.area_exponents": (0, 1),
    "simulate.distance_m": (0, 1_000_000),
}
_MIN_HZ = 1e-3  # warms up for a quarter of an hour
_MAX_THRESHOLD = math.log(65504 / 2**-24)  # frames are half-floats
_MAX_S = 2000.0  # sensors take less than 2147 s between two frames

POSES = 1001  # along a path: the median distance is within 1 mm on carpet and rocks
_FACING = 1e-9  # 1 - cosine between the axis of the camera and the normal


def check(study: Study) -> None:
    """Check a study alone: single numbers first, then what goes together."""
    _check_numbers("render", study.render)
    _check_numbers("simulate", study.simulate)
    for task, settings in study.evaluate.items():
        _check_numbers(f"evaluate.{task}", settings)
    check_spp(study.render.spp, StudyError)
    for rule in (_check_lists, _check_needs, _check_sensors, _check_tasks):
        rule(study)


def _check_numbers(section: str, values: Any) -> None:
    for field in fields(values):
        given, place = getattr(values, field.name), f"{section}.{field.name}"
        least, most = _RANGES.get(place, (0, math.inf))
        zero = MAY_BE_ZERO.items() <= field.metadata.items()
        for value in given if isinstance(given, tuple) else (given,):
            is_number = type(value) in (int, float)
            if is_number and (not least <= value <= most or (value == 0 and not zero)):
                low = "0 or more" if zero else "a positive number"
                low = f"at least {least}" if least else low
                high = f", at most {most}" if most < math.inf else ""
                raise StudyError(f"{place}: found {value}, expected {low}{high}")


def _check_lists(study: Study) -> None:
    """Refuse empty lists, values twice, and paths of scenes that the study does not have."""
    simulate, tracking = study.simulate, study.evaluate["tracking"]
    given = {field.name: getattr(simulate, field.name) for field in fields(simulate)}
    given["sensors"] = tuple(camera.name for camera in simulate.cameras) or None
    given["widths"] = simulate.widths or (None if simulate.sensors else ())
    tuples = {name: values for name, values in given.items() if isinstance(values, tuple)}
    lists: list[tuple[str, tuple[Any, ...]]] = [("scenes", study.scenes)]
    # In reverse, as cutoffs and speeds follow from later fields.
    lists += [(f"simulate.{name}", tuples[name]) for name in reversed(tuples)]
    if isinstance(tracking, Tracking) and tracking.methods:
        lists.append(("evaluate.tracking.sigmas_mm", tracking.sigmas_mm))
    planned = [(task, settings.methods) for task, _, settings in plans(study)]
    lists += [(f"evaluate.{task}, methods", methods) for task, methods in planned if methods]
    for place, values in lists:
        if not 0 < len(values) == len(set(values)):
            expected = "each once" if values else "one or more"
            raise StudyError(f"{place}: found {values or 'none'}, expected {expected}")
    for name in study.trajectories or {}:
        if name not in study.scenes:
            raise StudyError(f"trajectories: no scene {name!r}; {suggestion(name, study.scenes)}")


def _check_needs(study: Study) -> None:
    """Refuse settings that need another setting, or exclude one."""
    simulate = study.simulate
    for name, needed in (("area_exponents", "illuminance_lux"), ("distance_m", "speeds_m_s")):
        if getattr(simulate, name) is not None and getattr(simulate, needed) is None:
            raise StudyError(f"simulate.{name}: needs simulate.{needed}")
    programs = [name for name in simulate.simulators if name != "exact"]
    if simulate.frame_steps_px is not None and not programs:
        raise StudyError("simulate.frame_steps_px: needs 'v2e' in simulate.simulators")
    if programs and len(simulate.photoreceptors) > 1:
        raise StudyError(
            f"simulate.photoreceptors: found {len(simulate.photoreceptors)}, expected one beside "
            f"{programs[0]!r}, which has its own"
        )
    for step_px in simulate.frame_steps_px or ():
        times = step_px / study.render.max_displacement_px
        if abs(times - max(round(times), 1)) > 1e-9:
            raise StudyError(
                f"simulate.frame_steps_px: found {step_px:g} px, expected a multiple of "
                f"{study.render.max_displacement_px:g} px, render.max_displacement_px"
            )
    if simulate.distance_m is not None and simulate.same_lens:
        raise StudyError(
            "simulate.distance_m: cannot be combined with simulate.same_lens, which sets a "
            "distance for each width"
        )


def _check_sensors(study: Study) -> None:
    """Refuse sensors without a name, out of range, or finer than the frames."""
    simulate, render = study.simulate, study.render
    if not all(camera.name for camera in simulate.sensors):
        raise StudyError(
            "simulate.sensors: found a camera without a name; name it, or give its width in "
            "simulate.widths"
        )
    try:
        models = simulate.models(render)
    except SensorError as error:
        raise StudyError(f"simulate: {error}") from None
    for camera, _, model in models:
        width, height = render.seen_px(model.width, model.height)
        if model.width > width or model.height > height:
            raise StudyError(
                f"simulate.{_named(camera)}, finer than the {width}x{height} px of the frames in "
                "its view; increase render.resolution"
            )
        if model.cutoff_hz < _MIN_HZ:
            raise StudyError(
                f"simulate: found a cutoff of {model.cutoff_hz:g} Hz, expected at least "
                f"{_MIN_HZ:g} Hz"
            )
        if (least := min(model.contrast_threshold, model.off_threshold)) > _MAX_THRESHOLD:
            raise StudyError(
                f"simulate: found a contrast threshold of {least:g}, expected at most "
                f"{_MAX_THRESHOLD:.3g}, the largest log contrast of a frame"
            )


def _named(camera: EventCamera) -> str:
    """Return the field that a sensor is from, and what it is."""
    width, height = camera.size
    name = f"sensors: {camera.name!r} has" if camera.name else "widths: found"
    return f"{name} {width}x{height} px"


def plans(study: Study) -> Iterator[tuple[str, Stretches, TaskSettings]]:
    """Yield each task with its stretches and the settings for them."""
    for task, settings in study.evaluate.items():
        for stretches, planned in settings.plan().items():
            yield task, stretches, planned


def _check_tasks(study: Study) -> None:
    """Refuse fast methods at a speed of the study, and oracles beside another photoreceptor."""
    speeds = set() if study.simulate.speeds_m_s else {*study.simulate.speeds}
    for task, stretches, planned in plans(study):
        twice = speeds & {*stretches.speeds}
        if planned.methods and twice:
            raise StudyError(
                f"evaluate.{task}: has methods only for speed {max(twice):g}, but this speed is "
                "also in simulate.speeds, for all methods; choose another speed"
            )
        oracles = [n for n in planned.methods if TASKS[task].method(n).role == "diagnostic"]
        models = [model for *_, model in study.simulate.models(study.render) if oracles]
        programs = filter(None, study.simulate.emulations(study.render) if oracles else ())
        models += [program.of(models[0]) for program in programs]
        if unlike := next(filter(None, map(unlike_two_poles, models)), None):
            raise StudyError(
                f"evaluate.{task}.methods: {oracles[0]!r} assumes two poles with one cutoff, but a "
                f"sensor has {unlike}"
            )


def check_file(study: Study) -> None:
    """Check what only a file can have: settings without effect."""
    flow = study.evaluate["flow"]
    if isinstance(flow, Flow) and not flow.fast_methods:
        for name in ("fast_speed", "fast_scenes"):
            if getattr(flow, name) != getattr(Flow(), name):
                raise StudyError(f"evaluate.flow.{name}: needs evaluate.flow.fast_methods")
    names = [Path(scene).name.removesuffix(".xml") for scene in study.scenes]
    for task, stretches, planned in plans(study):
        if planned.methods and stretches.scenes and not {*stretches.scenes} & {*names}:
            raise StudyError(
                f"evaluate.{task}: has methods only for {', '.join(stretches.scenes)}, but the "
                f"study's scenes are {', '.join(names)}"
            )


def check_scenes(study: Study, scenes: Sequence[Scene]) -> None:
    """Refuse scenes of one name, by which rows and files identify them, or of one content, by which
    jobs do, and tasks for scenes that do not exist."""
    names = [scene.name for scene in scenes]
    for what, values in (("name", names), ("content", [scene.digest for scene in scenes])):
        first: dict[str, str] = {}
        for value, source in zip(values, study.scenes, strict=True):
            if (other := first.setdefault(value, source)) != source:
                raise StudyError(
                    f"scenes: {other!r} and {source!r} have the same {what}; list each scene once, "
                    "and give each folder or file its own name"
                )
    reserved = Path(INDEX_NAME).stem
    if reserved in names:
        raise StudyError(f"scenes: {reserved!r} is reserved for previews; rename the scene")
    for task, stretches, _ in plans(study):
        for name in stretches.scenes:
            if name not in (*names, *list_scenes()):  # a preset's scene may not be in a run
                raise StudyError(f"evaluate.{task}: no scene {name!r}; {suggestion(name, names)}")


def check_compares(methods: Collection[tuple[str, str]]) -> None:
    """Refuse do-nothing methods alone, of which there is nothing to report."""
    if all(name == TASKS[task].baseline for task, name in methods):
        listed = " and ".join(dict.fromkeys(name for _, name in methods))
        raise StudyError(
            f"evaluate: found only {listed}; add a method that uses the events and suits the scenes"
        )


def check_first_sensor(study: Study) -> None:
    """Refuse a first sensor that sees too few pixels; scaling is measured on what it sees."""
    camera = study.simulate.all_cameras(study.render)[0]
    width, height = study.render.seen_px(*camera.size)
    if min(width, height) < MIN_RESOLUTION:
        raise StudyError(
            f"simulate.{_named(camera)}, which see {width}x{height} px of the frames; the first "
            f"sensor must see at least {MIN_RESOLUTION} px on each side for the scaling statistics"
        )


def check_facing(scene: Scene, path: Trajectory) -> None:
    """Refuse a scene whose image does not just shrink when the camera is farther away."""
    plane = scene.plane
    if plane is not None:
        axes = path.pose(np.linspace(0.0, scene.duration_s, POSES))[:, :3, 2]
        if np.all(axes @ plane.normal < _FACING - 1.0):
            return
    what = "is not planar" if plane is None else "has a camera at an angle to the plane"
    raise StudyError(
        f"simulate.same_lens: {scene.name} {what}; the camera must look straight at a plane"
    )


def check_speeds(place: str, simulate: Simulate, render: Render) -> None:
    """Refuse speeds whose window is shorter than a microsecond or longer than half an hour."""
    least, most = render.window_s / _MAX_S, 1e6 * render.window_s
    for speed in simulate.speeds:
        if not least <= speed <= most:
            raise StudyError(
                f"{place}: found {speed:g} times the base speed, expected {least:.3g} to {most:g} "
                f"times; a window of {1e3 * render.window_s:g} ms would last "
                f"{render.window_s / speed:.3g} s"
            )


def check_buses(simulate: Simulate, render: Render) -> None:
    """Refuse a bus that carries less than one event per window, or a queue without a bus."""
    window_s = render.window_s / max(simulate.speeds)
    for camera in simulate.all_cameras(render):
        bus, own = simulate.readout(camera), [key for key in BUS_KEYS if camera.states(key)]
        if own and bus is None and "bus" not in own:
            raise StudyError(
                f"simulate.sensors: {camera.name!r}: {own[0]} needs a bus; give its bus or "
                "simulate.bus_mev_s"
            )
        if bus is not None and bus.row_overhead_s + 1 / bus.max_rate_hz > window_s:
            rate = [key for key in own if key != "fifo"]
            place = f"sensors: {camera.name!r}: {rate[0]}" if rate else "bus_mev_s"
            raise StudyError(
                f"simulate.{place}: an event takes {bus.row_overhead_s + 1 / bus.max_rate_hz:g} s "
                f"on the bus, but a window lasts only {window_s:g} s; choose a faster bus"
            )


def check_tracked(
    place: str, render: Render, simulate: Simulate, delay_s: float, left_s: float
) -> None:
    """Refuse speeds at which tracking lacks frames of its window or poses after it.

    `left_s` is what is left of the path at base speed when the last window starts.
    """
    for what, length_s, needed_s in (
        ("in a window", render.window_s, PATH_S + delay_s),
        ("after the start of the last window", left_s, PATH_S + KNOT_INTERVAL_S),
    ):
        most = length_s / needed_s
        if max(simulate.speeds) > most * (1 + 1e-9):
            raise StudyError(
                f"{place}: found {max(simulate.speeds):.3g} times the base speed, too fast for the "
                f"{1e3 * needed_s:g} ms of pose tracking {what}; expected at most "
                f"{_rounded(most, math.floor)}, or no methods in evaluate.tracking"
            )


def check_warm_up(stretches: Sequence[tuple[Render, Simulate, float]], scene: Scene) -> None:
    """Refuse a warm-up longer than the time between samples; name values that suit all tasks."""
    needs_s = [simulate.longest_warm_up_s + before_s for _, simulate, before_s in stretches]
    if not stretches or max(needs_s) <= 0.5 * stretches[0][0].every_s:
        return
    render, simulate, before_s = stretches[int(np.argmax(needs_s))]
    room_s = 0.5 * render.every_s
    reason = f"warm_up_s = {simulate.warm_up_s:g}"
    remedies = []
    if simulate.longest_warm_up_s > simulate.warm_up_s:
        camera, light, model = max(simulate.models(), key=lambda m: m[0].warm_up / m[2].cutoff_hz)
        name = f" of {camera.name!r}" if camera.name else ""
        reason = (
            f"{camera.warm_up:g} time constants of {model.cutoff_hz:g} Hz{name} at "
            f"speed {max(simulate.speeds):.3g}"
        )
        if all(sensors.warm_up_s + s < room_s for _, sensors, s in stretches):
            factor = max(sensors.longest_warm_up_s / (room_s - s) for _, sensors, s in stretches)
            least_hz = factor * model.cutoff_hz
            least_lux = factor * light.illuminance_lux or least_hz / cutoff_in_light(1.0)
            remedies.append(
                f"a cutoff of at least {_rounded(least_hz, math.ceil)} Hz "
                f"({_rounded(least_lux, math.ceil)} lux)"
            )
    every_s = _rounded(2 * max(needs_s), math.ceil)
    if all(float(every_s) <= _most_s(frames, scene) for frames, *_ in stretches):
        remedies.append(f"every_s = {every_s}")
    earlier = f" and {before_s:g} s of earlier windows" if before_s else ""
    raise StudyError(
        f"simulate: {scene.name} needs {max(needs_s):.3g} s of path before each window ({reason}"
        f"{earlier}), but render.every_s leaves {room_s:g} s, half of it"
        f"{'; use ' if remedies else ''}{', or '.join(remedies)}"
    )


def _rounded(value: float, to: Callable[[float], int]) -> str:
    """Return three digits of a limit, rounded to the side that is allowed."""
    unit = 10.0 ** (math.floor(math.log10(abs(value) or 1.0)) - 2)
    return f"{to(round(value / unit, 9)) * unit:g}"


def _most_s(render: Render, scene: Scene) -> float:
    """Return the longest time between samples with which one fits the path, s."""
    return 2 * (scene.duration_s - render.window_s)


def check_path(render: Render, scene: Scene) -> None:
    """Refuse a path without room for a sample."""
    most_s = _most_s(render, scene)
    if render.every_s > most_s * (1 + 1e-9):
        remedy = "shorten window_s or tracking_window_s"
        if most_s > 0:
            remedy = f"every_s can be at most {_rounded(most_s, math.floor)}"
        raise StudyError(
            f"render.every_s: no sample fits the path of {scene.name}, {scene.duration_s:g} s "
            f"long, with every_s = {render.every_s:g} and a window of {render.window_s:g} s; "
            f"{remedy}"
        )
