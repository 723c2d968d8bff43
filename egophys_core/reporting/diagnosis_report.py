"""The report of a diagnosis: one HTML file that works anywhere, the plain sentence first and the evidence after it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from egophys_core.reporting.diagnosis_words import (
    NO_CHANGE,
    UNKNOWN,
    EffectText,
    change,
    figures,
    finite,
    headline,
    millimetres,
    track_errors,
)
from egophys_core.reporting.error_figure import draw_errors
from egophys_core.reporting.evidence_sections import evidence_for_each, where_it_lives
from egophys_core.reporting.html_page import Picture, Table, coloured, render
from egophys_core.reporting.limits_section import limits_table
from egophys_core.reporting.marks import AFTER, BEFORE, interval
from egophys_core.reporting.why_section import why_this_outcome

TAGS = {
    "none": ("no effect", "#1b7f4b"),
    "named": ("effect found", AFTER),
    "ambiguous": ("cannot tell yet", "#b36b00"),
    "named_and_unexplained": ("effect found, and a rest", AFTER),
    "named_and_ambiguous": ("effect found, and one of several", AFTER),
    "unexplained": ("unexplained", "#a4262c"),
}
"""Outcome -> label and its colour."""


def diagnosis_html(
    content: Mapping[str, Any],
    *,
    times: Mapping[str, np.ndarray],
    before: Mapping[str, np.ndarray],
    after: Mapping[str, np.ndarray],
    rest: np.ndarray,
    field: np.ndarray,
    texts: Mapping[str, EffectText],
    mismatch_gain: float,
) -> str:
    """Write the report; every text in it is escaped.

    Args:
        content: of `diagnosis.json`, with null or NaN where there is no number.
        times: per episode [T] seconds.
        before: per episode [T] metres, track error without the effect.
        after: per episode [T] metres, with it.
        rest: [P, 3] metres, tracks of the first episode at rest.
        field: [P, 3] metres, their mean residual before any effect.
        texts: what the effects are, by name.
        mismatch_gain: held-out gain that is reached in few sets that lack nothing.
    """
    label, colour = TAGS[content["outcome"]]
    return render(
        "diagnosis.html.jinja",
        content=content,
        label=label,
        colour=colour,
        headline=headline(content, texts),
        cards=_cards(content),
        effects=[_effect(each, texts) for each in content["effects"]],
        errors=_errors(content["error"], times, before, after),
        why=why_this_outcome(content),
        evidence=evidence_for_each(content, mismatch_gain),
        limits=limits_table(content["limits"]),
        where=where_it_lives(content["where"], rest, field),
        seconds=figures(content["seconds"]),
    )


def _cards(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The numbers that stand out, and what each is."""
    errors, fitted = track_errors(content["error"]), sum(bool(each["fitted"]) for each in content["error"])
    judged = "not fitted" if errors.held_out else "fitted"
    return [
        (
            f"{millimetres(errors.before)} \N{RIGHTWARDS ARROW} {millimetres(errors.after)} mm",
            f"track error before and after, episodes {judged}",
        ),
        (change(errors.before, errors.after), "change of that error"),
        (f"{millimetres(content['where']['size_m'])} mm", "typical residual before any effect"),
        (f"{fitted} + {len(content['error']) - fitted}", "episodes fitted + only reported on"),
    ]


def _effect(effect: Mapping[str, Any], texts: Mapping[str, EffectText]) -> dict[str, Any]:
    text = texts.get(effect["name"], EffectText(summary="", equation="", nulls={}))
    return {
        "name": effect["name"],
        "summary": f"{text.summary[:1].upper()}{text.summary[1:]}." if text.summary else "",
        "equation": text.equation,
        "episodes_agree": effect["episodes_agree"],
        "parameters": Table(
            header=("parameter", "value", "unit", "95 % interval", "interval; upright stroke: no effect"),
            rows=[_parameter(name, each, text.nulls.get(name)) for name, each in effect["parameters"].items()],
            kinds=("", "", "text", "", "wide"),
        ),
    }


def _parameter(name: str, estimate: Mapping[str, Any], null: float | None) -> list[object]:
    low, high = estimate["ci95"]
    known = all(finite(each) for each in (low, estimate["value"], high))
    return [
        name,
        figures(estimate["value"]),
        estimate["unit"],
        f"{figures(low)} to {figures(high)}" if known else UNKNOWN,
        Markup(interval(low, estimate["value"], high, null=null)) if known else "",
    ]


def _errors(
    errors: Sequence[Mapping[str, Any]],
    times: Mapping[str, np.ndarray],
    before: Mapping[str, np.ndarray],
    after: Mapping[str, np.ndarray],
) -> dict[str, Any]:
    series = [each[np.isfinite(each)] for each in (*before.values(), *after.values())]
    highest = 1.15 * max((float(each.max()) for each in series if len(each)), default=0.0) or 0.001
    fitted = {each["episode"]: "fitted" if each["fitted"] else "not fitted" for each in errors}
    rows = [
        [
            each["episode"],
            fitted[each["episode"]],
            *_pair(each["track_before_m"], each["track_after_m"]),
            millimetres(each["last_residual_track_m"]),
            *_pair(each["chamfer_before_m"], each["chamfer_after_m"]),
        ]
        for each in errors
    ]
    header = (
        "episode",
        "",
        "track before",
        "after",
        "change",
        "last residual held",
        "Chamfer before",
        "after",
        "change",
    )
    pictures = [
        Picture(
            png=draw_errors(times[name], before[name], after[name], highest=highest),
            caption=f"{name}, {fitted.get(name, 'not fitted')}",
            says=f"Track error over time in {name}, before and after",
        )
        for name in times
    ]
    return {
        "table": Table(header=header, rows=rows, kinds=("", "text", *[""] * (len(header) - 2))),
        "pictures": pictures,
    }


def _pair(before: float | None, after: float | None) -> list[object]:
    shown = change(before, after)
    if shown in (NO_CHANGE, UNKNOWN):
        return [millimetres(before), millimetres(after), shown]
    colour = AFTER if shown.startswith("-") else BEFORE
    return [millimetres(before), millimetres(after), coloured(shown, colour)]
