"""Simulate a sensor on frames, and write its events."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eres_render import RadianceSequence
from eres_render.progress import Progress, silent
from eres_render.storage.json_values import use_python_numbers
from sensor import Events, LiveCamera, Readout, ReadoutReport, SensorModel, read_out, stream
from sensor.formats import FORMATS, Format, find_format, write_events
from sensor.formats.header import Value
from sensor.optics import crop_to_aspect
from tasks.errors import TaskError
from tasks.events.imu import imu_to_add
from tasks.events.imu_options import NO_IMU, ImuOptions
from tasks.events.overwriting import check_new
from tasks.events.truth import AddTo, truth_to_add
from tasks.footage import Footage
from tasks.origin import origin_of
from tasks.warm_up import TIME_CONSTANTS, warn_of_frames

_log = logging.getLogger(__name__)

_AT_ONCE = 8  # frames whose number is not known before
_SAMPLES_ALONG = 3  # of frames along a pixel, from which on a fill factor acts, see `SensorModel`

RadianceFrames = RadianceSequence | Footage


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulationOptions:
    """How a sensor is simulated on frames, and how its events are written.

    Parameters
    ----------
    speed
        Factor by which the scene moves faster than in the frames: their times are divided by it.
    seed
        Seed of everything random in the sensor.
    readout
        The bus on which the events leave; None if all leave when they fire.
    warm_up
        Shortest warm-up before a clip's window without a warning, in time constants of the
        photoreceptor.
    assumes
        What the simulation assumes, in words, for the file's origin.
    format
        As for `write_events`.
    overwrite
        Whether to replace an existing file.

    Raises
    ------
    TaskError
        The speed is not above 0 and below 1e9, or the seed is not in 0..2^63 - 1.
    """

    speed: float = 1.0
    seed: int = 0
    readout: Readout | None = None
    warm_up: float = TIME_CONSTANTS
    assumes: str = ""
    format: str | None = None
    overwrite: bool = False

    def __post_init__(self) -> None:
        use_python_numbers(self)
        if not 0 < self.speed < FASTEST:
            raise TaskError(f"speed: found {self.speed}, expected above 0 and below {FASTEST:g}")
        if not 0 <= self.seed < 1 << 63:
            raise TaskError(f"seed: found {self.seed}, expected an integer in 0..2^63 - 1")


FASTEST = 1e9
"""Speeds are below this factor."""

AS_IN_THE_FRAMES = SimulationOptions()


def warn_of_fill_factor(frames: RadianceFrames, model: SensorModel) -> None:
    """Warn if frames are too coarse for the fill factor of a sensor."""
    _, columns = crop_to_aspect(frames.height, frames.width, model.height, model.width)
    along = (columns.stop - columns.start) / model.width
    if model.fill_factor < 1 and 1 <= along < _SAMPLES_ALONG:  # less than 1 is refused later
        _log.warning(
            "fill factor %g has %s effect: a sensor pixel spans %.2g px of the frames and needs %d",
            model.fill_factor,
            "no" if along == 1 else "little",
            along,
            _SAMPLES_ALONG,
        )


def seen_part(frames: RadianceFrames, path: Path, model: SensorModel) -> tuple[slice, slice]:
    """Return the central rows and columns of frames that a sensor sees."""
    rows, columns = crop_to_aspect(frames.height, frames.width, model.height, model.width)
    height, width = rows.stop - rows.start, columns.stop - columns.start
    if model.height > height or model.width > width:
        raise TaskError(
            f"{path}: the sensor has {model.width}x{model.height} px, but sees {width}x{height} px "
            f"of {frames.width}x{frames.height} px frames; choose a sensor with fewer pixels"
        )
    return rows, columns


def simulate_sequence(
    sequence: RadianceSequence,
    model: SensorModel,
    out: str | Path,
    options: SimulationOptions = AS_IN_THE_FRAMES,
    *,
    truth_step_s: float | None = None,
    imu: ImuOptions = NO_IMU,
    on_progress: Progress = silent,
) -> tuple[int, ReadoutReport | None]:
    """Write the events that a sensor fires on a sequence.

    If the sensor's shape differs from the frames', the sensor sees their center, so that its pixels
    are square. All events are written, including those of the warm-up; the file's origin states the
    start and end of the window. Warns if the warm-up is short for the sensor, or if frames are far
    apart.

    If the poses of the path do not start at time 0, event times have the same zero as the poses, at
    any speed.

    Parameters
    ----------
    sequence
        The frames.
    model
        The sensor.
    out
        The file.
    options
        Speed, seed, bus, and how to write the file.
    truth_step_s
        Step of the ground truth to add to the file, seconds (see `truth_to_add`); None adds none.
    imu
        IMU to add to the file, if it has a rate; see `imu_to_add`.
    on_progress
        Called after each frame.

    Returns
    -------
    The number of events, and the report of the bus, None without a bus.

    Raises
    ------
    TaskError
        The file exists, its format cannot store ground truth or an IMU, or the sensor is finer than
        the frames.
    """
    out = Path(out)
    check_new(out, options.overwrite, sequence.folder)
    seen_part(sequence, sequence.folder, model)  # refused before ground truth is prepared
    speed = options.speed
    warn_of_frames(sequence, model.cutoff_hz, speed, time_constants=options.warm_up)
    additions: list[AddTo] = []
    imu.check()
    for name, wanted in (("truth", truth_step_s), ("imu", imu.imu)):
        if wanted is not None and find_format(out, options.format, new=True).name != "dsec":
            raise TaskError(f"{out}: only DSEC's format (.h5) can store {name}")
    if truth_step_s is not None:
        additions.append(truth_to_add(sequence, model, speed, truth_step_s))
    if imu.imu is not None:
        additions.append(imu_to_add(sequence, imu, speed, options.seed))
    return simulate_frames(
        sequence,
        model,
        out,
        options,
        origin=origin_of(sequence, speed),
        add=lambda path: [add(path) for add in additions],
        on_progress=on_progress,
    )


def simulate_frames(
    frames: RadianceFrames,
    model: SensorModel,
    out: str | Path,
    options: SimulationOptions = AS_IN_THE_FRAMES,
    *,
    origin: Mapping[str, Value],
    between: Callable[[Footage], Iterable[tuple[float, NDArray[np.float32]]]] | None = None,
    add: Callable[[Path], object] | None = None,
    on_events: Callable[[Events], object] | None = None,
    on_progress: Progress = silent,
) -> tuple[int, ReadoutReport | None]:
    """Write the events that a sensor fires on frames.

    If the sensor's shape differs from the frames', the sensor sees their center, so that its pixels
    are square.

    Parameters
    ----------
    frames
        The frames.
    model
        The sensor.
    out
        The file.
    options
        Speed, seed, bus, and how to write the file.
    origin
        Where the frames come from, for the file.
    between
        Function that adds frames to footage, and yields all with their times.
    add
        As for `write_events`.
    on_events
        Called with the events of each part, before the bus.
    on_progress
        Called after each of `frames`.

    Returns
    -------
    The number of events, and the report of the bus, None without a bus.

    Raises
    ------
    TaskError
        The file exists, or its format cannot store the time of the last frame, counted from the
        first frame.
    """
    out = Path(out)
    check_new(out, options.overwrite)
    _check_end(frames, out, options)
    facts = {
        **origin,
        "frames_width": frames.width,
        "frames_height": frames.height,
        "speed": float(options.speed),
        "seed": options.seed,
        **({"assumes": options.assumes} if options.assumes else {}),
    }
    rows, columns = crop_to_aspect(frames.height, frames.width, model.height, model.width)

    def counted() -> Iterator[NDArray[np.float32]]:
        for k, frame in enumerate(frames, start=1):
            yield frame
            on_progress("simulating", k, len(frames))

    def pushed(rest: Iterator[tuple[float, NDArray[np.float32]]]) -> Iterator[Events]:
        count = 0
        with LiveCamera(model, seed=options.seed) as live:
            while part := list(islice(rest, _AT_ONCE)):
                times_s, light = zip(*part, strict=True)
                seen = np.stack([frame[rows, columns] for frame in light])
                yield live.push(seen, np.array(times_s) / options.speed)
                count += len(part)
            yield live.finish()
        _log.info("%d frames after interpolation", count)

    parts: Iterable[Events]
    if isinstance(frames, Footage) and between is not None:
        parts = pushed(iter(between(replace(frames, frames=counted))))
    else:
        central = (frame[rows, columns] for frame in counted())
        parts = stream(central, frames.t_s / options.speed, model, seed=options.seed)
    if on_events is not None:
        parts = _shown(parts, on_events)
    leaving = None
    if options.readout is not None:
        facts |= {f"readout_{name}": value for name, value in asdict(options.readout).items()}
        parts = leaving = read_out(parts, options.readout)
    offset_us = frames.t_offset_us
    if offset_us:
        parts = (part.later(offset_us) for part in parts)
    count = write_events(
        out,
        parts,
        format=options.format,
        origin=facts,
        t_offset_us=offset_us,
        add=add,
        overwrite=options.overwrite,
    )
    return count, None if leaving is None else leaving.report


def _shown(parts: Iterable[Events], on_events: Callable[[Events], object]) -> Iterator[Events]:
    for part in parts:
        on_events(part)
        yield part


def _check_end(frames: RadianceFrames, out: Path, options: SimulationOptions) -> None:
    """Refuse frames that last longer than the format of the file can store."""
    offset_us = frames.t_offset_us
    times_us = 1e6 * frames.t_s[[0, -1]] / options.speed
    start_us, last_us = (round(min(t_us, 2.0**62)) + offset_us for t_us in times_us.tolist())

    def end_us(format: Format) -> float:
        return math.inf if format.end_us is None else format.end_us(start_us, offset_us)

    chosen = find_format(out, options.format, new=True)
    if last_us >= end_us(chosen):
        able = [each for each in FORMATS.values() if each.write and last_us < end_us(each)]
        suffixes = dict.fromkeys(suffix for each in able for suffix in each.suffixes[:1])
        raise TaskError(
            f"{out}: the frames last until {last_us} us, but {chosen.title} stores only times "
            f"below {end_us(chosen)} us; use {', '.join(suffixes)}"
        )
