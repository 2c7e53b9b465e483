"""The paper's claims about events at different resolutions, Sec. 3 and Fig. 2."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np

from tasks.study.claims.verdict import EVENT_INTEGRATION, Medians, Verdict, judge_scenes
from tasks.study.results.intervals import estimate
from tasks.study.results.paper import CUTOFFS_HZ, WIDTHS
from tasks.study.results.scaling import FIT_PX, Scaling
from tasks.study.results.scores import Cell, Condition, Scores
from tasks.study.results.words import cutoff_label, number_text

_IDEAL = CUTOFFS_HZ[0]
_NO_SCALING = "not measured, the run has no scaling statistics of this scene"


def pixels_of_finer_sensors_fire_more(scores: Scores, scaling: Mapping[str, Scaling]) -> Verdict:
    """Claim 1: the event rate of a pixel rises with resolution (Fig. 2 b, Eq. 5)."""
    log_width = np.log(WIDTHS)
    line = (log_width - log_width.mean()) / np.sum((log_width - log_width.mean()) ** 2)

    def check(scene: str, cells: Mapping[Condition, Cell]) -> tuple[bool | None, str]:
        if scene not in scaling:
            return None, _NO_SCALING
        if not all(np.all(cell.event_rates_hz > 0) for cell in cells.values()):
            return None, "not measured, a sample has no events"

        def per_pixel(rates: Medians) -> np.ndarray:
            return np.array([r / where.width**2 for where, r in rates.items()])

        grows = estimate(
            cells,
            lambda rates: np.tensordot(line, np.log(per_pixel(rates)), axes=1),
            of_rates=True,
        )
        medians = {where: np.array(cell.event_rate_hz) for where, cell in cells.items()}
        each = per_pixel(medians)
        laws = scaling[scene].everywhere.law, scaling[scene].edges.law
        gammas = [
            f"{number_text(law.exponent, 2)} [{number_text(law.low, 2)}, "
            f"{number_text(law.high, 2)}]"
            for law in laws
        ]
        text = (
            f"{' → '.join(f'{rate:,.{int(rate < 100)}f}' for rate in each)} events/s a pixel, γ = "
            f"{grows.text(sign='')}; |L_t|: γ = {gammas[0]} everywhere, {gammas[1]} at edges"
        )
        return bool(np.all(np.diff(each) > 0)) and all(law.low > 0 for law in laws), text

    return judge_scenes(
        scores,
        EVENT_INTEGRATION,
        [(width, _IDEAL, 1.0) for width in WIDTHS],
        check,
        number=1,
        title="The pixels of finer sensors fire more",
        statement="In ideal light the event rate of a single pixel rises from each width to the "
        "next, as |L_t|, the slope of log brightness, does by a power law of the pixel size, "
        "|L_t| ~ 1/p^γ with γ > 0.",
        paper="a power law for small p, no exponent printed",
        note=f"|L_t| between the last two frames of one clip, for p up to {FIT_PX:g} px of the "
        "render; its interval is a bootstrap over blocks of the image. Edges are the 5 % of pixels "
        "that are steepest at the finest size, so chosen that they fall more steeply than the "
        "mean. The paper's equations have γ positive, its caption negative.",
    )


def intervals_shorten_with_resolution(scores: Scores, scaling: Mapping[str, Scaling]) -> Verdict:
    """Claim 2: times between events shift to shorter with resolution (Fig. 2 c, Eq. 7)."""

    def check(scene: str, cells: Mapping[Condition, Cell]) -> tuple[bool | None, str]:
        if scene not in scaling:
            return None, _NO_SCALING
        one = scaling[scene]
        modes = {
            setting: [one.mode_us(width, *setting) for width in WIDTHS]
            for setting in one.settings()
        }
        cutoffs, speeds = {cutoff for cutoff, _ in modes}, {speed for _, speed in modes}
        if (_IDEAL, 1.0) not in modes or len(cutoffs) < 2 or len(speeds) < 2:
            return None, "not measured at ideal light, a lower cutoff and a higher speed"
        texts, holds = [], True
        for (cutoff_hz, speed), found in modes.items():
            known = [mode for mode in found if mode is not None]
            name = f"{cutoff_label(cutoff_hz)}, speed {speed:.2g}"
            if len(known) < len(found):
                missing = ", ".join(
                    str(w) for w, mode in zip(WIDTHS, found, strict=True) if mode is None
                )
                return None, f"not measured at {missing} px, {name}"
            shortens = known[-1] < known[0] and all(b <= a for a, b in pairwise(known))
            holds &= shortens
            line = " → ".join(f"{mode * 1e-3:.2g}" for mode in known)
            texts.append(f"{name}: {line} ms{'' if shortens else ' (not monotone)'}")
        return holds, "\n".join(["", *texts])

    return judge_scenes(
        scores,
        EVENT_INTEGRATION,
        [],
        check,
        number=2,
        title="Events follow each other faster on finer sensors",
        statement="The commonest time between consecutive events of a pixel falls with resolution, "
        "and never rises from one width to the next: in ideal light, at lower cutoffs and at "
        "higher speed.",
        paper="the mode shifts to shorter times, no number printed",
        note="The mode is the fullest of 10 bins a decade, so steps below 26 % do not show; where "
        "two humps are about as high it jumps from one to the other. One clip a scene, so without "
        "an interval.",
        of_samples=False,
    )


SCALING_CLAIMS: tuple[Callable[[Scores, Mapping[str, Scaling]], Verdict], ...] = (
    pixels_of_finer_sensors_fire_more,
    intervals_shorten_with_resolution,
)
