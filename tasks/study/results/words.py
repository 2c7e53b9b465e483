"""How conditions and numbers are written, in the terminal and in the report."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tasks.study.results.paper import BASE_SPEED_M_PER_S

MISSING = "–"


def cutoff_label(cutoff_hz: float) -> str:
    """Name a cutoff as the paper does: ideal, day, night; any other by its frequency."""
    return {math.inf: "ideal", 200.0: "day", 50.0: "night"}.get(cutoff_hz, f"{cutoff_hz:g} Hz")


def cutoff_detail(cutoff_hz: float) -> str:
    """Frequency of a cutoff in words."""
    return "no cutoff" if math.isinf(cutoff_hz) else f"cutoff {cutoff_hz:g} Hz"


def speed_label(scene: str, speed: float) -> str:
    """Speed factor to two digits (the paper's 1.3), with m/s where the paper states them."""
    base = BASE_SPEED_M_PER_S.get(scene)
    metres = "" if base is None else f" ({base * speed:.1f} m/s)"
    return f"speed {speed:.2g}{metres}"


def rate_label(event_rate_hz: float | None) -> str:
    """Event rate in Mev/s to about three digits."""
    if event_rate_hz is None or not math.isfinite(event_rate_hz):
        return MISSING
    mega = event_rate_hz / 1e6
    return f"{mega:.{0 if mega >= 100 else 1 if mega >= 10 else 2}f}"


def number_text(value: float, decimals: int, sign: str = "") -> str:
    """Format with a true minus sign, and none on a zero; `sign` "+" asks for a plus as well."""
    return f"{value:{sign}z.{decimals}f}".replace("-", "−")


def share_text(share: float | None) -> str:
    """A share in percent; what is neither none nor all is never printed as such."""
    if share is None:
        return MISSING
    percent = round(100 * share)
    if 0 < share < 1:
        percent = min(max(percent, 1), 99)
    return f"{percent}\u202f%"


def join_words(words: Sequence[str], last: str = "and") -> str:
    """Join as in "carpet, rocks and room"."""
    return f" {last} ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def capitalized(text: str) -> str:
    """A text with its first letter as at the start of a sentence."""
    return text[:1].upper() + text[1:]
