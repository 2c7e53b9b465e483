"""Compare the lag law with stored runs, and write what `eres advise` and its page have of them.

    python benchmarks/lag_law.py docs/results/paper docs/results/slider
    python benchmarks/lag_law.py docs/results/paper docs/results/slider --write

prints Markdown tables: how often the law is right, margins by lag, what following it costs, v2e's
photoreceptor, and the delay in flow and tracking. `--write` also writes the table in the package
and docs/figures/lag_law.png.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from eres_render import load_scene
from eres_render.storage.atomic import write_text
from tasks.advice import stored
from tasks.advice.law import CROSSING_PX, NEAR_PX, chosen, delay_s, finer_wins
from tasks.advice.stored import Case, Window, cases_of
from tasks.errors import ResultError
from tasks.registry import TASKS
from tasks.row import Row, read_rows
from tasks.study.results.run_files import read_config
from tasks.study.results.slider import NEAREST_M, is_of_slider

ROOT = Path(__file__).parents[1]
CROSSINGS_PX = (0.8, 0.9, 1.0, 1.1, 1.2)
EDGES_PX = (0, 0.3, 0.6, 0.9, 1.2, 2, 4, 9, math.inf)
METHOD, TRUE_FLOW = "event_integration", "zero_flow"
FLOW, TRACKING = "photometric_flow", "photometric_tracking"


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
    config = read_config(folder)
    rows = [one for one in read_rows(folder / "rows.parquet") if one.photoreceptor == photoreceptor]
    speeds_px_s = speeds_px_s_of(rows, config)
    groups: defaultdict[tuple[str, int, float, float], dict[int, Row]] = defaultdict(dict)
    for row in rows:
        if row.method == METHOD and (row.cutoff_hz < math.inf or row.speed == 1):
            groups[row.scene, row.sample, row.cutoff_hz, row.speed][row.width] = row
    if not groups or not speeds_px_s:
        raise ResultError(
            f"{folder}: needs scores of {METHOD}, and of {TRUE_FLOW} for the speed of the image; "
            f"run the study with `--method {METHOD} {TRUE_FLOW}`"
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


def speeds_px_s_of(rows: list[Row], config: dict[str, Any]) -> dict[tuple[str, int], float]:
    """Return the speed of the image at base speed by scene and sample, as widths of it per s."""
    if is_of_slider(config):
        width, speeds = config["render"]["resolution"], config["base_m_per_s"]
        focal = {scene: load_scene(scene).camera(width).K[0, 0] / width for scene in speeds}
        places = dict.fromkeys((row.scene, row.sample) for row in rows)
        return {at: float(focal[at[0]] * speeds[at[0]] / NEAREST_M) for at in places}
    lengths: defaultdict[tuple[str, int], list[float]] = defaultdict(list)
    for row in rows:
        if row.method == TRUE_FLOW:
            lengths[row.scene, row.sample].append(row.value)
    a_width_s = TASKS["dense_flow"].metric.reference_width_px * config["render"]["window_s"]
    return {at: median(each) / a_width_s for at, each in lengths.items()}


def write_windows(path: Path, windows: Iterable[Window]) -> None:
    """Write windows as JSON, one a line, with the widths of their run once."""
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


def table(heads: Iterable[str], lines: Iterable[Iterable[object]]) -> None:
    """Print a Markdown table."""
    heads = [*heads]
    print(f"\n| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for line in lines:
        print(f"| {' | '.join(map(str, line))} |")


def share(values: Iterable[bool]) -> str:
    """Return a share in percent."""
    values = [*values]
    return f"{100 * sum(values) / len(values):.1f} %" if values else "-"


def share_right(cases: Iterable[Case], crossing_px: float = CROSSING_PX) -> str:
    """Return in what share of cases the law is right, in percent."""
    return share(finer_wins(case.lag_px, crossing_px) == case.finer_won for case in cases)


def grouped(cases: Iterable[Case], key: Callable[[Case], str]) -> dict[str, list[Case]]:
    """Return cases by the text of one of their properties."""
    groups: defaultdict[str, list[Case]] = defaultdict(list)
    for case in cases:
        groups[key(case)].append(case)
    return groups


def print_shares(groups: dict[str, list[Case]]) -> None:
    """Print how often the law is right in each group, and with other crossings."""
    low, high = NEAR_PX
    near = f"outside {low} to {high} px"
    lines = []
    for name, cases in groups.items():
        far = [case for case in cases if not low <= case.lag_px <= high]
        others = [share_right(cases, at) for at in CROSSINGS_PX]
        cells = name, len(cases), share_right(cases), len(far), share_right(far), *others
        lines.append([str(cell).removesuffix(" %") for cell in cells])
    crossings = (f"at {one} px" for one in CROSSINGS_PX)
    table(("", "cases", "right, %", near, "right there, %", *crossings), lines)


def print_margins(cases: list[Case]) -> None:
    """Print by lag how often the finer wins, and by how much."""
    lines = []
    for low, high in pairwise(EDGES_PX):
        here = [case for case in cases if low <= case.lag_px < high]
        if here:
            margins = np.array([case.margin_db for case in here])
            ends = np.percentile(margins, (10, 90))
            name = f"{low} to {high}" if high < math.inf else f"above {low}"
            won, ties = (share(one) for one in (margins > 0, abs(margins) < 0.1))
            spread = f"{ends[0]:+.2f} to {ends[1]:+.2f}"
            lines.append((name, len(here), won, f"{np.median(margins):+.2f}", spread, ties))
    table(("lag, px", "cases", "finer wins", "median, dB", "80 % of them", "within 0.1 dB"), lines)


def by_law(window: Window) -> int:
    """Return the index of the width that the law chooses."""
    return chosen([*map(window.lag_px, window.widths)])


def print_regrets(windows: list[Window]) -> None:
    """Print how much worse than the best width a rule's is."""
    slow = [one for one in windows if one.cutoff_hz < math.inf]
    rules: dict[str, Callable[[Window], int]] = {"the law": by_law}
    for k, width in enumerate(slow[0].widths):
        rules[f"always {width} px"] = lambda _, k=k: k  # type: ignore[misc]
    lines = []
    for name, rule in rules.items():
        regrets = [max(one.psnr_db) - one.psnr_db[rule(one)] for one in slow]
        numbers = np.mean(regrets), np.median(regrets), *np.percentile(regrets, (90, 100))
        lines.append((name, len(slow), *(f"{one:.2f}" for one in numbers)))
    table(("rule", "windows", "mean regret, dB", "median", "90 % below", "worst"), lines)


def print_delays(folder: Path, windows: list[Window]) -> None:
    """Print the errors of flow and tracking at each width next to the lag and the delay."""
    widths, base_m_s = windows[0].widths, read_config(folder)["base_m_per_s"]
    lags = {one[1:5]: one.lag_px(widths[-1]) for one in windows if one.cutoff_hz < math.inf}
    found: defaultdict[tuple[Any, ...], defaultdict[int, list[float]]]
    found = defaultdict(lambda: defaultdict(list))
    for row in read_rows(folder / "rows.parquet"):
        plain = row.photoreceptor == "two_pole" and row.variant in ("", "sigma 20 mm")
        if plain and row.cutoff_hz < math.inf and row.speed in (1, 2):
            key = row.method, row.scene, row.cutoff_hz, row.speed, row.width
            found[key][row.sample].append(row.value)
    errors = {
        key: np.array([np.median(one) for _, one in sorted(inside.items())])
        for key, inside in found.items()
    }
    flows, paths = [], []
    for scene, cutoff_hz, speed in dict.fromkeys(key[1:4] for key in errors):
        where, name = (scene, cutoff_hz, speed), (scene, f"{cutoff_hz:g} Hz", f"{speed:g}")
        lag = np.array(
            [lags[scene, sample, *where[1:]] for sample in sorted(found[FLOW, *where, widths[-1]])]
        )
        by_width = [errors[FLOW, *where, width] for width in widths]
        rank = f"{spearmanr(lag, by_width[-1]).statistic:.2f}" if np.ptp(lag) else "-"
        ratios = [f"{np.median(each / lag):.2f}" for each in by_width]
        with_delay = f"{np.median(errors[f'{FLOW}_with_delay', *where, widths[-1]]):.2f}"
        flows.append((*name, f"{np.median(lag):.2f}", *ratios, rank, with_delay))
        if (TRACKING, *where, widths[-1]) in errors:
            late_mm = 1e3 * base_m_s[scene] * speed * delay_s(cutoff_hz)
            each = [f"{np.median(errors[TRACKING, *where, width]):.2f}" for width in widths]
            paths.append((*name, f"{late_mm:.2f}", *each))
    heads, at = ("scene", "cutoff", "speed"), [f"{width} px" for width in widths]
    print(f"\nPhotometric flow: error by lag in px of {at[-1]}, at each width; then at {at[-1]}")
    table((*heads, "lag, px", *at, "rank correlation", "error with delay, px"), flows)
    if paths:
        print("\nPhotometric tracking from 20 mm off: error in mm at each width")
        table((*heads, "speed x delay, mm", *at), paths)


def draw(path: Path, cases: list[Case]) -> None:
    """Draw the margin of every case against its lag."""
    figure = Figure(figsize=(7.2, 3.8), dpi=110, layout="constrained")
    axes = figure.subplots()
    axes.axvspan(*NEAR_PX, color="#eceeea", lw=0)
    axes.axvline(CROSSING_PX, color="#777777", lw=0.8)
    axes.axhline(0, color="#777777", lw=0.8)
    for scene, inside in grouped(cases, lambda case: case.scene).items():
        lags, margins = zip(*((case.lag_px, case.margin_db) for case in inside), strict=True)
        axes.plot(lags, margins, ".", ms=2.5, alpha=0.7, label=scene.replace("_", " "))
    bins = np.geomspace(0.03, 12, 25)
    lags = np.array([case.lag_px for case in cases])
    margins = np.array([case.margin_db for case in cases])
    places = np.digitize(lags, bins)
    here = [places == place for place in np.unique(places)]
    middle = [(np.median(lags[each]), np.median(margins[each])) for each in here]
    axes.plot(*zip(*middle, strict=True), color="black", lw=1.2, label="median")
    axes.set_xscale("log")
    axes.set_yscale("symlog", linthresh=0.25)
    ticks = (0.03, 0.1, 0.3, 1, 3, 10)
    axes.set_xticks(ticks, [f"{one:g}" for one in ticks])
    axes.set_xticks([], minor=True)
    heights = (-0.5, -0.2, 0, 0.2, 0.5, 1, 2, 4)
    axes.set_yticks(heights, [f"{one:+g}" if one else "0" for one in heights])
    axes.set_yticks([], minor=True)
    axes.set_xlabel("lag of the finer sensor, its px")
    axes.set_ylabel("PSNR, finer minus coarser, dB")
    axes.legend(frameon=False, markerscale=4, fontsize=8)
    figure.savefig(path, metadata={"Software": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("run", nargs="+", type=Path, help="folder of a stored run")
    parser.add_argument("--write", action="store_true", help="write the packaged table and figure")
    given = parser.parse_args()
    try:
        by_run = {folder: windows_of_run(folder) for folder in given.run}
    except ResultError as error:
        sys.exit(f"error: {error}")
    windows = [window for inside in by_run.values() for window in inside]
    for folder, inside in by_run.items():
        print(f"\n## {folder}")
        cases = cases_of(inside)
        print_shares(
            {folder.name: cases}
            | grouped(cases, lambda case: case.scene)
            | grouped(cases, lambda case: f"{case.width} over {case.coarser} px")
        )
        print_margins(cases)
        print_regrets(inside)
        try:
            other = windows_of_run(folder, "v2e")
        except ResultError:
            pass  # it has two poles alone
        else:
            print("\nThe photoreceptor v2e, one pole, at the lag of two")
            print_shares({f"{folder.name}, v2e": cases_of(other)})
            print_margins(cases_of(other))
        print_delays(folder, inside)
    if given.write:
        write_windows(Path(stored.__file__).with_name(stored.TABLE), windows)
        draw(ROOT / "docs" / "figures" / "lag_law.png", cases_of(windows))


if __name__ == "__main__":
    main()
