"""The rules of a study: what contradicts itself, or what no scene, sensor or method can give.

`check` needs the study alone, and `Study` calls it. The others need its scenes, which a run checks
before it renders the first frame. A rule raises `StudyError` with field, value and limit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eres_render import list_scenes
from eres_render.errors import check_positive, check_spp, suggestion
from sensor.cameras.camera import BUS_KEYS
from sensor.errors import SensorError
from sensor.model import cutoff_in_light
from tasks.errors import StudyError
from tasks.evaluation.settings import MAY_BE_ZERO, Flow, unlike_two_poles
from tasks.registry import TASKS
from tasks.study.results.previews import INDEX_NAME
from tasks.tracking import KNOT_INTERVAL_S, PATH_S

if TYPE_CHECKING:
    from eres_render import Scene, Trajectory
    from tasks.study.run.jobs import Job
    from tasks.study.settings import Render, Simulate, Study

_MIN_HZ = 1e-3  # warms up for a quarter of an hour
_MAX_THRESHOLD = math.log(65504 / 2**-24)  # frames are half-floats
_MAX_S = 2000.0  # sensors take less than 2147 s between two frames
_MIN_DISPLACEMENT_PX = 0.001
MIN_RESOLUTION = 62
"""Least side of a frame, px: `sensor.statistics.slopes_by_pixel_size` needs it for its blocks."""

POSES = 1001  # along a path: the median distance is within 1 mm on carpet and rocks
_FACING = 1e-9  # 1 - cosine between the axis of the camera and the normal


def check(study: Study) -> None:
    """Check a study alone: single numbers first, then what goes together."""
    _check_numbers("render", study.render)
    _check_numbers("simulate", study.simulate)
    for task, settings in study.evaluate.items():
        _check_numbers(f"evaluate.{task}", settings)
    for rule in (
        *(_check_lists, _check_frames, _check_widths, _check_sensors, _check_area_exponents),
        *(_check_names, _check_models, _check_distance, _check_tasks),
    ):
        rule(study)


def _check_lists(study: Study) -> None:
    """Refuse empty lists, values twice, and paths of scenes that the study does not have."""
    _check_list("scenes", study.scenes)
    for scene in study.trajectories or {}:
        if scene not in study.scenes:
            raise StudyError(
                f"trajectories: found {scene!r}, expected one of scenes; "
                f"{suggestion(scene, study.scenes)}"
            )
    for name in (
        *(
            name  # before the fields that follow from it
            for name in ("illuminance_lux", "speeds_m_s")
            if getattr(study.simulate, name) is not None
        ),
        *("cutoffs_hz", "contrast_thresholds", "speeds", "photoreceptors"),
        *(("widths",) if study.simulate.widths or not study.simulate.sensors else ()),
    ):
        _check_list(f"simulate.{name}", getattr(study.simulate, name))


def _check_frames(study: Study) -> None:
    """Refuse frames that the renderer or the scaling statistics cannot use."""
    for name, side in (("resolution", study.render.resolution), ("height", study.render.height)):
        if side is not None and side < MIN_RESOLUTION:
            raise StudyError(
                f"render.{name}: found {side} px, expected at least {MIN_RESOLUTION}, which "
                "the scaling statistics need"
            )
    check_spp(study.render.spp, StudyError)
    if (px := study.render.max_displacement_px) < _MIN_DISPLACEMENT_PX:
        raise StudyError(
            f"render.max_displacement_px: found {px}, expected at least {_MIN_DISPLACEMENT_PX} px"
        )
    if study.render.seed >= 1 << 32:
        raise StudyError(f"render.seed: found {study.render.seed}, expected less than 2^32")


def _check_widths(study: Study) -> None:
    """Refuse plain sensors finer than the frames."""
    if max(study.simulate.widths, default=0) > study.render.resolution:
        raise StudyError(
            f"simulate.widths: found {max(study.simulate.widths)} px, expected at most "
            f"{study.render.resolution}, which is render.resolution"
        )


def _check_sensors(study: Study) -> None:
    """Refuse a camera without a name or a grid, or finer than the frames."""
    for sensor in study.simulate.sensors:
        at = f"simulate.sensors: found {sensor.name!r}"
        render = study.render
        try:
            width, height = sensor.size
        except SensorError as error:
            raise StudyError(f"simulate.sensors: {error}") from None
        if not sensor.name:
            raise StudyError(
                f"simulate.sensors: found a camera of {width}x{height} px without a name, "
                "expected a name, or its width in simulate.widths"
            )
        seen = render.seen_px(width, height)
        if width > seen[0] or height > seen[1]:
            raise StudyError(
                f"{at} of {width}x{height} px, finer than the frames, of whose "
                f"{render.resolution}x{render.height_at(render.resolution)} px it sees "
                f"{seen[0]}x{seen[1]}, expected a larger render.resolution"
            )


def _check_area_exponents(study: Study) -> None:
    """Refuse exponents that are out of range, given twice, or without light in lux."""
    place, exponents = "simulate.area_exponents", study.simulate.area_exponents
    if exponents is None:
        return
    _check_list(place, exponents)
    if max(exponents) > 1:
        raise StudyError(f"{place}: found {max(exponents)}, expected numbers from 0 to 1")
    if study.simulate.illuminance_lux is None:
        raise StudyError(
            f"{place}: found {exponents} and cutoffs, expected simulate.illuminance_lux, from "
            "which cutoffs follow"
        )


def _check_names(study: Study) -> None:
    """Refuse two cameras of one name."""
    if study.simulate.sensors:
        _check_list("simulate.sensors", tuple(one.name for one in study.simulate.cameras))


def _check_models(study: Study) -> None:
    """Refuse sensors out of range, and buses that carry nothing at factors of the base speed."""
    try:
        models = [model for *_, model in study.simulate.models(study.render)]
    except SensorError as error:
        raise StudyError(f"simulate: {error}") from None
    slowest_hz = min(model.cutoff_hz for model in models)
    if slowest_hz < _MIN_HZ:
        raise StudyError(
            f"simulate: found a cutoff of {slowest_hz:g} Hz, expected at least {_MIN_HZ:g} Hz"
        )
    highest = max(min(model.contrast_threshold, model.off_threshold) for model in models)
    if highest > _MAX_THRESHOLD:
        raise StudyError(
            f"simulate: found a contrast threshold of {highest:g}, expected at most "
            f"{_MAX_THRESHOLD:.3g}, the log of the brightest over the darkest pixel of a frame"
        )
    if study.simulate.speeds_m_s is None:  # otherwise windows depend on the scene
        check_buses(study.simulate, study.render)


def _check_distance(study: Study) -> None:
    """Refuse a distance without speeds in m/s, or for widths that have their own."""
    place, found = "simulate.distance_m", study.simulate.distance_m
    if found is None:
        return
    check_positive(place, found, StudyError)
    if study.simulate.speeds_m_s is None:
        raise StudyError(
            f"{place}: found {found:g} m and speeds that are factors, expected simulate.speeds_m_s"
        )
    if study.simulate.same_lens:
        raise StudyError(
            f"{place}: found {found:g} m and simulate.same_lens, which gives each width a "
            "distance, expected one of them"
        )


def _check_tasks(study: Study) -> None:
    """Refuse settings that give a row twice or none, and oracles next to another
    photoreceptor."""
    tracking = study.evaluate["tracking"]
    if tracking.methods and getattr(tracking, "sigmas_mm", None) == ():
        raise StudyError("evaluate.tracking.sigmas_mm: found none, expected one or more")
    for task, settings in study.evaluate.items():
        for stretches, planned in settings.plan().items():
            if planned.methods:
                _check_list(f"evaluate.{task}, methods", planned.methods)
            speeds = () if study.simulate.speeds_m_s else study.simulate.speeds
            twice = set(stretches.speeds) & set(speeds)
            if planned.methods and twice:
                raise StudyError(
                    f"evaluate.{task}: found methods for a speed of {max(twice):g}, which "
                    "simulate.speeds has for all methods, expected another speed"
                )
        _check_diagnostics(study, task, settings.methods)


def _check_diagnostics(study: Study, task: str, methods: tuple[str, ...]) -> None:
    """Refuse oracles of two poles beside another photoreceptor."""
    asked = [name for name in methods if TASKS[task].method(name).role == "diagnostic"]
    models = [model for *_, model in study.simulate.models(study.render)] if asked else []
    for model in models:
        if found := unlike_two_poles(model):
            raise StudyError(
                f"evaluate.{task}.methods: found {asked[0]!r}, which is about two poles, and "
                f"{found}, expected only 'two_pole' with one cutoff"
            )


def check_file(study: Study) -> None:
    """Check what only a file can have: settings without effect."""
    _check_fast(study)
    _check_scenes_of_methods(study)


def _check_fast(study: Study) -> None:
    """Refuse a speed or scenes for fast methods of which there are none."""
    flow = study.evaluate["flow"]
    if not isinstance(flow, Flow) or flow.fast_methods:
        return
    for name in ("fast_speed", "fast_scenes"):
        if (found := getattr(flow, name)) != getattr(Flow(), name):
            raise StudyError(
                f"evaluate.flow.{name}: found {found!r}, expected it only with fast_methods"
            )


def _check_scenes_of_methods(study: Study) -> None:
    """Refuse methods that no scene of the file is for."""
    names = [Path(scene).name.removesuffix(".xml") for scene in study.scenes]
    for task, settings in study.evaluate.items():
        for stretches, planned in settings.plan().items():
            if planned.methods and stretches.scenes and not {*stretches.scenes} & {*names}:
                raise StudyError(
                    f"evaluate.{task}: found methods for {', '.join(stretches.scenes)} "
                    f"alone, expected a scene of the study: {', '.join(names)}"
                )


def check_scenes(study: Study, scenes: Sequence[Scene]) -> None:
    """Refuse scenes of one name, by which rows and files identify them, or of one content, by which
    jobs do, and tasks for scenes that do not exist."""
    names = [scene.name for scene in scenes]
    for scene, source in zip(scenes, study.scenes, strict=True):
        if names.count(scene.name) > 1:
            raise StudyError(
                f"scenes: found several named {scene.name!r}, such as {source}, expected different "
                "names of folders or files"
            )
        if scene.name == Path(INDEX_NAME).stem:
            raise StudyError(
                f"scenes: found {source}, expected another name of the folder or file: "
                f"previews/{INDEX_NAME} lists the pictures of all scenes"
            )
    by_content: dict[str, str] = {}
    for scene in scenes:
        other = by_content.setdefault(scene.digest, scene.name)
        if other != scene.name:
            raise StudyError(
                f"scenes: found {other!r} and {scene.name!r} with the same content, expected each "
                "scene once"
            )
    for task, settings in study.evaluate.items():
        for stretches in settings.plan():
            for name in stretches.scenes:
                if name not in (*names, *list_scenes()):  # a preset's scene may not be in a run
                    raise StudyError(
                        f"evaluate.{task}: found no scene {name!r}; {suggestion(name, names)}"
                    )


def check_compares(jobs: Iterable[Job]) -> None:
    """Refuse jobs of do-nothing methods alone, of which there is nothing to report."""
    asked = [
        (task, name)
        for job in jobs
        for task, settings in job.evaluate.items()
        for name in settings.methods
    ]
    if all(name == TASKS[task].baseline for task, name in asked):
        listed = " and ".join(dict.fromkeys(name for _, name in asked))
        raise StudyError(
            f"evaluate: found {listed} alone, expected a method that uses the events and suits the "
            "scenes"
        )


def check_first_sensor(study: Study) -> None:
    """Refuse a first sensor that sees too few pixels; scaling is measured on what it sees."""
    render = study.render
    sensor, _, first = next(study.simulate.models(render))
    width, height = render.seen_px(first.width, first.height)
    if min(width, height) < MIN_RESOLUTION:
        place, name = ("sensors", f"{sensor.name!r} of ") if sensor.name else ("widths", "")
        raise StudyError(
            f"simulate.{place}: found {name}{first.width}x{first.height} px first, which sees "
            f"{width}x{height} px of the frames, expected a first sensor that sees at least "
            f"{MIN_RESOLUTION} px on each side, which the scaling statistics need"
        )


def check_facing(scene: Scene, path: Trajectory) -> None:
    """Refuse a scene whose image does not just shrink when the camera is farther away."""
    plane = scene.plane
    if plane is not None:
        axes = path.pose(np.linspace(0.0, scene.duration_s, POSES))[:, :3, 2]
        if np.all(axes @ plane.normal < _FACING - 1.0):
            return
    found = "a scene with depth" if plane is None else "a camera that turns away from the plane"
    raise StudyError(f"simulate.same_lens: {scene.name}: found {found}, expected one that faces it")


def check_speeds(place: str, simulate: Simulate, render: Render) -> None:
    """Refuse speeds whose window is shorter than a microsecond or longer than half an hour."""
    window_us = 1e6 * render.window_s
    least, most = render.window_s / _MAX_S, window_us
    for speed in simulate.speeds:
        if not least <= speed <= most:
            raise StudyError(
                f"{place}: found {speed:g} times the base speed, at which a window of "
                f"{1e3 * render.window_s:g} ms lasts {render.window_s / speed:.3g} s, expected "
                f"{least:.3g} to {most:g}"
            )


def check_buses(simulate: Simulate, render: Render) -> None:
    """Refuse a bus that carries less than one event per window, or a queue without a bus."""
    window_s = render.window_s / max(simulate.speeds)
    for one in simulate.all_cameras(render):
        bus, own = simulate.readout(one), [key for key in BUS_KEYS if one.states(key)]
        if own and bus is None and "bus" not in own:
            raise StudyError(
                f"simulate.sensors: {one.name!r}: {own[0]}: found no bus, expected one of its own "
                "or simulate.bus_mev_s"
            )
        if bus is None or bus.row_overhead_s + 1 / bus.max_rate_hz <= window_s:
            continue
        overhead_s = bus.row_overhead_s
        expected = (
            f"at least {1e-6 / (window_s - overhead_s):g}"
            if overhead_s < window_s
            else f"a row_overhead of less than {window_s:g} s"
        )
        decisive = [key for key in own if key != "fifo"]
        place = f"sensors: {one.name!r}: {decisive[0]}" if decisive else "bus_mev_s"
        raise StudyError(
            f"simulate.{place}: found {bus.max_rate_hz / 1e6:g} Mev/s"
            f"{f' with a row_overhead of {overhead_s:g} s' if overhead_s else ''}, which carries "
            f"no event in a window of {1e3 * window_s:g} ms, expected {expected}"
        )


def _check_list(place: str, values: tuple[Any, ...]) -> None:
    if not values:
        raise StudyError(f"{place}: found none, expected one or more")
    if len(set(values)) < len(values):
        raise StudyError(f"{place}: found {values}, expected each of them once")


def _check_numbers(section: str, values: Any) -> None:
    for one in fields(values):
        found, place = getattr(values, one.name), f"{section}.{one.name}"
        for value in found if isinstance(found, tuple) else (found,):
            if type(value) not in (int, float) or value > 0:
                continue
            if not MAY_BE_ZERO.items() <= one.metadata.items():
                raise StudyError(f"{place}: found {value}, expected a positive number")
            if value != 0:
                raise StudyError(f"{place}: found {value}, expected 0 or more")


def check_tracked(
    place: str, render: Render, simulate: Simulate, delay_s: float, left_s: float
) -> None:
    """Refuse speeds at which tracking lacks frames of its window or poses after it.

    Parameters
    ----------
    left_s
        What is left of the scene's path when the last window starts, at base speed.
    """
    needs = (
        ("windows", render.window_s, PATH_S + delay_s),
        ("a path after the last start", left_s, PATH_S + KNOT_INTERVAL_S),
    )
    for what, there_s, needed_s in needs:
        most = there_s / needed_s
        if max(simulate.speeds) > most * (1 + 1e-9):
            raise StudyError(
                f"{place}: found {max(simulate.speeds):.3g} times the base speed, with {what} "
                f"shorter than the {1e3 * needed_s:g} ms of pose tracking, expected at most "
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
    nearest = []
    if simulate.longest_warm_up_s > simulate.warm_up_s:
        camera, light, model = max(
            simulate.models(), key=lambda found: found[0].warm_up / found[2].cutoff_hz
        )
        slowest_hz, lux = model.cutoff_hz, light.illuminance_lux
        name = f" of {camera.name!r}" if camera.name else ""
        reason = (
            f"{camera.warm_up:g} time constants of {slowest_hz:g} Hz{name} at "
            f"speed {max(simulate.speeds):.3g}"
        )
        if all(one.warm_up_s + before_s < room_s for _, one, before_s in stretches):
            factor = max(
                one.longest_warm_up_s / (room_s - before_s) for _, one, before_s in stretches
            )
            least_hz = factor * slowest_hz
            least_lux = factor * lux or least_hz / cutoff_in_light(1.0)
            nearest.append(
                f"at least {_rounded(least_hz, math.ceil)} Hz "
                f"({_rounded(least_lux, math.ceil)} lux)"
            )
    every_s = _rounded(2 * max(needs_s), math.ceil)
    if all(float(every_s) <= _most_s(one, scene) for one, *_ in stretches):
        nearest.append(f"every_s = {every_s}")
    earlier = f" and {before_s:g} s of earlier windows" if before_s else ""
    raise StudyError(
        f"simulate: {scene.name} needs {max(needs_s):.3g} s of path before each window, {reason}"
        f"{earlier}, expected at most {room_s:g} s, half of render.every_s"
        f"{': ' if nearest else ''}{', or '.join(nearest)}"
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
        if most_s <= 0:
            raise StudyError(
                f"render.window_s or tracking_window_s: found {render.window_s:g} s, expected less "
                f"than the path of {scene.name}, {scene.duration_s:g} s long"
            )
        raise StudyError(
            f"render.every_s: found {render.every_s:g} s, with which no sample fits the path of "
            f"{scene.name}, {scene.duration_s:g} s long, expected at most "
            f"{_rounded(most_s, math.floor)}"
        )
