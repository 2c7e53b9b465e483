"""Run a study: clip by clip, each once, into a folder that a report can be made of."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from eres_render import Clip, RadianceSequence, Renderer, Scene, clips, load_scene, render_clip
from tasks.errors import StudyError
from tasks.files import write_bytes
from tasks.row import Row, read_rows, write_rows
from tasks.study.clip import evaluate_clip
from tasks.study.config import Study, to_json
from tasks.study.environment import environment
from tasks.study.frame_cache import frames_folder, make_room
from tasks.study.previews import write_previews
from tasks.study.scaling import scaling_file, write_scaling

_log = logging.getLogger(__name__)

_CLIP_BYTES_PER_PX = 400  # of a clip of 200 half-float frames: what make_room is asked for
_RENDER_SHARE = 0.7  # of a clip's time; for the progress bar alone

# Called with what is being done, and how much of the clip is done, 0 to 1.
OnProgress = Callable[[str, float], None]


def run_study(study: Study, out: Path) -> list[Row]:
    """Render, simulate and score every clip of a study; what `out` holds already is kept.

    Writes into `out`: `rows.csv` (every score), `study.json` (the resolved study),
    `environment.json` (where the last clip was computed), `previews/` and `scaling/` (pictures and
    scaling statistics of each scene's first clip), and `clips/` with the rows of each clip, by
    which a run that was stopped goes on where it was.

    Raises
    ------
    StudyError
        The study asks for what cannot be, or `out` is not a folder.
    RenderError, SensorError, OSError
        As the stages raise them. Nothing is left under a final name that is not whole.
    """
    scenes = [load_scene(name) for name in study.scenes]
    work = [(scene, clip) for scene in scenes for clip in _chosen_clips(study, scene)]
    shown = {scene.name: clip for scene, clip in reversed(work)}  # each scene's first clip
    if out.exists() and not out.is_dir():
        raise StudyError(f"{out}: found a file, expected a folder for the run")
    rows_files = [out / "clips" / f"{study.clip_key(scene, clip)}.csv" for scene, clip in work]
    write_bytes(out / "study.json", _json(to_json(study)))
    renderer: Renderer | None = None
    with _progress(len(work)) as on_progress:
        for k, ((scene, clip), file) in enumerate(zip(work, rows_files, strict=True)):
            is_shown = clip == shown[scene.name]
            has_scaling = scaling_file(out / "scaling", scene.name).exists()
            if file.exists() and (has_scaling or not is_shown):
                on_progress(k, "found", 1.0)
                continue

            def on_clip(stage: str, share: float, k: int = k) -> None:
                on_progress(k, stage, share)

            if renderer is None or renderer.scene != scene:
                on_clip(f"loading {scene.name}", 0.0)
                renderer = Renderer(
                    scene, study.render.resolution, study.render.spp, study.render.seed
                )
            sequence = _frames(study, renderer, clip, on_clip)
            result = evaluate_clip(
                study,
                sequence,
                lambda done, of: on_clip("simulating", 1 - (1 - _RENDER_SHARE) * (1 - done / of)),
                with_scaling=is_shown,
            )
            if is_shown:
                write_previews(out / "previews", study, scene.name, result)
            if result.scaling:
                write_scaling(out / "scaling", *result.scaling)
            write_bytes(out / "environment.json", _json(environment(renderer.variant)))
            write_rows(file, result.rows)
    _write_preview_index(out / "previews", list(shown))
    rows = list(chain.from_iterable(read_rows(file) for file in rows_files))
    write_rows(out / "rows.csv", rows)
    return rows


def _chosen_clips(study: Study, scene: Scene) -> list[Clip]:
    """The study's samples, spread evenly over the path; all that fit where it says None."""
    render = study.render
    fitting = clips(
        scene,
        every_s=render.every_s,
        window_s=render.window_s,
        warmup_s=study.simulate.warmup_s,
    )
    count = len(fitting) if render.samples is None else render.samples
    if not 1 <= count <= len(fitting):
        raise StudyError(
            f"render.samples: found {render.samples}, expected 1 to {len(fitting)}, which fit the "
            f"path of {scene.name}"
        )
    return [fitting[i] for i in np.linspace(0, len(fitting), count, endpoint=False).astype(int)]


def _frames(study: Study, renderer: Renderer, clip: Clip, on_clip: OnProgress) -> RadianceSequence:
    """The clip's frames: from the cache, or rendered into it."""
    key = study.frames_key(renderer.scene, clip, renderer.variant, version("mitsuba"))
    folder = frames_folder(key)
    make_room(_CLIP_BYTES_PER_PX * study.render.resolution**2, keep=folder)
    return render_clip(
        renderer,
        clip,
        folder,
        study.render.max_displacement_px,
        lambda done, of: on_clip(f"rendering frame {done}/{of}", _RENDER_SHARE * done / of),
    )


def _write_preview_index(folder: Path, scene_names: list[str]) -> None:
    index = chain.from_iterable(json.loads((folder / f"{s}.json").read_text()) for s in scene_names)
    write_bytes(folder / "index.json", _json(list(index)))


def _json(value: Any) -> bytes:
    return json.dumps(value, indent=1).encode()


@contextmanager
def _progress(clip_count: int) -> Iterator[Callable[[int, str, float], None]]:
    """A bar over all clips on stderr, silent when that is not a terminal."""
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
        task = bar.add_task("study", total=clip_count)

        def update(clip: int, stage: str, share: float) -> None:
            described = f"clip {clip + 1}/{clip_count}: {stage}"
            bar.update(task, completed=clip + min(share, 1.0), description=described)

        yield update
