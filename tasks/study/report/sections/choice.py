"""Which resolution to choose: the report's headline and its tables of choices."""

from __future__ import annotations

import re
from collections.abc import Iterable
from html import escape

from tasks.study.report.markup import scrolling
from tasks.study.results.answer import headline, times_text
from tasks.study.results.bandwidth import capacities_hz
from tasks.study.results.choice import Choice, Choices
from tasks.study.results.intervals import MIN_SAMPLES_FOR_INTERVAL
from tasks.study.results.metrics import METRICS, Series
from tasks.study.results.words import (
    MISSING,
    cutoff_detail,
    cutoff_label,
    join_words,
    rate_label,
    share_text,
    speed_label,
)


def answer_html(choices: Choices, series: Series, *, named: bool = False) -> str:
    """Render the answer in words; `named` puts the series before it, for a page that answers for
    several."""
    answer = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", escape(headline(choices, series)))
    for unit in ("px", METRICS[series.metric].unit):
        answer = answer.replace(f" {unit}", f"&nbsp;{unit}")
    if not named:
        return f'<p class="answer">{answer}</p>'
    title = escape(series.title[0].upper() + series.title[1:])
    return f'<p class="answer several"><span class="task">{title}</span> {answer}</p>'


def choice_tables_html(choices: Choices, series: Series) -> str:
    """Render a table of choices for each scene: speeds down, cutoffs across."""
    metric = METRICS[series.metric]
    parts = [
        f'<p class="lead">In each place: the smallest width '
        f"whose median is within {metric.negligible:g} {metric.unit} of the best, and what it "
        "saves against the best. “Tied” is the smallest width that these samples do not tell apart "
        f"from the best (paired 95&#8239;% interval; needs {MIN_SAMPLES_FOR_INTERVAL} samples). "
        "“Paper” is the first rule on the medians that it prints. "
        "Struck out: even the best does not beat doing nothing by more than that. On a bus it is "
        "the same choice among the widths whose own mean event rate, of the square sensor, the bus "
        "carries, and how much of it that takes: for the slowest bus of a real camera, and for "
        "each faster one on which another width is enough. These buses carry "
        f"{_listed(capacities_hz())} Mev/s.</p>"
    ]
    cutoffs = list(dict.fromkeys(cutoff for _, cutoff, _ in choices))
    heads = "".join(
        f'<th scope="col">{escape(cutoff_label(c))} <small>{escape(cutoff_detail(c))}</small></th>'
        for c in cutoffs
    )
    for scene in dict.fromkeys(scene for scene, _, _ in choices):
        body = "".join(
            f'<tr><th scope="row">{escape(speed_label(scene, speed))}</th>'
            + "".join(choice_cell(choices[scene, cutoff, speed], series) for cutoff in cutoffs)
            + "</tr>"
            for speed in dict.fromkeys(speed for where, _, speed in choices if where == scene)
        )
        table = (
            f'<table class="choice"><caption><span>{escape(scene)}</span></caption>'
            f'<thead><tr><th scope="col"></th>{heads}</tr></thead><tbody>{body}</tbody></table>'
        )
        parts.append(scrolling(f"Choice, {scene}", table))
    return "".join(parts)


def choice_cell(choice: Choice | None, series: Series) -> str:
    """Render one place of a table of choices."""
    if choice is None:
        return f"<td>{MISSING}<br><small>not all samples measured</small></td>"
    metric = METRICS[series.metric]
    score = metric.text(choice.scores[choice.enough])
    facts = [f"{score} {metric.unit} at {rate_label(choice.event_rates_hz[choice.enough])} Mev/s"]
    if choice.enough == choice.best:
        facts.append("the best")
    else:
        saving = choice.saving(choice.best)
        fewer = "" if saving is None else f", {times_text(saving)} times the events"
        loss = f"{metric.text(choice.loss)} {metric.unit}"
        facts.append(f"best {choice.best} px: {loss} better{fewer}")
    if choice.tied is not None and choice.tied != choice.enough:
        facts.append(f"tied: {choice.tied} px")
    if choice.paper is not None:
        facts.append(f"paper: {choice.paper} px")
    facts += _bus_texts(choice)
    if choice.nothing is not None and not choice.worthwhile:
        facts.append(f"doing nothing: {metric.text(choice.nothing)} {metric.unit}")
    kind = "" if choice.worthwhile else ' class="worthless"'
    small = "".join(f"<small>{escape(fact)}</small><br>" for fact in facts)
    return f"<td{kind}><b>{choice.enough} px</b>{small}</td>"


def _bus_texts(choice: Choice) -> list[str]:
    """What is enough on which bus, as in "1 Mev/s bus: none", "12 Mev/s bus: 240 px at 22 %"."""
    if all(bus.enough is None for bus in choice.on_buses):
        return ["on any bus: none"]
    texts = []
    for bus in choice.on_buses:
        answer = "none"
        if bus.enough is not None:
            share = choice.event_rates_hz[bus.enough] / bus.capacity_hz
            answer = f"{bus.enough} px at {share_text(share)}"
        texts.append(f"{bus.capacity_hz / 1e6:g} Mev/s bus: {answer}")
    return texts


def _listed(capacities: Iterable[float]) -> str:
    return join_words([f"{capacity / 1e6:g}" for capacity in capacities])
