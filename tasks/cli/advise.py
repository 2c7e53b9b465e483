"""The command that says which width to choose."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from tasks.advice.law import NEAR_PX
from tasks.cli import terminal
from tasks.cli.app import AsJson
from tasks.errors import TaskError

if TYPE_CHECKING:
    from tasks.advice.advise import Advice, Sensor

_NEAR_DB = 0.1  # margins that decide nothing
_HEAD = """
Hz, lag: if the cutoff does not depend on the area of a pixel, and if it is
proportional to it."""
_BY_LAW = """Finer wins, by dB: event integration against the next
coarser sensor, in stored cases near the first lag. Mev/s: what stored scenes
say for a contrast threshold of 0.2. Two equal poles are assumed. The law is
about sensors of one cutoff: where cutoffs differ, the spectrum of a random
texture chooses. A coarser sensor has larger pixels: merging or cropping the
events of a fine one does not make it."""
_BY_IMAGE = """PSNR: of event integration at the finest width, as the
spectrum of the image predicts it for both. The image is taken to be as wide
as the field of view and, unless its pixels are floats, to be sRGB: its camera
may have another curve. Mev/s: what stored scenes say for a contrast threshold
of 0.2. A coarser sensor has larger pixels: merging or cropping the events of
a fine one does not make it."""


def advise(
    speed: float,
    distance: float,
    fov: float | None = None,
    focal_length: float | None = None,
    lux: float | None = None,
    cutoff: float | None = None,
    sensor: Annotated[tuple[str, ...], arg(metavar="CAMERA...", help_behavior_hint="")] = (),
    pitch: float | None = None,
    widths: Annotated[tuple[int, ...], arg(metavar="INT...", help_behavior_hint="")] = (),
    image: Path | None = None,
    direction: float | None = None,
    window: float | None = None,
    as_json: AsJson = False,
) -> None:
    """Say which width to choose for a speed, a distance, a lens and a light.

    The lag of a sensor is how far the image moves during the delay of its pixels. The finer of two
    widths has the better images by event integration if its lag is less than 1 px: see
    docs/what_decides.md. With an image of the scene, its spectrum decides in place of that rule,
    also for photoreceptors of one pole. The lag and the choice are given for a cutoff that does not
    depend on the area of a pixel (area^0), and for one that is proportional to it (area^1).

    Parameters
    ----------
    speed
        Speed of the camera relative to what it sees, along the image, m/s.
    distance
        Distance of what it sees, m.
    fov
        Horizontal field of view, degrees; 60 by default.
    focal_length
        Focal length in place of the field of view, mm.
    lux
        Light on the scene, lux, which decides the cutoff.
    cutoff
        Cutoff of the finest sensor in place of the light, Hz.
    sensor
        Camera: a name (`eres sensors` lists them), or a TOML file; it is compared with sensors of
        larger pixels. Or several cameras, to compare them with each other.
    pitch
        Side of a pixel of the finest sensor, um, to go with a focal length without a camera.
    widths
        Widths to compare, px; by default 128, 240, 346, 640 and 1280, up to that of the camera.
    image
        Image of the scene, as wide as the field of view and as the finest width: sRGB, or EXR.
    direction
        Where it moves: 0 along its rows, 90 along its columns, degrees; by default the mean of the
        squared errors at 0, 45, 90 and 135.
    window
        Length of the window whose events are added up, s; 0.05 by default, as in the study.
    """
    from sensor import find_camera, plain_camera
    from tasks.advice.advise import FOV_DEG, WIDTHS, WINDOW_S, View, fov_of, ladder, line_up
    from tasks.advice.advise import advise as advise_of

    cameras = [*map(find_camera, sensor)]
    if fov is not None and focal_length is not None:
        raise TaskError("give --fov or --focal-length, not both")
    if cameras and pitch is not None:
        raise TaskError("give --sensor or --pitch, not both")
    for option, value in (("direction", direction), ("window", window)):
        if value is not None and image is None:
            raise TaskError(f"--{option} is only for --image")
    if len(cameras) > 1 and (focal_length is not None or widths):
        raise TaskError(
            "several cameras are compared as they are in one field of view: give --fov, and "
            "neither --focal-length nor --widths"
        )
    chip = cameras[0] if cameras else replace(plain_camera(max(widths or WIDTHS)), pitch_um=pitch)
    full, _ = chip.size
    if focal_length is not None:
        fov = fov_of(full, chip.pitch_um, focal_length)
    view = View(
        speed=speed,
        distance=distance,
        fov=FOV_DEG if fov is None else fov,
        lux=lux,
        cutoff=cutoff,
        image=image,
        direction=direction,
        window=WINDOW_S if window is None else window,
    )
    if len(cameras) > 1:
        sensors = line_up(view, cameras)
    else:
        sensors = ladder(view, chip, widths or [*(w for w in WIDTHS if w < full), full])
    advice = advise_of(view, sensors)
    if as_json:
        terminal.show_json(advice)
        return
    rule = ("PSNR, dB",) if image else ("finer wins", "dB")
    table = terminal.Table("sensor", "px/s", "Hz", "lag, px", *rule, "Mev/s", "bus")
    for each in advice.sensors:
        table.add_row(*_cells(each))
    picture = f", {image.name}" if image else ""
    where = "" if direction is None else f" along {direction:g} degrees"
    terminal.say(f"{speed:g} m/s at {distance:g} m, {view.fov:.3g} degrees{picture}{where}")
    terminal.show(table)
    terminal.say("", *_words(advice), f"{_HEAD} {_BY_IMAGE if image else _BY_LAW}")


def _cells(sensor: Sensor) -> Iterator[str]:
    """Yield the cells of a sensor."""
    rates, bus = "-", "-"
    if sensor.events_hz is not None:
        rates = " to ".join(_short(1e-6 * rate, 2) for rate in sensor.events_hz)
        if sensor.bus_hz < math.inf:
            bus = f"{100 * sensor.events_hz[1] / sensor.bus_hz:.0f} %"
    yield sensor.name
    yield _short(sensor.speed_px_s)
    yield ", ".join(dict.fromkeys(map(_short, sensor.cutoffs_hz)))
    yield ", ".join(dict.fromkeys(f"{lag:.2f}" for lag in sensor.lags_px))
    if sensor.predicted_db:
        yield ", ".join(f"{value:.2f}" for value in sensor.predicted_db)
    else:
        won = sensor.finer_won
        yield "-" if won is None else f"{100 * won:.0f} % of {sensor.cases}"
        yield "-" if sensor.margin_db is None else f"{sensor.margin_db:+.2f}"
    yield rates
    yield bus


def _short(value: float, digits: int = 3) -> str:
    """Return a number with few digits, and without an exponent."""
    return f"{float(f'{value:.{digits}g}'):.15g}"


def _words(advice: Advice) -> Iterator[str]:
    """Yield what to choose, how sure that is, and where to see it."""
    first, *others = advice.choices
    index = [sensor.name for sensor in advice.sensors].index(first.sensor)
    predicted = [sensor.predicted_db[0] for sensor in advice.sensors if sensor.predicted_db]
    share = "no stored case has nearly its lag"
    if advice.right is not None:
        share = f"the law is right in {100 * advice.right:.0f} % of stored cases near these lags"
    if predicted:
        share = "by the image"
        rest = [(s.predicted_db[0], s.name) for s in advice.sensors if s.name != first.sensor]
        if rest:
            second, name = max(rest)
            share += f", which predicts {predicted[index] - second:+.2f} dB over {name}"
    yield f"choose {first.sensor}: {share}"
    for other in others:
        if other.sensor != first.sensor:
            yield f"or {other.sensor}, if the cutoff is proportional to the area of a pixel"
    for coarser, finer in pairwise(advice.sensors[max(index - 1, 0) : index + 2]):
        if predicted:
            is_near = abs(finer.predicted_db[0] - coarser.predicted_db[0]) < _NEAR_DB
        else:
            is_near = NEAR_PX[0] <= finer.lags_px[0] <= NEAR_PX[1]
        if is_near:
            yield f"{finer.name} is about as good as {coarser.name}, which has fewer events"
    yield f"delay {_short(1e3 * first.delay_s)} ms, or {_short(1e3 * first.late_m)} mm of the way"
    if case := advice.nearest:
        yield (
            f"nearest stored case: {case.run}, {case.scene}, {case.cutoff_hz:g} Hz, speed "
            f"{_short(case.speed)}:\n  at a lag of {case.lag_px:.2f} px, {case.width} px have "
            f"{case.margin_db:+.2f} dB over {case.coarser} px"
        )
