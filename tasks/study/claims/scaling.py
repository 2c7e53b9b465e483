"""The paper's claims about events at different resolutions, Sec. 3 and Fig. 2."""

from __future__ import annotations

from itertools import pairwise

from tasks.study.claims.claim import Claim, SceneClaim
from tasks.study.claims.numbers import NotMeasured, Number, NumberText, SceneScores, estimated
from tasks.study.claims.reconstruction import EVENT_INTEGRATION
from tasks.study.claims.statistics import IDEAL, log2, pixel_rate, slope, smallest_fall
from tasks.study.claims.verdict import Status, settled
from tasks.study.results.asked import SensorId
from tasks.study.results.intervals import Interval
from tasks.study.results.paper import WIDTHS
from tasks.study.results.scaling import FIT_PX, Scaling, Slopes
from tasks.study.results.words import cutoff_label

_PIXEL_RATES = [pixel_rate(width, IDEAL) for width in WIDTHS]


def _scaling(on: SceneScores) -> Scaling:
    if on.scaling is None:
        raise NotMeasured("not measured, the run has no scaling statistics of this scene")
    return on.scaling


def _exponent(slopes: Slopes) -> NumberText:
    """Read the exponent γ of |L_t| ~ 1/p^γ, which must be positive."""
    if slopes.law is None:
        raise NotMeasured("not measured, nothing moves between the clip's last two frames")
    exponent = Interval(slopes.law.exponent, slopes.law.low, slopes.law.high)
    return NumberText(exponent.text(sign=""), settled(exponent, above=True, bound=0.0))


def _pixel_rates(on: SceneScores) -> NumberText:
    """Read the event rate of a pixel at each width in ideal light, 1/s."""
    rates = [estimated(rate, on).value for rate in _PIXEL_RATES]
    return NumberText(" → ".join(f"{rate:,.{int(rate < 100)}f}" for rate in rates))


def _modes(on: SceneScores) -> NumberText:
    """Read the most common interval at each width for each light and speed; none may rise."""
    scaling = _scaling(on)
    settings = scaling.settings()
    cutoffs, speeds = ({of[k] for of in settings} for k in (0, 1))
    if (IDEAL, 1.0) not in settings or len(cutoffs) < 2 or len(speeds) < 2:
        raise NotMeasured("not measured, needs ideal light, a lower cutoff and a higher speed")
    lines, holds = [], True
    for cutoff_hz, speed in settings:
        name = f"{cutoff_label(cutoff_hz)}, speed {speed:.2g}"
        modes = {width: scaling.mode_us(SensorId(width), cutoff_hz, speed) for width in WIDTHS}
        if missing := [str(width) for width, mode in modes.items() if mode is None]:
            raise NotMeasured(f"not measured at {', '.join(missing)} px, {name}")
        known = [mode for mode in modes.values() if mode is not None]
        shortens = known[-1] < known[0] and all(b <= a for a, b in pairwise(known))
        holds &= shortens
        line = " → ".join(f"{mode * 1e-3:.2g}" for mode in known)
        lines.append(f"{name}: {line} ms{'' if shortens else ' (not monotone)'}")
    return NumberText("\n".join(lines), Status.HOLDS if holds else Status.DOES_NOT_HOLD)


SCALING_CLAIMS: tuple[Claim, ...] = (
    SceneClaim(
        number=1,
        why="Smaller pixels average less texture.",
        title="The pixels of finer sensors fire more",
        statement="In ideal light the event rate of a pixel rises from each width to the next. The "
        "slope of log brightness in time follows a power law of the pixel size p: |L_t| ~ 1/p^γ "
        "with γ > 0.",
        series=EVENT_INTEGRATION,
        numbers={
            "everywhere": lambda on: _exponent(_scaling(on).everywhere),
            "edges": lambda on: _exponent(_scaling(on).edges),
            "exponent": Number(slope([log2(rate) for rate in _PIXEL_RATES]), unit="", sign=""),
            "rise": Number(smallest_fall(*reversed(_PIXEL_RATES)), above=0),
            "rates": _pixel_rates,
        },
        text="{rates} events/s per pixel, γ = {exponent}; |L_t|: γ = {everywhere} everywhere, "
        "{edges} at edges",
        paper="a power law for small p, no exponent",
        note="|L_t| is taken between the last two frames of one clip, for p up to "
        f"{FIT_PX:g} px of the render; its interval is a bootstrap over blocks of the image. "
        "Edges are the 5 % of pixels that are steepest at the finest size, so their γ is larger "
        "than that of the mean. γ is positive in the paper's equations and negative in its "
        "caption.",
    ),
    SceneClaim(
        number=2,
        why="Larger changes cross more thresholds.",
        title="Events follow each other faster on finer sensors",
        statement="The most common time between consecutive events of a pixel falls with "
        "resolution and never rises from one width to the next, in ideal light, at lower cutoffs "
        "and at higher speed.",
        series=EVENT_INTEGRATION,
        numbers={"modes": _modes},
        text="at 128 → 240 → 346 → 640 → 1280 px\n{modes}",
        paper="the mode shifts to shorter times, no numbers",
        note="The mode is the fullest of 10 bins per decade, so changes below 26 % do not show. "
        "If two peaks are about equally high, the mode may jump between them. There is one clip "
        "per scene, so there is no interval.",
    ),
)
