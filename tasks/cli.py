"""The `eres` command: arguments in, library calls, results on stdout, errors in one line."""

from __future__ import annotations

import inspect
import logging
import math
import re
import sys
from collections import Counter
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from rich.console import Console
from rich.logging import RichHandler
from rich.markup import escape
from rich.table import Column
from tyro.conf import DisallowNone, FlagCreatePairsOff, OmitArgPrefixes, Positional, arg

from eres_render.errors import RenderError
from sensor.errors import EventError, SensorError
from tasks import DISTRIBUTION
from tasks.errors import StudyError, TaskError
from tasks.events.sensor_options import IDEAL_PIXEL, NO_BUS, BusOptions, PixelOptions
from tasks.row import Row
from tasks.table import Table

app = tyro.extras.SubcommandApp()
overview = tyro.extras.SubcommandApp()
_out = Console()
_err = Console(stderr=True)


def command(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make a function a command: `eres --help` shows its first line, its own --help all of it."""
    # tyro keeps the line breaks within what is said of an argument; a terminal has its own.
    text = re.sub(r"\n {8}(?=\S)", " ", inspect.cleandoc(function.__doc__ or ""))
    function.__doc__ = text
    overview.command(help=text.partition("\n")[0])(function)
    return app.command(function)


RunFolder = Annotated[Positional[Path], arg(metavar="RUN", help="folder of a run")]


@command
def doctor() -> int:
    """Show what works on this machine: renderer, threads, versions, where things are loaded from.

    Exit code 1 if nothing here can render.
    """
    from tasks.doctor import diagnose

    return diagnose(_out)


@command
def scenes() -> None:
    """List the packaged scenes."""
    from eres_render import list_scenes, load_scene

    table = Table("scene", "what it is", "camera speed", "length", "licence", box=None)
    for name in list_scenes():
        scene = load_scene(name)
        table.add_row(
            name,
            scene.settings.title,
            f"{scene.trajectory().mean_speed_mps(scene.duration_s):.3g} m/s",
            f"{scene.duration_s:g} s",
            scene.settings.licence,
        )
    _out.print(table, crop=False)


@command
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
    _out.print(table, crop=False)


@command
def methods() -> None:
    """List the methods of each task."""
    from tasks.methods import METHODS

    table = Table("task", "method", "where", box=None)
    for task, listed in METHODS.items():
        for name, where in listed.items():
            table.add_row(task, name, where)
    _out.print(table, crop=False)


@command
def bake(
    scene: Annotated[Positional[str], arg(metavar="SCENE", help="name or folder of a scene")],
) -> None:
    """Path-trace a scene's lightmaps anew, beside its scene.xml, to travel with it.

    Without them the first render bakes into the cache. Either needs LLVM or a GPU; machines that
    have neither can use lightmaps that others made.
    """
    from eres_render import load_scene
    from eres_render.rendering.backend import select_variant
    from eres_render.rendering.lightmaps import bake_scene
    from tasks.progress_bar import progress_bar

    found = load_scene(scene)
    select_variant()
    with progress_bar(_err) as on_progress:
        files = bake_scene(found, on_progress=on_progress)
    for file in files:
        _out.print(str(file), soft_wrap=True)


@command
def render(
    scene: Annotated[
        Positional[str], arg(metavar="SCENE", help="name or folder of a scene, or a Mitsuba .xml")
    ],
    out: Path,
    resolution: int = 1280,
    spp: int = 16,
    max_displacement: float = 0.5,
    duration: float | None = None,
    samples: int | None = None,
    continuous: bool = False,
    trajectory: Path | None = None,
    integrator: Literal["baked", "path"] | None = None,
    seed: int = 0,
) -> None:
    """Render HDR frames along a camera path, with times, poses and the path itself.

    Writes clips, or one continuous sequence. A clip is a warm-up for the sensor, then a 50 ms
    window, every 0.5 s of the path. Each is a folder: half-float OpenEXR frames of linear radiance,
    manifest.json, poses in TUM's format. Stopped at any point, the same command goes on with the
    first missing frame.

    Args:
        out: Folder for the clips.
        resolution: Side of the frames, px.
        spp: Samples per pixel: 1, 4, 9, 16, ...
        max_displacement: Largest motion in the image between two frames, px.
        duration: How much of the path, seconds; all of it by default.
        samples: How many clips, from the start; all by default.
        continuous: One sequence of everything from the start to the duration, instead of clips.
        trajectory: Poses (camera to world) in TUM's format that the camera passes through at their
            times, in place of the scene's own path; a Mitsuba .xml needs them.
        integrator: "baked": light is computed once, for Lambertian scenes. "path": path tracing in
            every frame, noisy. By default baked where that is possible.
        seed: Seed of the pixel sampler, the same for every frame.
    """
    from eres_render import load_scene, render_scene
    from tasks.progress_bar import progress_bar

    with progress_bar(_err) as on_progress:
        sequences = render_scene(
            load_scene(scene, trajectory),
            out,
            resolution=resolution,
            spp=spp,
            seed=seed,
            integrator=integrator,
            duration_s=duration,
            max_displacement_px=max_displacement,
            samples=samples,
            continuous=continuous,
            on_progress=on_progress,
        )
    for sequence in sequences:
        _out.print(f"{sequence.folder}: {len(sequence)} frames", soft_wrap=True)


@command
def truth(
    sequence: Annotated[
        Positional[Path], arg(metavar="SEQUENCE", help="folder of a clip or continuous sequence")
    ],
    out: Path,
    width: int = 346,
    height: int | None = None,
    step: float = 0.05,
    flow_png: bool = False,
    overwrite: bool = False,
) -> None:
    """Write ground truth of a sequence: depth, optical flow with what is visible, poses.

    Depth is along the camera's axis, in metres (EXR channel Z); flow is in pixels from each time to
    the next (EXR channels u, v, valid). Times run from the start of the window to its end.

    Args:
        out: Folder to write into.
        width: Width of the images, px; best that of the sensor.
        height: Height of the images, px, for a sensor that is not of the frames' shape: it sees the
            middle of them. By default all of the frames is seen.
        step: Time from one image to the next, seconds.
        flow_png: Write the flow as 16-bit PNG as well, as in the DSEC dataset.
        overwrite: Replace truth that the folder holds; without it such a folder is refused.
    """
    from eres_render import ground_truth, open_sequence, window_times, write_truth
    from tasks.progress_bar import progress_bar

    opened = open_sequence(sequence)
    times_s = window_times(opened, step)
    with progress_bar(_err) as on_progress:
        files = write_truth(
            ground_truth(opened),
            out,
            times_s,
            width,
            height,
            on_progress=on_progress,
            flow_png=flow_png,
            overwrite=overwrite,
        )
    _out.print(f"{out}: {len(files)} files, {len(times_s)} times", soft_wrap=True)


@command
def convergence(
    scene: Annotated[
        Positional[str], arg(metavar="SCENE", help="name or folder of a scene, or a Mitsuba .xml")
    ],
    resolution: int = 1280,
    duration: float = 0.01,
    trajectory: Path | None = None,
) -> None:
    """Show how many samples per pixel and how many frames are enough for a scene.

    Renders one stretch from the middle of the path with more and more samples, and with smaller and
    smaller motion from frame to frame, each with random numbers common to all frames and with fresh
    ones. Prints what an ideal sensor at the frames' resolution makes of it: how many events, and
    the PSNR of event integration against the finest frames. Minutes at 1280 px on 2 cores.

    Args:
        resolution: Side of frames and sensor, px.
        duration: Length of the stretch, seconds.
        trajectory: Poses in TUM's format in place of the scene's own path.
    """
    from eres_render import load_scene
    from tasks.convergence import converge
    from tasks.progress_bar import progress_bar

    table = Table("samples", "motion", "seeds", "frames", "events", "", "PSNR", box=None)
    finest: int | None = None
    with progress_bar(_err) as on_progress:
        outcomes = converge(
            load_scene(scene, trajectory),
            resolution=resolution,
            duration_s=duration,
            on_progress=on_progress,
        )
        for outcome in outcomes:
            finest = outcome.events if finest is None else finest
            setting = outcome.setting
            table.add_row(
                f"{setting.spp} spp",
                f"{setting.max_displacement_px:g} px",
                "fresh" if setting.fresh_seeds else "common",
                str(outcome.frames),
                str(outcome.events),
                f"{100 * (outcome.events / finest - 1):+.1f} %" if finest else "",
                f"{outcome.psnr_db:.2f} dB",
            )
    _out.print(table, crop=False)


@command
def simulate(
    path: Annotated[Positional[Path], arg(metavar="SEQUENCE", help="folder of a clip")],
    out: Path,
    sensor: str | None = None,
    resolution: int | None = None,
    threshold: float | None = None,
    speed: float = 1.0,
    seed: int = 0,
    format: str | None = None,
    truth: float | None = None,
    overwrite: bool = False,
    pixel: OmitArgPrefixes[PixelOptions] = IDEAL_PIXEL,
    bus: OmitArgPrefixes[BusOptions] = NO_BUS,
) -> None:
    """Turn a rendered sequence into a file of events, frame by frame.

    The dark level is a thousandth of the sequence's white. A sensor that is not of the frames'
    shape sees the middle of them. Events of the warm-up are in the file too; it says, where its
    format can, when the window starts and ends, and which sensor and seed made it.

    Args:
        out: File of events: .h5 (DSEC), .raw (Prophesee EVT3), .npz or .txt.
        sensor: A camera by name; `eres sensors` lists them. This or a resolution.
        resolution: Width of the sensor, px.
        threshold: Contrast threshold in log units; 0.2 by default.
        speed: How much faster the scene moves than it was rendered.
        seed: Seed of everything random in the sensor.
        format: dsec, evt3, evt2, npz or text, in place of what the file's extension says.
        truth: Add true depth, flow and poses to a DSEC file, this many seconds apart.
        overwrite: Replace the file if it exists; without it such a file is refused.
    """
    from rich.progress import track

    from eres_render import open_sequence
    from tasks.events.files import sensor_for, simulate_sequence

    sequence = open_sequence(path)
    model = sensor_for(
        sequence,
        sensor=sensor,
        resolution=resolution,
        contrast_threshold=threshold,
        pixel=pixel,
    )
    count, report = simulate_sequence(
        sequence,
        model,
        out,
        speed=speed,
        seed=seed,
        readout=bus.readout(),
        truth_step_s=truth,
        format=format,
        overwrite=overwrite,
        watch=lambda frames: track(
            frames,
            "frames",
            total=len(sequence),
            console=_err,
            disable=not _err.is_terminal,
            transient=True,
        ),
    )
    _out.print(f"{out}: {count} events of {model.width}x{model.height} px", soft_wrap=True)
    if report is not None:
        _out.print(f"bus: {report}", soft_wrap=True)


@command
def convert(
    source: Annotated[Positional[Path], arg(metavar="IN", help="file of events")],
    out: Annotated[Positional[Path], arg(metavar="OUT", help="file to write")],
    format: str | None = None,
    input_format: str | None = None,
    size: tuple[int, int] | None = None,
    overwrite: bool = False,
) -> None:
    """Write a file of events in another format.

    Formats: dsec (.h5, .hdf5), evt3 and evt2 (.raw), npz (.npz), text (.txt). A warning names what
    OUT cannot hold of IN; truth is kept from DSEC to DSEC.

    Args:
        format: The format of OUT, in place of what its extension says; a .raw is EVT3 by default.
        input_format: The format of IN, in place of what its extension or header says.
        size: Width and height of the sensor, for files that do not store it.
        overwrite: Replace OUT if it exists; without it such a file is refused.
    """
    from tasks.events.files import convert as convert_file

    count = convert_file(
        source,
        out,
        format=format,
        input_format=input_format,
        size=size,
        overwrite=overwrite,
    )
    _out.print(f"{out}: {count} events", soft_wrap=True)


@command
def evaluate(
    sequence: Annotated[
        Positional[Path], arg(metavar="SEQUENCE", help="folder of a clip or continuous sequence")
    ],
    task: Literal["reconstruction", "flow", "tracking", "video"],
    method: tuple[str, ...] = (),
    resolution: int = 346,
    cutoff: float = math.inf,
    threshold: float = 0.2,
    speed: float = 1.0,
) -> None:
    """Score methods of one task on the events of one sensor on one rendered sequence.

    reconstruction: PSNR of the image at the window's end. flow: end-point error of 20 patches.
    tracking: position error of the first 14 ms, in planar scenes. video: PSNR of images along a
    continuous sequence.

    Args:
        task: What to do with the events.
        method: Names (`eres methods` lists them), or functions of your own as
            package.module:function; by default all methods of the task.
        resolution: Width of the sensor, px.
        cutoff: Corner frequency of the photoreceptor's poles, Hz; by default an ideal pixel.
        threshold: Contrast threshold, log units.
        speed: How much faster the scene moves than it was rendered.
    """
    from eres_render import open_sequence
    from tasks.evaluation.sequence import evaluate_sequence
    from tasks.progress_bar import progress_bar

    with progress_bar(_err) as on_progress:
        rows = evaluate_sequence(
            open_sequence(sequence),
            task,
            methods=method,
            width=resolution,
            cutoff_hz=cutoff,
            contrast_threshold=threshold,
            speed=speed,
            on_progress=on_progress,
        )
    names = Column("method", no_wrap=True), Column("variant", no_wrap=True)
    table = Table(*names, "median", "metric", "scores", "failed", box=None, pad_edge=False)
    for (name, variant, metric), scored in _by(rows, "method", "variant", "metric").items():
        median = float(np.median([row.value for row in scored]))
        failed = sum(bool(row.failure) for row in scored)
        table.add_row(name, variant, f"{median:.3f}", metric, str(len(scored)), str(failed))
    _out.print(table, crop=False)
    _out.print(f"{rows[0].event_rate_hz / 1e6:.3g} M events/s in the window")


def _by(rows: list[Row], *fields: str) -> dict[tuple[str, ...], list[Row]]:
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(getattr(row, field) for field in fields), []).append(row)
    return groups


_AS_IN_STUDY = arg(help_behavior_hint="(default: the study's)")


@command
def study(
    out: Path,
    file: Annotated[
        Positional[Path | None],
        arg(
            metavar="[STUDY.toml]",
            help="a study of your own, in place of a preset",
            help_behavior_hint="",
        ),
    ] = None,
    preset: Annotated[str | None, arg(help_behavior_hint="(default: quick)")] = None,
    scenes: Annotated[tuple[str, ...], _AS_IN_STUDY] = (),
    samples: Annotated[int | None, _AS_IN_STUDY] = None,
    spp: Annotated[int | None, _AS_IN_STUDY] = None,
    resolution: Annotated[int | None, _AS_IN_STUDY] = None,
    method: Annotated[tuple[str, ...], arg(help_behavior_hint="")] = (),
    scheduler: Annotated[str | None, arg(help_behavior_hint="(default: this process)")] = None,
) -> None:
    """Ask which resolution serves a task best: render, simulate, evaluate, report.

    Prints the scores beside the paper's and writes report.html into the run's folder. What is done
    already is not done again: the same command resumes a run that was stopped.

    Args:
        out: Folder of the run.
        preset: Which study, if not one of your own. "quick": carpet, 5 resolutions, 3 cutoffs, 3
            speeds, a few samples. "paper": three scenes, 20 samples of each, all methods; hours.
        scenes: Names or folders of scenes.
        samples: How many samples along each path.
        spp: Samples per pixel of the render.
        resolution: Side of the rendered frames, px; sensors that are finer are left out.
        method: Methods of your own, as well as the study's, each as package.module:function.
        scheduler: Address of a Dask scheduler, tcp://HOST:PORT, whose workers compute the parts.
    """
    from dataclasses import replace

    from tasks.progress_bar import progress_bar
    from tasks.study.config import preset as find_preset
    from tasks.study.config import with_method
    from tasks.study.report import write_report
    from tasks.study.run import run_study
    from tasks.study.study_file import read_study

    if file is not None and preset is not None:
        raise StudyError(
            f"found both {file} and --preset {preset}, expected one of them: leave out --preset "
            f"for the study of the file, or the file for preset {preset}"
        )
    chosen = find_preset(preset or "quick") if file is None else read_study(file)
    given = {"samples": samples, "spp": spp, "resolution": resolution}
    rendering = replace(chosen.render, **{k: v for k, v in given.items() if v is not None})
    widths = tuple(w for w in chosen.simulate.widths if w <= rendering.resolution)
    sensors = replace(chosen.simulate, widths=widths)
    looked_at = scenes or chosen.scenes
    asked = replace(chosen, scenes=looked_at, render=rendering, simulate=sensors)
    for name in method:
        asked = with_method(asked, name)
    with progress_bar(_err) as on_progress:
        run_study(asked, out, scheduler, on_progress)
    _show_scores(out)
    _show_claims(out)
    _out.print(f"\nreport: {write_report(out)}", soft_wrap=True)


@command
def report(run: RunFolder) -> None:
    """Make report.html, figures and tables.csv of a run anew."""
    from tasks.study.report import write_report

    _out.print(str(write_report(run)), soft_wrap=True)


@command
def claims(run: RunFolder) -> None:
    """Judge the paper's claims on a run's scores."""
    _show_claims(run)


@command
def info(
    path: Annotated[
        Positional[Path], arg(metavar="PATH", help="folder of a sequence, or file of events")
    ],
    format: str | None = None,
) -> None:
    """Say what is in a radiance sequence or in a file of events.

    Args:
        format: dsec, evt3, evt2, npz or text, in place of what an event file's extension says.
    """
    if path.is_file():
        from tasks.events.files import describe

        _print_pairs(describe(path, format=format))
        return
    from eres_render import open_sequence
    from tasks.events.files import seconds

    sequence = open_sequence(path)
    manifest = sequence.manifest
    start_s, end_s = sequence.window_s
    length_m = float(np.diff(sequence.trajectory.length_m(sequence.t_s[[0, -1]]))[0])
    part = "continuous" if sequence.is_continuous else f"clip {manifest.clip}"
    clock = {}
    if sequence.t_offset_us:
        clock["clock"] = f"time 0 is {seconds(sequence.t_offset_us)} s on that of the poses given"
    pairs = {
        "scene": f"{manifest.scene}, {part}",
        "found at": manifest.scene_source,
        "frames": f"{len(sequence)} of {manifest.width}x{manifest.height} px, half-float OpenEXR",
        "time": f"{sequence.t_s[0]:.4f} to {sequence.t_s[-1]:.4f} s",
        **clock,
        "window": f"{start_s:.4f} to {end_s:.4f} s",
        "camera speed": f"{length_m / (sequence.t_s[-1] - sequence.t_s[0]):.3g} m/s on average",
        "white": f"{sequence.white_level:.4g} W m^-2 sr^-1",
        "samples per pixel": str(manifest.spp),
        "motion per frame": f"at most {manifest.max_displacement_px:g} px",
        "rendered by": f"Mitsuba {manifest.mitsuba}, {manifest.variant}, {manifest.integrator}",
    }
    _print_pairs(pairs)


def _print_pairs(pairs: dict[str, str]) -> None:
    table = Table(box=None, show_header=False)
    for name, value in pairs.items():
        table.add_row(name, escape(value))
    _out.print(table, crop=False)


def _show_scores(run: Path) -> None:
    """Print the main methods' scores at the base speed, beside the paper's where it has them."""
    from tasks.row import read_rows
    from tasks.study.report.terminal import to_rich
    from tasks.study.results.comparison import main_tables
    from tasks.study.results.scores import by_threshold
    from tasks.study.results.words import join_words

    scores, *others = by_threshold(read_rows(run / "rows.parquet"))
    for table in main_tables(scores):
        _out.print(to_rich(table), crop=False)
    if others:
        named = join_words([f"{other.contrast_threshold:g}" for other in others])
        _out.print(
            f"contrast threshold {scores.contrast_threshold:g}; those of {named} are in the report "
            "and in tables.csv",
            highlight=False,
        )


def _show_claims(run: Path) -> None:
    from tasks.row import read_rows
    from tasks.study.claims.judge import judge_all
    from tasks.study.claims.verdict import Status, threshold_note
    from tasks.study.results.scaling import read_scaling
    from tasks.study.results.scores import by_threshold

    marks = {
        Status.HOLDS: "[green]holds[/green]",
        Status.DOES_NOT_HOLD: "[red]does not hold[/red]",
        Status.NOT_MEASURED: "[dim]not measured[/dim]",
    }
    found = by_threshold(read_rows(run / "rows.parquet"))
    verdicts = judge_all(found[0], read_scaling(run / "scaling"))
    for verdict in verdicts:
        _out.print(f"\n{verdict.number:2} {marks[verdict.status]}: {escape(verdict.title)}")
        table = Table(Column(no_wrap=True), "", box=None, show_header=False, pad_edge=False)
        table.add_row("   ours", escape(verdict.ours))
        table.add_row("   paper", escape(verdict.paper))
        _out.print(table, crop=False)
    counts = Counter(verdict.status for verdict in verdicts)
    _out.print("\n" + ", ".join(f"{mark}: {counts[status]}" for status, mark in marks.items()))
    if note := threshold_note(found):
        _out.print(note, highlight=False)


def main() -> None:
    """Run the command line; exit code 1 for an error, 2 for wrong usage, 130 for Ctrl-C."""
    if sys.argv[1:] == ["--version"]:
        print(f"eres {version(DISTRIBUTION)}")
        return
    handler = RichHandler(console=_err, show_time=False, show_path=False, show_level=False)
    logging.basicConfig(level=logging.INFO, format="%(message)s", handlers=[handler])
    try:
        code = (overview if sys.argv[1:] in ([], ["-h"], ["--help"]) else app).cli(
            prog="eres",
            config=(DisallowNone, FlagCreatePairsOff),
            description="Which event-camera resolution serves a task best, at what bandwidth? "
            "Renders HDR radiance, turns it into events at any resolution, and scores what can "
            "be done with them. `eres --version` prints the version.",
        )
    except (RenderError, SensorError, EventError, TaskError) as error:
        _fail(str(error))
    except OSError as error:
        _fail(f"{error.filename or 'system'}: {error.strerror or error}")
    except MemoryError as error:
        _fail(f"out of memory: {error}; choose a lower resolution")
    except KeyboardInterrupt:
        _err.print("stopped; the same command takes up what is whole so far")
        sys.exit(130)
    sys.exit(code or 0)


def _fail(text: str) -> None:
    _err.print(f"[red]error:[/red] {escape(text)}", soft_wrap=True, highlight=False)
    sys.exit(1)
