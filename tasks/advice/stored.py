"""Scored windows of stored runs: the cases of the lag law, and a table of them in the package."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple

from tasks.advice.law import lag_px
from tasks.errors import ResultError

if TYPE_CHECKING:
    from tasks.row import Row

TABLE = "stored.json"
"""The table in this package; `python benchmarks/lag_law.py --write` writes it."""

_METHOD, _FLOW = "event_integration", "zero_flow"


@dataclass(frozen=True, slots=True)
class Case:
    """Two neighboring widths in one window."""

    run: str
    scene: str
    samples: int  # 1, or how many it is the median of
    cutoff_hz: float
    speed: float  # factor on the base speed
    width: int  # px, of the finer one
    coarser: int  # px
    lag_px: float  # of the finer one
    margin_db: float  # PSNR of the finer minus that of the coarser

    @property
    def finer_won(self) -> bool:
        """Whether the finer one has the better image."""
        return self.margin_db > 0


class Window(NamedTuple):
    """One window in one light at one speed, seen by sensors of all widths with equal pixels."""

    run: str
    scene: str
    sample: int
    cutoff_hz: float  # inf for ideal pixels
    speed: float  # factor on the base speed
    speed_px_s: float  # of the image, px/s of the widest sensor
    widths: tuple[int, ...]  # px, ascending
    psnr_db: tuple[float, ...]  # of event integration, by width
    events_per_px: tuple[float, ...]  # of a pixel while the image moves by a pixel, by width

    def lag_px(self, width: int) -> float:
        """Return the lag of a sensor, px of it."""
        return lag_px(self.speed_px_s * width / self.widths[-1], self.cutoff_hz)

    def cases(self) -> Iterator[Case]:
        """Yield the pairs of neighboring widths; none with ideal pixels, whose lag is 0."""
        scores = zip(self.widths, self.psnr_db, strict=True)
        for (coarser, low), (finer, high) in pairwise(scores if self.cutoff_hz < math.inf else ()):
            where = self.run, self.scene, 1, self.cutoff_hz, self.speed
            yield Case(*where, finer, coarser, self.lag_px(finer), high - low)


def cases_of(windows: Iterable[Window]) -> list[Case]:
    """Return the cases of windows."""
    return [case for window in windows for case in window.cases()]


def windows_of_run(folder: Path, photoreceptor: str = "two_pole") -> list[Window]:
    """Read the windows of a run that scores event integration at several widths.

    The speed of the image is the median length of the true flow at the sample's features, which is
    the score of `zero_flow`; on the virtual slider it follows from its speed, lens and distance.
    Of ideal pixels there is one speed, as their events per motion do not depend on it.

    Raises
    ------
    ResultError
        The folder is not that of a finished run, or its rows do not tell the speed of the image.
    """
    from tasks.row import read_rows
    from tasks.study.results.run_files import read_config

    config = read_config(folder)
    rows = [one for one in read_rows(folder / "rows.parquet") if one.photoreceptor == photoreceptor]
    speeds_px_s = _speeds_px_s(rows, config)
    groups: defaultdict[tuple[str, int, float, float], dict[int, Row]] = defaultdict(dict)
    for row in rows:
        if row.method == _METHOD and (row.cutoff_hz < math.inf or row.speed == 1):
            groups[row.scene, row.sample, row.cutoff_hz, row.speed][row.width] = row
    if not groups or not speeds_px_s:
        raise ResultError(
            f"{folder}: needs scores of {_METHOD}, and of {_FLOW} for the speed of the image; run "
            f"the study with `--method {_METHOD} {_FLOW}`"
        )
    render = config["render"]
    aspect = (render.get("height") or render["resolution"]) / render["resolution"]
    windows = []
    for (scene, sample, cutoff_hz, speed), by_width in groups.items():
        widths = tuple(sorted(by_width))
        px_per_s = [speed * speeds_px_s[scene, sample] * width for width in widths]
        events = [
            by_width[width].event_rate_hz / (width * round(width * aspect) * px_s)
            for width, px_s in zip(widths, px_per_s, strict=True)
        ]
        psnr_db = tuple(round(by_width[width].value, 4) for width in widths)
        where = folder.as_posix(), scene, sample, cutoff_hz, round(speed, 4)
        rounded = tuple(float(f"{one:.3g}") for one in events)
        windows.append(Window(*where, round(px_per_s[-1], 2), widths, psnr_db, rounded))
    return windows


def _speeds_px_s(rows: list[Row], config: dict[str, Any]) -> dict[tuple[str, int], float]:
    """Return the speed of the image at base speed by scene and sample, as widths of it per s."""
    from eres_render import load_scene
    from tasks.registry import TASKS
    from tasks.study.results.slider import NEAREST_M, is_of_slider

    if is_of_slider(config):
        width, speeds = config["render"]["resolution"], config["base_m_per_s"]
        focal = {scene: load_scene(scene).camera(width).K[0, 0] / width for scene in speeds}
        places = dict.fromkeys((row.scene, row.sample) for row in rows)
        return {at: float(focal[at[0]] * speeds[at[0]] / NEAREST_M) for at in places}
    lengths: defaultdict[tuple[str, int], list[float]] = defaultdict(list)
    for row in rows:
        if row.method == _FLOW:
            lengths[row.scene, row.sample].append(row.value)
    a_width_s = TASKS["dense_flow"].metric.reference_width_px * config["render"]["window_s"]
    return {at: median(each) / a_width_s for at, each in lengths.items()}


def write_windows(path: Path, windows: Iterable[Window]) -> None:
    """Write windows as JSON, one a line, with the widths of their run once."""
    from eres_render.storage.atomic import write_text

    runs: defaultdict[tuple[str, tuple[int, ...]], list[str]] = defaultdict(list)
    for run, scene, sample, cutoff_hz, speed, speed_px_s, widths, psnr_db, events in windows:
        line = scene, sample, str(cutoff_hz), speed, speed_px_s, psnr_db, events  # JSON has no inf
        runs[run, widths].append(json.dumps(line, separators=(",", ":")))
    parts = [
        f'{{"run":{json.dumps(run)},"widths":{json.dumps(widths)},"windows":[\n'
        + ",\n".join(lines)
        + "\n]}"
        for (run, widths), lines in runs.items()
    ]
    write_text(path, "[" + ",\n".join(parts) + "]\n")


@cache
def stored_windows() -> tuple[Window, ...]:
    """Return the windows of the table in this package."""
    parts = json.loads(files("tasks.advice").joinpath(TABLE).read_text())
    return tuple(
        Window(
            *(part["run"], scene, sample, float(cutoff), speed, px_s),
            *map(tuple, (part["widths"], psnr_db, events)),
        )
        for part in parts
        for scene, sample, cutoff, speed, px_s, psnr_db, events in part["windows"]
    )


@cache
def stored_cases() -> tuple[Case, ...]:
    """Return the cases of the table in this package."""
    return tuple(cases_of(stored_windows()))


@cache
def stored_cells() -> tuple[Case, ...]:
    """Return the medians of these cases over the samples of a scene."""
    cells: defaultdict[tuple[object, ...], list[Case]] = defaultdict(list)
    for case in stored_cases():
        cells[case.run, case.scene, case.cutoff_hz, case.speed, case.width].append(case)
    return tuple(
        replace(
            inside[0],
            samples=len(inside),
            lag_px=median(case.lag_px for case in inside),
            margin_db=median(case.margin_db for case in inside),
        )
        for inside in cells.values()
    )
