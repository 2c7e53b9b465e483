"""Commands for studies: a study, its report, the paper's claims."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.console import Group
from rich.table import Column
from rich.text import Text
from tyro.conf import OmitArgPrefixes, Positional, arg

from sensor.model import Photoreceptor
from tasks.cli import terminal
from tasks.cli.app import AsJson, OtherRuns, RunFolder, WeightsFiles
from tasks.errors import ResultError, StudyError

if TYPE_CHECKING:
    from tasks.study.config import Study
    from tasks.study.report.finished_run import FinishedRun
    from tasks.study.results.comparison import ComparisonTable
    from tasks.study.results.words import BaseSpeeds

_AS_IN_STUDY = arg(help_behavior_hint="(default: the study's)")


@dataclass(frozen=True, kw_only=True)
class Changes:
    """Changes to the study.

    Parameters
    ----------
    scenes
        Names or folders of scenes, or a Mitsuba file (.xml) with --trajectory.
    samples
        Number of samples along each path.
    spp
        Samples per pixel of the render.
    resolution
        Side of the rendered frames, px; finer sensors are left out.
    sensors
        Cameras in place of the study's sensors: names (`eres sensors` lists them), or TOML files.
    lux
        Light on the scene in place of the study's, lux; inf for ideal pixels.
    photoreceptor
        two_pole, one_pole or v2e (v2e's limit for small steps), or several of them, on the same
        frames.
    distance_m
        Scale planar scenes and their paths to this median distance between camera and plane, m;
        needs a study with speeds in m/s.
    trajectory
        File of poses in TUM format, in place of the scene's own path.
    method
        Methods in addition to the study's: names (`eres methods` lists them), or your own as
        package.module:function.
    """

    scenes: Annotated[tuple[str, ...], _AS_IN_STUDY] = ()
    samples: Annotated[int | None, _AS_IN_STUDY] = None
    spp: Annotated[int | None, _AS_IN_STUDY] = None
    resolution: Annotated[int | None, _AS_IN_STUDY] = None
    sensors: Annotated[tuple[str, ...], _AS_IN_STUDY, arg(metavar="NAME|FILE [NAME|FILE ...]")] = ()
    lux: Annotated[tuple[float, ...], _AS_IN_STUDY, arg(metavar="FLOAT [FLOAT ...]")] = ()
    photoreceptor: Annotated[tuple[Photoreceptor, ...], _AS_IN_STUDY] = ()
    distance_m: Annotated[float | None, _AS_IN_STUDY] = None
    trajectory: Path | None = None
    method: Annotated[tuple[str, ...], arg(help_behavior_hint="")] = ()

    def applied_to(self, study: Study) -> Study:
        """Return the study with these changes."""
        from tasks.study.config import with_method, with_resolution, with_scenes
        from tasks.study.settings import Simulate
        from tasks.study.study_file import read_camera_of

        asked = with_scenes(study, self.scenes, self.trajectory)
        rendering = _given(samples=self.samples, spp=self.spp)
        sensing = _given(photoreceptors=self.photoreceptor, distance_m=self.distance_m)
        if self.sensors:
            cameras = tuple(read_camera_of(name, "--sensors", Path()) for name in self.sensors)
            sensing |= {"sensors": cameras, "widths": ()}
        if self.lux:
            sensing |= {"illuminance_lux": self.lux, "cutoffs_hz": Simulate().cutoffs_hz}
        render, simulate = replace(asked.render, **rendering), replace(asked.simulate, **sensing)
        asked = replace(asked, render=render, simulate=simulate)
        if self.resolution is not None:
            asked = with_resolution(asked, self.resolution)
        for name in self.method:
            asked = with_method(asked, name)
        return asked


def _given(**values: Any) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value not in (None, ())}


AS_IT_IS = Changes()


def study(
    out: Path,
    file: Annotated[
        Positional[Path | None],
        arg(metavar="[STUDY.toml]", help="your own study, in place of a preset"),
    ] = None,
    preset: Annotated[str | None, arg(help_behavior_hint="(default: quick)")] = None,
    scheduler: Annotated[str | None, arg(help_behavior_hint="(default: this process)")] = None,
    weights: WeightsFiles = (),
    mix: bool = False,
    changes: OmitArgPrefixes[Changes] = AS_IT_IS,
) -> None:
    """Ask which resolution serves a task best.

    Renders, simulates, evaluates and reports. Prints the scores next to the paper's and writes
    report.html into the run's folder. The same command resumes a run that was stopped.

    Parameters
    ----------
    out
        Folder of the run.
    preset
        Name of a study. "quick": carpet, 5 resolutions, 3 cutoffs, 3 speeds, a few samples.
        "paper": three scenes, 20 samples of each, the methods of the paper that need no network,
        two photoreceptors; takes about two hours on 2 fast cores. "slider": three prints in front
        of a camera on a slider, from three distances at three speeds, as in the paper's real data.
        "chip": one chip divided into 128 to 1280 px, with cutoffs that grow with a pixel's area to
        three powers. "paper-v2e": v2e's program on the frames of "paper" at three frame steps, 10
        samples; about two hours. "paper-seeds": five textures and paths of each scene; about three
        hours. "ablations": what the paper leaves open, on 6 samples of each scene.
    scheduler
        Address of a Dask scheduler, tcp://HOST:PORT, whose workers compute the jobs.
    weights
        Files of networks' weights as METHOD=FILE, or a FILE for the one method that needs weights.
    mix
        Allow resuming with another Mitsuba version or device than the run started with. Frames then
        differ slightly.
    """
    from tasks.methods.networks import named_weights
    from tasks.study.config import preset as find_preset
    from tasks.study.config import with_weights
    from tasks.study.report import write_report
    from tasks.study.report.finished_run import read_run
    from tasks.study.run import run_study
    from tasks.study.study_file import read_study

    if file is not None and preset is not None:
        raise StudyError(f"give {file} or --preset {preset}, not both")
    chosen = find_preset(preset or "quick") if file is None else read_study(file)
    asked = changes.applied_to(chosen)
    in_use = [name for task in asked.evaluate.values() for name in task.methods]
    asked = with_weights(asked, named_weights(weights, in_use))
    with terminal.progress() as on_progress:
        run_study(asked, out, scheduler, on_progress, mix=mix)
    run = read_run(out)
    _show_scores(run)
    _show_claims(run)
    terminal.say(f"\nreport: {write_report(run)}")


def report(run: RunFolder) -> None:
    """Rewrite report.html, figures and tables of a run."""
    from tasks.study.report import write_report

    terminal.say(str(write_report(run)))


def claims(run: RunFolder, others: OtherRuns = (), *, as_json: AsJson = False) -> None:
    """Judge the paper's claims on a run's scores.

    Several runs of one study, each with the --weights of another training of the same networks, are
    judged together. Intervals then cover samples and trainings.

    Parameters
    ----------
    run
        Folder of a run.
    others
        Further runs of the study, with other weights.
    """
    from eres_render.storage.settings_reader import read_json
    from tasks.provenance import differing_software
    from tasks.study.report.finished_run import read_run

    joined = read_run(run, *others)
    if as_json:
        terminal.show_json(joined.verdicts_by_photoreceptor)
        return
    _show_claims(joined)
    files = [folder / "environment.json" for folder in others]
    environments = [read_json(dict[str, str], file, ResultError) for file in files]
    if differing := differing_software([joined.environment, *environments]):
        listed = "; ".join(f"{name} {values}" for name, values in differing.items())
        terminal.say(f"The runs differ in more than weights: {listed}")


def _show_scores(run: FinishedRun) -> None:
    """Print the main methods' scores at the base speed, next to the paper's."""
    from tasks.study.results.choice import exponents_text
    from tasks.study.results.comparison import main_tables
    from tasks.study.results.words import join_words, lost_text, photoreceptor_label

    terminal.say(*run.assumes)
    scores, *further = run.by_threshold
    for table in main_tables(scores):
        terminal.out.print(to_rich(table, run.base_speeds), crop=False)
    if any(len(scores.speeds(series)) > 1 for series in scores.series()):
        terminal.say("other speeds are in the report and in tables.csv")
    if scores.dropped:
        lost = lost_text(scores.dropped)
        terminal.say(f"largest share of a window's events that the bus lost: {lost}")
    terminal.say(*exponents_text(scores, run.firsts, run.base_speeds))
    if further:
        named = join_words([f"{other.contrast_threshold:g}" for other in further])
        terminal.say(
            f"contrast threshold {scores.contrast_threshold:g}; the scores at {named} are in the "
            "report and in tables.csv"
        )
    if run.others:
        words = [photoreceptor_label(name) for name in run.others]
        terminal.say(
            f"photoreceptor: {photoreceptor_label(scores.photoreceptor)}; what changes with "
            f"{join_words(words)} is in the report"
        )


def to_rich(table: ComparisonTable, base: BaseSpeeds) -> Group:
    """Render for a terminal of 80 columns or more, each block under its own heading.

    Parameters
    ----------
    base
        Mean speed of the camera at factor 1 by scene, m/s.

    Returns
    -------
    The table with title and footnote.
    """
    from tasks.study.results.comparison import line_label
    from tasks.study.results.words import cutoff_label, speed_label

    columns = [column for column in table.columns if column.in_terminal]
    parts: list[Text | terminal.Table] = [Text(table.title, "bold")]
    for block in table.blocks:
        heading = f"\n{block.scene}, {speed_label(block.scene, block.speed, base)}"
        shown = terminal.Table(padding=(0, 1, 0, 0), pad_edge=False, header_style="dim")
        parts += [Text(heading, "italic"), shown]
        shown.add_column("", no_wrap=True)
        for cutoff_hz, column in product(table.cutoffs_hz, columns):
            head = cutoff_label(cutoff_hz) if column.kind == "ours" else column.head
            dim = "dim" if column.kind in ("paper", "rate") else ""
            shown.add_column(head, justify="right", style=dim, no_wrap=True)
        for line in block.lines:
            cells = [Text("do nothing" if line.sensor is None else line_label(line, table.series))]
            for entry, column in product(line.entries, columns):
                text = column.text(table.series, entry, line)
                cells.append(Text(text, entry.marks.get(column.kind, "")))
            shown.add_row(*cells)
    return Group(*parts, Text(f"\n{table.footnote(columns)}", "dim"))


def _show_claims(run: FinishedRun) -> None:
    from tasks.study.claims.judge import changed_verdicts
    from tasks.study.claims.verdict import Status, chance_note, threshold_note
    from tasks.study.results.intervals import BRACKETS
    from tasks.study.results.words import photoreceptor_label

    colors = {Status.HOLDS: "green", Status.DOES_NOT_HOLD: "red", Status.UNDECIDED: "yellow"}
    marks = {status: Text(status, colors.get(status, "dim")) for status in Status}
    if not run.verdicts:
        terminal.say("none of the paper's claims is about these sensors, lights and methods")
        return
    for verdict in run.verdicts:
        likeness = f" ({verdict.likeness})" if verdict.likeness else ""
        number, title = f"\n{verdict.number:2} ", f": {verdict.title}{likeness}"
        terminal.say(Text.assemble(number, marks[verdict.status], title))
        table = terminal.Table(Column(no_wrap=True), "", show_header=False, pad_edge=False)
        table.add_row("   ours", verdict.ours)
        table.add_row("   paper", verdict.paper)
        if verdict.why:
            table.add_row("   why", verdict.why)
        terminal.show(table)
    counts = Counter(verdict.status for verdict in run.verdicts)
    counted = [Text.assemble(mark, f": {counts[status]}") for status, mark in marks.items()]
    terminal.say(Text("\n") + Text(", ").join(counted))
    for note in filter(
        None, (BRACKETS, chance_note(run.verdicts), threshold_note(run.by_threshold))
    ):
        terminal.out.print(note, highlight=False)
    for name in run.others:
        changed = changed_verdicts({"": run.verdicts, name: run.verdicts_by_photoreceptor[name]})
        named = [Text.assemble(f"{new.number} ", marks[new.status]) for _, new in changed]
        changes = Text(", ").join(named) if named else Text("no verdict changes")
        terminal.say(Text(f"With {photoreceptor_label(name)}: ") + changes)
