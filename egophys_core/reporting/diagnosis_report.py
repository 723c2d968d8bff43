"""The report of a diagnosis: one HTML file that works anywhere, the plain sentence first and the evidence after it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

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
from egophys_core.reporting.html_page import Markup, element, page, picture, table
from egophys_core.reporting.marks import AFTER, BEFORE, interval
from egophys_core.reporting.why_section import why_this_outcome

TAGS = {
    "none": ("no effect", "#1b7f4b"),
    "named": ("effect found", AFTER),
    "ambiguous": ("cannot tell yet", "#b36b00"),
    "named_and_unexplained": ("effect found, and a rest", AFTER),
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
        mismatch_gain: held-out gain that the twin's own mismatch reaches without any effect.
    """
    return page(
        f"Diagnosis of twin {content['twin_id']}",
        *_beginning(content, texts),
        *_effects(content["effects"], content["outcome"], texts),
        *why_this_outcome(content),
        *_errors(content["error"], times, before, after),
        *evidence_for_each(content, mismatch_gain),
        *where_it_lives(content["where"], rest, field),
        element("h2", "About this report"),
        element(
            "p",
            f"Twin {content['twin_id']} was diagnosed; the improved twin is {content['improved_twin_id']} and names "
            f"the first as its parent. The diagnosis took {figures(content['seconds'])} s. All numbers are in "
            "diagnosis.json, beside this file.",
            class_="quiet",
        ),
    )


def _beginning(content: Mapping[str, Any], texts: Mapping[str, EffectText]) -> list[Markup]:
    label, colour = TAGS[content["outcome"]]
    errors, fitted = track_errors(content["error"]), sum(bool(each["fitted"]) for each in content["error"])
    judged = "not fitted" if errors.held_out else "fitted"
    cards = [
        (
            f"{millimetres(errors.before)} \N{RIGHTWARDS ARROW} {millimetres(errors.after)} mm",
            f"track error before and after, episodes {judged}",
        ),
        (change(errors.before, errors.after), "change of that error"),
        (f"{millimetres(content['where']['size_m'])} mm", "typical residual before any effect"),
        (f"{fitted} + {len(content['error']) - fitted}", "episodes fitted + only reported on"),
    ]
    parts = [
        element("span", label, class_="tag", style=f"background: {colour}"),
        element("h1", headline(content, texts)),
        element("p", f"Why: {content['reason'].rstrip('.')}."),
    ]
    if content["experiment"]:
        parts.append(
            element("div", element("b", "What to do next: "), content["experiment"], class_="next"),
        )
    numbers = [
        element("div", element("b", number), element("span", what, class_="quiet"), class_="card")
        for number, what in cards
    ]
    return [*parts, element("div", *numbers, class_="cards")]


def _effects(effects: Sequence[Mapping[str, Any]], outcome: str, texts: Mapping[str, EffectText]) -> list[Markup]:
    if not effects:
        return []
    parts = [element("h2", "What it may be, one of these" if outcome == "ambiguous" else "What the twin lacks")]
    for effect in effects:
        text = texts.get(effect["name"], EffectText(summary="", equation="", nulls={}))
        parts += [
            element("h3", effect["name"]),
            element(
                "p",
                f"{text.summary[:1].upper()}{text.summary[1:]}. " if text.summary else "",
                element("code", text.equation),
            ),
            table(
                ("parameter", "value", "unit", "95 % interval", "interval; upright stroke: no effect"),
                [_parameter(name, each, text.nulls.get(name)) for name, each in effect["parameters"].items()],
                kinds=("", "", "text", "", "wide"),
            ),
            element(
                "p",
                "Each episode alone asks for the same parameters, within their intervals."
                if effect["episodes_agree"]
                else "The episodes, each taken alone, were not shown to ask for the same parameters: "
                "take the numbers with care.",
                class_="quiet",
            ),
        ]
    return parts


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
) -> list[Markup]:
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
        picture(
            draw_errors(times[name], before[name], after[name], highest=highest),
            caption=f"{name}, {fitted.get(name, 'not fitted')}",
            says=f"Track error over time in {name}, before and after",
        )
        for name in times
    ]
    return [
        element("h2", "Error before and after"),
        element(
            "p",
            "Mean over each episode in mm, the whole motion predicted from its start. Before: the same twin refitted "
            "with the same effort without the effect, so the difference is the effect's alone. Last residual held: "
            "before, with the error of the last train frame taken off all that follows; a good effect beats that too.",
            class_="quiet",
        ),
        table(header, rows, kinds=("", "text", "", "", "", "", "", "", "")),
        element("div", *pictures, class_="pictures"),
    ]


def _pair(before: float | None, after: float | None) -> list[object]:
    shown = change(before, after)
    if shown in (NO_CHANGE, UNKNOWN):
        return [millimetres(before), millimetres(after), shown]
    colour = AFTER if shown.startswith("-") else BEFORE
    return [millimetres(before), millimetres(after), element("span", shown, style=f"color: {colour}")]
