"""`view`: events and rendered clips into a file to look at."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from eres_render.progress import Progress, silent
from eres_render.storage.atomic import new_file
from tasks.errors import TaskError
from tasks.events.overwriting import check_new
from tasks.events.reading import AS_STORED, ReadOptions
from tasks.view.clip import Show
from tasks.view.drawing import PALETTES, Picture
from tasks.view.files import WRITERS, possible_fps
from tasks.view.layout import Layout
from tasks.view.look import Look
from tasks.view.player import write_player
from tasks.view.recording import write_recording
from tasks.view.subject import Subject, open_subject

_SIZES = {".mp4": (1920, 1080), ".png": (1920, 1080), ".gif": (960, 540), ".webp": (960, 540)}
_SECONDS = {".mp4": 8.0, ".gif": 4.0, ".webp": 4.0}  # approximate default duration of a file
_MAX_SIDE_PX = {".mp4": 16384, ".gif": 65535, ".webp": 16383}  # that encoders take
_USUAL_FPS = 25.0
_FACTORS = [digit * 10.0**power for power in range(6) for digit in (1, 2, 5)]
# All pictures of a .gif or .webp are in memory at once; of other files, only their times.
_MAX_IN_MEMORY, _MAX_PICTURES = 300, 10**6

KINDS = (*WRITERS, ".html", ".rrd")
_WITHOUT = {  # options of a look that a kind of file does not have
    **dict.fromkeys(WRITERS, ("at",)),
    ".png": ("fps", "slow"),
    ".html": ("at", "count", "fps", "height", "slow"),
    ".rrd": ("at", "height"),
}


def view(
    paths: str | Path | Sequence[str | Path],
    out: str | Path | None,
    look: Look,
    *,
    over: str | Path | None = None,
    show: Show = "frames",
    reading: ReadOptions = AS_STORED,
    format: str | None = None,
    overwrite: bool = False,
    on_progress: Progress = silent,
) -> None:
    """Write events and rendered clips to a file to look at, side by side.

    Parameters
    ----------
    paths
        Files of events, and folders of rendered clips; or one of them.
    out
        The file: .mp4, .gif, .webp, .png, .html or .rrd; None opens the Rerun viewer.
    look
        Which events are shown, and how.
    over
        Rendered clip, video or folder of images that is drawn behind the events.
    show
        What is drawn of rendered clips.
    reading, format
        How to read files of events that do not state it.
    overwrite
        Whether to replace an existing file.
    on_progress
        Called after each picture.

    Raises
    ------
    TaskError
        The kind of file is unknown or does not have an option, the file exists, or there is nothing
        to show in it.

    Examples
    --------
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from sensor import Events
    >>> from sensor.formats import write_events
    >>> from tasks.view.look import Look
    >>> from tasks.view.view import view
    >>> t_us, x = np.arange(0, 50_000, 500), np.arange(100, dtype=np.uint16)
    >>> events = Events(t_us, x, x, np.ones(100, np.int8), width=100, height=100)
    >>> write_events("diagonal.h5", events)
    100
    >>> view("diagonal.h5", "diagonal.png", Look(window=20.0, at=0.03))
    >>> Path("diagonal.png").stat().st_size > 0
    True
    """
    look.check()
    out = None if out is None else Path(out)
    kind = ".rrd" if out is None else out.suffix.lower()
    if kind not in KINDS:
        raise TaskError(f"{out}: found extension {kind!r}, expected one of {', '.join(KINDS)}")
    for name in _WITHOUT[kind]:
        if (value := getattr(look, name)) is not None:
            raise TaskError(f"--{name} {value} does not apply to a {kind} file")
    files = [Path(path) for path in ([paths] if isinstance(paths, str | Path) else paths)]
    if out is not None:
        check_new(out, overwrite, *files)
    behind = None if over is None else Path(over)
    subject = open_subject(
        files, look, over=behind, show=show, reading=reading, format=format, on_progress=on_progress
    )
    if kind == ".html" and out is not None:
        if len(subject.event_sources) < len(subject.sources):
            raise TaskError(f"{out}: a .html shows a rendered clip only behind events; use --over")
        write_player(out, subject, look.window_ms, on_progress, overwrite=overwrite)
        return
    times_us = _times(subject, look, kind)
    if kind == ".rrd" or out is None:
        write_recording(out, subject.sources, times_us, on_progress, overwrite=overwrite)
        return
    pictures = _pictures(subject, look, times_us, kind, on_progress)
    with new_file(out, overwrite=overwrite) as file:
        fps = possible_fps(kind, look.fps or _USUAL_FPS)
        WRITERS[kind](file, _small_enough(pictures, kind), fps)


def _small_enough(pictures: Iterator[Picture], kind: str) -> Iterator[Picture]:
    """Refuse pictures that are larger than the encoder of a file takes."""
    limit = _MAX_SIDE_PX.get(kind, math.inf)
    for picture in pictures:
        height, width = picture.shape[:2]
        if max(height, width) > limit:
            raise TaskError(
                f"{width}x{height} px exceed the {limit} px of a {kind}; reduce --height"
            )
        yield picture


def _times(subject: Subject, look: Look, kind: str) -> list[int]:
    """Return the ends of the pictures' windows, us."""
    start_us, end_us = subject.start_us, subject.end_us
    if kind == ".png":
        # The middle, rounded up, so that it is after the only event of a file.
        t_us = (start_us + end_us + 1) // 2 if look.at is None else round(1e6 * look.at)
        if not start_us <= t_us <= end_us:
            span = f"{start_us * 1e-6:.6f} to {end_us * 1e-6:.6f} s"
            raise TaskError(f"--at: found {look.at} s, but the sources cover {span}")
        return [t_us]
    step_us = 1e6 / (possible_fps(kind, look.fps or _USUAL_FPS) * _slow(subject, look, kind))
    # The first picture shows a whole window.
    lead_us = (look.length_us or step_us) if subject.event_sources else 0.0
    first_us = min(start_us + lead_us, end_us)
    steps = math.floor((end_us - first_us) / step_us)
    limit, other = _MAX_PICTURES, ""
    if kind in (".gif", ".webp"):
        limit, other = _MAX_IN_MEMORY, ", or write a .mp4"
    if steps >= limit:
        raise TaskError(
            f"{steps + 1} pictures exceed the {limit} that a {kind} holds; give --start and --end, "
            f"or reduce --slow or --fps{other}"
        )
    return [round(first_us + k * step_us) for k in range(steps + 1)]


def _slow(subject: Subject, look: Look, kind: str) -> float:
    if look.slow is not None:
        return look.slow
    span_s = 1e-6 * max(subject.end_us - subject.start_us, 1)
    ideal = _SECONDS.get(kind, _SECONDS[".mp4"]) / span_s
    return min(_FACTORS, key=lambda factor: abs(math.log(factor / ideal)))


def _pictures(
    subject: Subject, look: Look, times_us: list[int], kind: str, on_progress: Progress
) -> Iterator[Picture]:
    sizes = [source.size for source in subject.sources]
    layout = Layout(sizes, _SIZES[kind], PALETTES[look.palette], look.height)
    notes = []
    if subject.event_sources:
        notes.append(f"{look.count} events" if look.count else f"{look.window_ms:g} ms of events")
    if kind != ".png":
        notes.append(_pace(_slow(subject, look, kind)))
    drawn = zip(*(source.panels(times_us) for source in subject.sources), strict=True)
    for k, (t_us, panels) in enumerate(zip(times_us, drawn, strict=True), start=1):
        yield layout.draw(panels, ", ".join([f"{t_us * 1e-6:.4f} s", *notes]))
        on_progress("drawing", k, len(times_us))


def _pace(slow: float) -> str:
    if slow == 1:
        return "real time"
    return f"{slow:g} times slower" if slow > 1 else f"{1 / slow:g} times faster"
