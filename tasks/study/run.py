"""Run a study: part by part, each once, into a folder that a report can be made of."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from eres_render import (
    GroundTruth,
    RadianceSequence,
    Renderer,
    ground_truth,
    load_scene,
    render_clip,
)
from tasks.errors import StudyError
from tasks.files import write_bytes
from tasks.row import Row, read_rows, write_rows
from tasks.study.config import Study, digest, to_json
from tasks.study.cost import cost
from tasks.study.environment import environment
from tasks.study.evaluate_part import OnProgress, evaluate_part
from tasks.study.frame_cache import frames_folder, make_room
from tasks.study.parts import Part, check_methods, parts
from tasks.study.previews import write_previews
from tasks.study.scaling import scaling_file, write_scaling

_log = logging.getLogger(__name__)

_BYTES_PER_PX_S = 4500  # of 2250 half-float frames a second of path: what make_room is asked for

# Where each stage begins in a part's time, and its share of it; for the progress bar alone.
_STAGES = {"rendering": (0.0, 0.5), "simulating": (0.5, 0.2), "scoring": (0.7, 0.3)}


def run_study(study: Study, out: Path) -> list[Row]:
    """Render, simulate and score every part of a study; what `out` holds already is kept.

    Writes into `out`: `rows.parquet` (every score), `study.json` (the resolved study),
    `environment.json` (where the last part was computed), `previews/` and `scaling/` (pictures and
    scaling statistics of each scene's first clip), and `parts/` with the rows of each part, by
    which a run that was stopped goes on where it was.

    Raises
    ------
    StudyError
        The study asks for what cannot be, or `out` is not a folder.
    TaskError
        A method does not exist.
    RenderError, SensorError, OSError
        As the stages raise them. Nothing is left under a final name that is not whole.
    """
    check_methods(study.evaluate)
    scenes = [load_scene(name) for name in study.scenes]
    work = [part for scene in scenes for part in parts(study, scene)]
    shown = {part.scene.name: part for part in reversed(work)}  # each scene's first part
    if out.exists() and not out.is_dir():
        raise StudyError(f"{out}: found a file, expected a folder for the run")
    rows_files = [out / "parts" / f"{part.key}.parquet" for part in work]
    write_bytes(out / "study.json", _json(to_json(study)))
    to_do = [part for part, file in zip(work, rows_files, strict=True) if not file.exists()]
    if to_do:
        _log.info("%s", cost(to_do).text())
    light: _SceneLight | None = None
    with _progress(len(work)) as on_progress:
        for k, (part, file) in enumerate(zip(work, rows_files, strict=True)):
            is_shown = part is shown[part.scene.name]
            has_scaling = scaling_file(out / "scaling", part.scene.name).exists()
            if file.exists() and (has_scaling or not is_shown):
                on_progress(k, "found", 1.0)
                continue

            def on_part(stage: str, done: int, of: int, k: int = k) -> None:
                begin, share = _STAGES[stage]
                on_progress(k, f"{stage} {done}/{of}", begin + share * done / of)

            on_progress(k, f"loading {part.scene.name}", 0.0)
            if light is None or light.renderer.scene != part.scene:
                light = _SceneLight(part)
            sequence, truth = light.look(part, on_part)
            result = evaluate_part(part, sequence, truth, on_part, shown=is_shown)
            if result.exhibit:
                write_previews(out / "previews", part, result.exhibit)
                write_scaling(out / "scaling", result.exhibit.scaling, result.exhibit.slope)
            write_bytes(out / "environment.json", _json(environment(light.renderer.variant)))
            write_rows(file, result.rows)
    _write_preview_index(out / "previews", list(shown))
    rows = list(chain.from_iterable(read_rows(file) for file in rows_files))
    write_rows(out / "rows.parquet", rows)
    return rows


class _SceneLight:
    """A scene's renderer and ground truth, which take long to load."""

    def __init__(self, part: Part) -> None:
        render = part.render
        self.renderer = Renderer(part.scene, render.resolution, render.spp, render.seed)
        self._truth: GroundTruth | None = None

    def look(self, part: Part, on_progress: OnProgress) -> tuple[RadianceSequence, GroundTruth]:
        """The part's frames, from the cache or rendered into it, and the truth behind them."""
        renderer = self.renderer
        decided_by = {
            **part.frames_decided_by,
            "white_level": renderer.white_level,
            "integrator": renderer.integrator,
            "variant": renderer.variant,
            "mitsuba": version("mitsuba"),
        }
        folder = frames_folder(digest(decided_by))
        seconds = part.clip.t_window_end_s - part.clip.t_start_s
        make_room(round(seconds * _BYTES_PER_PX_S * part.render.resolution**2), keep=folder)
        sequence = render_clip(
            renderer,
            part.clip,
            folder,
            part.render.max_displacement_px,
            lambda done, of: on_progress("rendering", done, of),
        )
        if self._truth is None:
            self._truth = ground_truth(sequence)
        return sequence, self._truth


def _write_preview_index(folder: Path, scene_names: list[str]) -> None:
    index = chain.from_iterable(json.loads((folder / f"{s}.json").read_text()) for s in scene_names)
    write_bytes(folder / "index.json", _json(list(index)))


def _json(value: Any) -> bytes:
    return json.dumps(value, indent=1).encode()


@contextmanager
def _progress(part_count: int) -> Iterator[Callable[[int, str, float], None]]:
    """A bar over all parts on stderr, silent when that is not a terminal."""
    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("study", total=part_count)

        def update(part: int, stage: str, share: float) -> None:
            described = f"part {part + 1}/{part_count}: {stage}"
            bar.update(task, completed=part + min(share, 1.0), description=described)

        yield update
