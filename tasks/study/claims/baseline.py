"""Our own claim: every method beats doing nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tasks.study.claims.claim import Claim, Evidence, too_few_text
from tasks.study.results.intervals import MIN_SAMPLES_FOR_INTERVAL, estimate
from tasks.study.results.metrics import METRICS, Series
from tasks.study.results.perturbation import shown_series
from tasks.study.results.scaling import Scaling
from tasks.study.results.scores import Condition, Scores, beats
from tasks.study.results.words import cutoff_label, join_words


@dataclass(frozen=True, kw_only=True)
class BaselineClaim(Claim):
    """In every cell of every method the median is better than without using the events."""

    def evidence(self, scores: Scores, scaling: Mapping[str, Scaling]) -> Evidence:
        """Count the cells of each method that are better."""
        counts = [_Count(scores, series) for series in shown_series(scores)]
        samples = min((count.samples for count in counts), default=0)
        return Evidence(
            outcomes=[outcome for count in counts for outcome in count.outcomes.values()],
            ours="\n".join(str(count) for count in counts) or "no rows of any method",
            paper="not reported",
            scope=f"{too_few_text(samples)}."
            if samples < MIN_SAMPLES_FOR_INTERVAL
            else "Not settled: the paired interval of the difference reaches zero.",
        )


BEATS_DOING_NOTHING = BaselineClaim(
    number=24,
    title="Every method beats doing nothing",
    statement="Under every condition the median score is better than that of the image, flow or "
    "path that the method starts from.",
    note="Our own check: a score that does not beat its starting point says nothing about the "
    "resolution.",
)


class _Count:
    """How often one series beats doing nothing, and where it does not."""

    def __init__(self, scores: Scores, series: Series) -> None:
        self.series = series
        self.outcomes: dict[Condition, bool | None] = {}
        self.unsettled = 0
        self.samples = min(scores.samples(series, scene) for scene in scores.scenes(series))
        sign = METRICS[series.metric].sign
        for where in scores.conditions(series):
            cells = {"ours": scores.cell(series, where), "nothing": scores.baseline(series, where)}
            self.outcomes[where] = beats(cells["ours"], cells["nothing"], series)
            if self.outcomes[where] is None or cells["ours"].samples < MIN_SAMPLES_FOR_INTERVAL:
                continue
            gain = estimate(cells, lambda m: np.asarray(sign * (m["ours"] - m["nothing"])))
            self.unsettled += gain.includes(0.0)

    def __str__(self) -> str:
        measured = [where for where, outcome in self.outcomes.items() if outcome is not None]
        lost = [where for where in measured if not self.outcomes[where]]
        text = f"{self.series.title}: {len(measured) - len(lost)} of {len(measured)}"
        if self.unsettled:
            text += f" ({self.unsettled} not settled)"
        if unknown := len(self.outcomes) - len(measured):
            text += f", {unknown} not measured"
        return f"{text}; not {'; '.join(self._groups(lost))}" if lost else text

    def _groups(self, lost: list[Condition]) -> list[str]:
        """A text for each scene and cutoff, with widths and speeds unless it is all of them."""
        parts = []
        for scene, cutoff_hz in dict.fromkeys((c.scene, c.cutoff_hz) for c in lost):
            here = {c for c in self.outcomes if (c.scene, c.cutoff_hz) == (scene, cutoff_hz)}
            widths = sorted({c.width for c in here})
            at_speeds: dict[str, list[str]] = {}
            for speed in sorted({c.speed for c in here}):
                found = [w for w in widths if Condition(scene, w, cutoff_hz, speed) in lost]
                if found:
                    some = f"{join_words([str(width) for width in found])} px"
                    name = "all widths" if found == widths else some
                    at_speeds.setdefault(name, []).append(f"{speed:.2g}")
            which = "; ".join(
                f"{name} at speed {join_words(speeds)}" for name, speeds in at_speeds.items()
            )
            light = f"{scene} {cutoff_label(cutoff_hz)}"
            parts.append(light if here <= set(lost) else f"{light} ({which})")
        return parts
