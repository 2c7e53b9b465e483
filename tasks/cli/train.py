"""Train small networks of our own on random crops."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import OmitArgPrefixes, Positional, arg

from tasks.cli import terminal
from tasks.cli.app import require, several
from tasks.errors import TrainingError

_Runs = Annotated[Positional[tuple[Path, ...]], several("RUNS", "folders of finished trainings")]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingOptions:
    """Options of a training, the same for both networks.

    Parameters
    ----------
    out
        Folder of the training.
    config
        Settings: small; trial, which takes minutes; or a TOML file (docs/training.md).
    light
        Light of the crops: ideal, where all have ideal pixels; all, where each has its own random
        cutoff. All else is the same.
    sensor
        Camera of the crops in place of that in the settings, a name or a TOML file. It gives what
        is not random: photoreceptor, dark level, noise, delays.
    seed
        Seed of the crops and the initial weights.
    device
        Where to compute; by default a GPU if PyTorch finds one.
    dry_run
        Only print how much time, memory and disk space it takes.
    """

    out: Path
    config: Annotated[str, arg(metavar="NAME|FILE.toml")] = "small"
    light: Literal["ideal", "all"] = "all"
    sensor: str | None = None
    seed: int = 0
    device: Literal["cpu", "cuda"] | None = None
    dry_run: bool = False


def reconstruction(training: OmitArgPrefixes[TrainingOptions]) -> None:
    """Train our network for reconstruction: images from events alone.

    Updates the learning curve, curve.csv and curve.png, while it trains, and writes weights.pt at
    the end, for --weights our_reconstruction_all_light=OUT/weights.pt (or ideal_light, as trained).
    The same command continues after an interruption.
    """
    from tasks.learned.training.settings import RECONSTRUCTIONS, find_training

    _train(find_training(RECONSTRUCTIONS, training.config), training)


def flow(training: OmitArgPrefixes[TrainingOptions]) -> None:
    """Train our network for dense optical flow.

    Updates the learning curve, curve.csv and curve.png, while it trains, and writes weights.pt at
    the end, for --weights our_flow_all_light=OUT/weights.pt (or ideal_light, as trained). The same
    command continues after an interruption.
    """
    from tasks.learned.training.settings import FLOWS, find_training

    _train(find_training(FLOWS, training.config), training)


def card(runs: _Runs, out: Path | None = None, overwrite: bool = False) -> None:
    """Describe finished trainings: data, time, code, scores of every seed, limits.

    Parameters
    ----------
    out
        Markdown file to write; by default the card is printed.
    overwrite
        Replace OUT if it exists.
    """
    from eres_render.storage.atomic import write_text
    from tasks.events.overwriting import check_new
    from tasks.learned.training.card import card as describe

    require(runs, "finished training")
    if out is not None:
        check_new(out, overwrite)
    text = describe(runs)
    if out is None:
        terminal.out.print(text, markup=False, highlight=False, soft_wrap=True, end="")
    else:
        write_text(out, text, overwrite=overwrite)


def _train(settings: Any, options: TrainingOptions) -> None:
    if not 0 <= options.seed < 2**64:  # PyTorch's
        raise TrainingError(f"--seed: found {options.seed}, expected 0 to 2^64 - 1")
    from tasks.learned.training.loop import start
    from tasks.provenance import environment

    if options.sensor is not None:
        settings = replace(settings, crops=replace(settings.crops, sensor=options.sensor))
    with terminal.progress() as on_progress:
        problem, scores = start(
            settings,
            options.light,
            options.seed,
            options.out.resolve(),
            device=options.device,
            made_with=environment(),
            dry_run=options.dry_run,
            on_progress=on_progress,
        )
    if options.dry_run:
        return
    table = terminal.Table("held-out crops", "network", *problem.baselines, title=problem.score)
    for name, values in scores.items():
        table.add_row(name, *(f"{value:.2f}" for value in values))
    terminal.show(table)
