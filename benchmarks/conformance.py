"""Compare the sensor, or another simulator, with light whose events are known in closed form.

    python benchmarks/conformance.py                      print the table
    python benchmarks/conformance.py --write              also write docs/conformance.md
    python benchmarks/conformance.py --signals FILE.npz   write the signals and their exact events

The exact events come from the formulas in this file, solved with Brent's method on the continuous
light; they do not use the package. Pixels start at the first frame's light.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from sensor import SensorModel, simulate

TABLE = Path(__file__).parent.parent / "docs" / "conformance.md"
C = 0.2
EDGE_S = 1e-9  # how long a step takes

Voltage = Callable[[float], float]


@dataclass(frozen=True)
class Signal:
    """Light on a row of pixels, and the events that it must cause.

    Attributes
    ----------
    frames, t_s
        (T, 1, W) float64 linear radiance, and when.
    cutoff_hz, dark_level
        The sensor's; its threshold is `C`.
    events
        Exact (t seconds, column, polarity), by column, then time.
    """

    name: str
    source: str
    frames: np.ndarray
    t_s: np.ndarray
    cutoff_hz: float
    dark_level: float
    events: list[tuple[float, int, int]]


def crossings(voltage: Voltage, turns: list[float], start: float) -> list[tuple[float, int]]:
    """Return (t, polarity) at each level C from the last event's; `voltage` is monotone between
    turns."""
    memory, events = start, []
    for low, high in pairwise(turns):
        end = voltage(high)
        while abs(end - memory) >= C:
            sign = 1 if end > memory else -1
            memory += sign * C

            def off_level(t: float, level: float = memory) -> float:
                return voltage(t) - level

            # If rounding puts the start of a piece at or past the level, the crossing is there.
            at_start = off_level(low) * off_level(high) > 0
            events.append((low if at_start else brentq(off_level, low, high, xtol=1e-15), sign))
    return events


def one_column(events: list[tuple[float, int]]) -> list[tuple[float, int, int]]:
    return [(t, 0, p) for t, p in events]


def turns_of(slope: Voltage, end_s: float, step_s: float) -> list[float]:
    """Return 0, the times at which a voltage turns, and end_s; turns are more than a step apart."""
    grid = np.arange(0, end_s + step_s / 2, step_s).tolist()
    found = [brentq(slope, a, b, xtol=1e-15) for a, b in pairwise(grid) if slope(a) * slope(b) < 0]
    return [0.0, *found, end_s]


def log_ramp(cutoff_hz: float) -> Signal:
    """u = s t. Both poles start at rest: v2 = s t - 2 s/a + (2 s/a + s t) e^{-a t}."""
    s, end = 37.0, 0.1
    a = 2 * math.pi * cutoff_hz
    t_s = np.linspace(0, end, 12)

    def voltage(t: float) -> float:
        if math.isinf(a):
            return s * t
        return s * t - 2 * s / a + (2 * s / a + s * t) * math.exp(-a * t)

    return Signal(
        "log ramp, 37 a second",
        "linear in log intensity, 12 frames, 9.1 ms apart",
        np.exp(s * t_s)[:, None, None],
        t_s,
        cutoff_hz,
        0.0,
        one_column(crossings(voltage, [0.0, end], 0.0)),
    )


def step(cutoff_hz: float) -> Signal:
    """u = 1 from 1 ns on: v2 = 1 - (1 + a t) e^{-a t}."""
    a, end = 2 * math.pi * cutoff_hz, 0.1

    def voltage(t: float) -> float:
        return 1 - (1 + a * t) * math.exp(-a * t)

    t_s = np.concatenate(([0.0, EDGE_S], np.arange(1, 21) * 5e-3))
    return Signal(
        "unit step of log intensity",
        "frames 5 ms apart after the step",
        np.exp(np.minimum(t_s / EDGE_S, 1.0))[:, None, None],
        t_s,
        cutoff_hz,
        0.0,
        one_column(crossings(voltage, [0.0, end], 0.0)),
    )


def sweep(cutoff_hz: float, frame_s: float) -> Signal:
    """u = 1/2 sin(w t), one frequency per column, 5 to 400 Hz. With H = 1 / (1 + i w/a)^2 and poles
    at rest, v2 = Im(H e^{i w t}) / 2 - (k0 + k1 t) e^{-a t}, k0 and k1 from v2(0) = v2'(0) = 0."""
    height, end = 0.5, 0.0985  # no level is met exactly at the end
    frequencies = np.geomspace(5, 400, 24)
    t_s = np.arange(round(end / frame_s) + 1) * frame_s
    a = 2 * math.pi * cutoff_hz
    events = []
    for column, f in enumerate(frequencies.tolist()):
        w = 2 * math.pi * f
        H = 1 / (1 + 1j * w / a) ** 2
        k0 = height * H.imag
        k1 = 0.0 if math.isinf(a) else height * w * H.real + a * k0

        def voltage(
            t: float, w: float = w, H: complex = H, k0: float = k0, k1: float = k1
        ) -> float:
            lasting = height * (H.real * math.sin(w * t) + H.imag * math.cos(w * t))
            return lasting if math.isinf(a) else lasting - (k0 + k1 * t) * math.exp(-a * t)

        def slope(t: float, w: float = w, H: complex = H, k0: float = k0, k1: float = k1) -> float:
            lasting = height * w * (H.real * math.cos(w * t) - H.imag * math.sin(w * t))
            if math.isinf(a):
                return lasting
            return lasting - (k1 - a * (k0 + k1 * t)) * math.exp(-a * t)

        turns = turns_of(slope, end, 0.02 / max(f, 0.0 if math.isinf(a) else cutoff_hz))
        events += [(t, column, p) for t, p in crossings(voltage, turns, 0.0)]
    u = height * np.sin(2 * np.pi * frequencies * t_s[:, None])
    return Signal(
        "sines from 5 to 400 Hz",
        f"24 pixels, frames {frame_s * 1e3:g} ms apart",
        np.exp(u)[:, None, :],
        t_s,
        cutoff_hz,
        0.0,
        events,
    )


def moving_edge(frame_s: float) -> Signal:
    """An edge from radiance 1 to 8 passes 16 pixels, each in 10 ms: the light rises linearly, so a
    level k C is crossed (e^{k C} - 1) / 7 of the way."""
    ratio, pixels, each_s = 8.0, 16, 0.01
    t_s = np.arange(round(pixels * each_s / frame_s) + 1) * frame_s
    covered = np.clip(t_s[:, None] / each_s - np.arange(pixels), 0, 1)
    levels = np.arange(1, math.floor(math.log(ratio) / C) + 1) * C
    return Signal(
        "moving edge, contrast 8",
        f"16 pixels, 10 ms each, frames {frame_s * 1e3:g} ms apart",
        (1 + (ratio - 1) * covered)[:, None, :],
        t_s,
        math.inf,
        0.0,
        [
            (each_s * (column + (math.exp(level) - 1) / (ratio - 1)), column, 1)
            for column in range(pixels)
            for level in levels.tolist()
        ],
    )


def dark_step(dark_level: float) -> Signal:
    """Radiance 0 to 0.5 in a millisecond on a dark level d: log((0.5 + d) / d) / C events."""
    rise = math.log((0.5 + dark_level) / dark_level)
    return Signal(
        f"radiance 0 → 0.5 on a dark level of {dark_level:g}",
        "2 frames, 1 ms apart",
        np.array([0.0, 0.5])[:, None, None],
        np.array([0.0, 1e-3]),
        math.inf,
        dark_level,
        [(k * C / rise * 1e-3, 0, 1) for k in range(1, math.floor(rise / C) + 1)],
    )


def all_signals() -> list[Signal]:
    """Return every signal of the table."""
    return [
        *(log_ramp(cutoff) for cutoff in (math.inf, 200.0, 50.0)),
        *(step(cutoff) for cutoff in (200.0, 50.0)),
        *(sweep(cutoff, 5e-5) for cutoff in (math.inf, 200.0, 50.0)),
        sweep(200.0, 5e-4),
        *(moving_edge(frame_s) for frame_s in (1e-4, 1e-3)),
        *(dark_step(level) for level in (0.01, 0.001)),
    ]


@dataclass(frozen=True)
class Outcome:
    """A simulator's events, compared with the exact ones.

    Times are compared in the pixels that fired the right number of events with the right
    polarities; errors are in microseconds.
    """

    fired: int
    right_pixels: int
    pixels: int
    mean_error_us: float
    worst_error_us: float


def compare(signal: Signal, t_us: np.ndarray, x: np.ndarray, p: np.ndarray) -> Outcome:
    """Compare events, in order for each pixel, with the exact ones of a signal."""
    errors: list[float] = []
    right = 0
    width = signal.frames.shape[2]
    for column in range(width):
        exact = [(t, sign) for t, at, sign in signal.events if at == column]
        mine = x == column
        if p[mine].tolist() == [sign for _, sign in exact]:
            right += 1
            errors += (t_us[mine] - [t * 1e6 for t, _ in exact]).tolist()
    found = np.array(errors or [math.nan])
    return Outcome(len(t_us), right, width, float(found.mean()), float(np.abs(found).max()))


def run(signal: Signal) -> Outcome:
    """Simulate a signal and compare."""
    model = SensorModel(
        width=signal.frames.shape[2],
        height=1,
        contrast_threshold=C,
        cutoff_hz=signal.cutoff_hz,
        dark_level=signal.dark_level,
    )
    events = simulate(signal.frames, signal.t_s, model)
    return compare(signal, events.t_us, events.x, events.p)


def table(signals: list[Signal], outcomes: list[Outcome]) -> str:
    """Return the table in Markdown."""
    lines = [
        "| signal | frames | cutoff | events, exact | ours | pixels with the right events "
        "| mean time error | worst |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for signal, outcome in zip(signals, outcomes, strict=True):
        cutoff = "ideal" if math.isinf(signal.cutoff_hz) else f"{signal.cutoff_hz:g} Hz"
        lines.append(
            f"| {signal.name} | {signal.source} | {cutoff} | {len(signal.events)} "
            f"| {outcome.fired} | {outcome.right_pixels} of {outcome.pixels} "
            f"| {outcome.mean_error_us:+.2f} µs | {outcome.worst_error_us:.2f} µs |"
        )
    return "\n".join(lines)


PAGE = """# Conformance

Light whose events are known in closed form, and what `sensor.simulate` makes of it. C = {C:g}; each
pixel's memory and filter start at the first frame's log intensity. Times are whole microseconds, so
an error of up to 0.5 µs is rounding.

{table}

**How to read it.** A simulator sees frames, not light: `sensor` takes log intensity as a straight
line between two frames and is exact from there on. The ramp, the steps and the dark step are such
lines, so nothing but rounding may be left. The sines and the edge are not: their errors are those
of the straight line, and fall with the square of the frame interval, as the pairs of rows show.

**Another simulator.** This table is made by

    python benchmarks/conformance.py --write

and

    python benchmarks/conformance.py --signals conformance.npz

writes the signals with their exact events. For the k-th signal: `name_k`, `frames_k` (T, 1, W)
float64 linear radiance, `t_s_k` (T,), `cutoff_hz_k` (of each of two equal poles; inf for none),
`dark_level_k` (added to the radiance before the logarithm), and `event_t_s_k`, `event_x_k`,
`event_p_k`, the exact events by column, then time. `contrast_threshold` is the same for all.
"""


def write_signals(path: Path, signals: list[Signal]) -> None:
    """Write signals and their exact events as .npz; docs/conformance.md lists the contents."""
    arrays: dict[str, np.ndarray] = {"contrast_threshold": np.array(C)}
    for k, signal in enumerate(signals):
        t, x, p = np.array(signal.events).T
        arrays |= {
            f"name_{k}": np.array(f"{signal.name}, {signal.source}"),
            f"frames_{k}": signal.frames,
            f"t_s_{k}": signal.t_s,
            f"cutoff_hz_{k}": np.array(signal.cutoff_hz),
            f"dark_level_{k}": np.array(signal.dark_level),
            f"event_t_s_{k}": t,
            f"event_x_{k}": x.astype(np.uint16),
            f"event_p_{k}": p.astype(np.int8),
        }
    np.savez_compressed(path, allow_pickle=False, **arrays)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--write", action="store_true", help=f"write {TABLE.name} too")
    parser.add_argument("--signals", type=Path, help="write the signals to this .npz file")
    args = parser.parse_args()
    signals = all_signals()
    text = table(signals, [run(signal) for signal in signals])
    print(text)
    if args.write:
        TABLE.write_text(PAGE.format(C=C, table=text))
    if args.signals:
        write_signals(args.signals, signals)


if __name__ == "__main__":
    main()
